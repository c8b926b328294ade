import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.benchmarks.cache import ResultCache
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class Part:
    name: str
    errors: npt.NDArray[np.float64]
    seconds: float = math.nan


@dataclass(frozen=True)
class Whole:
    parts: tuple[Part, ...]
    low: float | None = None


def whole() -> Whole:
    return Whole((Part("a", np.array([0.1, 1 / 3]), 2.0), Part("b", np.empty(0))))


def test_a_result_is_run_once_and_other_settings_run_again(tmp_path):
    cache = ResultCache(tmp_path / "cells", Whole, "test/1")
    calls = []

    def run():
        calls.append(1)
        return whole()

    first = cache.get_or_run("M4", {"system": "a", "rounds": 2}, run)
    again = cache.get_or_run("M4", {"rounds": 2, "system": "a"}, run)
    assert len(calls) == 1
    for found in (first, again):
        assert [part.errors.tolist() for part in found.parts] == [[0.1, 1 / 3], []]
        assert (found.parts[0].seconds, found.low) == (2.0, None)
        assert math.isnan(found.parts[1].seconds)
    cache.get_or_run("M4", {"system": "b", "rounds": 2}, run)
    ResultCache(tmp_path / "cells", Whole, "test/2").get_or_run("M4", {"system": "a", "rounds": 2}, run)
    assert len(calls) == 3
    assert len(list((tmp_path / "cells").iterdir())) == 3


def test_a_full_disk_leaves_no_file(tmp_path, full_disk):
    with pytest.raises(OSError, match="No space"):
        ResultCache(tmp_path, Whole, "test/1").get_or_run("x", {}, whole)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"condition": "x"}', '{"result": {"parts": [1]}}', '{"result": {"parts": null}}']
)
def test_a_damaged_file_is_named(tmp_path, content):
    cache = ResultCache(tmp_path, Whole, "test/1")
    path = cache.path("x", {})
    path.write_text(content)
    with pytest.raises(InputError, match=rf"{path.name}: damaged .* delete it and run the same command again"):
        cache.get_or_run("x", {}, whole)
