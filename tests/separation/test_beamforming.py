import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.separation.beamforming import Extraction, Masking, Mvdr, WienerFilter, delay_and_sum

F, M, T = 5, 4, 60
WAYS: list[Extraction] = [WienerFilter(), Mvdr(), Masking()]


def complex_noise(seed: int, *shape: int) -> Tensor:
    return torch.randn(*shape, dtype=torch.complex128, generator=torch.Generator().manual_seed(seed))


@given(st.integers(0, 10_000), st.integers(0, M - 1))
def test_mvdr_passes_a_source_of_rank_one_as_the_reference_microphone_hears_it(seed: int, reference: int) -> None:
    transfer_fm, source_ft = complex_noise(seed, F, M), complex_noise(seed + 1, F, T)
    # It alone in the first half, others alone in the second; whatever they are, nothing of it may be lost.
    image_fmt = transfer_fm[..., None] * source_ft[:, None]
    image_fmt[..., T // 2 :] = 0
    others_fmt = complex_noise(seed + 2, F, M, T)
    others_fmt[..., : T // 2] = 0
    mask_ft = (torch.arange(T) < T // 2).double().expand(F, T)
    extracted_ft = Mvdr()(image_fmt + others_fmt, mask_ft, reference)
    torch.testing.assert_close(extracted_ft[:, : T // 2], image_fmt[:, reference, : T // 2])
    # And of the others less is left than the reference microphone has.
    assert extracted_ft[:, T // 2 :].abs().square().sum() < others_fmt[:, reference].abs().square().sum() * 2


@pytest.mark.parametrize("way", [WienerFilter(), Masking()])
def test_a_mask_of_ones_returns_the_reference_microphone(way: Extraction) -> None:
    x_fmt = complex_noise(0, F, M, T)
    extracted_ft = way(x_fmt, torch.ones(F, T, dtype=torch.float64), 2)
    torch.testing.assert_close(extracted_ft, x_fmt[:, 2], rtol=0.01, atol=0.01)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("mask", [0.0, 0.3, 1.0])
def test_silence_and_dead_microphones_stay_finite(way: Extraction, mask: float) -> None:
    mask_ft = torch.full((F, T), mask, dtype=torch.float64)
    assert not way(torch.zeros(F, M, T, dtype=torch.complex128), mask_ft, 0).any()
    x_fmt = complex_noise(0, F, M, T)
    x_fmt[:, 1] = 0
    assert way(x_fmt, mask_ft, 0).isfinite().all()
    assert not way(x_fmt, mask_ft, 1).any()


def test_the_wiener_filter_leaves_less_error_than_any_other_way() -> None:
    """A target of rank one among noise that the microphones share, with the best masks there are."""
    image_fmt = complex_noise(0, F, M)[..., None] * complex_noise(1, F, T)[:, None]
    others_fmt = complex_noise(2, F, M)[..., None] * complex_noise(3, F, T)[:, None] + 0.3 * complex_noise(4, F, M, T)
    power_ft, other_power_ft = image_fmt.abs().square().sum(1), others_fmt.abs().square().sum(1)
    mask_ft = power_ft / (power_ft + other_power_ft)
    error = [
        float((way(image_fmt + others_fmt, mask_ft, 0) - image_fmt[:, 0]).abs().square().mean())
        for way in (WienerFilter(), Mvdr())
    ]
    assert error[0] < error[1]
    assert error[0] < float(others_fmt[:, 0].abs().square().mean()) / 2


@pytest.mark.parametrize("name", ["circle6", "starss23-foa"])
@pytest.mark.parametrize("reference", [0, 1])
def test_delay_and_sum_passes_its_own_plane_wave_unchanged(name: str, reference: int) -> None:
    array = PRESETS[name]
    frequencies = np.array([250.0, 1000.0, 5000.0])
    unit_vector = np.array([[0.6, 0.48, 0.64]])
    steering_fm = torch.from_numpy(array.steering.model(array).pressure(unit_vector, frequencies)[:, 0])
    image_fmt = steering_fm[..., None] * complex_noise(0, 3, T)[:, None]
    torch.testing.assert_close(delay_and_sum(image_fmt, steering_fm, reference), image_fmt[:, reference])
