"""Agreement of Pyro's ELBO with the closed forms of the paper and with enumerated masks, on simulated clips."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from avssl_pyro.acoustics.stft import stft
from avssl_pyro.batch import collate_clips
from avssl_pyro.criticism.elbo_comparison import (
    Difference,
    SampledAgreement,
    explicit_mask_differences,
    mean_field_differences,
    sampled_agreement,
)
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.system import System, build_system

MAX_STANDARD_ERRORS = 4.0
MAX_RELATIVE = 1e-9


@dataclass(frozen=True)
class ElboAgreement:
    """Differences between two ways to compute each quantity.

    Args:
        mean_field: Pyro's TraceMeanField_ELBO against the closed forms, at one seed.
        explicit: marginal model against enumerated masks, at one seed.
        sampled: Trace_ELBO against the closed form.
        draws: number of samples behind ``sampled``.
    """

    mean_field: Sequence[Difference]
    explicit: Sequence[Difference]
    sampled: SampledAgreement
    draws: int

    @property
    def agrees(self) -> bool:
        """Whether exact quantities agree to 1e-9, and sampled ones to four standard errors."""
        exact = max(row.relative for row in [*self.mean_field, *self.explicit]) <= MAX_RELATIVE
        return exact and abs(self.sampled.z_score) <= MAX_STANDARD_ERRORS

    def tables(self) -> list[Table[Any]]:
        """A table for each comparison."""
        columns: list[Column[SampledAgreement]] = [
            Column("quantity", lambda _: "loss"),
            Column("closed form", lambda row: row.reference, "{:.4f}"),
            Column("Pyro", lambda row: row.mean, "{:.4f}"),
            Column("standard error", lambda row: row.standard_error, "{:.4f}"),
            Column("z", lambda row: row.z_score, "{:+.2f}"),
        ]
        return [
            _table(self.mean_field, "closed form", "TraceMeanField_ELBO at one seed"),
            _table(self.explicit, "enumerated masks", "Marginal model at one seed"),
            Table([self.sampled], columns, f"Trace_ELBO, mean of {self.draws} draws"),
        ]


def compare_elbos(system: System, clips: int, seconds: float, draws: int, seed: int = 0) -> ElboAgreement:
    """Compares on simulated clips, in double precision.

    Args:
        system: model and guide, with an audio network.
        clips: number of clips in the batch.
        seconds: length of the clips, up to 1; enumerated masks need memory.
        draws: number of samples behind the comparison with Trace_ELBO.
        seed: seed of clips and draws.
    """
    system = double_precision(system)
    simulator = SceneSimulator(seed=seed, array=system.config.array)
    batch = collate_clips([simulator.render(index).clip for index in range(clips)])
    samples = round(seconds * system.config.stft.sample_rate)
    x_bfmt = stft(batch.audio_bmn[..., :samples].double(), system.config.stft)
    image_bcij: Tensor = batch.image_float().double()
    return ElboAgreement(
        mean_field_differences(system, x_bfmt, image_bcij, seed),
        explicit_mask_differences(system, x_bfmt, image_bcij, seed),
        sampled_agreement(system, x_bfmt, image_bcij, draws, seed),
        draws,
    )


def double_precision(system: System) -> System:
    """A copy of a system in float64 and evaluation mode, where two computations can agree to rounding."""
    double = build_system(system.config, torch.float64)
    double.load_state_dict(system.state_dict())
    double.model.eval()
    double.guide.eval()
    return double


def _table(rows: Sequence[Difference], reference: str, title: str) -> Table[Difference]:
    columns: list[Column[Difference]] = [
        Column("quantity", lambda row: row.name),
        Column(reference, lambda row: row.reference, "{:.10g}"),
        Column("Pyro", lambda row: row.value, "{:.10g}"),
        Column("relative difference", lambda row: row.relative, "{:.1e}"),
    ]
    return Table(rows, columns, title)
