import torch
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.networks.augmentation import RandomYawFlip

D = 12


def view(turns: list[int], signs: list[int]) -> RandomYawFlip:
    return RandomYawFlip(D, torch.tensor(turns)[:, None], torch.tensor(signs)[:, None])


@given(
    turns=st.lists(st.integers(0, D - 1), min_size=2, max_size=2),
    signs=st.lists(st.sampled_from([-1, 1]), min_size=2, max_size=2),
    per_direction=st.integers(1, 3),
)
def test_undo_takes_back_what_apply_did(turns: list[int], signs: list[int], per_direction: int) -> None:
    x = torch.rand(2, 3, 4, D * per_direction)
    assert torch.equal(view(turns, signs).undo(view(turns, signs).apply(x)), x)


@given(turn=st.integers(0, D - 1), sign=st.sampled_from([-1, 1]), direction=st.integers(0, D - 1))
def test_an_object_in_the_picture_and_its_direction_turn_alike(turn: int, sign: int, direction: int) -> None:
    """What a network finds in the turned picture must come back at the object's own direction."""
    picture = torch.zeros(1, 1, 1, 4 * D)
    picture[..., 4 * direction : 4 * direction + 4] = 1
    seen = view([turn], [sign]).apply(picture)
    found = torch.nn.functional.adaptive_avg_pool2d(seen, (1, D))[:, 0]
    assert found.max() == 1, "an object must fill a direction of the view, not parts of two"
    assert view([turn], [sign]).undo(found).argmax().item() == direction


def test_every_clip_gets_a_view_of_its_own_and_the_seed_decides() -> None:
    torch.manual_seed(0)
    first = RandomYawFlip.draw(64, D, torch.device("cpu"))
    torch.manual_seed(0)
    again = RandomYawFlip.draw(64, D, torch.device("cpu"))
    assert torch.equal(first.turn_b1, again.turn_b1)
    assert torch.equal(first.sign_b1, again.sign_b1)
    assert set(first.turn_b1.flatten().tolist()) == set(range(D))
    assert set(first.sign_b1.flatten().tolist()) == {-1, 1}
