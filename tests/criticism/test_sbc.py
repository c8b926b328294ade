"""Simulation-based calibration: it passes an exact posterior, tells others apart, and goes on after a stop."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from torch import Tensor

from avssl_pyro.benchmarks.calibration import ToyModel
from avssl_pyro.criticism.sbc import quantities, rank_histogram, run_trials, uniformity
from avssl_pyro.errors import InputError
from avssl_pyro.guides.posterior_draws import PosteriorDraws, prior_draws
from avssl_pyro.models.likelihoods import PrecedenceGaussian
from avssl_pyro.models.priors import LogNormalWeights, SymmetricDirichlet
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

TOY = ToyModel()
L = 19
# So much diffuse power that nothing can be told of directions: the posterior is the prior.
BLIND = SpatialCGMM(TOY.steering_fdm, TOY.num_sources, SymmetricDirichlet(1.0), LogNormalWeights(1.0), diffuse=1e4)


def from_the_prior(x_bfmt: Tensor, image_bcij: Tensor, seeds: Sequence[int]) -> list[PosteriorDraws]:
    return [
        prior_draws(BLIND, x_fmt, image_cij, L, seed)
        for x_fmt, image_cij, seed in zip(x_bfmt, image_bcij, seeds, strict=True)
    ]


def too_narrow(x_bfmt: Tensor, image_bcij: Tensor, seeds: Sequence[int]) -> list[PosteriorDraws]:
    clips = from_the_prior(x_bfmt, image_bcij, seeds)
    return [PosteriorDraws(draws.w_skd**0.3, draws.pi_sk) for draws in clips]


def test_an_exact_posterior_has_uniform_ranks_and_a_narrow_one_has_not() -> None:
    trials = run_trials(BLIND, {"exact": from_the_prior, "narrow": too_narrow}, TOY.spectrogram(), range(100))
    names = ("largest level", "power ahead", "power left", "power behind", "sharpness", "mean log w")
    found = {
        posterior: {name: uniformity([trial[posterior][name] for trial in trials], L) for name in names}
        for posterior in ("exact", "narrow")
    }
    assert min(result.p_value for result in found["exact"].values()) > 0.01
    assert found["exact"]["mean log w"].spread == pytest.approx(1.0, abs=0.15)
    assert found["narrow"]["mean log w"].p_value < 1e-6
    assert found["narrow"]["mean log w"].spread > 1.3
    # Levels were not touched.
    assert found["narrow"]["largest level"] == found["exact"]["largest level"]


def test_a_shift_is_told_with_its_sign() -> None:
    high, low = uniformity([15, 17, 18, 19], L), uniformity([0, 1, 2, 3], L)
    assert high.shift > 0.3 > -0.3 > low.shift
    assert uniformity(range(20), L).spread == pytest.approx(1.0)
    assert uniformity(range(20), L).p_value == pytest.approx(1.0)


def test_ranks_fall_into_equal_bins() -> None:
    assert rank_histogram([0, 1, 2, 19, 19], L).tolist() == [2, 1, 0, 0, 0, 0, 0, 0, 0, 2]
    with pytest.raises(InputError, match="multiple of 10"):
        rank_histogram([0], 20)


def test_quantities_do_not_know_the_order_of_classes() -> None:
    model = TOY.model()
    x_fmt, image_cij = torch.randn_like(TOY.spectrogram()), torch.zeros(3, 1, 1)
    draws = prior_draws(model, x_fmt, image_cij, 6)
    turned = PosteriorDraws(draws.w_skd.flip(-2), draws.pi_sk.flip(-1))
    for name, values_s in quantities(model, x_fmt, image_cij, draws).items():
        torch.testing.assert_close(quantities(model, x_fmt, image_cij, turned)[name], values_s, msg=name)


def test_sectors_are_where_they_are_called() -> None:
    model = TOY.model()
    # Direction d of 8 is at 157.5 - 45 d degrees: 3 and 4 are ahead, 1 and 2 left of the array, 7 and 0 behind.
    for name, direction in (("ahead", 3), ("left", 1), ("behind", 7)):
        w_skd = torch.full((1, 2, 8), 1e-6)
        w_skd[..., direction] = 1.0
        found = quantities(
            model, TOY.spectrogram() + 1, torch.zeros(3, 1, 1), PosteriorDraws(w_skd, torch.tensor([[0.5, 0.5]]))
        )
        assert found[f"power {name}"].item() == pytest.approx(1.0, abs=1e-4)


def test_a_model_that_counts_bins_twice_is_refused() -> None:
    model = SpatialCGMM(TOY.steering_fdm, 2, bin_weight=2.0)
    with pytest.raises(InputError, match="bin_weight 2"):
        run_trials(model, {"any": from_the_prior}, TOY.spectrogram(), [0])


def test_a_model_that_weighs_bins_is_refused() -> None:
    model = SpatialCGMM(TOY.steering_fdm, 2, likelihood=PrecedenceGaussian())
    with pytest.raises(InputError, match=r"PrecedenceGaussian\(.*\) weighs bins .* use ProfiledGaussian"):
        run_trials(model, {"any": from_the_prior}, TOY.spectrogram(), [0])


@pytest.mark.parametrize("room", [False, True])
def test_every_posterior_of_the_line_up_gives_its_draws(room: bool) -> None:
    quick = ToyModel(num_directions=4, num_bins=2, num_frames=4, draws=9, warmup=10, thinning=1, room=room)
    x_bfmt = torch.randn(2, *quick.spectrogram().shape, dtype=torch.complex64)
    for name, sampler in quick.samplers(steps=3).items():
        for draws in sampler(x_bfmt, torch.zeros(2, 3, 1, 1), [0, 1]):
            assert draws.w_skd.shape == (9, 2, 4), name
            np.testing.assert_allclose(draws.pi_sk.sum(-1), 1.0, rtol=1e-5, err_msg=name)
            assert (draws.e_skc is not None) == room
    ranks = run_trials(quick.model(), quick.samplers(steps=3), quick.spectrogram(), [0])[0]
    assert all(0 <= rank <= 9 for of_one in ranks.values() for rank in of_one.values())
