"""Precedence weights: onsets count, decays do not, and the scale of the recording is of no account."""

import math

import torch

from avssl_pyro.distributions.precedence import log_decay_of, precedence_weights
from avssl_pyro.distributions.profiled_gaussian import observe

F, M, T = 6, 3, 40
LOG_DECAY = log_decay_of(0.5, 0.01)


def weights(x_bfmt: torch.Tensor) -> torch.Tensor:
    return precedence_weights(observe(x_bfmt), LOG_DECAY, 0.05)


def test_a_decay_of_the_time_asked_for_is_60_decibels() -> None:
    assert math.isclose(LOG_DECAY * 50, -math.log(1e6))


def test_running_maximum_is_the_recursion() -> None:
    torch.manual_seed(0)
    x_bfmt = torch.randn(2, F, M, T, dtype=torch.complex128)
    power_bft = x_bfmt.abs().square().sum(-2)
    padded_bft = torch.cat([power_bft[:, :1], power_bft, power_bft[:, -1:]], dim=1)
    power_bft = (padded_bft[:, :-2] + padded_bft[:, 1:-1] + padded_bft[:, 2:]) / 3
    expected = torch.ones_like(power_bft)
    r_bf = torch.zeros_like(power_bft[..., 0])
    for t in range(1, T):
        r_bf = math.exp(LOG_DECAY) * torch.maximum(r_bf, power_bft[..., t - 1])
        expected[..., t] = (1 - r_bf / power_bft[..., t]).clamp_min(0.05)
    found = weights(x_bfmt)
    torch.testing.assert_close(found / found[..., :1], expected / expected[..., :1], rtol=1e-6, atol=1e-9)


def test_a_reverberant_tail_counts_least_and_its_onset_most() -> None:
    x_bfmt = torch.full((1, F, M, T), 1e-9, dtype=torch.complex128)
    x_bfmt[..., 10:] = torch.exp(0.6 * LOG_DECAY * torch.arange(T - 10)).sqrt() + 0j
    c_bft = weights(x_bfmt)
    assert (c_bft[..., 10] > 2 * c_bft[..., 11:].amax(-1)).all()


def test_weights_do_not_depend_on_the_scale_and_survive_silence() -> None:
    torch.manual_seed(0)
    x_bfmt = torch.randn(1, F, M, T, dtype=torch.complex64)
    torch.testing.assert_close(weights(x_bfmt), weights(1e-6 * x_bfmt), rtol=1e-3, atol=1e-5)
    silent_bft = weights(torch.zeros(1, F, M, T, dtype=torch.complex64))
    assert silent_bft.isfinite().all() and (silent_bft > 0).all()
