"""Cut-outs of people: what a source offers, and the source that reads a folder."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError
from avssl_pyro.simulation.assets import list_assets

SUFFIXES = frozenset({".png"})
# At 0.5 m a metre covers about 230 image rows, but only the middle of a body is in view; more pixels would not show.
MAX_HEIGHT_PX = 320
OPAQUE = 32


class PersonSource(Protocol):
    """Where the bodies in an image come from."""

    @property
    def name(self) -> str:
        """Short identity for manifests, e.g. ``procedural``."""
        ...

    def describe(self) -> str:
        """One line for people: what the cut-outs are and how many."""
        ...

    def draw(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        """A standing person, uint8 RGBA (H, W, 4), not premultiplied: head at the top edge, feet at the bottom edge."""
        ...


@dataclass(frozen=True)
class PeopleFolder:
    """Cut-outs from the RGBA PNG files found under a folder, trimmed to what is opaque.

    Raises:
        InputError: the folder is missing or empty; on drawing, a file that cannot be read, has no alpha channel, or
            shows nothing.
    """

    folder: Path
    paths: tuple[Path, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", list_assets(self.folder, SUFFIXES, "cut-out"))

    @property
    def name(self) -> str:
        return f"folder:{self.folder}"

    def describe(self) -> str:
        return f"{len(self.paths)} cut-outs of {self.folder}"

    def draw(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        return read_cutout(self.paths[int(rng.integers(len(self.paths)))])


def read_cutout(path: Path) -> npt.NDArray[np.uint8]:
    """One cut-out, RGBA (H, W, 4), trimmed, at most 320 rows.

    Raises:
        InputError: see :class:`PeopleFolder`.
    """
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path}: cannot read the cut-out; an RGBA PNG is expected.")
    if image.ndim != 3 or image.shape[2] != 4 or image.dtype != np.uint8:
        shape = " x ".join(map(str, image.shape))
        raise InputError(f"{path}: the cut-out is {shape} {image.dtype}; 8-bit RGBA with transparency is expected.")
    opaque_ij = image[..., 3] > OPAQUE
    rows, columns = np.flatnonzero(opaque_ij.any(axis=1)), np.flatnonzero(opaque_ij.any(axis=0))
    if len(rows) < 8 or len(columns) < 3:
        raise InputError(f"{path}: the cut-out is transparent nearly everywhere; a visible person is expected.")
    trimmed = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    rgba_ijc = np.asarray(cv2.cvtColor(trimmed, cv2.COLOR_BGRA2RGBA), dtype=np.uint8)
    if rgba_ijc.shape[0] <= MAX_HEIGHT_PX:
        return rgba_ijc
    width = max(3, round(rgba_ijc.shape[1] * MAX_HEIGHT_PX / rgba_ijc.shape[0]))
    return np.asarray(cv2.resize(rgba_ijc, (width, MAX_HEIGHT_PX), interpolation=cv2.INTER_AREA), dtype=np.uint8)
