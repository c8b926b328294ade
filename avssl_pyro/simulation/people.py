"""Cut-outs of people: the interface of a source, and a source that reads a folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError
from avssl_pyro.simulation.assets import AssetFolder

# At 0.5 m a metre covers about 230 image rows, but only the middle of a body is in view; more pixels would not show.
MAX_HEIGHT_PX = 320
OPAQUE = 32


class PersonSource(Protocol):
    """A source of cut-outs of people."""

    @property
    def name(self) -> str:
        """Short name for manifests, e.g. ``procedural``."""
        ...

    def describe(self) -> str:
        """One readable line: kind and number of the cut-outs."""
        ...

    def draw(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        """Draws a standing person, uint8 RGBA (H, W, 4), not premultiplied; head at the top, feet at the bottom."""
        ...


@dataclass(frozen=True)
class PeopleFolder(AssetFolder):
    """Cut-outs from the RGBA PNG files under a folder, trimmed to their opaque part.

    Raises:
        InputError: the folder is missing or empty; on drawing, a file cannot be read, has no alpha channel, or is
            transparent nearly everywhere.
    """

    suffixes: ClassVar[frozenset[str]] = frozenset({".png"})
    kind: ClassVar[str] = "cut-out"
    plural: ClassVar[str] = "cut-outs"

    def draw(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        return read_cutout(self.paths[int(rng.integers(len(self.paths)))])


def read_cutout(path: Path) -> npt.NDArray[np.uint8]:
    """Reads one cut-out, RGBA (H, W, 4), trimmed, at most 320 rows.

    Raises:
        InputError: see :class:`PeopleFolder`.
    """
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path}: cannot read the cut-out; give an RGBA PNG.")
    if image.ndim != 3 or image.shape[2] != 4 or image.dtype != np.uint8:
        shape = " x ".join(map(str, image.shape))
        raise InputError(f"{path}: the cut-out is {shape} {image.dtype}; give 8-bit RGBA with transparency.")
    opaque_ij = image[..., 3] > OPAQUE
    rows, columns = np.flatnonzero(opaque_ij.any(axis=1)), np.flatnonzero(opaque_ij.any(axis=0))
    if len(rows) < 8 or len(columns) < 3:
        raise InputError(f"{path}: the cut-out is transparent nearly everywhere; give one of a visible person.")
    trimmed = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    rgba_ijc = np.asarray(cv2.cvtColor(trimmed, cv2.COLOR_BGRA2RGBA), dtype=np.uint8)
    if rgba_ijc.shape[0] <= MAX_HEIGHT_PX:
        return rgba_ijc
    width = max(3, round(rgba_ijc.shape[1] * MAX_HEIGHT_PX / rgba_ijc.shape[0]))
    return np.asarray(cv2.resize(rgba_ijc, (width, MAX_HEIGHT_PX), interpolation=cv2.INTER_AREA), dtype=np.uint8)
