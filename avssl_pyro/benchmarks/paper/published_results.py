"""Figures of the paper's Tables I-III, by microphones and talkers.

Its authors measured them on their own simulated scenes, with a tolerance that the paper does not state.
"""

from collections.abc import Mapping
from dataclasses import dataclass

ALL_SPEAK, SOME_SILENT = "all-speak", "some-silent"
MICROPHONES = (2, 4, 6)
TALKERS = (2, 3)
PROPOSED = "Proposed"

PaperCell = tuple[int, int]
"""Number of microphones and number of talkers."""


@dataclass(frozen=True)
class PaperTable:
    """One table of the paper.

    Args:
        number: in Roman numerals, as printed.
        measure: quantity shown.
        condition: scenes it was measured on.
        figures: per method, by the paper's name, and per cell; cells left empty in the paper are missing.
    """

    number: str
    measure: str
    condition: str
    figures: Mapping[str, Mapping[PaperCell, float]]


def _row(*figures: float | None) -> dict[PaperCell, float]:
    cells = [(microphones, talkers) for microphones in MICROPHONES for talkers in TALKERS]
    return {cell: figure for cell, figure in zip(cells, figures, strict=True) if figure is not None}


TABLE_I = PaperTable(
    "I",
    "F-measure",
    ALL_SPEAK,
    {
        "SRP-PHAT": _row(0.41, 0.37, 0.65, 0.56, 0.74, 0.63),
        "MUSIC": _row(None, None, 0.80, 0.70, 0.84, 0.78),
        "w/o Aud": _row(0.68, 0.68, 0.85, 0.82, 0.85, 0.82),
        PROPOSED: _row(0.74, 0.66, 0.86, 0.83, 0.85, 0.84),
    },
)
TABLE_II = PaperTable(
    "II",
    "F-measure",
    SOME_SILENT,
    {
        "SRP-PHAT": _row(0.43, 0.36, 0.66, 0.54, 0.73, 0.63),
        "MUSIC": _row(None, None, 0.73, 0.64, 0.85, 0.77),
        "w/o Aud": _row(0.55, 0.54, 0.62, 0.63, 0.69, 0.67),
        PROPOSED: _row(0.70, 0.70, 0.77, 0.73, 0.78, 0.74),
    },
)
TABLE_III = PaperTable(
    "III",
    "count accuracy",
    SOME_SILENT,
    {
        "SRP-PHAT": _row(0.48, 0.01, 0.50, 0.17, 0.51, 0.26),
        "MUSIC": _row(None, None, 0.59, 0.27, 0.83, 0.59),
        "w/o Aud": _row(0.37, 0.42, 0.54, 0.42, 0.56, 0.51),
        PROPOSED: _row(0.52, 0.58, 0.72, 0.45, 0.71, 0.47),
    },
)
PAPER_TABLES = (TABLE_I, TABLE_II, TABLE_III)
