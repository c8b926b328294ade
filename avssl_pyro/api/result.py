"""The result of localizing one clip: sources, posterior, drawing and separated sounds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import write_separated
from avssl_pyro.io.images import save_png
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.localization.results import Localization
from avssl_pyro.separation.separator import SeparationConfig, Separator
from avssl_pyro.viz.overlay import draw_overlay
from avssl_pyro.viz.polar import Circle, draw_circles, figure_pixels

if TYPE_CHECKING:
    from avssl_pyro.api.model import Model

PLOT_DPI = 240


@dataclass(frozen=True)
class Result:
    """The sources of one clip, with the posterior behind them.

    Args:
        model: model that estimated them.
        clip: audio and image, as the model takes them.
        localization: posterior and sources.
        has_image: whether an image was given.
        context: names of the files.

    >>> from avssl_pyro.api.model import load
    >>> result = load("circle4").localize(np.zeros((4, 16_000)), np.zeros((88, 288, 3), np.uint8))
    >>> result
    Result(no source)
    >>> result.plot().shape
    (386, 1152, 3)
    >>> result.to_dict()["format"]
    'avssl-result/1'
    >>> result.separate().shape
    (0, 16000)
    """

    model: "Model"
    clip: Clip
    localization: Localization
    has_image: bool
    context: dict[str, Any]

    def __repr__(self) -> str:
        found = ", ".join(f"{source.azimuth_deg:+.0f}° (level {source.level:.2f})" for source in self.sources)
        return f"Result({found or 'no source'})"

    @property
    def sources(self) -> tuple[LocalizedSource, ...]:
        """The sources, loudest first."""
        return self.localization.sources

    @property
    def posterior(self) -> ClipPosterior:
        """Posterior means and spreads of directions and levels."""
        return self.localization.posterior

    def to_dict(self, separated: Sequence[Path] | None = None) -> dict[str, Any]:
        """JSON values of the result, ``avssl-result/1``.

        Args:
            separated: files with the sound of each source, as :meth:`save_sounds` returns them.
        """
        model = self.model
        context = {**self.context, "array": model.array.to_dict(), "checkpoint": model.weights}
        return self.localization.to_dict(separated, **context)

    def plot(self, path: str | Path | None = None, *, truth_deg: Sequence[float] = ()) -> npt.NDArray[np.uint8]:
        """Draws the sources over the image, or on a circle where there is none.

        Args:
            path: PNG file to write.
            truth_deg: true azimuths in degrees, drawn as triangles.

        Returns:
            The drawing, RGB, (H, W, 3).

        Raises:
            InputError: the file's name does not end in .png.
        """
        if path is not None and Path(path).suffix.lower() != ".png":
            raise InputError(f"{path}: pictures are written as PNG; give a name that ends in .png.")
        posterior, sources, truth = self.posterior, self.sources, np.deg2rad(truth_deg)
        if self.has_image:
            drawing_ijc = draw_overlay(self.clip.image_ijc, posterior, sources, self.localization.grid, truth=truth)
        else:
            circle = Circle.of(posterior, sources, SceneLabels(tuple(truth)))
            drawing_ijc = figure_pixels(draw_circles({self.clip.key: circle}), dpi=PLOT_DPI)
        if path is not None:
            save_png(Path(path), drawing_ijc)
        return drawing_ijc

    def separate(self, config: SeparationConfig | None = None) -> npt.NDArray[np.float32]:
        """The sound of every source at one microphone, (S, N), 16 kHz, in the order of the sources.

        Args:
            config: settings of the separation.

        Raises:
            InputError: the reference microphone is not one of the array's.
        """
        model = self.model
        separator = model.separator if config is None else Separator(model.system.config, config)
        gains = model.localizer.gains_of(self.clip.audio_mn[None])
        return separator.separate(gains.compensated(self.clip.audio_mn), self.posterior, self.sources)

    def save_sounds(self, folder: str | Path, name: str | None = None) -> list[Path]:
        """Writes the sound of every source as a 16 kHz WAV file, and returns the paths.

        Args:
            folder: folder to write to; it is made if it is not there.
            name: beginning of the files' names; by default the name of the clip.
        """
        azimuths = [source.azimuth for source in self.sources]
        return write_separated(Path(folder), name or self.clip.key, azimuths, self.separate())
