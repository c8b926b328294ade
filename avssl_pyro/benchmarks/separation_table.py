"""The table of separated mixtures: mean improvements of SI-SDR with intervals, and how often a talker was missed."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from avssl_pyro.benchmarks.separation import UNPROCESSED, Improvements
from avssl_pyro.evaluation.metrics import Interval, bootstrap_mean
from avssl_pyro.evaluation.tables import ResultTable, TableCell

# What each way did, by its name, for every mixture.
Trials = Sequence[Mapping[str, Improvements]]


def separation_table(trials: Trials, title: str, ours: str, baseline: str) -> ResultTable:
    """One line for each way of separation.

    Args:
        trials: at least one mixture.
        title: of the table.
        ours, baseline: the ways of which the lead of the one over the other is told below.
    """
    lines = []
    for name in trials[0]:
        if name == UNPROCESSED:
            continue
        found = [trial[name] for trial in trials]
        image, direct = _talkers(found)
        image_b, direct_b = _mixtures(found)
        texts = (
            f"{image.mean():.2f}",
            _bounds(bootstrap_mean(image_b)),
            f"{np.median(image):.2f}",
            f"{direct.mean():.2f}",
            _bounds(bootstrap_mean(direct_b)),
            f"{sum(one.missed for one in found) / len(image):.1%}",
        )
        lines.append((name, tuple(TableCell(text) for text in texts)))
    columns = ("image", "95 %", "median", "direct", "95 %", "missed")
    return ResultTable(title, columns, tuple(lines), _notes(trials, ours, baseline), corner="separated by")


def lead(trials: Trials, name: str, over: str) -> tuple[tuple[float, Interval], tuple[float, Interval]]:
    """Mean lead of one way over another on the same mixtures, dB, with its interval: image first, then direct sound."""
    image, direct = (
        ours_b - theirs_b
        for ours_b, theirs_b in zip(
            _mixtures([trial[name] for trial in trials]), _mixtures([trial[over] for trial in trials]), strict=True
        )
    )
    return (float(image.mean()), bootstrap_mean(image)), (float(direct.mean()), bootstrap_mean(direct))


def _talkers(found: Sequence[Improvements]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    return np.concatenate([one.image_s for one in found]), np.concatenate([one.direct_s for one in found])


def _mixtures(found: Sequence[Improvements]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Talkers of one mixture are not independent, so intervals are over mixtures."""
    return np.array([one.image_s.mean() for one in found]), np.array([one.direct_s.mean() for one in found])


def _notes(trials: Trials, ours: str, baseline: str) -> tuple[str, ...]:
    image, direct = _talkers([trial[UNPROCESSED] for trial in trials])
    (image_lead, image_interval), (direct_lead, direct_interval) = lead(trials, ours, baseline)
    return (
        f"{UNPROCESSED}: SI-SDR {image.mean():.1f} dB against the image, {direct.mean():.1f} dB against direct sound.",
        f"{ours} above {baseline}: {image_lead:.1f} dB ({_bounds(image_interval)}) against the image, "
        f"{direct_lead:.1f} dB ({_bounds(direct_interval)}) against direct sound.",
    )


def _bounds(interval: Interval) -> str:
    return f"{interval.low:.1f} to {interval.high:.1f}"
