"""SRP-PHAT, MUSIC and NormMUSIC along a whole recording, window by window."""

from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import Clip
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.methods import plain_and_tuned
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.io.dcase import FRAME_S
from avssl_pyro.recordings.recording import Recording

NOBODY: Azimuths = np.zeros(0)


def baselines_of_recording(
    recording: Recording,
    array: MicrophoneArray,
    labelled: Sequence[Azimuths],
    peaks: PeakSetting,
    tolerance: float,
    hop_s: float = 0.5,
    window_s: float = 1.0,
) -> dict[str, list[Azimuths]]:
    """What each says in every frame of 100 ms: the answer of the window whose middle is nearest; by name.

    Two rows each: with ``peaks``, and tuned on these very labels.

    Args:
        recording: its audio.
        array: that recorded it.
        labelled: who sounds in every frame, radians.
        peaks: when a peak counts as a source.
        tolerance: that rows are tuned for, radians.
        hop_s, window_s: of the windows.
    """
    windows = list(recording.audio_windows(hop_s, window_s))
    clips = [Clip.without_picture(recording.key_at(start_s), audio_mn) for start_s, audio_mn in windows]
    middle_b = np.array([start_s + window_s / 2 for start_s, _ in windows])
    nearest_t = [int(np.abs(middle_b - (t + 0.5) * FRAME_S).argmin()) for t in range(len(labelled))]
    given: dict[str, list[Azimuths]] = {}
    for method in default_baselines(array, DirectionGrid()):
        spectra = method.observe_all(tqdm(clips, desc=method.name, unit="window"))
        given |= plain_and_tuned(method, [spectra[b] for b in nearest_t], labelled, peaks, tolerance)
    return given
