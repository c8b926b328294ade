"""The methods that stand beside each other in a comparison on one array."""

from dataclasses import asdict, dataclass
from typing import Any

from avssl_pyro.benchmarks.posterior_method import SOURCE_SETTINGS, PosteriorMethod
from avssl_pyro.evaluation.baselines import DEFAULT_BAND_HZ, PEAK_SETTINGS, default_baselines
from avssl_pyro.evaluation.methods import Method
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer, audio_only_refinement
from avssl_pyro.systems.checkpoint import fingerprint
from avssl_pyro.systems.system import System


def system_band_hz(system: System) -> tuple[float, float]:
    """The band a system listens to, up to and without the next bin, as pyroomacoustics leaves out the upper end."""
    config = system.config.stft
    frequencies_f = config.frequencies
    return float(frequencies_f[0]), float(frequencies_f[-1] + config.sample_rate / config.window)


@dataclass(frozen=True)
class MethodSuite:
    """Baselines and a trained system on the system's array and grid.

    Args:
        system: whose rows are ``amortized`` and ``refined``.
        without_audio: whose row is ``no-audio-net``, with every mixing level at 1/K.
        refinement: of the rows ``refined`` and ``audio-only refined``; the latter starts without the picture.
        baseline_band_hz: frequencies that the baselines search.
        workers: processes of the baselines; None is one per core.
        device: of the networks.
    """

    system: System
    without_audio: System
    refinement: RefinementConfig
    baseline_band_hz: tuple[float, float] = DEFAULT_BAND_HZ
    workers: int | None = 1
    device: str = "cpu"

    def methods(self) -> list[Method[Any, Any]]:
        """All methods, fresh."""
        config = self.system.config
        grid = config.grid
        localizers = {
            "audio-only refined": Localizer(self.system, self.device, refinement=self.refinement, audio_only=True),
            "no-audio-net": Localizer(self.without_audio, self.device, uniform_levels=True),
            "amortized": Localizer(self.system, self.device),
        }
        localizers["refined"] = Localizer(self.system, self.device, refinement=self.refinement)
        return [
            *default_baselines(config.array, grid, self.workers, self.baseline_band_hz),
            *(PosteriorMethod(name, localizer.posteriors, grid) for name, localizer in localizers.items()),
        ]

    def facts(self) -> dict[str, Any]:
        """Everything that decides the methods' answers, as JSON values."""
        return {
            "system": fingerprint(self.system),
            "without_audio": fingerprint(self.without_audio),
            "refinement": asdict(self.refinement),
            "blind_refinement": asdict(audio_only_refinement(self.refinement)),
            "baseline_band_hz": list(self.baseline_band_hz),
            "source_settings": [asdict(setting) for setting in SOURCE_SETTINGS],
            "peak_settings": [asdict(setting) for setting in PEAK_SETTINGS],
        }
