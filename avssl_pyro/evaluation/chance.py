"""Chance rows: random azimuths, drawn without the clips. Unlike methods they may use (part of) the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from avssl_pyro.evaluation.metrics import Azimuths


class ChanceRow(Protocol):
    """Random azimuths, whatever the clip."""

    @property
    def name(self) -> str: ...

    def estimate(
        self, validation_references: Sequence[npt.NDArray[np.float64]], references: Sequence[npt.NDArray[np.float64]]
    ) -> list[Azimuths]:
        """Azimuths, radians, for each clip of ``references``."""
        ...


def _draw(counts: Sequence[int], seed: int) -> list[Azimuths]:
    rng = np.random.default_rng(seed)
    return [rng.uniform(-np.pi, np.pi, size=count) for count in counts]


@dataclass(frozen=True)
class RandomAtTrueCount:
    """Uniformly random azimuths at the true count, so that its count accuracy is 1."""

    seed: int = 0
    name: str = "random"

    def estimate(
        self, validation_references: Sequence[npt.NDArray[np.float64]], references: Sequence[npt.NDArray[np.float64]]
    ) -> list[Azimuths]:
        del validation_references
        return _draw([len(truth) for truth in references], self.seed)


@dataclass(frozen=True)
class ConstantCount:
    """Uniformly random azimuths at the most frequent count of the validation scenes."""

    seed: int = 0
    name: str = "constant-count"

    def estimate(
        self, validation_references: Sequence[npt.NDArray[np.float64]], references: Sequence[npt.NDArray[np.float64]]
    ) -> list[Azimuths]:
        mode = int(np.bincount([len(truth) for truth in validation_references]).argmax())
        return _draw([mode] * len(references), self.seed)


CHANCE_ROWS: tuple[ChanceRow, ...] = (RandomAtTrueCount(), ConstantCount())
