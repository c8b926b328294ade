"""The amortized guide of models with a room: its site, its parameters, its gradients."""

import torch
from pyro.infer import TraceMeanField_ELBO

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.guides.diffuse import DiffuseAmortizedGuide
from avssl_pyro.models.room import ROOM_DIFFUSE, Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet

K, C = 3, 2


def test_training_reaches_the_diffuse_weights() -> None:
    torch.manual_seed(0)
    array, grid, frequencies = PRESETS["circle4"], DirectionGrid(72), StftConfig(window=64).frequencies
    steering_fdm = array.steering_vectors(grid, frequencies).to(torch.complex64)
    model = SpatialCGMM(steering_fdm, K, diffuse=ROOM_DIFFUSE, room=Room.of_array(array, grid, frequencies))
    guide = DiffuseAmortizedGuide(VisualNet(num_sources=K), AudioNet(steering_fdm), C)
    x_bfmt = torch.randn(2, len(frequencies), 4, 10, dtype=torch.complex64)
    image_bcij = torch.rand(2, 3, 88, 288)
    TraceMeanField_ELBO().differentiable_loss(model, guide, x_bfmt, image_bcij).backward()
    for parameter in (guide.diffuse_mu_kc, guide.diffuse_log_sigma_kc):
        assert parameter.grad is not None and parameter.grad.abs().min() > 0
    known = guide.parameters_of(x_bfmt, image_bcij)
    assert known.diffuse_mu_bkc is not None and known.diffuse_mu_bkc.shape == (2, K, C)
    assert known.diffuse_sigma_bkc is not None and known.diffuse_sigma_bkc.min() > 0
