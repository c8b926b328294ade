"""Scores of a whole recording's directions against its labels, per frame of 100 ms, whatever the class."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import check_channels
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.chance import RandomAtTrueCount
from avssl_pyro.evaluation.methods import plain_and_tuned
from avssl_pyro.evaluation.metrics import Azimuths, Scores, evaluate
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.io.audio import AudioFile
from avssl_pyro.io.dcase import FRAME_S, DcaseRow, azimuths_by_frame, read_dcase
from avssl_pyro.recordings.recording import Recording

TUNED_DEG = 10.0
PEAKS = PeakSetting(0.5, 4)
RANDOM = "random directions at the true count"

COLUMNS: tuple[Column[tuple[str, Scores]], ...] = (
    Column("method", lambda row: row[0]),
    Column("F", lambda row: row[1].f_measure, "{:.3f}"),
    Column("precision", lambda row: row[1].precision, "{:.3f}"),
    Column("recall", lambda row: row[1].recall, "{:.3f}"),
    Column("mean error", lambda row: float(np.rad2deg(row[1].localization_error)), "{:.1f}°"),
    Column("right count", lambda row: row[1].count_accuracy, "{:.3f}"),
)


@dataclass(frozen=True)
class FrameAzimuths:
    """Azimuths of every frame, radians: those of the labels, and those of each method by its name."""

    labelled: Sequence[Azimuths]
    estimated: Mapping[str, Sequence[Azimuths]]

    def table(self, tolerance_deg: float, source: str) -> Table[tuple[str, Scores]]:
        """Table with one line for each method.

        Args:
            tolerance_deg: largest error that counts as correct, degrees.
            source: name of the labels.
        """
        tolerance = float(np.deg2rad(tolerance_deg))
        rows = [(name, evaluate(self.labelled, azimuths, tolerance)) for name, azimuths in self.estimated.items()]
        directions = sum(map(len, self.labelled))
        title = f"{source}, {len(self.labelled)} frames, {directions} labelled directions, within {tolerance_deg:g}°"
        return Table(rows, COLUMNS, title)


def compare_with_labels(
    labels: Path, estimates: Sequence[Path], audio: Path | None = None, array: MicrophoneArray | None = None
) -> FrameAzimuths:
    """Azimuths of label and estimate files, of the baselines where there is audio, and random ones.

    Args:
        labels: CSV of the labels, in any of DCASE's forms.
        estimates: CSV files of methods.
        audio: sound file of the recording, for the baselines.
        array: microphones of the recording.

    Raises:
        InputError: a file cannot be read, the recording does not fit the array, or there is nothing to score.
    """
    truth = read_dcase(labels)
    rows = {str(path): read_dcase(path) for path in estimates}
    recording = None if audio is None else Recording(audio.stem, AudioFile(audio))
    count = _num_frames(truth, rows.values(), recording)
    labelled = azimuths_of_frames(truth, count)
    estimated = {name: azimuths_of_frames(each, count) for name, each in rows.items()}
    if recording is not None and array is not None:
        check_channels(recording.audio.num_channels, array, str(audio))
        ordered = Recording(recording.name, recording.audio, channels=array.channel_indices)
        estimated |= baselines_of_recording(ordered, array, labelled, PEAKS, float(np.deg2rad(TUNED_DEG)))
    estimated[RANDOM] = RandomAtTrueCount().estimate([], labelled)
    return FrameAzimuths(labelled, estimated)


def _num_frames(
    labels: Sequence[DcaseRow], estimates: Iterable[Sequence[DcaseRow]], recording: Recording | None
) -> int:
    """Frames of the recording, or up to the last source where there is none."""
    rows = [*labels, *(row for each in estimates for row in each)]
    last = max((row.frame + 1 for row in rows), default=0)
    if recording is not None:
        last = max(last, round(recording.duration_s / FRAME_S))
    if not last:
        raise InputError("neither labels nor estimates have a single source; there is nothing to score.")
    return last


def azimuths_of_frames(rows: Sequence[DcaseRow], num_frames: int) -> list[Azimuths]:
    """Azimuths of the sources of every frame, radians; those closer than 5 degrees are merged, as in the labels.

    Raises:
        InputError: a frame lies beyond the last.
    """
    frames = azimuths_by_frame(rows)
    if frames and max(frames) >= num_frames:
        raise InputError(f"there is a source in frame {max(frames)}, but the recording has {num_frames} frames.")
    return [np.array(frames.get(frame, ())) for frame in range(num_frames)]


def baselines_of_recording(
    recording: Recording,
    array: MicrophoneArray,
    labelled: Sequence[Azimuths],
    peaks: PeakSetting,
    tolerance: float,
    hop_s: float = 0.5,
    window_s: float = 1.0,
) -> dict[str, list[Azimuths]]:
    """Azimuths of every frame by each baseline, from the window whose middle is nearest; by name.

    Each has two rows: with ``peaks``, and tuned on these very labels.

    Args:
        recording: recording with audio.
        array: its microphones.
        labelled: true azimuths of every frame, radians.
        peaks: conditions under which a peak counts as a source.
        tolerance: largest error that counts as correct in tuning, radians.
        hop_s, window_s: hop and length of the windows, seconds.
    """
    windows = list(recording.audio_windows(hop_s, window_s))
    clips = [Clip.from_audio(recording.key_at(start_s), audio_mn) for start_s, audio_mn in windows]
    middle_b = np.array([start_s + window_s / 2 for start_s, _ in windows])
    nearest_t = [int(np.abs(middle_b - (t + 0.5) * FRAME_S).argmin()) for t in range(len(labelled))]
    estimated: dict[str, list[Azimuths]] = {}
    for method in default_baselines(array, DirectionGrid()):
        spectra = method.observe_all(tqdm(clips, desc=method.name, unit="window"))
        estimated |= plain_and_tuned(method, [spectra[b] for b in nearest_t], labelled, peaks, tolerance)
    return estimated
