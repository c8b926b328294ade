"""Preparation of training shards from the loudest clips of recordings.

A first pass selects the clips, a second cuts them. The selection is stored in ``selection.json``, so that an
interrupted command resumes without the first pass. :mod:`avssl_pyro.datasets.generation` writes the shards, as it
does for simulated clips.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.datasets.generation import SCENES_PER_SHARD, GenerationPlan, generate
from avssl_pyro.datasets.manifest import Manifest, first_difference, read_json, to_json
from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import DcaseRow, labels_between
from avssl_pyro.recordings.candidates import ClipCandidate, Survey, survey
from avssl_pyro.recordings.excerpts import read_excerpts
from avssl_pyro.recordings.recording import Recording
from avssl_pyro.recordings.split import NoSplit, Splitter

SELECTION_NAME = "selection.json"
MIN_CLIP_S, MAX_CLIP_S = 0.1, 10.0


@dataclass(frozen=True)
class CuttingConfig:
    """Selection of the clips to cut.

    Args:
        clip_s: length of a clip in seconds.
        hop_s: time between the starts of consecutive clips in seconds.
        loudest: number of clips to keep, over all recordings; None keeps all.
    """

    clip_s: float = 1.0
    hop_s: float = 1.0
    loudest: int | None = 5000

    def __post_init__(self) -> None:
        if not MIN_CLIP_S <= self.clip_s <= MAX_CLIP_S:
            raise InputError(f"clips of {self.clip_s:g} s; give {MIN_CLIP_S:g} to {MAX_CLIP_S:g} s.")
        if not 0.0 < self.hop_s < float("inf"):
            raise InputError(f"a clip every {self.hop_s:g} s is impossible; give a positive number of seconds.")
        if self.loudest is not None and self.loudest < 1:
            raise InputError(f"the {self.loudest} loudest clips; give a number of at least 1.")


@dataclass(frozen=True)
class CutClip:
    """A clip with labels and metadata.

    Args:
        clip: audio and image.
        labels: azimuths of the sources; None where the recording has no labels.
        metadata: name of the recording, start in seconds, and RMS.
    """

    clip: Clip
    labels: SceneLabels | None
    metadata: dict[str, Any]


@dataclass(frozen=True)
class ClipCutter:
    """Cutter of clips from recordings; picklable.

    Args:
        recordings: recordings with unique names, see :func:`unique_names`.
        labels: rows of labels by recording; None where a recording has none.
        places: clips to cut, ordered by recording and time so that files are read forward.
        clip_s: length of a clip in seconds.
    """

    recordings: tuple[Recording, ...]
    labels: tuple[tuple[DcaseRow, ...] | None, ...]
    places: tuple[ClipCandidate, ...]
    clip_s: float

    def render(self, index: int) -> CutClip:
        """Cuts the clip of an index.

        Raises:
            InputError: a file is damaged at the clip; the message names the file.
        """
        place = self.places[index]
        recording, rows = self.recordings[place.recording], self.labels[place.recording]
        # Times of labels are times of the audio.
        labels = None if rows is None else labels_between(rows, place.start_s + recording.offset_s, self.clip_s)
        metadata = {"recording": recording.name, "start_s": place.start_s, "rms": place.rms}
        return CutClip(recording.clip_at(place.start_s, self.clip_s), labels, metadata)


@dataclass(frozen=True)
class Prepared:
    """Result of a preparation.

    Args:
        manifests: manifest of each folder.
        remarks: sentences on the clips and recordings that were left out.
    """

    manifests: dict[Path, Manifest]
    remarks: tuple[str, ...]


def open_for_array(recording: Recording, array: MicrophoneArray) -> Recording:
    """Returns the recording with the channels of an array, after a quick check.

    The channels are the recording's selection, or else the array's channel map. The check covers the first frame and
    excerpts of the audio, so that faults appear before the long passes.

    Raises:
        InputError: the channels do not match the array's microphones, one of them is dead, or the picture does not
            cover 360 degrees.
    """
    recording = recording.with_channels_of(array)
    recording.check_picture()
    excerpts = read_excerpts(recording.audio.path)
    excerpts.select(recording.channels or range(excerpts.num_channels)).check_live(recording.audio.path)
    return recording


def prepare(
    folder: Path,
    recordings: tuple[Recording, ...],
    array: MicrophoneArray,
    cutting: CuttingConfig,
    splitter: Splitter | None = None,
    labels: tuple[tuple[DcaseRow, ...] | None, ...] | None = None,
    scenes_per_shard: int = SCENES_PER_SHARD,
    workers: int | None = None,
    progress: bool = True,
) -> Prepared:
    """Writes or completes a data set of the loudest clips and returns its manifests.

    ``SceneDataset(folder)`` reads the data set.

    Args:
        folder: folder of the shards; a splitter that divides fills its sub-folders ``train`` and ``validation``.
        recordings: recordings with unique names, see :func:`unique_names`.
        array: array of all recordings.
        cutting: selection of the clips.
        splitter: split into training and validation; by default all clips are in one part.
        labels: rows of labels by recording, stored with the clips for evaluation.
        scenes_per_shard: number of clips in a tar file.
        workers: number of processes, see :func:`generate`.
        progress: switch of the progress bars.

    Raises:
        InputError: see :func:`open_for_array` and :func:`survey`; or the folder holds other clips.
        OSError: there is no space or no permission; finished shards stay, and no partial file is left.
    """
    recordings = tuple(open_for_array(recording, array) for recording in recordings)
    splitter = splitter or NoSplit()
    configuration = {
        "recordings": [_identity(recording) for recording in recordings],
        "cutting": asdict(cutting),
        "split": {"by": type(splitter).__name__} | vars(splitter),
        "labels": labels is not None,
    }
    found = _surveyed(folder, configuration, recordings, cutting, progress)
    parts = splitter.split(found.loudest(cutting.loudest), recordings, cutting.clip_s)
    manifests = {}
    for name, places in parts.items():
        cutter = ClipCutter(recordings, labels or (None,) * len(recordings), places, cutting.clip_s)
        part = configuration | {"part": name}
        plan = GenerationPlan(folder / name, cutter, part, 0, array, len(places), scenes_per_shard, "cutting clips")
        manifests[plan.folder] = generate(plan, workers, progress)
    return Prepared(manifests, found.remarks)


def _surveyed(
    folder: Path,
    configuration: dict[str, Any],
    recordings: tuple[Recording, ...],
    cutting: CuttingConfig,
    progress: bool,
) -> Survey:
    """Returns the survey stored in ``folder``, or makes and stores a new one."""
    path = folder / SELECTION_NAME
    # The round trip through JSON makes tuples equal to the lists read from a file.
    wanted = _json_values(configuration)
    if path.exists():
        stored = read_json(path)
        try:
            difference = first_difference(stored["configuration"], wanted)
            kept = Survey(tuple(ClipCandidate(*place) for place in stored["places"]), tuple(stored["remarks"]))
        except (TypeError, KeyError) as error:
            raise InputError(f"{path}: damaged ({type(error).__name__}: {error}); use another folder.") from error
        if difference is not None:
            field, old, new = difference
            raise InputError(
                f"{folder} holds clips cut with {field} = {old!r}, not {new!r}; "
                "use the same settings or another folder."
            )
        return kept
    found = survey(recordings, cutting.hop_s, cutting.clip_s, progress)
    kept = Survey(found.loudest(cutting.loudest), found.remarks)
    folder.mkdir(parents=True, exist_ok=True)
    content = {
        "configuration": wanted,
        "remarks": list(kept.remarks),
        "places": [[place.recording, place.start_s, place.rms] for place in kept.places],
    }
    write_atomically(path, to_json(content))
    return kept


def _json_values(data: dict[str, Any]) -> dict[str, Any]:
    """Returns the values after a round trip through JSON."""
    return json.loads(to_json(data))


def _identity(recording: Recording) -> dict[str, Any]:
    """Returns the manifest entry of a recording.

    Files are identified by name and size, so that they can move to another folder.
    """
    video = recording.video
    return {
        "name": recording.name,
        "audio": [recording.audio.path.name, recording.audio.path.stat().st_size],
        "video": None if video is None else [video.path.name, video.path.stat().st_size],
        "offset_s": recording.offset_s,
        "yaw_deg": recording.yaw_deg,
        "mirror": recording.mirror,
        "elevation_range_deg": recording.elevation_range_deg,
        "channels": recording.channels,
    }
