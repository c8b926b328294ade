"""Models that localize clips and recordings, and their results."""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import check_trained_array
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.api.result import Result
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.audio import fit_audio, read_audio
from avssl_pyro.io.images import fit_panorama, read_image
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.recordings.recording import Alignment
from avssl_pyro.separation.separator import Separator
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.pretrained import load_pretrained
from avssl_pyro.systems.system import System
from avssl_pyro.tracking.recording_localizer import (
    default_rate_hz,
    localize_recording,
    open_recording,
)
from avssl_pyro.tracking.timeline import Timeline

PRETRAINED_NAME = "shipped"


def load(
    source: str | Path | MicrophoneArray,
    *,
    array: str | Path | MicrophoneArray | None = None,
    device: str | torch.device = "cpu",
    rounds: int = RefinementConfig().rounds,
    rule: DirectLevelRule | None = None,
) -> "Model":
    """Loads a model: pretrained weights for an array, or a checkpoint of training.

    Args:
        source: name of an array preset, path of an array's YAML file, an array, or path of a checkpoint (.safetensors).
        array: array that recorded, by preset, file or object, where a checkpoint's own has other channels.
        device: torch device of the computation.
        rounds: most rounds of refinement per clip; 0 leaves the networks' posterior, faster and less accurate.
        rule: conditions under which a class counts as a source.

    Raises:
        InputError: nothing has that name, a file cannot be read, or the checkpoint was trained for another array.

    >>> load("circle4")
    Model(array='circle4', weights='shipped')
    >>> load("circle7")
    Traceback (most recent call last):
    ...
    avssl_pyro.errors.InputError: array 'circle7' is neither a preset (circle2, ...) nor a YAML file.
    """
    if rounds < 0:
        raise InputError(f"load: rounds is {rounds}; give a number of rounds of refinement, or 0 for none.")
    refinement = RefinementConfig(rounds=rounds) if rounds else None
    if isinstance(source, MicrophoneArray) or Path(source).suffix != ".safetensors":
        if array is not None:
            raise InputError(f"load: {source} names an array already; leave out 'array', which goes with a checkpoint.")
        served = resolve_array(source)
        return Model(load_pretrained(served).system, served, PRETRAINED_NAME, device, refinement, rule)
    system = load_checkpoint(Path(source))
    served = system.config.array if array is None else resolve_array(array)
    check_trained_array(system.config.array, served, str(source))
    return Model(system, served, str(source), device, refinement, rule)


class Model:
    """A system ready to localize the recordings of one array; :func:`load` returns it.

    Args:
        system: model and guide.
        array: microphones that recorded, with the channels they are on.
        weights: path of the checkpoint, or "shipped".
        device: torch device of the computation.
        refinement: settings of the refinement of every clip's posterior; None for one forward pass.
        rule: conditions under which a class counts as a source.

    Raises:
        InputError: the device is not available.

    >>> load("circle4").localize(np.zeros((4, 16_000)), np.zeros((88, 288, 3), np.uint8)).sources
    ()
    """

    def __init__(
        self,
        system: System,
        array: MicrophoneArray,
        weights: str,
        device: str | torch.device = "cpu",
        refinement: RefinementConfig | None = None,
        rule: DirectLevelRule | None = None,
    ) -> None:
        self.system = system
        self.array = array
        self.weights = weights
        self.localizer = Localizer(system, device, refinement=refinement, rule=rule)
        self._refinement = refinement
        self._rule = rule

    def __repr__(self) -> str:
        return f"Model(array='{self.array.name}', weights='{self.weights}')"

    @cached_property
    def audio_only_localizer(self) -> Localizer:
        """The localizer of clips without an image.

        Raises:
            InputError: the model was loaded without rounds of refinement.
        """
        if self._refinement is None:
            raise InputError(
                "without an image the posterior comes from refinement alone; load the model with rounds above 0."
            )
        return Localizer(
            self.system,
            self.localizer.device,
            refinement=self._refinement,
            audio_only=True,
            rule=self._rule,
        )

    @cached_property
    def separator(self) -> Separator:
        """The separator of this model's clips."""
        return Separator(self.system.config)

    def localize(
        self,
        audio: str | Path | npt.ArrayLike,
        image: str | Path | npt.ArrayLike | None = None,
        *,
        sample_rate: int | None = None,
    ) -> Result:
        """Estimates the sources of one clip.

        Args:
            audio: WAV or FLAC file of any rate, or floats in [-1, 1], (M, N), one row per channel.
            image: equirectangular image file, or uint8 RGB (H, W, 3), twice as wide as high or 88 x 288. Without it
                the sources are estimated from the audio alone.
            sample_rate: sample rate of an audio array in Hz; by default 16000.

        Raises:
            InputError: a file cannot be read, or an array has another shape or type.

        >>> result = load("circle4").localize(np.zeros((4, 16_000)))
        >>> result.sources
        ()
        """
        context = {}
        if isinstance(audio, str | Path):
            if sample_rate is not None:
                raise InputError(f"{audio}: a file has its own sample rate; leave out 'sample_rate'.")
            audio_mn, key = read_audio(Path(audio), self.array), Path(audio).stem
            context["audio"] = str(audio)
        else:
            rate = SAMPLE_RATE if sample_rate is None else sample_rate
            audio_mn, key = _audio_array(np.asarray(audio), rate, self.array), "clip"
        if image is None:
            clip = Clip.from_audio(key, audio_mn)
        elif isinstance(image, str | Path):
            clip = Clip(key, audio_mn, read_image(Path(image)))
            context["image"] = str(image)
        else:
            clip = Clip(key, audio_mn, _image_array(np.asarray(image)))
        localizer = self.audio_only_localizer if image is None else self.localizer
        (localization,) = localizer.localize([clip])
        return Result(self, clip, localization, image is not None, context)

    def localize_recording(
        self,
        audio: str | Path,
        video: str | Path | None = None,
        *,
        alignment: Alignment | None = None,
        rate_hz: float | None = None,
        tracking: bool = True,
        progress: bool = False,
    ) -> Timeline:
        """Estimates the sources of a whole recording over time.

        Args:
            audio: WAV or FLAC file of any length and rate, one channel per microphone.
            video: equirectangular video. Without it the sources are estimated from the audio alone.
            alignment: position of the picture relative to the array; by default its centre is straight ahead.
            rate_hz: results per second, each of one second of sound; by default 2, or 10 without refinement.
            tracking: link the results, so that a source keeps its number and a short miss is bridged.
            progress: show a progress bar.

        Raises:
            InputError: a file cannot be read, or is not of this array.
        """
        if alignment is None:
            alignment = Alignment()
        if alignment.channels is None and self.array.channels is not None:
            alignment = replace(alignment, channels=self.array.channel_indices)
        recording = open_recording(Path(audio), None if video is None else Path(video), self.array, alignment)
        localizer = self.audio_only_localizer if video is None else self.localizer
        rate_hz = default_rate_hz(self._refinement is not None) if rate_hz is None else rate_hz
        return localize_recording(recording, localizer, rate_hz=rate_hz, tracking=tracking, progress=progress)


def _audio_array(audio: npt.NDArray[Any], rate: float, array: MicrophoneArray) -> npt.NDArray[np.float32]:
    if audio.ndim != 2:
        raise InputError(f"audio: its shape is {audio.shape}; give (M, N), one row of samples per channel.")
    if not np.issubdtype(audio.dtype, np.floating):
        raise InputError(f"audio: its type is {audio.dtype}; give floats from -1 to 1, such as 16-bit samples / 32768.")
    if not (isinstance(rate, int | float) and rate > 0 and rate == int(rate)):
        raise InputError(f"audio: sample_rate is {rate}; give a positive whole number of Hz.")
    if audio.shape[0] > audio.shape[1]:
        raise InputError(
            f"audio: its shape is {audio.shape}; give (M, N), one row of samples per channel (its transpose)."
        )
    return fit_audio(audio.T.astype(np.float32), int(rate), array, "audio")


def _image_array(image: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    if image.ndim != 3 or image.shape[-1] != 3:
        raise InputError(f"image: its shape is {image.shape}; give RGB, (H, W, 3).")
    if image.dtype != np.uint8:
        raise InputError(f"image: its type is {image.dtype}; give uint8 from 0 to 255.")
    return fit_panorama(np.ascontiguousarray(image), "image")
