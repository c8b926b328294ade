"""Runs ``avssl benchmark rooms``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from avssl_pyro.cli.options import DEFAULT_SEED, DEFAULT_WORKERS, Seed, Workers, parse_options
from avssl_pyro.cli.outputs import check_outputs
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class RoomsOptions:
    """Compare the model with baselines on clips from measured room responses, by audio alone.

    The clips last one second: dry speech through the responses, with noise 25 to 30 dB below it. Two talkers are in one
    setting, at least 20 degrees apart and at most 5 dB different. In clips of nobody there is white noise in every
    channel, diffuse pink noise, or silence. The folder's labels.csv has the columns file and azimuth_deg, and
    optionally room, setting and distance_m. Thresholds of the baselines are the best on these very clips.
    """

    responses: Path
    """Folder of labels.csv and multichannel responses: WAV, FLAC or SOFA, any rate."""
    speech: Path
    """Folder of dry speech: WAV or FLAC, any rate."""
    array: str | None = None
    """Array of the responses: a preset or a YAML file; by default the only YAML file in --responses."""
    checkpoint: Path | None = None
    """Checkpoint of 'avssl train' for this array; by default the pretrained weights."""
    num_clips: Annotated[tuple[int, int, int], tyro.conf.arg(metavar="ONE TWO NOBODY")] = (60, 60, 30)
    """Numbers of clips with one talker, with two, and with nobody. The last are a third each of the kinds of noise."""
    seed: Seed = DEFAULT_SEED
    workers: Workers = DEFAULT_WORKERS
    clips: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the clips as WAV, with clips.csv (audio, azimuth_deg, kind) and array.yaml, for other tools."""
    out: Path = Path("runs/rooms.json")
    """JSON file of the scores and of every clip's estimates."""


def rooms(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark rooms``.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse_options(RoomsOptions, args)
    one, two, nobody = options.num_clips
    if min(options.num_clips) < 0 or one + two < 1:
        raise InputError(
            f"--num-clips {one} {two} {nobody}: give numbers of at least 0, and at least one clip with a talker."
        )
    if options.clips is not None and options.clips.exists() and not options.clips.is_dir():
        raise InputError(f"--clips {options.clips}: is a file; name a folder.")
    from avssl_pyro.benchmarks.rooms.clips import RoomClips, write_clips
    from avssl_pyro.benchmarks.rooms.responses import read_responses
    from avssl_pyro.benchmarks.rooms.scores import choose_array, run_rooms
    from avssl_pyro.evaluation.tables import print_tables
    from avssl_pyro.simulation.speech import SpeechFolder

    array = choose_array(options.array, options.responses)
    responses = read_responses(options.responses, array)
    source = RoomClips(responses, SpeechFolder(options.speech), array.num_microphones, options.seed)
    check_outputs([options.out], [options.checkpoint])
    clips = source.draw_all(one, two, nobody)
    if options.clips is not None:
        write_clips(options.clips, clips, array)
    result = run_rooms(clips, array, options.checkpoint, options.workers)
    result.write(options.out, seed=options.seed, num_clips=list(options.num_clips))
    print_tables(result.tables())
    print(f"{options.out}: written.")
