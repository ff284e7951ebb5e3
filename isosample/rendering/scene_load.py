"""How much a picture asks of each method: triangles, fragments and samples, estimated without rendering.

Counts come from the bounds of the field in bricks and macrocells and from a sample of the cells; what a ray meets
comes from some rays through a coarse grid of their densities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.defaults import MACROCELLS
from isosample.transfer.visible_values import visible_intervals
from isosample.volume.bricks import BRICK_CELLS
from isosample.volume.cell_sample import sample_cells
from isosample.volume.macrocells import MacrocellGrid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.cell_sample import CellSample
    from isosample.volume.grid import Volume
    from isosample.volume.reconstruction import GridSpline, Reconstruction

F64 = npt.NDArray[np.float64]

TRIANGLES_PER_CELL = 2.0  # of marching cubes, per cell that a surface crosses
MEAN_COSINE = 0.5  # between a ray and the normals of surfaces that lie in all directions
BLOCKS = 32  # along the longest axis, of the grid of densities
RAYS = 32  # along an edge of the picture
STEPS = 96  # of one of these rays
LARGEST_DEPTH = 30.0  # of one crossing: an opaque surface
MOST_CAMERAS = 4  # of a film are looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneLoad:
    """What the methods have to deal with. Counts of one picture are means over the cameras.

    Attributes
    ----------
    isovalues : int
    scanned_cells : float
        Cells in bricks that an isovalue crosses.
    triangles : float
    pixels : float
    fragments : float
        Crossings of all rays with surfaces.
    ordered_fragments : float
        The same, each times the binary logarithm of the length of its list.
    resolved_fragments : float
        Those in front of what is opaque.
    voxels : float
    visible_length : float
        Way of all rays through macrocells that show something, in front of what is opaque [voxel].
    samples : float
        That way in steps of the ray caster.
    pieces : float
        Crossings with values at which the transfer function bends, in front of what is opaque.
    macrocells : float
        That rays meet until they end, leaps taken as one.
    """

    isovalues: int
    scanned_cells: float
    triangles: float
    pixels: float
    fragments: float
    ordered_fragments: float
    resolved_fragments: float
    voxels: float
    visible_length: float
    samples: float
    pieces: float
    macrocells: float

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers, JSON-ready, with three digits."""
        return {name: float(f"{getattr(self, name):.3g}") for name in self.__slots__}


class LoadEstimator:
    """A volume and a transfer function, looked at once; `load` then tells of any plan and camera.

    Parameters
    ----------
    volume : Volume
        In memory or lazily sliced; its value range must be known.
    transfer_function : TransferFunction
    reconstruction : Reconstruction
    spline : GridSpline, optional
        Of this volume and reconstruction, if it is at hand.
    """

    def __init__(
        self,
        volume: Volume,
        transfer_function: TransferFunction,
        reconstruction: Reconstruction,
        *,
        spline: GridSpline | None = None,
    ) -> None:
        self._volume = volume
        self._tf = transfer_function
        self._cells = sample_cells(volume)
        self.macrocells = self._grid = MacrocellGrid.build(volume, reconstruction, MACROCELLS, spline=spline)
        self._occupied = self._grid.occupancy(visible_intervals(transfer_function, isosurfaces=True))

    def load(
        self,
        plan: IsovaluePlan,
        cameras: Sequence[Camera],
        size: tuple[int, int],
        settings: RenderSettings,
        *,
        step: float,
    ) -> SceneLoad:
        """Estimate what a picture asks for.

        Parameters
        ----------
        plan : IsovaluePlan
        cameras : sequence of Camera
            A few are enough for a film.
        size : (width, height)
        settings : RenderSettings
            Its clip planes and `min_transmittance` count.
        step : float
            Of the ray caster [voxel].
        """
        cells = self._cells
        crossed = _between(plan.isovalues, cells.low, cells.high)
        bends = np.unique(
            [point.value for point in self._tf.points] + [s.value for s in self._tf.isosurfaces]
        )
        span = np.where(cells.high > cells.low, cells.high - cells.low, np.inf)
        per_value = (
            MEAN_COSINE * cells.slope / span
        )  # crossings with one value inside the cell, per world unit
        depth = _mean_extinction(self._tf, cells) + per_value * _surface_depth(self._tf, cells)
        densities = self._blocks(
            cells, [per_value * crossed, per_value * _between(bends, cells.low, cells.high), depth]
        )
        few = cameras[:: -(-len(cameras) // MOST_CAMERAS)]  # evenly spread
        rays = [self._along_rays(camera, size, settings, densities) for camera in few]
        lists, resolved, visible, pieces, visits = (np.stack(part) for part in zip(*rays, strict=True))
        pixels = float(size[0] * size[1])
        voxel = min(self._volume.spacing)
        return SceneLoad(
            isovalues=len(plan.isovalues),
            scanned_cells=self._scanned_cells(plan.isovalues),
            triangles=TRIANGLES_PER_CELL * cells.share * float(crossed.sum()),
            pixels=pixels,
            fragments=pixels * float(lists.mean()),
            ordered_fragments=pixels * float((lists * np.log2(lists + 1.0)).mean()),
            resolved_fragments=pixels * float(resolved.mean()),
            voxels=float(self._volume.array.size),
            visible_length=pixels * float(visible.mean()) / voxel,
            samples=pixels * float(visible.mean()) / (voxel * step),
            pieces=pixels * float(pieces.mean()),
            macrocells=pixels * float(visits.mean()),
        )

    def _blocks(self, cells: CellSample, values: list[F64]) -> F64:
        """(N, Z, Y, X) means of numbers per cell over blocks of cells."""
        counts = np.array(self._volume.size_xyz) - 1
        shape = np.minimum(np.maximum(counts, 1), BLOCKS)
        place = np.minimum((cells.centre / np.maximum(counts, 1) * shape).astype(np.int64), shape - 1)
        row = (place[:, 2] * shape[1] + place[:, 1]) * shape[0] + place[:, 0]
        held = np.bincount(row, minlength=int(shape.prod()))
        means = [np.bincount(row, number, len(held)) / np.maximum(held, 1) for number in values]
        return np.stack(means).reshape(len(values), *shape[::-1])

    def _scanned_cells(self, isovalues: F64) -> float:
        """Cells of bricks whose range holds an isovalue."""
        factor = max(1, round(BRICK_CELLS / self._grid.cells))
        low, high = self._grid.low, self._grid.high
        for axis in range(3):
            starts = np.arange(0, low.shape[axis], factor)
            low, high = np.minimum.reduceat(low, starts, axis), np.maximum.reduceat(high, starts, axis)
        active = _between(isovalues, low, high) > 0
        cells = math.prod(max(size - 1, 1) for size in self._volume.size_xyz)
        return float(active.mean()) * cells if active.size else 0.0

    def _along_rays(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings, densities: F64
    ) -> tuple[F64, F64, F64, F64, F64]:
        """Per ray: crossings, those before the opaque, visible way [world], pieces, macrocells met."""
        points, dt = self._points(camera, size, settings)
        edge = np.array(self._volume.size_xyz) - 1.0
        unit = np.clip(points / np.maximum(edge, 1.0), 0.0, 1.0 - 1e-9)
        crossings, pieces, depth = (_look_up(density, unit) * dt for density in densities)
        before = np.cumsum(depth, axis=1) - depth
        shown = before < -math.log(max(settings.min_transmittance, 1e-30))
        occupied = _look_up(
            self._occupied,
            np.clip(points / (self._grid.cells * np.array(self._occupied.shape[::-1])), 0.0, 1.0 - 1e-9),
        )
        visible = occupied * shown * dt
        length = self._grid.cells * min(self._volume.spacing)  # of a macrocell
        changes = np.abs(np.diff(occupied.astype(np.int8), axis=1)).sum(axis=1)
        return (
            crossings.sum(axis=1),
            (crossings * shown).sum(axis=1),
            visible.sum(axis=1),
            (pieces * shown).sum(axis=1),
            visible.sum(axis=1) / length + changes,
        )

    def _points(self, camera: Camera, size: tuple[int, int], settings: RenderSettings) -> tuple[F64, F64]:
        """(R, S, 3) index positions along rays of a small picture, and the (R, S) way that each stands for [world]."""
        width, height = size
        longest = max(size)
        origins, directions = camera.rays(width / height).origins_and_directions(
            max(1, round(RAYS * width / longest)), max(1, round(RAYS * height / longest))
        )
        origins, directions = origins.reshape(-1, 3), directions.reshape(-1, 3)
        index_from_world = np.linalg.inv(self._volume.world_from_index)
        start = origins @ index_from_world[:3, :3].T + index_from_world[:3, 3]
        way = directions @ index_from_world[:3, :3].T
        safe = np.where(np.abs(way) > 1e-12, way, 1e-12)
        ends = np.stack([-start / safe, (np.array(self._volume.size_xyz) - 1.0 - start) / safe])
        near = ends.min(axis=0).max(axis=1)
        if camera.rays(1.0).perspective:
            near = np.maximum(near, 0.0)
        far = np.maximum(ends.max(axis=0).min(axis=1), near)
        part = (np.arange(STEPS) + 0.5) / STEPS
        t = near[:, None] + (far - near)[:, None] * part
        dt = np.repeat((far - near)[:, None] / STEPS, STEPS, axis=1)
        for plane in settings.clip_planes:
            normal = np.array([plane.nx, plane.ny, plane.nz])
            side = (origins @ normal)[:, None] + t * (directions @ normal)[:, None] + plane.d
            dt = np.where(side >= 0.0, dt, 0.0)
        return start[:, None] + t[..., None] * way[:, None], dt


def _look_up(grid: npt.NDArray[Any], unit: F64) -> npt.NDArray[Any]:
    """Entries of a grid (Z, Y, X) at positions (..., 3) in [0, 1)."""
    z, y, x = grid.shape
    place = (unit * (x, y, z)).astype(np.int64)
    found: npt.NDArray[Any] = grid[place[..., 2], place[..., 1], place[..., 0]]
    return found


def _between(values: npt.ArrayLike, low: F64, high: F64) -> npt.NDArray[np.int64]:
    """How many of some ascending values lie in low < v <= high."""
    found: npt.NDArray[np.int64] = np.maximum(
        np.searchsorted(values, high, side="right") - np.searchsorted(values, low, side="right"), 0
    )
    return found


def _mean_extinction(transfer_function: TransferFunction, cells: CellSample) -> F64:
    """Extinction of cells whose values are spread evenly over their range [1/world]."""
    if not transfer_function.points:
        return np.zeros(len(cells.low))
    value = np.array([point.value for point in transfer_function.points])
    extinction = np.array([point.extinction for point in transfer_function.points])
    width = np.diff(value)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (extinction[1:] + extinction[:-1]) * width)])

    def integral(at: F64) -> F64:
        inside = np.clip(at, value[0], value[-1])
        piece = np.clip(np.searchsorted(value, inside, side="right") - 1, 0, max(len(width) - 1, 0))
        if not len(width):
            return np.zeros(len(at))
        along = inside - value[piece]
        rise = (extinction[piece + 1] - extinction[piece]) / np.where(width > 0.0, width, 1.0)[piece]
        found: F64 = sums[piece] + along * (extinction[piece] + 0.5 * rise * along)
        return found

    _, flat = transfer_function.evaluate(cells.low, side="right")
    span = cells.high - cells.low
    ranged = integral(cells.high) - integral(cells.low)
    return np.where(span > 0.0, ranged / np.where(span > 0.0, span, 1.0), flat)


def _surface_depth(transfer_function: TransferFunction, cells: CellSample) -> F64:
    """Optical depths of the isosurfaces inside each cell's range, added up."""
    surfaces = sorted(transfer_function.isosurfaces, key=lambda surface: surface.value)
    depths = [
        LARGEST_DEPTH if surface.opacity >= 1.0 else min(-math.log1p(-surface.opacity), LARGEST_DEPTH)
        for surface in surfaces
    ]
    sums = np.concatenate([[0.0], np.cumsum(depths)])
    values = [surface.value for surface in surfaces]
    found: F64 = (
        sums[np.searchsorted(values, cells.high, side="right")]
        - sums[np.searchsorted(values, cells.low, side="right")]
    )
    return found
