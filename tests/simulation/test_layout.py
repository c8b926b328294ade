import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.errors import InputError
from avssl_pyro.simulation.layout import draw_layout
from avssl_pyro.simulation.scene_config import ALL_SPEAK, SOME_SILENT, Condition, SceneConfig


@given(st.integers(0, 2**32 - 1), st.sampled_from([ALL_SPEAK, SOME_SILENT]))
def test_people_stand_apart_within_their_ranges(seed: int, condition: Condition) -> None:
    config = SceneConfig(condition)
    layout = draw_layout(config, np.random.default_rng(seed))
    assert len(layout.people) in condition.people
    assert len(layout.talkers) in {2, 3}
    if condition is ALL_SPEAK:
        assert len(layout.talkers) == len(layout.people)
    for person in layout.people:
        assert 0.5 <= person.distance_m <= 2.0
        assert 1.5 <= person.height_m <= 1.9
        assert (person.level_db is not None) == person.speaks
        assert abs(person.level_db or 0.0) <= 2.5
    for first in layout.people:
        for second in layout.people:
            apart = abs((np.rad2deg(first.azimuth - second.azimuth) + 180) % 360 - 180)
            nearer = np.rad2deg(np.arctan(0.3 / min(first.distance_m, second.distance_m)))
            assert first is second or apart >= max(20.0, nearer) - 1e-9


def test_every_count_and_every_place_in_line_occurs() -> None:
    layouts = [draw_layout(SceneConfig(), np.random.default_rng(seed)) for seed in range(200)]
    counts = {(len(layout.people), len(layout.talkers)) for layout in layouts}
    assert counts == {(2, 2), (3, 2), (3, 3), (4, 2), (4, 3)}
    assert {layout.people[0].speaks for layout in layouts} == {True, False}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"distance_range_m": (0.5, 3.0)}, "inside the room"),
        ({"distance_range_m": (0.0, 2.0)}, "more than 0.2 m"),
        ({"rt60_range_s": (0.4, 0.2)}, "must not exceed"),
        ({"rt60_range_s": (0.01, 0.2)}, "at least 0.1"),
        ({"height_range_m": (1.5, 3.2)}, "lower than the room"),
        ({"peak_range_db": (-3.0, 0.0)}, "full scale"),
    ],
)
def test_an_impossible_configuration_is_refused(change: dict[str, tuple[float, float]], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        replace(SceneConfig(), **change)


def test_a_crowd_that_cannot_stand_apart_is_refused() -> None:
    crowd = SceneConfig(Condition("crowd", people=(12,)), min_separation_deg=40.0)
    with pytest.raises(InputError, match="12 people do not fit"):
        draw_layout(crowd, np.random.default_rng(0))


def test_a_configuration_survives_json() -> None:
    for condition in (ALL_SPEAK, SOME_SILENT):
        config = SceneConfig(condition, snr_db=15.0, rt60_range_s=(0.25, 0.3))
        assert SceneConfig.from_dict(json.loads(json.dumps(asdict(config)))) == config
