"""Which detail of every piece a picture takes: the coarsest whose displacement stays below a fraction of a pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from isosample.surfaces.detail import MOST_DETAILS, detail_tolerance

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


class DetailChoice:
    """Chooses among the details of one scene, picture by picture.

    Parameters
    ----------
    chunks : (C,) `CHUNK_DTYPE`
    voxel : float
        Largest distance of neighbouring samples [world].
    """

    def __init__(self, chunks: npt.NDArray[np.void], voxel: float) -> None:
        self._detail = chunks["detail"].astype(np.int64)
        self._voxel = voxel
        self._has_details = bool(self._detail.any())
        if not self._has_details:
            return
        names = np.concatenate([chunks["level"].astype(np.int64)[:, None], chunks["brick"]], axis=1)
        _, group = np.unique(names, axis=0, return_inverse=True)  # of one level in one brick
        self._group = group.reshape(-1)
        finest = self._detail == 0
        boxes = np.empty((2, int(self._group.max()) + 1, 3))
        boxes[:, self._group[finest]] = chunks["low"][finest], chunks["high"][finest]
        self._nowhere = ~np.isfinite(boxes).all(axis=(0, 2))  # a piece of which it is not known where it lies
        boxes[:, self._nowhere] = 0.0
        self._centre, self._half = 0.5 * (boxes[1] + boxes[0]), 0.5 * (boxes[1] - boxes[0])

    def chosen(self, frame: np.void, largest_pixels: float) -> Bool:
        """(C,) whether a piece is at the detail that a picture takes; exactly one of each level in each brick.

        Parameters
        ----------
        frame : struct Frame
        largest_pixels : float
            How far coarser triangles may be from where the finest are [pixel]; 0: the finest.
        """
        if not self._has_details:
            return np.ones(len(self._detail), dtype=bool)
        if largest_pixels <= 0.0:
            finest: Bool = self._detail == 0
            return finest
        allowed = self._allowed(frame, largest_pixels)[self._group]
        coarsest = np.zeros(len(self._centre), dtype=np.int64)
        fits = self._detail <= allowed
        np.maximum.at(coarsest, self._group[fits], self._detail[fits])
        taken: Bool = self._detail == coarsest[self._group]
        return taken

    def reach(self, chosen: Bool) -> float:
        """How far apart crossings of one place may lie in the wrong order [diagonals of a cell].

        Meshes of neighbouring isovalues cut each other within a triangle. As extracted it lies in one cell; where it
        may be δ voxel from the surface it is larger. 1 + 16 δ diagonals, 1.5 to 9, is a measured choice: of 8 million
        crossings of 33 isosurfaces of a steep scan (engine, at 1/4 pixel, δ = 1/16) 21 903 did not fit where it was
        1, 17 385 with 1 + 16 δ, and 27 456 with 1 + 64 δ, which takes what is far apart for one place.
        """
        coarsest = int(self._detail[chosen].max(initial=0))
        return 1.0 + 16.0 * detail_tolerance(coarsest)

    def _allowed(self, frame: np.void, largest_pixels: float) -> I64:
        """(G,) the coarsest detail that each level in each brick may have."""
        displacements = np.array([detail_tolerance(detail) for detail in range(1, MOST_DETAILS + 1)])
        largest = largest_pixels / (self._pixels_per_unit(frame) * self._voxel)
        allowed: I64 = np.searchsorted(displacements, largest, side="right").astype(np.int64)
        allowed[self._nowhere] = 0
        return allowed

    def _pixels_per_unit(self, frame: np.void) -> F64:
        """(G,) most pixels that a world unit can cover anywhere in each brick; infinite around the eye."""
        right, up = (
            float(np.linalg.norm(frame[name].astype(np.float64))) for name in ("span_right", "span_up")
        )
        width, height = frame["image_size"].tolist()
        scale = max(0.5 * width / right, 0.5 * height / up)
        if frame["perspective"] == 0.0:
            return np.full(len(self._centre), scale)
        forward = frame["forward"].astype(np.float64)
        depth = (self._centre - frame["eye"].astype(np.float64)) @ forward
        nearest = np.maximum(np.abs(depth) - self._half @ np.abs(forward), 0.0)
        # A step s at depth z moves the image (x / z) by at most |s| sqrt(1 + |x / z|²) / z, largest in a corner.
        oblique = float(np.sqrt(1.0 + right**2 + up**2))
        found = np.full(len(nearest), np.inf)
        np.divide(scale * oblique, nearest, out=found, where=nearest > 0.0)
        return found
