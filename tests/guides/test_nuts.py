"""NUTS on one clip: it samples the posterior that is known in closed form, and hands its draws on."""

import numpy as np
import pyro
import pytest
import torch
from pyro import distributions as dist
from torch import Tensor, nn

from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.guides.nuts import NutsConfig, NutsDraws, NutsGuide, sample_posterior, sample_posteriors

K, D = 3, 2
PRIOR_SIGMA, NOISE = 1.0, 0.5
COUNT_K = torch.tensor([6.0, 2.0, 1.0])


class Conjugate(nn.Module):
    """Log-weights seen in noise, and levels behind counts: the posterior is LogNormal x Dirichlet.

    ::

        w_kd --> x_kd     pi_k --> counts
        `---- plate "clip" -----'
    """

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("count_k", COUNT_K.clone())

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        zero_kd = self.count_k.new_zeros(K, D)
        with pyro.plate("clip", len(x_bfmt), dim=-1):
            w_bkd = pyro.sample("direction_weights", dist.LogNormal(zero_kd, PRIOR_SIGMA).to_event(2))
            pi_bk = pyro.sample("mixing_levels", dist.Dirichlet(self.count_k.new_ones(K)))
            seen_bkd = x_bfmt.real.reshape(-1, K, D)
            pyro.sample("weights seen", dist.Normal(w_bkd.log(), NOISE).to_event(2), obs=seen_bkd)
            pyro.factor("levels seen", (self.count_k * pi_bk.log()).sum(-1))


class Start(nn.Module):
    """Near enough, and much too sure of itself."""

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        zero_bkd = torch.zeros(len(x_bfmt), K, D)
        return GuideParameters(zero_bkd, zero_bkd + 0.3, torch.full((len(x_bfmt), K), 20.0), zero_bkd[:, :, None])


@pytest.fixture(scope="module")
def x_bfmt() -> Tensor:
    torch.manual_seed(3)
    return torch.randn(2, K, D, 1, dtype=torch.complex64)


IMAGE_BCIJ = torch.zeros(2, 3, 1, 1)
CONFIG = NutsConfig(draws=150, warmup=80, chains=2, seed=1)


@pytest.fixture(scope="module")
def draws(x_bfmt: Tensor) -> list[NutsDraws]:
    return sample_posteriors(Start(), Conjugate(), x_bfmt, IMAGE_BCIJ, CONFIG)


def test_draws_have_the_moments_of_the_posterior(draws: list[NutsDraws], x_bfmt: Tensor) -> None:
    precision = PRIOR_SIGMA**-2 + NOISE**-2
    levels = dist.Dirichlet(COUNT_K + 1)
    for clip, x_fmt in zip(draws, x_bfmt, strict=True):
        assert clip.w_skd.shape == (300, K, D)
        mean_kd, std_kd, concentration_k = (moment.float() for moment in clip.moments())
        expected_kd = x_fmt.real.reshape(K, D) * NOISE**-2 / precision
        torch.testing.assert_close(mean_kd, expected_kd, rtol=0, atol=0.12)
        torch.testing.assert_close(std_kd, torch.full_like(std_kd, precision**-0.5), rtol=0.25, atol=0)
        torch.testing.assert_close(clip.pi_sk.mean(0).float(), levels.mean, rtol=0, atol=0.04)
        torch.testing.assert_close(clip.pi_sk.std(0).float(), levels.stddev, rtol=0.25, atol=0)
        torch.testing.assert_close(concentration_k, COUNT_K + 1, rtol=0.4, atol=0)
        assert not clip.diverging_s.any()


def test_chains_agree_and_go_to_arviz(draws: list[NutsDraws]) -> None:
    data = draws[0].to_arviz()
    assert dict(data.posterior.sizes) == {"chain": 2, "draw": 150, "source": K, "direction": D}
    assert data.posterior["mixing_levels"].dims == ("chain", "draw", "source")
    np.testing.assert_allclose(data.posterior["mixing_levels"].sum("source"), 1.0, rtol=1e-6)
    assert not data.sample_stats["diverging"].any()
    spread = data.posterior["mixing_levels"].mean("draw").std("chain")
    assert float(spread.max()) < 0.05


def test_the_same_seed_gives_the_same_draws_and_leaves_others_alone(x_bfmt: Tensor) -> None:
    config = NutsConfig(draws=5, warmup=5, chains=1)
    torch.manual_seed(0)
    expected = torch.rand(())
    torch.manual_seed(0)
    first = sample_posterior(Start(), Conjugate(), x_bfmt[0], IMAGE_BCIJ[0], config)
    assert torch.rand(()) == expected
    with torch.no_grad():
        again = sample_posterior(Start(), Conjugate(), x_bfmt[0], IMAGE_BCIJ[0], config)
    torch.testing.assert_close(again.w_skd, first.w_skd, rtol=0, atol=0)
    assert not pyro.get_param_store()


def test_as_a_guide_it_has_the_public_sites(x_bfmt: Tensor) -> None:
    guide = NutsGuide(Start(), Conjugate(), NutsConfig(draws=30, warmup=40, chains=1))
    trace = pyro.poutine.trace(guide).get_trace(x_bfmt, IMAGE_BCIJ)
    assert trace.stochastic_nodes == ["clip", "direction_weights", "mixing_levels"]
    assert trace.nodes["direction_weights"]["value"].shape == (2, K, D)
    parameters = guide.parameters_of(x_bfmt, IMAGE_BCIJ)
    assert parameters.mu_bkd.dtype == torch.float32
    assert parameters.concentration_bk.shape == (2, K)


@pytest.mark.parametrize("wrong", [{"draws": 0}, {"warmup": 0}, {"chains": 0}, {"target_accept": 1.0}])
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(wrong))} is"):
        NutsConfig(**wrong)  # type: ignore[arg-type]
