"""The rule of direct levels: what is flat or diffuse is no source, what has a peak is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.errors import InputError
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior

RULE = DirectLevelRule()


def posterior(weights_kd: np.ndarray, diffuse_k: list[float] | None = None) -> ClipPosterior:
    k = len(weights_kd)
    shares_kc = None if diffuse_k is None else np.array(diffuse_k)[:, None]
    return ClipPosterior(weights_kd, np.full(k, 1 / k), np.full(k, 0.01), np.full(k, 0.02), diffuse_shares_kc=shares_kc)


def lobe(centre: float, d: int, width: float = 1.0) -> np.ndarray:
    offset_d = (np.arange(d) - centre + d / 2) % d - d / 2
    weights_d = np.exp(-0.5 * (offset_d / width) ** 2)
    return np.asarray(weights_d / weights_d.sum())


@pytest.mark.parametrize("d", [36, 72, 360])
def test_a_flat_class_scores_zero(d: int) -> None:
    flat = posterior(np.full((2, d), 1 / d))
    assert np.allclose(RULE.direct_levels(flat), 0.0)
    assert RULE.select(flat, DirectionGrid(d)) == ()


@given(st.floats(0, 71.99), st.floats(0, 0.5))
def test_a_lobe_is_found_where_it_is_with_the_share_that_is_not_diffuse(centre: float, diffuse: float) -> None:
    grid = DirectionGrid(72)
    (source,) = RULE.select(posterior(lobe(centre, 72)[None], [diffuse]), grid)
    expected = 180 - 5 * (centre + 0.5)
    assert abs((source.azimuth_deg - expected + 180) % 360 - 180) < 0.1
    assert 0.9 * (1 - diffuse) < source.direct_level <= 1 - diffuse


def test_a_diffuse_class_is_no_source_whatever_its_peak() -> None:
    assert RULE.select(posterior(lobe(10, 72)[None], [0.995]), DirectionGrid(72)) == ()


def test_levels_of_close_classes_add() -> None:
    weights_kd = np.stack([lobe(10, 72), lobe(11.5, 72), lobe(40, 72)])
    sources = RULE.select(posterior(weights_kd), DirectionGrid(72))
    assert [source.classes for source in sources] in ([(0, 1), (2,)], [(1, 0), (2,)])
    assert sources[0].direct_level == pytest.approx(RULE.direct_levels(posterior(weights_kd))[:2].sum())


def test_quiet_classes_that_are_enough_together_are_reported() -> None:
    weights_kd = np.concatenate([np.full((8, 72), 1 / 72), lobe(10, 72)[None], lobe(10, 72)[None]])
    rule = DirectLevelRule(least=0.15)
    assert len(rule.select(posterior(weights_kd), DirectionGrid(72))) == 1


@pytest.mark.parametrize("wrong", [{"least": 1.5}, {"cells": 4}, {"merge_deg": -1.0}])
def test_numbers_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        DirectLevelRule(**wrong)  # type: ignore[arg-type]


def test_fewer_directions_than_cells_are_refused() -> None:
    with pytest.raises(InputError, match="directions"):
        RULE.direct_levels(posterior(np.full((1, 4), 0.25)))
