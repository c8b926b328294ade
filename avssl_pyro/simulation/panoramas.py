"""Backgrounds of scenes: the interface of a source of panoramas, and a source that reads a folder."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_MAX_ELEVATION_DEG, IMAGE_ROWS
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.assets import AssetFolder

CACHED_PANORAMAS = 64
WORKING_COLUMNS = 4 * IMAGE_COLUMNS


class PanoramaSource(Protocol):
    """A source of rooms without people."""

    @property
    def name(self) -> str:
        """Short name for manifests, e.g. ``procedural``."""
        ...

    def describe(self) -> str:
        """One readable line: kind and number of the panoramas."""
        ...

    def draw(self, rng: np.random.Generator, camera_height_m: float) -> npt.NDArray[np.uint8]:
        """Draws a room, uint8 RGB, equirectangular, with any direction in the middle.

        The panorama is a full sphere (width twice the height), or has elevations -55 to 55 degrees alone (88 x 288
        pixels or a multiple). A source of photographs ignores the height of the camera.
        """
        ...


@runtime_checkable
class RoomShapedPanoramas(PanoramaSource, Protocol):
    """A source of panoramas that can show a room of given size; photographs cannot."""

    def in_room(self, dims_m: tuple[float, float, float], camera_floor_m: tuple[float, float]) -> PanoramaSource:
        """Returns a source of rooms of this size.

        Args:
            dims_m: length, width and height, metres.
            camera_floor_m: place of the camera along length and width, metres from a corner.
        """
        ...


def to_clip_image(panorama_ijc: npt.NDArray[np.uint8], yaw: float) -> npt.NDArray[np.uint8]:
    """Rotates a panorama left by ``yaw`` radians and resizes it to a clip's image, (88, 288, 3).

    Raises:
        InputError: the panorama is neither a full sphere nor shaped as a clip's image.
    """
    rows, columns = panorama_ijc.shape[:2]
    shift = round(yaw / (2 * np.pi) * columns)
    turned = np.roll(panorama_ijc, -shift, axis=1)
    if columns == 2 * rows:
        rows_full = IMAGE_COLUMNS // 2
        margin = round((90.0 - IMAGE_MAX_ELEVATION_DEG) / 180.0 * rows_full)
        whole = cv2.resize(turned, (IMAGE_COLUMNS, rows_full), interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(whole[margin : margin + IMAGE_ROWS], dtype=np.uint8)
    if columns * IMAGE_ROWS == rows * IMAGE_COLUMNS:
        resized = cv2.resize(turned, (IMAGE_COLUMNS, IMAGE_ROWS), interpolation=cv2.INTER_AREA)
        return np.asarray(resized, dtype=np.uint8)
    raise InputError(
        f"a panorama of {columns} x {rows} pixels is neither a full sphere (width twice the height) "
        f"nor {IMAGE_COLUMNS} x {IMAGE_ROWS}; give one of these shapes."
    )


def to_full_sphere(panorama_ijc: npt.NDArray[np.uint8], yaw: float, columns: int) -> npt.NDArray[np.uint8]:
    """Rotates a panorama left by ``yaw`` radians and extends it to a full sphere, (columns / 2, columns, 3).

    Elevations outside the panorama repeat its edge.
    """
    rows_given, columns_given = panorama_ijc.shape[:2]
    turned_ijc = np.roll(panorama_ijc, -round(yaw / (2 * np.pi) * columns_given), axis=1)
    rows = round(rows_given * columns / columns_given)
    way = cv2.INTER_AREA if columns < columns_given else cv2.INTER_CUBIC
    resized_ijc = cv2.resize(turned_ijc, (columns, rows), interpolation=way)
    above = (columns // 2 - rows) // 2
    below = columns // 2 - rows - above
    return np.asarray(cv2.copyMakeBorder(resized_ijc, above, below, 0, 0, cv2.BORDER_REPLICATE), dtype=np.uint8)


@dataclass(frozen=True)
class PanoramaFolder(AssetFolder):
    """Panoramas from the equirectangular JPEG and PNG files under a folder; each is a full sphere, 2:1.

    The latest panoramas stay in memory at working size; pickling leaves them out.

    Raises:
        InputError: the folder is missing or empty; on drawing, a file cannot be read or is not twice as wide as high.
    """

    suffixes: ClassVar[frozenset[str]] = frozenset({".jpg", ".jpeg", ".png"})
    kind: ClassVar[str] = "panorama"
    plural: ClassVar[str] = "panoramas"

    _cache: dict[Path, npt.NDArray[np.uint8]] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {"folder": self.folder, "paths": self.paths, "_cache": {}}

    def draw(self, rng: np.random.Generator, camera_height_m: float) -> npt.NDArray[np.uint8]:  # noqa: ARG002
        path = self.paths[int(rng.integers(len(self.paths)))]
        panorama_ijc = self._cache.get(path)
        if panorama_ijc is None:
            if len(self._cache) >= CACHED_PANORAMAS:
                self._cache.clear()
            panorama_ijc = self._cache.setdefault(path, read_panorama(path))
        return panorama_ijc


def read_panorama(path: Path) -> npt.NDArray[np.uint8]:
    """Reads a full-sphere panorama, uint8 RGB, at most 1152 columns wide.

    Raises:
        InputError: the file cannot be read or is not twice as wide as high.
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path}: cannot read the panorama; give a JPEG or PNG.")
    rows, columns = image.shape[:2]
    if columns != 2 * rows or columns < IMAGE_COLUMNS:
        raise InputError(
            f"{path}: the panorama is {columns} x {rows} pixels; give an equirectangular full sphere, twice as wide as "
            f"high and at least {IMAGE_COLUMNS} wide."
        )
    if columns > WORKING_COLUMNS:
        image = cv2.resize(image, (WORKING_COLUMNS, WORKING_COLUMNS // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
