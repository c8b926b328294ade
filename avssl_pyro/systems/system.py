"""A whole system by its configuration: array, networks, model and guide."""

from dataclasses import dataclass, field
from typing import Any

import pyro.settings
import torch
from torch import Tensor

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import AmortizedGuide, UniformLevelGuide
from avssl_pyro.models.likelihoods import Likelihood, PrecedenceGaussian, ProfiledGaussian
from avssl_pyro.models.priors import LogNormalWeights, SparseDirichlet
from avssl_pyro.models.room import Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet
from avssl_pyro.systems.config import GuideConfig, ModelConfig


@dataclass(frozen=True)
class SystemConfig:
    """Configuration of a system, enough to rebuild it before its weights are loaded.

    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> SystemConfig(PRESETS["circle4"]).steering().shape
    torch.Size([257, 72, 4])
    """

    array: MicrophoneArray
    model: ModelConfig = field(default_factory=ModelConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    stft: StftConfig = field(default_factory=StftConfig)

    def __post_init__(self) -> None:
        if self.stft.sample_rate != SAMPLE_RATE:
            raise InputError(
                f"STFT: the sample rate is {self.stft.sample_rate} Hz; clips are resampled to {SAMPLE_RATE} Hz."
            )
        if self.guide.diffuse_class and self.model.num_sources < 2:
            raise InputError("one source class alone cannot be kept for diffuse noise; give num_sources of at least 2.")

    @property
    def grid(self) -> DirectionGrid:
        return DirectionGrid(self.model.num_directions)

    def steering(self, dtype: torch.dtype = torch.complex64) -> Tensor:
        """Steering vectors of the array, (F, D, M)."""
        return self.array.steering_vectors(self.grid, self.stft.frequencies).to(dtype)

    def room(self) -> Room | None:
        """The room of the array, in double precision; None without one."""
        return Room.of_array(self.array, self.grid, self.stft.frequencies) if self.model.room else None

    def likelihood(self) -> Likelihood:
        """The likelihood of a spectrogram."""
        if not self.model.room:
            return ProfiledGaussian()
        return PrecedenceGaussian(frame_s=self.stft.hop / self.stft.sample_rate)


@dataclass(frozen=True)
class System:
    """A model and a guide that belong together.

    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> build_system(SystemConfig(PRESETS["circle4"])).model.num_sources
    4
    """

    config: SystemConfig
    model: SpatialCGMM
    guide: AmortizedGuide | UniformLevelGuide

    def model_with(self, **parts: Any) -> SpatialCGMM:
        """This system's model with other parts.

        Args:
            parts: arguments to replace: ``level_prior``, ``direction_prior``, ``likelihood`` or any other of
                :class:`SpatialCGMM`.
        """
        own = self.model
        usual = {
            "num_sources": own.num_sources,
            "level_prior": own.level_prior,
            "direction_prior": own.direction_prior,
            "diffuse": own.diffuse,
            "bin_weight": own.bin_weight,
            "likelihood": own.likelihood,
            "room": own.room,
        }
        return SpatialCGMM(self.config.steering(), **{**usual, **parts}).to(own.template_pairs.device)

    def state_dict(self) -> dict[str, Tensor]:
        """Weights of model and guide, prefixed ``model.`` and ``guide.``."""
        return {
            f"{part}.{name}": value
            for part, module in (("model", self.model), ("guide", self.guide))
            for name, value in module.state_dict().items()
        }

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Loads what :meth:`state_dict` returned.

        Raises:
            RuntimeError: names or shapes differ from the configuration's.
        """
        for part, module in (("model", self.model), ("guide", self.guide)):
            prefix = f"{part}."
            own = {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
            module.load_state_dict(own)


def build_system(config: SystemConfig, dtype: torch.dtype = torch.float32) -> System:
    """Model and guide with fresh weights, drawn from torch's global generator.

    Parameters live in the modules, not in Pyro's global store, so that torch optimizers, deep copies and data
    parallelism see them.
    """
    dtype_of_x = torch.complex128 if dtype == torch.float64 else torch.complex64
    steering_fdm = config.steering(dtype_of_x)
    options, sizes = config.guide, config.model
    room = config.room()
    num_diffuse = 0 if room is None else room.num_components
    with pyro.settings.context(module_local_params=True):
        model = SpatialCGMM(
            steering_fdm,
            sizes.num_sources,
            level_prior=SparseDirichlet(sizes.alpha),
            direction_prior=LogNormalWeights(sizes.sigma),
            diffuse=sizes.diffuse,
            bin_weight=sizes.bin_weight,
            likelihood=config.likelihood(),
            room=room,
        )
        visual = VisualNet(
            sizes.num_sources - options.diffuse_class,
            sizes.num_directions,
            options.visual_channels,
            options.dropout,
            options.circular,
            options.position_channels,
            options.anchor_gain,
            options.augment,
        )
        if options.audio_net:
            audio = AudioNet(steering_fdm, options.audio_channels, dropout=options.dropout, num_diffuse=num_diffuse)
            guide: AmortizedGuide | UniformLevelGuide = AmortizedGuide(
                visual, audio, options.initial_sigma, options.initial_beta, options.diffuse_class
            )
        else:
            guide = UniformLevelGuide(visual, options.initial_sigma, options.diffuse_class, num_diffuse)
        return System(config, model.to(dtype), guide.to(dtype))
