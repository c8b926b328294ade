"""Responses of a make-believe room, as somebody measured them, and somebody's dry speech."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech

RATE = 16_000
# Sound before the measurement's loudspeaker is heard, and the room's decay.
DELAY_S, TAIL_S = 0.02, 0.2


def response(
    array: MicrophoneArray, azimuth_deg: float, rate: int = RATE, tail: float = 0.05
) -> npt.NDArray[np.float64]:
    """A direct sound of height 1, (N, M), and a decay of independent noise of that height beside it."""
    azimuth, size = np.deg2rad(azimuth_deg), round(0.25 * rate)
    lead_m = array.positions @ [np.cos(azimuth), np.sin(azimuth), 0.0] / array.speed_of_sound
    frequencies = np.fft.rfftfreq(size, 1 / rate)
    direct_nm = np.fft.irfft(np.exp(-2j * np.pi * frequencies[:, None] * (DELAY_S - lead_m)), size, axis=0)
    time_n = np.arange(size) / rate - DELAY_S
    decay_n = np.where(time_n > 0.002, 10 ** (-3 * time_n / TAIL_S), 0)
    noise_nm = np.random.default_rng(round(azimuth_deg) % 360).standard_normal((size, array.num_microphones))
    return direct_nm + tail * decay_n[:, None] * noise_nm


def write_room(folder: Path, array: MicrophoneArray, azimuths_deg: Sequence[float], setting: str = "hall") -> Path:
    """Writes responses and labels.csv into a folder; every third file is FLAC, every fourth has 48 kHz."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["file,setting,azimuth_deg"]
    for number, azimuth_deg in enumerate(azimuths_deg):
        name = f"{number}.{'wav' if number % 3 else 'flac'}"
        rate = RATE if number % 4 else 3 * RATE
        soundfile.write(folder / name, 0.5 * response(array, azimuth_deg, rate), rate, subtype="PCM_24")
        lines.append(f"{name},{setting},{azimuth_deg:g}")
    (folder / "labels.csv").write_text("\n".join(lines) + "\n")
    return folder


def write_speech(folder: Path, num_files: int = 3) -> Path:
    """Writes dry speech of three seconds a file."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(num_files):
        speech_n = ProceduralSpeech().draw(np.random.default_rng(number), 3 * RATE)
        soundfile.write(folder / f"{number}.wav", 0.1 * speech_n, RATE)
    return folder
