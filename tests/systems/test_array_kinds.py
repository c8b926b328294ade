"""Every kind of array goes the whole way: a step of training, a checkpoint, localization."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.acoustics.steering_kinds import MeasuredKind
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.batch import collate_clips
from avssl_pyro.clip import Clip
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.checkpoint import load_checkpoint, save_checkpoint
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import SystemConfig, build_system
from avssl_pyro.training.elbo_terms import TraceMeanFieldELBOWithTerms

GRID = DirectionGrid(36)
TRUE_DIRECTION = 11


@pytest.fixture(params=["circle5", "starss23-mic", "starss23-foa", "measured"])
def array(request: pytest.FixtureRequest, write_sofa: Callable[..., Path]) -> MicrophoneArray:
    if request.param != "measured":
        return PRESETS[request.param]
    sofa = write_sofa(PRESETS["circle4"], np.rad2deg(GRID.azimuths))
    return MicrophoneArray("measured", steering=MeasuredKind.read(sofa))


@pytest.fixture(params=[False, True], ids=["no-room", "room"])
def config(array: MicrophoneArray, request: pytest.FixtureRequest) -> SystemConfig:
    return SystemConfig(
        array,
        ModelConfig(num_sources=2, num_directions=36, room=request.param),
        GuideConfig(visual_channels=(4, 4), audio_channels=4),
        StftConfig(low_hz=300, high_hz=4000, bin_step=4),
    )


@pytest.fixture
def clip(array: MicrophoneArray) -> Clip:
    """White noise from one direction of the grid, heard as the array hears."""
    rng = np.random.default_rng(0)
    num_samples = 4096
    a_fm = array.steering_vectors(GRID, np.fft.rfftfreq(num_samples, 1 / 16_000))[:, TRUE_DIRECTION].numpy()
    source_f = np.fft.rfft(rng.standard_normal(num_samples))
    audio_mn = np.fft.irfft(source_f * a_fm.T) + 0.05 * rng.standard_normal((array.num_microphones, num_samples))
    return Clip("noise", (0.1 * audio_mn).astype(np.float32), np.full((88, 288, 3), 127, dtype=np.uint8))


def test_a_step_of_training_has_finite_gradients(config: SystemConfig, clip: Clip) -> None:
    torch.manual_seed(0)
    system = build_system(config)
    batch = collate_clips([clip, clip])
    loss = TraceMeanFieldELBOWithTerms()(system.model, system.guide)
    loss(stft(batch.audio_bmn, config.stft), batch.image_float()).backward()
    gradients = [value.grad for value in loss.parameters() if value.grad is not None]
    assert gradients
    assert all(gradient.isfinite().all() for gradient in gradients)
    assert any(gradient.any() for gradient in gradients)


def test_a_checkpoint_localizes_by_itself_where_the_sound_comes_from(
    config: SystemConfig, clip: Clip, tmp_path: Path
) -> None:
    torch.manual_seed(0)
    system = build_system(config)
    path = tmp_path / "mine.safetensors"
    save_checkpoint(path, system)
    if isinstance(config.array.steering, MeasuredKind):
        config.array.steering.file.unlink()
    loaded = load_checkpoint(path)
    assert loaded.config == config
    torch.testing.assert_close(loaded.config.steering(), config.steering(), atol=1e-5, rtol=0)
    torch.testing.assert_close(loaded.model.template_dfmm, system.model.template_dfmm, atol=1e-5, rtol=0)
    (posterior,) = Localizer(loaded, refinement=RefinementConfig(rounds=30)).posteriors([clip])
    loudest = posterior.mixing_levels_k.argmax()
    assert abs(posterior.direction_weights_kd[loudest].argmax() - TRUE_DIRECTION) <= 1


def test_steering_is_of_the_array_s_kind(config: SystemConfig) -> None:
    own = config.steering(torch.complex128)
    assert own.shape == (len(config.stft.frequencies), 36, config.array.num_microphones)
    torch.testing.assert_close(own.abs().square().sum(-1), torch.full(own.shape[:2], own.shape[-1]).double())
    if config.array.name == "starss23-mic":
        free = FreeField(config.array)(GRID, config.stft.frequencies)
        assert (own - free).abs().max() > 0.5


def test_a_checkpoint_without_its_measured_responses_is_damaged(
    write_sofa: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steering = MeasuredKind.read(write_sofa(PRESETS["circle2"], np.arange(0.0, 360.0, 10.0)))
    small = GuideConfig(visual_channels=(4, 4), audio_channels=4)
    system = build_system(
        SystemConfig(
            MicrophoneArray("measured", steering=steering), ModelConfig(2, 8), small, StftConfig(window=64, hop=32)
        )
    )
    path = tmp_path / "mine.safetensors"
    monkeypatch.setattr("avssl_pyro.systems.checkpoint._stored_responses", lambda _: {})
    save_checkpoint(path, system)
    with pytest.raises(InputError, match=r"mine\.safetensors: the measured responses .* missing or damaged"):
        load_checkpoint(path)


def test_rooms_are_not_simulated_for_measured_responses(write_sofa: Callable[..., Path]) -> None:
    steering = MeasuredKind.read(write_sofa(PRESETS["circle2"], np.arange(0.0, 360.0, 10.0)))
    with pytest.raises(InputError, match=r"array 'measured' is described by .* from above and below; give recordings"):
        SceneSimulator(array=MicrophoneArray("measured", steering=steering))


@pytest.mark.parametrize("name", ["starss23-mic", "starss23-foa"])
def test_scenes_are_made_for_arrays_that_scatter_or_encode(name: str) -> None:
    audio_mn = SceneSimulator(array=PRESETS[name]).render(0).clip.audio_mn
    assert audio_mn.shape == (4, 16_000)
    assert 0.2 < np.abs(audio_mn).max() < 1.0


def test_thirty_two_capsules_have_a_likelihood_in_single_precision() -> None:
    torch.manual_seed(0)
    config = SystemConfig(
        PRESETS["eigenmike32"],
        ModelConfig(num_sources=2, num_directions=12, diffuse=1e-3),
        GuideConfig(visual_channels=(4, 4), audio_channels=4),
        StftConfig(low_hz=300, high_hz=7000, bin_step=64),
    )
    single, double = build_system(config), build_system(config, torch.float64)
    x_bfmt = torch.randn(1, len(config.stft.frequencies), 32, 5, dtype=torch.complex128)
    w_bkd, pi_bk = torch.rand(1, 2, 12).double() ** 8 + 1e-9, torch.tensor([[0.3, 0.7]]).double()
    found, expected = (
        SpatialMixture(system.model.template_dfmm, w_bkd.to(real), pi_bk.to(real), num_frames=5, diffuse=1e-3).log_prob(
            x_bfmt.to(complex_)
        )
        for system, real, complex_ in (
            (single, torch.float32, torch.complex64),
            (double, torch.float64, torch.complex128),
        )
    )
    torch.testing.assert_close(found.double(), expected, rtol=1e-3, atol=0)
