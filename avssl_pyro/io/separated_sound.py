"""The sound of separated sources as files, one WAV per source."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.clip import SAMPLE_RATE


def write_separated(
    folder: Path, name: str, azimuths: Sequence[float], sound_sn: npt.NDArray[np.float32]
) -> list[Path]:
    """Writes ``NAME-source1-az+034.wav`` and so on: mono, 16 kHz, 32-bit float, so that nothing is clipped.

    Args:
        folder: made if it is not there.
        name: what the names of the files begin with.
        azimuths: of the sources, (S,), radians; the names have them in degrees.
        sound_sn: (S, N).

    Returns:
        The files, in the order of the sources.

    Raises:
        OSError: the folder cannot be written to; every file is there whole or not at all.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, (azimuth, sound_n) in enumerate(zip(azimuths, sound_sn, strict=True), start=1):
        stream = io.BytesIO()
        soundfile.write(stream, sound_n, SAMPLE_RATE, format="WAV", subtype="FLOAT")
        path = folder / f"{name}-source{number}-az{round(float(np.rad2deg(azimuth))):+04d}.wav"
        write_atomically(path, stream.getvalue())
        paths.append(path)
    return paths
