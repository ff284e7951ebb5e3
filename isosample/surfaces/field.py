"""The field that isosurfaces are of, brick by brick: a volume's samples, or their smooth reconstruction."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.brick_meshes import extract_brick
from isosample.surfaces.brick_samples import load_brick, spline_brick
from isosample.surfaces.mesh import BrickMesh
from isosample.volume.bricks import brick_ranges
from isosample.volume.reconstruction import GridSpline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume

    Bool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class Field:
    """A volume and what lies between its samples; a spline is fitted when it is first needed.

    Parameters
    ----------
    volume : Volume
    settings : ExtractionSettings
    """

    def __init__(self, volume: Volume, settings: ExtractionSettings) -> None:
        self.volume = volume
        self.settings = settings

    @cached_property
    def spline(self) -> GridSpline | None:
        """The spline of a smooth reconstruction."""
        kind = self.settings.reconstruction
        return GridSpline.build(self.volume, kind) if kind.smooth else None

    @cached_property
    def nodes(self) -> Volume:
        """The field at the samples: they themselves, except where the reconstruction smooths them.

        An interpolating spline passes through the samples up to rounding, which would tear plateaus that equal an
        isovalue.
        """
        if self.spline is None or self.settings.reconstruction.interpolates:
            return self.volume
        return replace(self.volume, array=self.spline.samples())

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest finite sample; of a spline its bounds."""
        return self.volume.value_range if self.spline is None else self.spline.value_range

    @property
    def boundary(self) -> BoundarySlices:
        """The field on the faces of the volume."""
        return BoundarySlices.from_volume(self.volume, self.spline)

    def active(self, bricks: Sequence[Brick], levels: F64, ranges: F64) -> Bool:
        """(B, K) bool, whether an isosurface passes through a brick; `ranges` are of the volume's samples."""
        if not self.settings.reconstruction.interpolates:
            ranges = brick_ranges(self.nodes, bricks)
        return active_levels(ranges, levels)

    def prepare(self) -> None:
        """Fit the spline, where there is one; threads that need it first would each fit their own."""
        _ = self.nodes

    def meshes(self, brick: Brick, isovalues: F64) -> list[BrickMesh]:
        """Return the isosurfaces in one brick that have triangles, in the order of the isovalues."""
        spline = self.spline
        samples = (
            load_brick(self.nodes, brick, passing=True)
            if spline is None
            else spline_brick(self.nodes, spline, brick)
        )
        return extract_brick(samples, isovalues, brick, self.nodes, self.settings)

    def pieces(self, brick: Brick, isovalues: F64) -> list[BrickMesh]:
        """Return one mesh per isovalue in one brick, those without triangles too."""
        found = {mesh.isovalue: mesh for mesh in self.meshes(brick, isovalues)}
        return [found.get(value) or no_mesh(value, brick) for value in isovalues.tolist()]


class ExtractedField(Field):
    """A field whose isosurfaces are at hand: nothing is fitted, and nothing is extracted again.

    Parameters
    ----------
    volume, settings
        As of any field.
    surfaces : SurfaceSet
        All that `extract_surfaces` gives of this volume for the isovalues that are asked for.
    """

    def __init__(self, volume: Volume, settings: ExtractionSettings, surfaces: SurfaceSet) -> None:
        super().__init__(volume, settings)
        self.surfaces = surfaces
        self._known = {(mesh.brick, mesh.isovalue): mesh for mesh in surfaces.meshes}

    @property
    def value_range(self) -> tuple[float, float]:
        """The range of the surfaces."""
        return self.surfaces.value_range

    @property
    def boundary(self) -> BoundarySlices:
        """The boundary of the surfaces."""
        return self.surfaces.boundary

    def active(self, bricks: Sequence[Brick], levels: F64, ranges: F64) -> Bool:
        """(B, K) bool, as of any field; where the reconstruction smooths, by the triangles that are there."""
        if self.settings.reconstruction.interpolates:
            return active_levels(ranges, levels)
        there = [[(brick.index, value) in self._known for value in levels.tolist()] for brick in bricks]
        return np.array(there, dtype=np.bool_).reshape(len(bricks), len(levels))

    def prepare(self) -> None:
        """There is nothing to prepare."""

    def meshes(self, brick: Brick, isovalues: F64) -> list[BrickMesh]:
        """Return the isosurfaces in one brick that have triangles, in the order of the isovalues."""
        found = (self._known.get((brick.index, value)) for value in isovalues.tolist())
        return [mesh for mesh in found if mesh is not None]


def active_levels(ranges: F64, levels: F64) -> Bool:
    """(B, K) bool, whether a brick has values on both sides: low < isovalue <= high, equal being inside."""
    found: Bool = (ranges[:, :1] < levels) & (levels <= ranges[:, 1:])
    return found


def no_mesh(isovalue: float, brick: Brick) -> BrickMesh:
    """Return a piece without triangles."""
    return BrickMesh(
        isovalue=isovalue,
        brick=brick.index,
        start=brick.start,
        positions=np.empty((0, 3), dtype=np.float32),
        gradients=np.empty((0, 3), dtype=np.float32),
        edge_keys=np.empty(0, dtype=np.int64),
        triangles=np.empty((0, 3), dtype=np.int32),
        residuals=np.empty((0, 2), dtype=np.float32),
    )
