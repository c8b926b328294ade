"""Scores of the model and of baselines on clips from measured rooms, by audio alone."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.api.model import load
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.rooms.clips import NOBODY, ONE_TALKER, TWO_TALKERS, RoomClip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.methods import tune
from avssl_pyro.evaluation.metrics import Azimuths, tally
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.evaluation.spread_calibration import GATE_DEG, coverage, match_spreads
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.localization.posterior import LocalizedSource

FORMAT = "avssl-rooms/1"
MODEL = "audio-only model"
TOLERANCE_DEG = 10.0
TOLERANCE = float(np.deg2rad(TOLERANCE_DEG))
ARRAY_SUFFIXES = frozenset({".yaml", ".yml"})


@dataclass(frozen=True)
class Estimates:
    """Estimates of a method for every clip.

    Args:
        azimuths: estimated azimuths of every clip, radians.
        sources: sources with their spreads, or None for a method without spreads.
        setting: tuned peak setting of a baseline.
    """

    azimuths: Sequence[Azimuths]
    sources: Sequence[Sequence[LocalizedSource]] | None = None
    setting: PeakSetting | None = None


@dataclass(frozen=True)
class TalkerScores:
    """Scores of a method on the clips of one number of talkers.

    Args:
        method: name of the method.
        hits: number of talkers within 10 degrees of an estimate of their own.
        talkers: number of talkers.
        false: number of estimates without a talker.
        right_counts: number of clips with as many estimates as talkers.
        clips: number of clips.
        error_deg: mean error of the hits in degrees; NaN without any.
        within_one, within_two: shares of errors within one and two stated deviations; NaN without deviations.
    """

    method: str
    hits: int
    talkers: int
    false: int
    right_counts: int
    clips: int
    error_deg: float
    within_one: float
    within_two: float


@dataclass(frozen=True)
class NobodyScores:
    """False sources of a method in clips without a talker.

    Args:
        method: name of the method.
        false: number of estimates by kind of noise.
        right_counts: number of clips without an estimate.
        clips: number of clips.
    """

    method: str
    false: Mapping[str, int]
    right_counts: int
    clips: int


TALKER_COLUMNS: tuple[Column[TalkerScores], ...] = (
    Column("method", lambda row: row.method),
    Column("hits", lambda row: f"{row.hits} of {row.talkers}"),
    Column("false", lambda row: row.false),
    Column("count right", lambda row: f"{row.right_counts} of {row.clips}"),
    Column("mean error", lambda row: row.error_deg, "{:.1f}°"),
    Column("within 1 sd", lambda row: row.within_one, "{:.2f}"),
    Column("within 2 sd", lambda row: row.within_two, "{:.2f}"),
)
NOBODY_COLUMNS: tuple[Column[NobodyScores], ...] = (
    Column("method", lambda row: row.method),
    *(Column(f"false, {kind}", lambda row, kind=kind: row.false.get(kind)) for kind in NOBODY),  # type: ignore[misc]
    Column("count right", lambda row: f"{row.right_counts} of {row.clips}"),
)


def choose_array(array: str | None, folder: Path) -> MicrophoneArray:
    """The array of a preset or YAML file, or of the only YAML file in the folder of responses.

    Raises:
        InputError: the array cannot be read, or none is given and the folder has no YAML file or several.
    """
    if array is not None:
        return resolve_array(array)
    found = sorted(path.name for path in folder.glob("*") if path.suffix.lower() in ARRAY_SUFFIXES)
    if len(found) == 1:
        return resolve_array(folder / found[0])
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of room responses.")
    reason = f"{folder} has {len(found)} ({', '.join(found)})" if found else f"{folder} has no YAML file of one"
    raise InputError(f"give --array, the microphones of the responses, as a preset or a YAML file: {reason}.")


@dataclass(frozen=True)
class RoomsResult:
    """Clips and every method's estimates for them.

    Args:
        array: name of the array.
        clips: clips with the azimuths of their talkers.
        estimates: estimates by the name of the method.
    """

    array: str
    clips: Sequence[RoomClip]
    estimates: Mapping[str, Estimates]

    def tables(self) -> list[Table[Any]]:
        """A table of scores for each number of talkers, of which the last has the notes."""
        tables: list[Table[Any]] = []
        for kind in (ONE_TALKER, TWO_TALKERS):
            if members := self._members((kind,)):
                talkers = [self._talker_scores(name, members) for name in self.estimates]
                tables.append(Table(talkers, TALKER_COLUMNS, f"{kind}: {_number(len(members))}"))
        if members := self._members(NOBODY):
            nobody = [self._nobody_scores(name) for name in self.estimates]
            tables.append(Table(nobody, NOBODY_COLUMNS, f"nobody: {_number(len(members))}"))
        return [*tables[:-1], replace(tables[-1], notes=self._notes())]

    def write(self, path: Path, **context: Any) -> None:
        """Writes scores, tuned settings and the estimates of every clip as JSON, azimuths in degrees.

        Args:
            path: file to write.
            context: further fields, such as the seed.
        """
        document = {
            "format": FORMAT,
            **context,
            "array": self.array,
            "tolerance_deg": TOLERANCE_DEG,
            "tuned_on_these_clips": {
                name: asdict(each.setting) for name, each in self.estimates.items() if each.setting is not None
            },
            "tables": {
                table.title.partition(":")[0]: [_finite(asdict(row)) for row in table.rows] for table in self.tables()
            },
            "clips": [self._clip_dict(index) for index in range(len(self.clips))],
        }
        write_atomically(path, f"{json.dumps(document, indent=1, allow_nan=False)}\n".encode())

    def _notes(self) -> tuple[str, ...]:
        tuned = ", ".join(
            f"{name} {each.setting.threshold:g} (up to {each.setting.max_peaks})"
            for name, each in self.estimates.items()
            if each.setting is not None
        )
        return (
            f"hits: talkers within {TOLERANCE_DEG:g}° of an estimate of their own; false: all other estimates; mean "
            f"error: of the hits; within 1 and 2 sd: share of the errors up to {GATE_DEG:g}° that lie within one and "
            "two stated standard deviations, 0.68 and 0.95 if these are right.",
            "Rows 'tuned' have one peak threshold and one largest number of peaks each, chosen for the best F-measure "
            "over all clips with talkers of these very tables, then for right counts: an advantage that the model does "
            f"not have. Chosen were: {tuned}.",
        )

    def _members(self, kinds: Sequence[str]) -> list[int]:
        return [index for index, made in enumerate(self.clips) if made.kind in kinds]

    def _talker_scores(self, name: str, members: Sequence[int]) -> TalkerScores:
        estimates = self.estimates[name]
        truth = [self.clips[index].azimuths for index in members]
        tallies = tally(truth, [estimates.azimuths[index] for index in members], TOLERANCE)
        hits = int(tallies.hits_b.sum())
        within = (math.nan, math.nan)
        if estimates.sources is not None:
            spread = match_spreads(truth, [estimates.sources[index] for index in members])
            within = (coverage(spread, 1), coverage(spread, 2))
        return TalkerScores(
            f"{name}{_tuned(estimates)}",
            hits,
            talkers=int(tallies.references_b.sum()),
            false=int(tallies.estimates_b.sum()) - hits,
            right_counts=int((tallies.references_b == tallies.estimates_b).sum()),
            clips=len(members),
            error_deg=float(np.rad2deg(tallies.errors_b.sum())) / hits if hits else math.nan,
            within_one=within[0],
            within_two=within[1],
        )

    def _nobody_scores(self, name: str) -> NobodyScores:
        estimates = self.estimates[name]
        by_kind = {
            kind: [len(estimates.azimuths[index]) for index in members]
            for kind in NOBODY
            if (members := self._members((kind,)))
        }
        counts = [count for each in by_kind.values() for count in each]
        false = {kind: sum(each) for kind, each in by_kind.items()}
        return NobodyScores(f"{name}{_tuned(estimates)}", false, counts.count(0), len(counts))

    def _clip_dict(self, index: int) -> dict[str, Any]:
        made = self.clips[index]
        return {
            "clip": made.clip.key,
            "kind": made.kind,
            "talkers": [
                {
                    "azimuth_deg": _degrees(response.azimuth),
                    "distance_m": response.distance_m,
                    "setting": response.setting,
                    "response": response.name,
                }
                for response in made.responses
            ],
            "estimates_deg": {
                name: [_degrees(azimuth) for azimuth in each.azimuths[index]] for name, each in self.estimates.items()
            },
            "stated_deg": {
                name: [_degrees(source.azimuth_std) for source in each.sources[index]]
                for name, each in self.estimates.items()
                if each.sources is not None
            },
        }


def run_rooms(
    clips: Sequence[RoomClip], array: MicrophoneArray, checkpoint: Path | None = None, workers: int | None = 1
) -> RoomsResult:
    """Localizes clips by the model, by audio alone with its defaults, and by every baseline at its best threshold.

    Args:
        clips: clips of the array's microphones, in their order.
        array: microphones of the clips.
        checkpoint: checkpoint of a training; by default the pretrained weights.
        workers: number of processes of the baselines; None is one per core.

    Raises:
        InputError: no clip has a talker, or the checkpoint cannot be used.
    """
    talking = [index for index, made in enumerate(clips) if len(made.azimuths)]
    if not talking:
        raise InputError("rooms: no clip has a talker; the baselines' thresholds are chosen on such clips.")
    # The clips have the microphones alone, whatever the channels of the recorder.
    array = replace(array, channels=None)
    estimates = {MODEL: _by_model(clips, array, checkpoint)}
    for method in default_baselines(array, DirectionGrid(), workers):
        spectra = method.observe_all(tqdm([made.clip for made in clips], desc=method.name, unit="clip"))
        truth = [clips[index].azimuths for index in talking]
        setting = tune(method, [spectra[index] for index in talking], truth, TOLERANCE).setting
        azimuths = [method.decide(spectrum_d, setting) for spectrum_d in spectra]
        estimates[method.name] = Estimates(azimuths, setting=setting)
    return RoomsResult(array.name, clips, estimates)


def _by_model(clips: Sequence[RoomClip], array: MicrophoneArray, checkpoint: Path | None) -> Estimates:
    model = load(array) if checkpoint is None else load(checkpoint, array=array)
    sources = [model.localize(made.clip.audio_mn).sources for made in tqdm(clips, desc=MODEL, unit="clip")]
    return Estimates([np.array([source.azimuth for source in found]) for found in sources], sources)


def _number(clips: int) -> str:
    return f"{clips} clip" if clips == 1 else f"{clips} clips"


def _tuned(estimates: Estimates) -> str:
    return "" if estimates.setting is None else ", tuned"


def _degrees(angle: float) -> float:
    return round(float(np.rad2deg(angle)), 2)


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
