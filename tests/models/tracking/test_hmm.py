"""The track model against every path written out by hand, and the fast forward-backward against the model.

::

    alive, sounding, motion, direction at t-1  ──►  the same at t  ──►  detections_t        t = 0..T-1

A path is one value of all four at every window: 2 x 2 x 3 x D states, T windows.
"""

import itertools

import numpy as np
import numpy.typing as npt
import pyro
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from pyro.infer import infer_discrete

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.models.tracking.hmm import SourceTrack, log_evidence
from avssl_pyro.models.tracking.motion import MOTION_SIGNS, TrackPrior, TrackTables, move_kernel
from avssl_pyro.tracking.hmm_filter import initial, observe, predict, smooth
from avssl_pyro.tracking.hmm_filter import log_evidence as chain_log_evidence

Array = npt.NDArray[np.float64]
# Restless enough that every transition matters within three windows.
PRIOR = TrackPrior(
    speed=2.0, speed_std=1.0, turn_rate=2.0, pause_rate=2.0, resume_rate=3.0, birth_rate=3.0, leave_rate=1.0
)
STEP_S = 0.4


def tables(num_directions: int) -> TrackTables:
    return PRIOR.tables(DirectionGrid(num_directions), STEP_S)


def log_ratios(num_windows: int, num_directions: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(0.5, 1.5, (num_windows, num_directions))


State = tuple[int, int, int, int]


def step_probability(t: TrackTables, before: State | None, after: State) -> float:
    alive, sounding, motion, direction = after
    if before is None:
        return (t.birth if alive else 1 - t.birth) * sounding / (len(MOTION_SIGNS) * t.move_hde.shape[1])
    stays = (t.survive if alive else 1 - t.survive) if before[0] else 1.0 - alive
    return float(
        stays
        * t.activity_aa[before[1], sounding]
        * t.motion_hh[before[2], motion]
        * t.move_hde[motion, before[3], direction]
    )


def all_paths(t: TrackTables, log_ratio_td: Array) -> dict[tuple[State, ...], float]:
    """Joint probability of every path and the detections."""
    states = list(itertools.product(range(2), range(2), range(3), range(log_ratio_td.shape[1])))
    ratio_td = np.exp(log_ratio_td)
    paths = {(): 1.0}
    for ratio_d in ratio_td:
        longer = {}
        for path, probability in paths.items():
            for state in states:
                step = step_probability(t, path[-1] if path else None, state)
                if probability * step > 0:
                    longer[(*path, state)] = probability * step * (ratio_d[state[3]] if state[0] and state[1] else 1.0)
        paths = longer
    return paths


def forward(t: TrackTables, log_ratio_td: Array) -> float:
    """Evidence by the forward algorithm over {absent} + 6 D states with one dense transition matrix."""
    d = log_ratio_td.shape[1]
    size = 6 * d
    transition = np.zeros((size + 1, size + 1))
    present = np.einsum("ab,hg,gde->ahdbge", t.activity_aa, t.motion_hh, t.move_hde).reshape(size, size)
    transition[:size, :size] = t.survive * present
    transition[:size, size] = 1 - t.survive
    transition[size, size] = 1.0
    alpha = np.concatenate([np.zeros(3 * d), np.full(3 * d, t.birth / (3 * d)), [1 - t.birth]])
    for number, log_ratio_d in enumerate(log_ratio_td):
        alpha = alpha @ transition if number else alpha
        alpha = alpha * np.concatenate([np.ones(3 * d), np.tile(np.exp(log_ratio_d), 3), [1.0]])
    return float(np.log(alpha.sum()))


def test_enumerated_evidence_is_the_sum_over_all_paths_and_that_of_the_forward_algorithm() -> None:
    t, log_ratio_td = tables(2), log_ratios(3, 2)
    evidence = log_evidence(SourceTrack(t), torch.from_numpy(log_ratio_td)).item()
    assert evidence == pytest.approx(np.log(sum(all_paths(t, log_ratio_td).values())), abs=1e-10)
    assert evidence == pytest.approx(forward(t, log_ratio_td), abs=1e-10)
    longer_td = log_ratios(6, 5)
    evidence = log_evidence(SourceTrack(tables(5)), torch.from_numpy(longer_td)).item()
    assert evidence == pytest.approx(forward(tables(5), longer_td), abs=1e-10)


def test_gradient_of_the_evidence_is_the_posterior_over_all_paths() -> None:
    t, log_ratio_td = tables(2), log_ratios(3, 2, seed=1)
    paths = all_paths(t, log_ratio_td)
    expected_td = np.zeros_like(log_ratio_td)
    for path, probability in paths.items():
        for window, (alive, sounding, _, direction) in enumerate(path):
            expected_td[window, direction] += alive * sounding * probability / sum(paths.values())
    observed = torch.from_numpy(log_ratio_td).requires_grad_()
    log_evidence(SourceTrack(t), observed).backward()
    assert observed.grad is not None
    np.testing.assert_allclose(observed.grad.numpy(), expected_td, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_most_likely_path_is_the_likeliest_of_all(seed: int) -> None:
    t, log_ratio_td = tables(2), log_ratios(3, 2, seed)
    paths = all_paths(t, log_ratio_td)
    decoded = infer_discrete(SourceTrack(t), first_available_dim=-1, temperature=0)
    nodes = pyro.poutine.trace(decoded).get_trace(torch.from_numpy(log_ratio_td)).nodes
    names = ("alive", "sounding", "motion", "direction")
    path = tuple(tuple(int(nodes[f"{name}_{window}"]["value"]) for name in names) for window in range(3))
    assert paths[path] == pytest.approx(max(paths.values()), rel=1e-10)


@pytest.mark.parametrize(("num_windows", "num_directions"), [(1, 4), (5, 6), (8, 3)])
def test_fast_forward_backward_is_the_enumerated_model(num_windows: int, num_directions: int) -> None:
    t, log_ratio_td = tables(num_directions), log_ratios(num_windows, num_directions)
    observed = torch.from_numpy(log_ratio_td).requires_grad_()
    evidence = log_evidence(SourceTrack(t), observed)
    evidence.backward()
    steps = []
    for log_ratio_d in log_ratio_td:
        predicted = predict(steps[-1].filtered, t) if steps else initial(t.birth, num_directions)
        steps.append(observe(predicted, np.exp(log_ratio_d), t))
    assert chain_log_evidence(steps) == pytest.approx(evidence.item(), abs=1e-10)
    smoothed = list(smooth(steps))[::-1]
    assert observed.grad is not None
    np.testing.assert_allclose([belief.sounding_d for belief in smoothed], observed.grad.numpy(), atol=1e-10)
    assert [belief.total for belief in smoothed] == pytest.approx([1.0] * num_windows)


def test_source_that_is_gone_stays_away() -> None:
    t = tables(2)
    returning = [
        path
        for path in all_paths(t, log_ratios(3, 2))
        if any(not before[0] and after[0] for before, after in itertools.pairwise(path))
    ]
    assert returning == []


@given(
    st.integers(8, 90),
    st.floats(-0.6, 0.6),
    st.floats(0.0, 0.3),
)
def test_step_keeps_its_mean_and_crosses_cells_as_often_as_it_should(num: int, drift: float, std: float) -> None:
    grid = DirectionGrid(num)
    kernel_de = move_kernel(grid, drift, std)
    np.testing.assert_allclose(kernel_de.sum(1), 1.0)
    assert (kernel_de >= 0).all()
    step_e = wrap_angle(grid.azimuths - grid.azimuths[num // 2])
    assert kernel_de[num // 2] @ step_e == pytest.approx(drift, abs=1e-3)


def test_step_without_spread_or_drift_stays() -> None:
    np.testing.assert_allclose(move_kernel(DirectionGrid(72), 0.0, 0.0), np.eye(72), atol=1e-12)


def test_every_direction_is_alike_across_the_seam() -> None:
    grid = DirectionGrid(36)
    kernel_de = move_kernel(grid, 0.1, 0.2)
    np.testing.assert_array_equal(np.roll(kernel_de, (5, 5), (0, 1)), kernel_de)
