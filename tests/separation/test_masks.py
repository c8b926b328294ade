from dataclasses import replace

import numpy as np
import pytest
import torch
from anechoic import GRID, scene

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.separation.masks import fitted_masks, masks_of_sources, posterior_masks

ARRAY = PRESETS["circle4"]
STFT = StftConfig(window=512, hop=256)
TEMPLATE_DFMM = template_covariances(ARRAY.steering_vectors(GRID, STFT.frequencies))
SCENE = scene(ARRAY, (40.0, -100.0))
OBSERVED = observe(stft(torch.from_numpy(SCENE.audio_mn).double()[None], STFT)[0])


def source(*classes: int) -> LocalizedSource:
    return LocalizedSource(0.0, 0.03, 0.3, 0.01, 0.2, classes[0], classes[1:])


def test_masks_are_probabilities_and_follow_their_classes() -> None:
    gamma_fkt = posterior_masks(OBSERVED, TEMPLATE_DFMM, SCENE.posterior, 0.1)
    assert gamma_fkt.min() >= 0
    torch.testing.assert_close(gamma_fkt.sum(1), torch.ones_like(gamma_fkt[:, 0]))
    order = [2, 0, 1]
    swapped = replace(
        SCENE.posterior,
        direction_weights_kd=SCENE.posterior.direction_weights_kd[order],
        mixing_levels_k=SCENE.posterior.mixing_levels_k[order],
    )
    torch.testing.assert_close(posterior_masks(OBSERVED, TEMPLATE_DFMM, swapped, 0.1), gamma_fkt[:, order])


def test_posteriors_of_models_without_a_room_use_directions_alone_and_others_must_fit() -> None:
    diffuse_cfmm = torch.eye(ARRAY.num_microphones).to(TEMPLATE_DFMM).expand(2, *TEMPLATE_DFMM.shape[1:])
    room_jfmm = torch.cat([TEMPLATE_DFMM, diffuse_cfmm])
    plain_fkt = posterior_masks(OBSERVED, TEMPLATE_DFMM, SCENE.posterior, 0.1)
    torch.testing.assert_close(posterior_masks(OBSERVED, room_jfmm, SCENE.posterior, 0.1), plain_fkt)
    k = len(SCENE.posterior.mixing_levels_k)
    none, one, two = (replace(SCENE.posterior, diffuse_shares_kc=np.full((k, c), 0.2)) for c in (0, 1, 2))
    torch.testing.assert_close(posterior_masks(OBSERVED, TEMPLATE_DFMM, none, 0.1), plain_fkt)
    assert (posterior_masks(OBSERVED, room_jfmm, two, 0.1) - plain_fkt).abs().max() > 0.01
    for template_jfmm, posterior, found in ((TEMPLATE_DFMM, two, "2 .* system 0"), (room_jfmm, one, "1 .* system 2")):
        with pytest.raises(InputError, match=f"the posterior has {found}"):
            posterior_masks(OBSERVED, template_jfmm, posterior, 0.1)


@pytest.mark.parametrize("reverberation", [0.0, 0.4, 1.0])
def test_sources_have_all_their_classes_and_a_share_of_the_rest(reverberation: float) -> None:
    gamma_fkt = torch.rand(3, 5, 7, dtype=torch.float64).softmax(1)
    mask_fst = masks_of_sources(gamma_fkt, [source(3, 0), source(2)], reverberation)
    torch.testing.assert_close(mask_fst.sum(1), torch.ones(3, 7, dtype=torch.float64))
    torch.testing.assert_close(mask_fst[:, 2], (1 - reverberation) * (gamma_fkt[:, 1] + gamma_fkt[:, 4]))
    own_ft, other_ft = gamma_fkt[:, 3] + gamma_fkt[:, 0], gamma_fkt[:, 2]
    torch.testing.assert_close(mask_fst[:, 0] / mask_fst[:, 1], own_ft / other_ft)


def test_a_bin_of_no_source_at_all_is_left_to_noise() -> None:
    gamma_fkt = torch.tensor([0.0, 1.0], dtype=torch.float64)[None, :, None]
    assert masks_of_sources(gamma_fkt, [source(0)], 1.0).flatten().tolist() == [0.0, 1.0]


@pytest.mark.parametrize("rounds", [0, 1, 4])
def test_fitting_keeps_masks_probabilities_and_sources_in_order(rounds: int) -> None:
    gamma_fkt = posterior_masks(OBSERVED, TEMPLATE_DFMM, SCENE.posterior, 0.1)
    start_fst = masks_of_sources(gamma_fkt, SCENE.sources, 0.5)
    fitted_fst = fitted_masks(OBSERVED, start_fst, rounds)
    torch.testing.assert_close(fitted_fst.sum(1), torch.ones_like(fitted_fst[:, 0]))
    images = torch.from_numpy(SCENE.images_smn[[source.source_class for source in SCENE.sources]])
    louder_ft = stft(images, STFT).abs().square().sum(2).argmax(0)
    loud_ft = OBSERVED.features_bfct[:, :4].sum(1) > OBSERVED.features_bfct[:, :4].sum(1).quantile(0.8)
    agree_ft = fitted_fst[:, :2].argmax(1) == louder_ft
    assert agree_ft[loud_ft].double().mean() > 0.85


def test_fitting_copes_with_silence_and_with_a_class_without_bins() -> None:
    silent = observe(torch.zeros(3, 4, 6, dtype=torch.complex128))
    start_fst = torch.tensor([0.5, 0.5, 0.0], dtype=torch.float64)[None, :, None].expand(3, 3, 6)
    for observed in (silent, observe(torch.randn(3, 4, 6, dtype=torch.complex128))):
        fitted_fst = fitted_masks(observed, start_fst, 3)
        assert fitted_fst.isfinite().all()
        assert np.allclose(fitted_fst.sum(1), 1)
