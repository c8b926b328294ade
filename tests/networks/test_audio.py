import numpy as np
import pytest
import torch
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.networks.audio import AudioNet

F, D, M, K, T = 33, 36, 6, 3, 12
FREQUENCIES = np.linspace(250.0, 4000.0, F)
STEERING_FDM = FreeField(PRESETS["circle6"])(DirectionGrid(D), FREQUENCIES)


def network(steering_fdm: Tensor = STEERING_FDM, **options: object) -> AudioNet:
    torch.manual_seed(0)
    return AudioNet(steering_fdm, channels=6, **options).eval().double()  # type: ignore[arg-type]


def spectrogram(*batch: int) -> Tensor:
    torch.manual_seed(1)
    return torch.randn(*batch, F, M, T, dtype=torch.complex128)


def share(*batch: int) -> Tensor:
    torch.manual_seed(2)
    return torch.randn(*batch, K, D, dtype=torch.float64).softmax(-1)


def test_levels_lie_on_the_simplex() -> None:
    level_bk = network()(spectrogram(4), share(4))
    assert level_bk.shape == (4, K)
    assert (level_bk > 0).all()
    torch.testing.assert_close(level_bk.sum(-1), torch.ones(4, dtype=torch.float64))


@pytest.mark.parametrize("particles", [(5,), (2, 3)])
def test_particles_and_clips_are_heard_one_by_one(particles: tuple[int, ...]) -> None:
    net, x_bfmt, share_bkd = network(), spectrogram(4), share(*particles, 4)
    level_bk = net(x_bfmt, share_bkd)
    assert level_bk.shape == (*particles, 4, K)
    first = (0,) * len(particles)
    torch.testing.assert_close(level_bk[(*first, 2)], net(x_bfmt[2:3], share_bkd[(*first, slice(2, 3))])[0])
    last = tuple(size - 1 for size in particles)
    torch.testing.assert_close(level_bk[last], net(x_bfmt, share_bkd[last]))


@pytest.mark.parametrize("gain", [1e-6, 0.1, 30.0, 1e6])
def test_gain_of_the_recording_does_not_matter(gain: float) -> None:
    net = network()
    torch.testing.assert_close(net(gain * spectrogram(2), share(2)), net(spectrogram(2), share(2)))


def test_gain_of_one_frequency_hardly_matters() -> None:
    """Normalised per frequency: a loud hum must not drown what the others tell."""
    equalizer_f11 = torch.logspace(-1, 1, F, dtype=torch.float64)[:, None, None]
    net = network()
    torch.testing.assert_close(
        net(equalizer_f11 * spectrogram(2), share(2)), net(spectrogram(2), share(2)), rtol=1e-3, atol=1e-4
    )


@pytest.mark.parametrize("direction", [0, 9, 20, 35])
def test_beam_towards_the_source_is_the_strongest(direction: int) -> None:
    net = network(pooled_frames=1)
    x_bfmt = (STEERING_FDM[:, direction, :, None] * torch.randn(F, 1, T, dtype=torch.complex128))[None]
    log_power = net._log_power(x_bfmt)[0].reshape(F, D, T)
    assert (log_power.argmax(1) == direction).all()


def test_features_of_a_silent_or_dead_recording_are_finite() -> None:
    net = network().float()
    for x_bfmt in (torch.zeros(1, F, M, T), torch.full((1, F, M, T), 1e-30), torch.ones(1, F, M, T)):
        level_bk = net(x_bfmt.to(torch.complex64), share(1).float())
        assert level_bk.isfinite().all()
    half_silent = spectrogram(1).to(torch.complex64)
    half_silent[..., ::2] = 0
    half_silent[..., 0, :] = 0
    assert net(half_silent, share(1).float()).isfinite().all()


def test_order_of_directions_does_not_matter() -> None:
    """Weights and beams are paired by direction, whatever that order is."""
    order = torch.randperm(D, generator=torch.Generator().manual_seed(3))
    net, permuted = network(), network(STEERING_FDM[:, order])
    permuted.load_state_dict(net.state_dict())
    x_bfmt, share_bkd = spectrogram(2), share(2)
    torch.testing.assert_close(permuted.direction_features(x_bfmt), net.direction_features(x_bfmt)[:, :, order])
    torch.testing.assert_close(permuted(x_bfmt, share_bkd[..., order]), net(x_bfmt, share_bkd))


def test_order_of_sources_is_kept() -> None:
    net, x_bfmt, share_bkd = network(), spectrogram(2), share(2)
    order = torch.tensor([2, 0, 1])
    torch.testing.assert_close(net(x_bfmt, share_bkd[:, order]), net(x_bfmt, share_bkd)[:, order])


def test_features_are_the_normalised_beam_powers_embedded() -> None:
    """The fused product against the steps of Fig. 3 (b) one after the other."""
    net, x_bfmt = network(pooled_frames=2), spectrogram(2)
    beam_bfdt = torch.einsum("fdm,bfmt->bfdt", STEERING_FDM.conj() / M, x_bfmt)
    # The frame left over when there is an odd number of them is not heard.
    pairs = beam_bfdt.shape[-1] // 2
    power = beam_bfdt[..., : 2 * pairs].abs().square().unflatten(-1, (pairs, 2)).mean(-1)
    log_power = (power + 1e-8 * power.mean((1, 2, 3), keepdim=True)).log()
    normalised = (log_power - log_power.mean((2, 3), keepdim=True)) / (
        log_power.std((2, 3), keepdim=True, correction=0) + 1e-3
    )
    embedded = torch.einsum("cf,bfdt->bcdt", net.embed.weight, normalised)
    torch.testing.assert_close(net.direction_features(x_bfmt), net.over_directions(net.embed_norm(embedded)))


def test_few_frequencies_are_heard_all_and_many_in_part() -> None:
    assert network().embed.in_features == F
    thinned = network(most_bins=10)
    assert 5 <= thinned.embed.in_features <= 10
    assert thinned(spectrogram(2), share(2)).shape == (2, K)


def test_every_parameter_learns() -> None:
    net = network().train()
    level_bk = net(spectrogram(2), share(2).requires_grad_())
    (level_bk * torch.randn_like(level_bk)).sum().backward()
    for name, parameter in net.named_parameters():
        assert parameter.grad is not None, name
        # A shift of all logits changes no softmax.
        assert name == "affine.bias" or parameter.grad.abs().max() > 1e-12, name


def test_weights_of_directions_learn_through_the_levels() -> None:
    share_bkd = share(2).requires_grad_()
    (grad,) = torch.autograd.grad(network()(spectrogram(2), share_bkd)[:, 0].sum(), share_bkd)
    assert (grad.abs().amax(-1) > 0).all()


def test_the_order_of_sources_does_not_matter() -> None:
    net, x_bfmt, share_bkd = network(), spectrogram(2), share(2)
    torch.testing.assert_close(net(x_bfmt, share_bkd.flip(-2)), net(x_bfmt, share_bkd).flip(-1))


def test_a_source_is_compared_with_the_others() -> None:
    """The odds of two sources depend on a third, which a softmax of each one's own score alone could never do."""
    net, x_bfmt, share_bkd = network(), spectrogram(1), share(1)
    # A fresh network's features are so much alike that no unit's sign differs between sources; here it is that of
    # being above the average.
    first = net.beside[0]
    assert isinstance(first, torch.nn.Linear)
    one, nothing = torch.eye(6, dtype=torch.float64), torch.zeros(6, 6, dtype=torch.float64)
    first.weight.data = torch.cat([one, -one, nothing], dim=-1)
    first.bias.data.zero_()
    moved_bkd = share_bkd.clone()
    moved_bkd[:, 2] = share_bkd[:, 2].flip(-1)
    level_bk, changed_bk = net(x_bfmt, share_bkd), net(x_bfmt, moved_bkd)
    assert not torch.isclose(level_bk[0, 0] / level_bk[0, 1], changed_bk[0, 0] / changed_bk[0, 1], rtol=1e-6)
