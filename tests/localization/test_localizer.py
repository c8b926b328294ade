from dataclasses import replace

import numpy as np
import pytest
import torch
from attrs import evolve

from avssl_pyro.acoustics.channel_gains import ChannelGains
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import ClipPosterior
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system

K, D = 3, 36
CONFIG = SystemConfig(
    PRESETS["circle4"],
    model=ModelConfig(num_sources=K, num_directions=D),
    guide=GuideConfig(visual_channels=(4, 6), audio_channels=4),
    stft=StftConfig(window=64, hop=80),
)


def make_system(initial_sigma: float = 0.3, audio_net: bool = True) -> System:
    torch.manual_seed(0)
    guide = evolve(CONFIG.guide, initial_sigma=initial_sigma, audio_net=audio_net)
    return build_system(replace(CONFIG, guide=guide))


def clips(number: int, microphones: int = 4) -> list[Clip]:
    random = np.random.default_rng(0)
    return [
        Clip(
            f"clip{index}",
            random.uniform(-1, 1, (microphones, 1600)).astype(np.float32),
            random.integers(0, 256, (88, 288, 3)).astype(np.uint8),
        )
        for index in range(number)
    ]


def assert_same(first: ClipPosterior, second: ClipPosterior) -> None:
    for name in ("direction_weights_kd", "mixing_levels_k", "level_std_k", "azimuth_std_k", "activations_kij"):
        np.testing.assert_allclose(getattr(first, name), getattr(second, name), rtol=1e-3, atol=1e-5, err_msg=name)


def test_posterior_is_complete() -> None:
    (posterior,) = Localizer(make_system()).posteriors(clips(1))
    assert posterior.direction_weights_kd.shape == (K, D)
    assert posterior.direction_weights_kd.sum(-1) == pytest.approx(np.ones(K))
    assert posterior.mixing_levels_k.sum() == pytest.approx(1.0)
    assert (posterior.level_std_k > 0).all()
    assert (posterior.azimuth_std_k > 0).all()
    assert posterior.activations_kij is not None
    assert posterior.activations_kij.shape == (K, 22, 72)


def test_a_batch_is_its_clips_one_by_one() -> None:
    localizer = Localizer(make_system(initial_sigma=1.0))
    together = localizer.posteriors(clips(3))
    for clip, posterior in zip(clips(3), together, strict=True):
        assert_same(posterior, localizer.posteriors([clip])[0])


def test_posteriors_depend_on_image_and_sound() -> None:
    localizer = Localizer(make_system())
    first, second = clips(2)
    swapped = Clip("swapped", second.audio_mn, first.image_ijc)
    own, other_sound, other = localizer.posteriors([first, swapped, second])
    np.testing.assert_allclose(own.direction_weights_kd, other_sound.direction_weights_kd, rtol=1e-4)
    assert np.abs(own.mixing_levels_k - other_sound.mixing_levels_k).max() > 1e-6
    assert np.abs(own.direction_weights_kd - other.direction_weights_kd).max() > 1e-6


def test_a_guide_in_training_is_taken_out_of_it() -> None:
    system = make_system()
    system.guide.train()
    localizer = Localizer(system)
    assert_same(localizer.posteriors(clips(1))[0], localizer.posteriors(clips(1))[0])


def test_clips_of_another_array_are_refused_by_name() -> None:
    wrong = [*clips(1), Clip("odd-one", np.zeros((3, 1600), np.float32), clips(1)[0].image_ijc)]
    with pytest.raises(InputError, match=r"odd-one: 3 channels.*4 microphones of array 'circle4'"):
        Localizer(make_system()).posteriors(wrong)


def test_uniform_levels_leave_directions_as_they_are() -> None:
    system = make_system()
    (full,) = Localizer(system).posteriors(clips(1))
    (uniform,) = Localizer(system, uniform_levels=True).posteriors(clips(1))
    assert uniform.mixing_levels_k.tolist() == pytest.approx([1 / K] * K)
    assert (uniform.level_std_k == 0).all()
    np.testing.assert_array_equal(uniform.direction_weights_kd, full.direction_weights_kd)


def test_a_guide_without_audio_network_has_certain_levels() -> None:
    (posterior,) = Localizer(make_system(audio_net=False)).posteriors(clips(1))
    assert posterior.mixing_levels_k.tolist() == pytest.approx([1 / K] * K)
    assert (posterior.level_std_k < 1e-3).all()


def test_spread_of_azimuth_grows_with_sigma() -> None:
    spread = []
    for sigma in (1e-9, 0.01, 0.1):
        system = make_system(initial_sigma=sigma)
        # A fresh network hardly prefers a direction; stronger activations make peaks worth the name.
        with torch.no_grad():
            system.guide.visual.head[-1].weight.mul_(200)
        spread.append(Localizer(system).posteriors(clips(1))[0].azimuth_std_k)
    assert spread[0] == pytest.approx([0.0] * K, abs=1e-3)
    assert spread[0].sum() < spread[1].sum() < spread[2].sum()


def test_pauses_can_be_left_out() -> None:
    loud, other = clips(2)
    # What is heard in the pause comes to all microphones at once.
    quiet_mn = 1e-3 * np.repeat(other.audio_mn[:1], 4, axis=0)
    paused = replace(loud, audio_mn=np.concatenate([loud.audio_mn, quiet_mn], axis=1))
    system = make_system()
    everything, without_pauses = (
        Localizer(system, refinement=RefinementConfig(), audio_only=True, pause_db=pause_db)
        for pause_db in (None, 20.0)
    )
    [expected] = everything.posteriors([loud])
    alone, left_out = without_pauses.posteriors([loud, paused])
    [mixed] = everything.posteriors([paused])
    assert_same(alone, expected)
    error_k, mixed_error_k = (
        np.abs(levels.mixing_levels_k - expected.mixing_levels_k).max() for levels in (left_out, mixed)
    )
    assert error_k < 0.05 < mixed_error_k


def test_one_call_gives_posteriors_and_sources() -> None:
    localizer = Localizer(make_system(), rule=DirectLevelRule(least=0.0, merge_deg=0.0))
    found, expected = localizer.localize(clips(2)), localizer.posteriors(clips(2))
    for localization, posterior in zip(found, expected, strict=True):
        assert_same(localization.posterior, posterior)
        assert localization.sources == localizer.rule.select(posterior, CONFIG.grid)
        assert len(localization.sources) == K


@pytest.mark.parametrize("level", [0.0, 0.1])
def test_a_constant_clip_is_silence(level: float) -> None:
    """Refined without a picture, rounding alone would make sources of it."""
    localizer = Localizer(make_system(), audio_only=True, rule=DirectLevelRule(least=0.0))
    (found,) = localizer.localize([Clip.from_audio("constant", np.full((4, 16_000), level, np.float32))])
    assert found.sources == ()
    np.testing.assert_array_equal(found.posterior.direction_weights_kd, np.full((K, D), 1 / D))


def test_audio_only_ignores_the_images() -> None:
    localizer = Localizer(make_system(), audio_only=True)
    first, second = clips(2)
    (own,) = localizer.posteriors([first])
    (swapped,) = localizer.posteriors([replace(first, image_ijc=second.image_ijc)])
    np.testing.assert_array_equal(own.direction_weights_kd, swapped.direction_weights_kd)
    np.testing.assert_array_equal(own.mixing_levels_k, swapped.mixing_levels_k)


def common_sound(gain_db_m: list[float]) -> Clip:
    """A clip whose microphones share most of their sound, with these gains."""
    rng = np.random.default_rng(1)
    audio_mn = 0.05 * rng.standard_normal((1, 16_000)) + 0.005 * rng.standard_normal((len(gain_db_m), 16_000))
    return Clip.from_audio("gains", (audio_mn * 10 ** (np.array(gain_db_m)[:, None] / 20)).astype(np.float32))


def test_a_louder_channel_changes_nothing_and_small_gains_are_taken_as_they_are() -> None:
    localizer = Localizer(make_system(), refinement=RefinementConfig(rounds=10), audio_only=True)
    trusting = localizer.with_gains(ChannelGains.equal(4))
    (even,) = localizer.posteriors([common_sound([0, 0, 0, 0])])
    (uneven,) = localizer.posteriors([common_sound([0, 0, 9, 0])])
    np.testing.assert_allclose(uneven.direction_weights_kd, even.direction_weights_kd, atol=0.02)
    (trusted,) = trusting.posteriors([common_sound([0, 0, 9, 0])])
    assert np.abs(trusted.direction_weights_kd - even.direction_weights_kd).max() > 0.05
    slight = common_sound([0, 1, 0, -1])
    (left_alone,) = localizer.posteriors([slight])
    (as_it_is,) = trusting.posteriors([slight])
    np.testing.assert_array_equal(left_alone.direction_weights_kd, as_it_is.direction_weights_kd)


def test_given_gains_are_undone_whatever_the_clip() -> None:
    refinement = RefinementConfig(rounds=10)
    localizer = Localizer(
        make_system(),
        refinement=refinement,
        audio_only=True,
        gains=ChannelGains((0.0, 0.0, 9.0, 0.0), (False,) * 4, (False,) * 4),
    )
    clip = common_sound([0, 0, 9, 0])
    assert localizer.gains_of(clip.audio_mn[None]).remarks() == ("channel 3 is 9 dB louder than the others",)
    (given,) = localizer.posteriors([clip])
    (estimated,) = Localizer(make_system(), refinement=refinement, audio_only=True).posteriors([clip])
    np.testing.assert_allclose(given.direction_weights_kd, estimated.direction_weights_kd, atol=0.02)
