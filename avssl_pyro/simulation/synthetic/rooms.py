"""Synthetic rooms: furnished box rooms drawn in code, as equirectangular panoramas."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_MAX_ELEVATION_DEG, IMAGE_ROWS
from avssl_pyro.simulation.synthetic.people import random_color
from avssl_pyro.simulation.synthetic.textures import PX_PER_M, draw_ceiling, draw_floor, draw_wall

OVERSAMPLING = 2
NUM_WALLS = 4


@dataclass(frozen=True)
class Cuboid:
    """A piece of furniture.

    Args:
        low, high: opposite corners, metres, with the camera over the origin of the floor.
        color: RGB, 0-255.
        shelves: number of drawers or shelves, marked by dark lines.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    color: tuple[float, ...]
    shelves: int


@dataclass(frozen=True)
class ProceduralRoom:
    """Box rooms with windows, doors, pictures, rugs and furniture along the walls.

    Args:
        dims_m: length, width and height, metres.
        camera_m: place of the camera relative to the middle of the floor, along length and width, metres.
    """

    dims_m: tuple[float, float, float] = (5.0, 5.0, 3.0)
    camera_m: tuple[float, float] = (0.0, 0.0)

    @property
    def name(self) -> str:
        return "procedural"

    def describe(self) -> str:
        return "furnished box rooms drawn in code"

    def in_room(self, dims_m: tuple[float, float, float], camera_floor_m: tuple[float, float]) -> "ProceduralRoom":
        return replace(
            self,
            dims_m=dims_m,
            camera_m=(camera_floor_m[0] - dims_m[0] / 2, camera_floor_m[1] - dims_m[1] / 2),
        )

    @property
    def _wall_distances(self) -> npt.NDArray[np.float32]:
        """Distances of the camera from the walls +x, +y, -x and -y, metres."""
        (length, width, _), (x, y) = self.dims_m, self.camera_m
        return np.array([length / 2 - x, width / 2 - y, length / 2 + x, width / 2 + y], dtype=np.float32)

    def draw(self, rng: np.random.Generator, camera_height_m: float) -> npt.NDArray[np.uint8]:
        rays = _rays()
        atlas_ijc, tops = self._atlas(rng)
        hits = self._hit(rays, camera_height_m)
        row_ij, column_ij = self._atlas_coordinates(hits, rays, tops)
        surface_ijc = cv2.remap(atlas_ijc, column_ij, row_ij, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        view_ijc = np.asarray(surface_ijc, dtype=np.float32)
        view_ijc *= self._corner_shade(hits)[..., None]
        for box in self._furniture(rng):
            _draw_box(view_ijc, hits.reach_ij, rays, box, camera_height_m)
        view_ijc += 3.0 * rng.standard_normal((*view_ijc.shape[:2], 1), dtype=np.float32)
        return np.clip(np.rint(view_ijc), 0, 255).astype(np.uint8)

    def _atlas(self, rng: np.random.Generator) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
        """Draws all surfaces into one texture, and returns the first row of each."""
        length, width, height = self.dims_m
        base = random_color(rng, (0.0, 0.45), (0.45, 0.98))
        trim = random_color(rng, (0.0, 0.3), (0.2, 1.0))
        surfaces = [draw_wall(rng, wall, height, base, trim) for wall in (width, length, width, length)]
        surfaces += [draw_floor(rng, length, width), draw_ceiling(rng, length, width)]
        tops = np.cumsum([0] + [len(surface) for surface in surfaces[:-1]]).astype(np.float32)
        columns = max(surface.shape[1] for surface in surfaces)
        padded = [np.pad(s, ((0, 0), (0, columns - s.shape[1]), (0, 0)), mode="edge") for s in surfaces]
        return np.concatenate(padded), tops

    def _hit(self, rays: "Rays", camera_height_m: float) -> "Hits":
        height, (x, y) = self.dims_m[2], self.camera_m
        tiny = np.float32(1e-6)
        front, left, back, right = self._wall_distances
        across_j = np.where(rays.cos_j > 0, front, back) / np.maximum(np.abs(rays.cos_j), tiny)
        along_j = np.where(rays.sin_j > 0, left, right) / np.maximum(np.abs(rays.sin_j), tiny)
        wall_reach_j = np.minimum(across_j, along_j)
        level = np.where(rays.slope_i > 0, height - camera_height_m, camera_height_m).astype(np.float32)
        level_reach_i = level / np.maximum(np.abs(rays.slope_i), tiny)
        reach_ij = np.minimum(wall_reach_j, level_reach_i[:, None])
        wall_j = np.where(across_j < along_j, np.where(rays.cos_j > 0, 0, 2), np.where(rays.sin_j > 0, 1, 3))
        return Hits(
            x_ij=reach_ij * rays.cos_j + np.float32(x),
            y_ij=reach_ij * rays.sin_j + np.float32(y),
            z_ij=reach_ij * rays.slope_i[:, None] + np.float32(camera_height_m),
            reach_ij=reach_ij,
            on_wall_ij=wall_reach_j < level_reach_i[:, None],
            wall_j=wall_j,
        )

    def _atlas_coordinates(
        self, hits: "Hits", rays: "Rays", tops: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        length, width, height = (np.float32(side) for side in self.dims_m)
        faces_x_j = hits.wall_j % 2 == 0
        reach_j = self._wall_distances[hits.wall_j] / np.abs(np.where(faces_x_j, rays.cos_j, rays.sin_j))
        x_j = reach_j * rays.cos_j + np.float32(self.camera_m[0])
        y_j = reach_j * rays.sin_j + np.float32(self.camera_m[1])
        # On each wall the texture runs from left to right as seen from inside.
        right_j = np.choose(hits.wall_j, [width / 2 - y_j, x_j + length / 2, y_j + width / 2, length / 2 - x_j])
        column_ij = np.where(hits.on_wall_ij, right_j, width / 2 - hits.y_ij) * PX_PER_M - np.float32(0.5)
        # Rows stay inside each texture, so that interpolation takes nothing from its neighbours in the atlas.
        wall_row_ij = np.clip((height - hits.z_ij) * PX_PER_M - 0.5, 0.0, height * PX_PER_M - 1.5)
        level_row_ij = np.clip((length / 2 - hits.x_ij) * PX_PER_M - 0.5, 0.0, length * PX_PER_M - 1.5)
        level_top_i1 = np.where(rays.slope_i > 0, tops[5], tops[4])[:, None]
        row_ij = np.where(hits.on_wall_ij, wall_row_ij + tops[hits.wall_j], level_row_ij + level_top_i1)
        return row_ij.astype(np.float32), column_ij.astype(np.float32)

    def _corner_shade(self, hits: "Hits") -> npt.NDArray[np.float32]:
        """Returns brightness factors that darken corners and edges."""
        length, width, height = (np.float32(side) for side in self.dims_m)
        shade_ij = np.full(hits.x_ij.shape, 1 / 0.86, dtype=np.float32)
        for gap_ij in (length / 2 - np.abs(hits.x_ij), width / 2 - np.abs(hits.y_ij), hits.z_ij, height - hits.z_ij):
            near_ij = np.clip(1 - 2 * gap_ij, 0, 1)
            shade_ij *= 1 - np.float32(0.14) * near_ij * near_ij
        return shade_ij

    def _furniture(self, rng: np.random.Generator) -> list[Cuboid]:
        """Draws furniture along the walls, behind all people."""
        half = (self.dims_m[0] / 2, self.dims_m[1] / 2)
        boxes = []
        for wall in range(NUM_WALLS):
            if rng.uniform() < 0.25:
                continue
            axis, sign = wall % 2, 1 if wall < 2 else -1
            depth, breadth = float(rng.uniform(0.25, 0.45)), float(rng.uniform(0.5, 1.8))
            height = float(rng.choice([rng.uniform(0.4, 0.9), rng.uniform(1.2, 2.1)]))
            along = float(rng.uniform(-1, 1)) * (half[1 - axis] - breadth / 2 - 0.5)
            low, high = [0.0, 0.0, 0.0], [0.0, 0.0, height]
            low[axis], high[axis] = sorted((sign * (half[axis] - depth), sign * half[axis]))
            low[1 - axis], high[1 - axis] = along - breadth / 2, along + breadth / 2
            for side, camera in enumerate(self.camera_m):
                low[side], high[side] = low[side] - camera, high[side] - camera
            color = random_color(rng, (0.1, 0.6), (0.2, 0.9))
            boxes.append(Cuboid((low[0], low[1], 0.0), (high[0], high[1], height), color, int(rng.integers(0, 5))))
        return boxes


@dataclass(frozen=True)
class Rays:
    """Rays of the camera: one metre along the floor moves a point by (cos, sin, slope).

    Args:
        cos_j, sin_j: cosine and sine of the azimuth of each column.
        slope_i: tangent of the elevation of each row.
    """

    cos_j: npt.NDArray[np.float32]
    sin_j: npt.NDArray[np.float32]
    slope_i: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Hits:
    """Points where rays meet the walls, the floor or the ceiling.

    Args:
        x_ij, y_ij, z_ij: coordinates, metres, with the origin in the middle of the floor.
        reach_ij: distance from the camera along the floor, metres.
        on_wall_ij: True on a wall, False on floor and ceiling.
        wall_j: index of the wall in each column: +x, +y, -x, -y.
    """

    x_ij: npt.NDArray[np.float32]
    y_ij: npt.NDArray[np.float32]
    z_ij: npt.NDArray[np.float32]
    reach_ij: npt.NDArray[np.float32]
    on_wall_ij: npt.NDArray[np.bool_]
    wall_j: npt.NDArray[np.int64]


def _rays() -> Rays:
    """Returns the rays of a clip's image at twice its resolution."""
    rows, columns = IMAGE_ROWS * OVERSAMPLING, IMAGE_COLUMNS * OVERSAMPLING
    elevation_i = np.deg2rad(IMAGE_MAX_ELEVATION_DEG) * (1 - 2 * (np.arange(rows) + 0.5) / rows)
    azimuth_j = np.pi - 2 * np.pi * (np.arange(columns) + 0.5) / columns
    return Rays(
        np.cos(azimuth_j).astype(np.float32),
        np.sin(azimuth_j).astype(np.float32),
        np.tan(elevation_i).astype(np.float32),
    )


def _draw_box(
    view_ijc: npt.NDArray[np.float32],
    reach_ij: npt.NDArray[np.float32],
    rays: Rays,
    box: Cuboid,
    camera_height_m: float,
) -> None:
    """Draws a cuboid into the view and updates the reach, by the slab method."""
    columns = _columns_of(box, view_ijc.shape[1])
    nearest, farthest = [], []
    origins = (0.0, 0.0, camera_height_m)
    for axis, direction in enumerate((rays.cos_j[columns], rays.sin_j[columns], rays.slope_i[:, None])):
        slope = np.where(np.abs(direction) < 1e-6, np.float32(1e-6), direction)
        first = np.float32(box.low[axis] - origins[axis]) / slope
        second = np.float32(box.high[axis] - origins[axis]) / slope
        nearest.append(np.minimum(first, second))
        farthest.append(np.maximum(first, second))
    side_j = np.maximum(nearest[0], nearest[1])
    entry = np.maximum(side_j, nearest[2])
    leave = np.minimum(np.minimum(farthest[0], farthest[1]), farthest[2])
    hit = (entry < leave) & (entry > 0) & (entry < reach_ij[:, columns])
    on_side = side_j >= nearest[2]
    shade = np.where(on_side, np.where(nearest[0] > nearest[1], 0.85, 0.7), 1.1).astype(np.float32)
    if box.shelves:
        # Dark lines between drawers.
        height = entry * rays.slope_i[:, None] + np.float32(camera_height_m)
        shade[on_side & (height * (box.shelves / box.high[2]) % 1.0 < 0.08)] *= 0.55
    color = np.array(box.color, dtype=np.float32) * shade[..., None]
    view_ijc[:, columns] = np.where(hit[..., None], color, view_ijc[:, columns])
    reach_ij[:, columns] = np.where(hit, entry, reach_ij[:, columns])


def _columns_of(box: Cuboid, num_columns: int) -> npt.NDArray[np.int64]:
    corners = np.array([[x, y] for x in (box.low[0], box.high[0]) for y in (box.low[1], box.high[1])])
    middle = corners.mean(axis=0)
    azimuths = np.arctan2(corners[:, 1], corners[:, 0])
    center = np.arctan2(middle[1], middle[0])
    offsets = (azimuths - center + np.pi) % (2 * np.pi) - np.pi
    pixel = 2 * np.pi / num_columns
    first = int(np.floor((np.pi - center - offsets.max()) / pixel)) - 1
    last = int(np.ceil((np.pi - center - offsets.min()) / pixel)) + 1
    return np.arange(first, last) % num_columns
