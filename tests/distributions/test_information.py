"""Information of the spatial mixture: that of scores drawn from it, and none where nothing can be told."""

import numpy as np
import torch

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.information import mixture_information
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.distributions.spatial_mixture import SpatialMixture

D, F, T, DIFFUSE = 8, 4, 20000, 0.1
TEMPLATE_DFMM = template_covariances(FreeField(PRESETS["circle4"])(DirectionGrid(D), np.linspace(500, 3000, F)))


def drawn(w_kd: torch.Tensor, pi_k: torch.Tensor, frames: int) -> torch.Tensor:
    ones = torch.ones(F, len(pi_k), frames, dtype=torch.float64)
    return SpatialMixture(TEMPLATE_DFMM, w_kd, pi_k, num_frames=frames, diffuse=DIFFUSE, psd_bfkt=ones).sample()


def test_information_of_one_class_is_the_variance_of_its_scores() -> None:
    torch.manual_seed(0)
    w_kd, pi_k = torch.rand(1, D, dtype=torch.float64) + 0.1, torch.ones(1, dtype=torch.float64)
    x_fmt = drawn(w_kd, pi_k, T)
    # The same weights as a batch of one-frame clips give one score a frame.
    log_w_tkd = w_kd.log().expand(T, 1, D).clone().requires_grad_()
    mixture = SpatialMixture(TEMPLATE_DFMM, log_w_tkd.exp(), pi_k.expand(T, 1), num_frames=1, diffuse=DIFFUSE)
    mixture.log_prob(x_fmt.movedim(-1, 0)[..., None]).sum().backward()
    score_td = log_w_tkd.grad[:, 0]
    found = mixture_information(observe(x_fmt[None]), TEMPLATE_DFMM, DIFFUSE, w_kd.log()[None], pi_k[None])
    # eps goes with the summed weights in the information, and with each weight in the mixture; the scale takes it up.
    torch.testing.assert_close(found.log_weights_bkd[0, 0] / T, score_td.var(0), rtol=0.05, atol=0.0)


def test_equal_classes_tell_nothing_of_levels_and_well_separated_ones_all() -> None:
    torch.manual_seed(0)
    pi_k = torch.tensor([0.6, 0.4], dtype=torch.float64)
    same_kd = torch.ones(2, D, dtype=torch.float64)
    apart_kd = torch.full((2, D), 1e-3, dtype=torch.float64)
    apart_kd[0, 1] = apart_kd[1, 5] = 100.0
    shares = []
    for w_kd in (same_kd, apart_kd):
        x_fmt = drawn(w_kd, pi_k, 200)
        information = mixture_information(observe(x_fmt[None]), TEMPLATE_DFMM, DIFFUSE, w_kd.log()[None], pi_k[None])
        shares.append(information.levels_b.item())
        assert (information.log_weights_bkd >= 0).all()
    assert shares[0] < 1e-6
    assert 0.5 < shares[1] <= 1
