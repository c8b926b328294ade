import pytest
import torch
from torch import Tensor

from avssl_pyro.networks.augmentation import RandomYawFlip
from avssl_pyro.networks.visual import VisualNet, _WrapAzimuth


def network(**options: object) -> VisualNet:
    torch.manual_seed(0)
    return VisualNet(**{"channels": (4, 6, 8, 8), **options}).eval().double()  # type: ignore[arg-type]


def image(batch: int = 1) -> Tensor:
    return torch.rand(batch, 3, 88, 288, dtype=torch.float64, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("num_directions", [36, 72])
@pytest.mark.parametrize("circular", [False, True])
@pytest.mark.parametrize("position_channels", [False, True])
def test_shapes(num_directions: int, circular: bool, position_channels: bool) -> None:
    net = network(num_sources=3, num_directions=num_directions, circular=circular, position_channels=position_channels)
    mu_bkd, activation_bkij = net(image(2))
    assert mu_bkd.shape == (2, 3, num_directions)
    assert activation_bkij.shape == (2, 3, 22, 72)


@pytest.mark.parametrize("anchor_gain", [0.0, 2.0])
def test_log_weights_are_the_column_maxima_of_the_averaged_activation(anchor_gain: float) -> None:
    """What the overlay shows is what the directions were made from."""
    mu_bkd, activation_bkij = network(num_directions=36, anchor_gain=anchor_gain)(image())
    expected = activation_bkij.reshape(1, 4, 22, 36, 2).mean(-1).amax(-2)
    torch.testing.assert_close(mu_bkd, expected)


@pytest.mark.parametrize("blocks", [1, 5, 17])
def test_circular_network_sees_no_seam(blocks: int) -> None:
    net = network(position_channels=False)
    mu_bkd, activation_bkij = net(image())
    turned_mu, turned_activation = net(image().roll(16 * blocks, dims=-1))
    torch.testing.assert_close(turned_mu, mu_bkd.roll(4 * blocks, dims=-1))
    torch.testing.assert_close(turned_activation, activation_bkij.roll(4 * blocks, dims=-1))


def test_zero_padding_does_see_the_seam() -> None:
    net = network(position_channels=False, circular=False)
    mu_bkd, _ = net(image())
    turned_mu, _ = net(image().roll(144, dims=-1))
    assert (turned_mu - mu_bkd.roll(36, dims=-1)).abs().max() > 1e-6


@pytest.mark.parametrize("num_directions", [36, 72])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.7, 0.999])
def test_direction_d_looks_at_image_block_d(num_directions: int, share: float) -> None:
    """A mirrored or shifted alignment would train to nothing without any error."""
    direction = int(share * num_directions)
    block = 288 // num_directions
    # Gradients of many random networks, since one may by chance look past its block.
    influence_j = torch.zeros(288, dtype=torch.float64)
    for seed in range(4):
        torch.manual_seed(seed)
        net = VisualNet(num_directions=num_directions, channels=(8, 8, 8), circular=True).eval().double()
        picture = image().requires_grad_()
        (grad,) = torch.autograd.grad(net(picture)[0][0, :, direction].sum(), picture)
        influence_j += grad.abs().sum((0, 1, 2))
    # Measured around the block so that the seam does not split it.
    centered = influence_j.roll(144 - direction * block - block // 2)
    center_of_mass = (centered * torch.arange(288)).sum() / centered.sum()
    assert abs(center_of_mass.item() - 144) <= 3
    inside = centered[144 - block // 2 - 4 : 144 + block // 2 + 4].sum()
    assert inside > 0.6 * centered.sum()


def test_only_position_channels_tell_directions_of_a_uniform_image_apart() -> None:
    blank = torch.full((1, 3, 88, 288), 0.5, dtype=torch.float64)
    without, _ = network(position_channels=False)(blank)
    # Four directions are the stride of the coarsest level; within it every position has weights of its own.
    torch.testing.assert_close(without, without.roll(4, dims=-1))
    with_position, _ = network(position_channels=True)(blank)
    assert (with_position - with_position.roll(4, dims=-1)).abs().max() > 1e-4


def test_anchors_give_every_class_a_sector_of_its_own() -> None:
    """Class k is drawn to the k-th of K equal blocks of the image, whatever the picture."""
    blank = torch.full((1, 3, 88, 288), 0.5, dtype=torch.float64)
    mu_bkd, _ = network(num_sources=4, anchor_gain=50.0, position_channels=False)(blank)
    # The centre of a block lies between two directions.
    for k, peak in enumerate(mu_bkd[0].argmax(-1).tolist()):
        assert peak - (18 * k + 8.5) == pytest.approx(0, abs=4)


def test_views_are_drawn_in_training_only_and_their_answer_is_turned_back() -> None:
    net = network(augment=True, dropout=0.0)
    looked_at: list[Tensor] = []
    net.down[0].register_forward_pre_hook(lambda _, inputs: looked_at.append(inputs[0][:, :3]))
    plain_bkd, _ = net(image(8))
    assert torch.equal(looked_at.pop(), 2 * image(8) - 1)
    # The flag alone, so that batch norm keeps to its running statistics.
    net.training = True
    torch.manual_seed(3)
    answer_bkd, _ = net(image(8))
    (seen,) = looked_at
    torch.manual_seed(3)
    view = RandomYawFlip.draw(8, 72, seen.device)
    torch.testing.assert_close(seen, view.apply(2 * image(8) - 1))
    net.training = False
    torch.testing.assert_close(answer_bkd, view.undo(net(view.apply(image(8)))[0]))
    assert not torch.equal(answer_bkd, plain_bkd)


def test_every_parameter_learns() -> None:
    net = network(anchor_gain=1.0, augment=True).train()
    mu_bkd, _ = net(image(2))
    (mu_bkd * torch.randn_like(mu_bkd)).sum().backward()
    for name, parameter in net.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().max() > 0, name


def test_dropout_acts_in_training_only() -> None:
    net = network(dropout=0.5)
    assert torch.equal(net(image())[0], net(image())[0])
    net.train()
    assert not torch.equal(net(image())[0], net(image())[0])


@pytest.mark.parametrize("shape", [(2, 3, 2, 4), (1, 1, 1, 5), (1, 1, 1, 1), (1, 2, 3, 2)])
def test_wrapping_differentiates(shape: tuple[int, ...]) -> None:
    x = torch.randn(shape, dtype=torch.float64, requires_grad=True)
    assert torch.equal(_WrapAzimuth.apply(x), torch.nn.functional.pad(x, (1, 1, 0, 0), mode="circular"))
    assert torch.autograd.gradcheck(_WrapAzimuth.apply, (x,))


def test_wrapping_leaves_the_incoming_gradient_alone() -> None:
    x = torch.randn(1, 1, 1, 5, requires_grad=True)
    grad = torch.ones(1, 1, 1, 7)
    torch.autograd.backward(_WrapAzimuth.apply(x), grad)
    assert (grad == 1).all()
