import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource, peak_azimuth

GRID = DirectionGrid(72)
RULE = DirectLevelRule(least=0.0)

Array = npt.NDArray[np.float64]


def bump(azimuth_deg: float, width_deg: float = 5.0) -> Array:
    """Weights of a class that looks in one direction."""
    offset_d = wrap_angle(GRID.azimuths - np.deg2rad(azimuth_deg))
    weights_d = np.exp(-0.5 * (offset_d / np.deg2rad(width_deg)) ** 2)
    return weights_d / weights_d.sum()


def posterior(
    *classes: tuple[float | None, float], azimuth_std: float = 0.05, level_std: float = 0.03
) -> ClipPosterior:
    """One class for each (azimuth in degrees or None for diffuse, level)."""
    weights_kd = np.stack([np.full(72, 1 / 72) if azimuth is None else bump(azimuth) for azimuth, _ in classes])
    number = len(classes)
    return ClipPosterior(
        weights_kd,
        np.array([level for _, level in classes]),
        np.full(number, level_std),
        np.full(number, azimuth_std),
    )


def select(beliefs: ClipPosterior, rule: DirectLevelRule = RULE) -> tuple[LocalizedSource, ...]:
    return rule.select(beliefs, GRID)


def found_deg(sources: tuple[LocalizedSource, ...]) -> list[float]:
    return [np.rad2deg(source.azimuth) for source in sources]


# On a grid of 5 degrees with centres at 2.5 degrees and so on; 180 is the seam.
@pytest.mark.parametrize("azimuth_deg", [-180.0, -179.0, -177.5, -90.0, 0.0, 1.3, 88.8, 177.5, 179.0, 180.0])
def test_peak_is_finer_than_the_grid_and_knows_no_seam(azimuth_deg: float) -> None:
    found = peak_azimuth(bump(azimuth_deg), GRID)
    assert abs(wrap_angle(found - np.deg2rad(azimuth_deg))) < np.deg2rad(0.05)
    assert -np.pi <= found <= np.pi


def test_peak_ignores_what_is_far_from_the_maximum() -> None:
    weights_d = 0.6 * bump(42.5) + 0.4 * bump(-102.5)
    assert np.rad2deg(peak_azimuth(weights_d, GRID)) == pytest.approx(42.5, abs=0.01)


@given(st.lists(st.floats(0.01, 1.0), min_size=72, max_size=72, unique=True), st.integers(-200, 200))
def test_turning_the_weights_turns_the_azimuth(values: list[float], steps: int) -> None:
    weights_d = np.array(values)
    turned = peak_azimuth(np.roll(weights_d, steps), GRID)
    # Towards larger indices is to the right, clockwise.
    expected = peak_azimuth(weights_d, GRID) - steps * GRID.spacing
    assert abs(wrap_angle(turned - expected)) < 1e-9


def test_a_single_direction_is_its_own_azimuth() -> None:
    for index in (0, 30, 71):
        assert peak_azimuth(np.eye(72)[index], GRID) == pytest.approx(GRID.azimuths[index])


def test_sources_come_loudest_first_with_their_uncertainty() -> None:
    sources = select(posterior((42.5, 0.2), (-102.5, 0.5), (None, 0.3)))
    assert found_deg(sources) == pytest.approx([-102.5, 42.5], abs=0.01)
    assert [source.source_class for source in sources] == [1, 0]
    assert [source.level for source in sources] == [0.5, 0.2]
    assert [source.level_std for source in sources] == [0.03, 0.03]
    assert [source.azimuth_std for source in sources] == [0.05, 0.05]


@pytest.mark.parametrize(("least", "counted"), [(0.019, True), (0.021, False)])
def test_least_level(least: float, counted: bool) -> None:
    """A class without spread at one direction alone has a direct level as high as its mixing level."""
    weights_kd = np.stack([np.eye(72)[30], np.full(72, 1 / 72)])
    narrow = ClipPosterior(weights_kd, np.array([0.02, 0.98]), np.zeros(2), np.zeros(2))
    assert bool(select(narrow, DirectLevelRule(least))) is counted


def test_wide_classes_need_higher_levels() -> None:
    narrow, wide = bump(42.5, 5.0), bump(-60.0, 40.0)
    beliefs = ClipPosterior(np.stack([narrow, wide]), np.array([0.5, 0.5]), np.zeros(2), np.zeros(2))
    assert found_deg(select(beliefs, DirectLevelRule(0.05))) == pytest.approx([42.5], abs=0.01)
    assert len(select(beliefs, DirectLevelRule(0.001))) == 2


def test_nothing_heard_is_no_source() -> None:
    assert select(posterior((None, 0.6), (None, 0.4))) == ()


@pytest.mark.parametrize("first_deg", [2.5, 172.5, 177.5, -177.5])
def test_close_classes_are_one_object_between_them(first_deg: float) -> None:
    beliefs = posterior((first_deg, 0.3), (first_deg + 10, 0.1), (first_deg + 90, 0.6), level_std=0.04)
    far, near = select(beliefs)
    assert far.level == 0.6
    # Weighted by level, three parts to one.
    assert float(wrap_angle(near.azimuth - np.deg2rad(first_deg + 2.5))) == pytest.approx(0, abs=1e-3)
    assert near.level == pytest.approx(0.4)
    assert near.source_class == 0
    assert near.level_std == pytest.approx(np.hypot(0.04, 0.04))
    # The spread within the classes and that between them: shares 3/4 and 1/4, ten degrees apart.
    between = 0.75 * 0.25 * np.deg2rad(10.0) ** 2
    assert near.azimuth_std == pytest.approx(np.sqrt(0.05**2 + between), rel=1e-3)


def test_of_two_neighbours_the_closer_one_is_joined_though_the_other_is_louder() -> None:
    beliefs = posterior((2.5, 0.5), (17.5, 0.4), (12.5, 0.05))
    louder, other = select(beliefs, DirectLevelRule(0.0, merge_deg=14.0))
    assert (louder.source_class, other.source_class) == (0, 1)
    assert (louder.level, other.level) == (0.5, pytest.approx(0.45))


def test_merging_never_leaves_two_objects_too_close() -> None:
    """The first two merge and so come close to the third."""
    beliefs = posterior((2.5, 0.3), (12.5, 0.3), (22.5, 0.05))
    (source,) = select(beliefs, DirectLevelRule(0.0, merge_deg=15.5))
    assert source.level == pytest.approx(0.65)


@pytest.mark.parametrize(("apart_deg", "number"), [(10.0, 1), (15.0, 2)])
def test_merging_distance(apart_deg: float, number: int) -> None:
    beliefs = posterior((0.0, 0.4), (apart_deg, 0.4), (None, 0.2))
    assert len(select(beliefs)) == number
    assert len(select(beliefs, DirectLevelRule(0.0, merge_deg=0.0))) == 2


def test_merged_sources_tell_all_their_classes() -> None:
    beliefs = posterior((-90.0, 0.1), (50.0, 0.2), (58.0, 0.3), (54.0, 0.25), (None, 0.15))
    merged, alone = select(beliefs, DirectLevelRule(0.0, merge_deg=12.0))
    assert merged.classes[0] == merged.source_class
    assert sorted(merged.classes) == [1, 2, 3]
    assert alone.classes == (0,)


def test_classes_merged_can_overtake() -> None:
    beliefs = posterior((2.5, 0.3), (102.5, 0.4), (7.5, 0.3))
    assert found_deg(select(beliefs)) == pytest.approx([5.0, 102.5], abs=0.01)


classes = st.lists(st.tuples(st.floats(-180, 180), st.floats(0.01, 1.0)), min_size=1, max_size=6)


@given(classes)
def test_objects_found_are_apart_and_account_for_all_levels(drawn: list[tuple[float, float]]) -> None:
    sources = select(posterior(*drawn))
    assert sum(source.level for source in sources) == pytest.approx(sum(level for _, level in drawn))
    direct = [source.direct_level for source in sources]
    assert direct == sorted(direct, reverse=True)
    for first in sources:
        for second in sources:
            apart = abs(wrap_angle(first.azimuth - second.azimuth))
            assert first is second or apart >= np.deg2rad(RULE.merge_deg) - 1e-9


@given(classes, st.integers(0, 71))
def test_turning_the_scene_turns_the_objects(drawn: list[tuple[float, float]], steps: int) -> None:
    beliefs = posterior(*drawn)
    # Between two directions, rounding decides which is the peak.
    runner_up_k, best_k = np.sort(beliefs.direction_weights_kd, axis=-1)[:, -2:].T
    assume((best_k - runner_up_k > 1e-9).all())
    turned = ClipPosterior(
        np.roll(beliefs.direction_weights_kd, steps, axis=-1),
        beliefs.mixing_levels_k,
        beliefs.level_std_k,
        beliefs.azimuth_std_k,
    )
    before = select(beliefs)
    after = select(turned)
    # Nor may rounding decide whether two are merged, or in which order they come.
    distances = [wrap_angle(a.azimuth - b.azimuth) for a in before for b in before if a is not b]
    assume(all(abs(abs(distance) - np.deg2rad(RULE.merge_deg)) > 1e-6 for distance in distances))
    assume(len({round(level, 6) for _, level in drawn}) == len(drawn))
    assert len(before) == len(after)
    for first, second in zip(before, after, strict=True):
        assert abs(wrap_angle(second.azimuth - first.azimuth + steps * GRID.spacing)) < 1e-6
        assert second.source_class == first.source_class
