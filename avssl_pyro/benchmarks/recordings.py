"""Comparison of methods on labelled recordings, localized by sound alone, by the number of talkers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import DEFAULT_BAND_HZ, default_baselines
from avssl_pyro.evaluation.methods import PosteriorMethod, plain_and_tuned
from avssl_pyro.evaluation.metrics import Azimuths, evaluate
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.audio import read_audio
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.recordings.labeled_recordings import LabeledRecording
from avssl_pyro.systems.system import SystemConfig, build_system

CLOSE_DEG = 5.0
NEAR_DEG = 10.0
AUDIO_ONLY = "audio-only refined"
NOTES = (
    f"false: estimates not within {NEAR_DEG:g}° of a labelled direction of their own; mean error: of those within "
    f"{NEAR_DEG:g}°.",
    "Rows 'tuned' have the peak setting that is best on these very files, an advantage that no other row has.",
)


@dataclass(frozen=True)
class RecordingsExperiment:
    """Audio-only refinement and baselines on labelled recordings of one array.

    Args:
        config: array, model and spectrogram; no trained weights are used.
        refinement: of the audio-only posterior.
        rule: conditions under which a source class counts as a talker.
        peaks: conditions under which a peak of a baseline's spectrum counts as a talker.
        pause_db: decibels below the loudest frame; frames quieter than that are left out.
        baseline_band_hz: frequencies that the baselines search.
    """

    config: SystemConfig
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    rule: DirectLevelRule = field(default_factory=DirectLevelRule)
    peaks: PeakSetting = field(default_factory=lambda: PeakSetting(0.5, 4))
    pause_db: float = 20.0
    baseline_band_hz: tuple[float, float] = DEFAULT_BAND_HZ

    def run(self, recordings: Sequence[LabeledRecording]) -> dict[str, list[Azimuths]]:
        """Estimated azimuths of every recording, by method, radians.

        Raises:
            InputError: a recording cannot be read, or does not fit the array.
        """
        clips = [_read_clip(recording, self.config.array) for recording in recordings]
        return self._audio_only(clips) | self._baselines(clips, [np.array(one.azimuths) for one in recordings])

    def _audio_only(self, clips: Sequence[Clip]) -> dict[str, list[Azimuths]]:
        system = build_system(self.config)
        localizer = Localizer(system, refinement=self.refinement, audio_only=True, pause_db=self.pause_db)
        # One by one, for they need not be of equal length.
        method = PosteriorMethod(AUDIO_ONLY, localizer.posteriors, self.config.grid, batch_size=1)
        posteriors = method.observe_all(tqdm(clips, desc=AUDIO_ONLY))
        return {AUDIO_ONLY: [method.decide(posterior, self.rule) for posterior in posteriors]}

    def _baselines(self, clips: Sequence[Clip], labelled: Sequence[Azimuths]) -> dict[str, list[Azimuths]]:
        estimates: dict[str, list[Azimuths]] = {}
        grid = DirectionGrid(self.config.model.num_directions)
        for method in default_baselines(self.config.array, grid, freq_range_hz=self.baseline_band_hz):
            spectra = method.observe_all(tqdm(clips, desc=method.name))
            estimates |= plain_and_tuned(method, spectra, labelled, self.peaks, float(np.deg2rad(NEAR_DEG)))
        return estimates


def _read_clip(recording: LabeledRecording, array: MicrophoneArray) -> Clip:
    audio_mn = read_audio(recording.path, array)
    if recording.azimuths and not audio_mn.any():
        raise InputError(
            f"{recording.path}: is silent throughout, but its labels name somebody who talks; give another recording, "
            "or leave its field azimuth_deg empty."
        )
    return Clip.from_audio(recording.path.name, audio_mn)


@dataclass(frozen=True)
class GroupScores:
    """Scores of a method on the recordings of one number of talkers.

    Args:
        method: name of the method.
        labelled: number of labelled directions.
        close, near: number of these found within 5 and within 10 degrees, each by an estimate of its own.
        false: number of estimates not within 10 degrees of a labelled direction of their own.
        error: mean error of those found within 10 degrees, radians; NaN without any.
        right_counts: number of recordings with as many estimates as labelled directions.
        recordings: number of recordings.
    """

    method: str
    labelled: int
    close: int
    near: int
    false: int
    error: float
    right_counts: int
    recordings: int


COLUMNS: tuple[Column[GroupScores], ...] = (
    Column("method", lambda row: row.method),
    Column(f"within {CLOSE_DEG:g}°", lambda row: f"{row.close} of {row.labelled}"),
    Column(f"within {NEAR_DEG:g}°", lambda row: f"{row.near} of {row.labelled}"),
    Column("false", lambda row: row.false),
    Column("mean error", lambda row: float(np.rad2deg(row.error)), "{:.1f}°"),
    Column("right count", lambda row: f"{row.right_counts} of {row.recordings}"),
)


def score_group(method: str, labelled: Sequence[Azimuths], estimated: Sequence[Azimuths]) -> GroupScores:
    """Scores of one method on some recordings, azimuths in radians.

    Raises:
        InputError: there is no recording, or an azimuth is not finite.
    """
    close, near = (
        evaluate(labelled, estimated, float(np.deg2rad(degrees))).tallies for degrees in (CLOSE_DEG, NEAR_DEG)
    )
    hits = int(near.hits_b.sum())
    return GroupScores(
        method,
        labelled=int(near.references_b.sum()),
        close=int(close.hits_b.sum()),
        near=hits,
        false=int(near.estimates_b.sum()) - hits,
        error=float(near.errors_b.sum()) / hits if hits else float("nan"),
        right_counts=int((near.references_b == near.estimates_b).sum()),
        recordings=len(near.hits_b),
    )


def comparison_tables(
    labelled: Sequence[Azimuths], estimated: Mapping[str, Sequence[Azimuths]], notes: tuple[str, ...] = ()
) -> list[Table[GroupScores]]:
    """A table for every number of talkers that occurs.

    Args:
        labelled: azimuths of every recording's talkers, radians.
        estimated: estimates of each method for the same recordings.
        notes: shown below the last table.
    """
    counts = [len(azimuths) for azimuths in labelled]
    tables = []
    for count in sorted(set(counts)):
        members = [index for index, talkers in enumerate(counts) if talkers == count]
        rows = [
            score_group(method, [labelled[index] for index in members], [azimuths[index] for index in members])
            for method, azimuths in estimated.items()
        ]
        title = f"{_number(count, 'talker')}: {_number(len(members), 'recording')}"
        tables.append(Table(rows, COLUMNS, title))
    return [*tables[:-1], *(replace(last, notes=notes) for last in tables[-1:])]


def _number(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
