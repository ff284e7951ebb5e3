"""VTK's depth peeling of meshes: the same triangles, colours and camera as the A-buffer's."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.peer_vtk import keep_display, make_window, place

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from isosample.rendering.camera import Camera
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.control_points import Isosurface

    F32 = npt.NDArray[np.float32]


MORE_THAN_ANY = (
    1 << 16
)  # peels; 0, documented as no limit, makes VTK 9.7 peel once and blend the rest in any order


class VtkPeeledSurfaces:
    """Isosurfaces of even colour and opacity, blended in exact order by dual depth peeling.

    Every level is an actor without lighting. Peeling goes on until nothing is left: occlusion ratio 0, any number of
    peels. VTK accumulates in 8 bits per channel.
    """

    def __init__(self, surfaces: SurfaceSet, looks: Sequence[Isosurface], camera: Camera, size: int) -> None:
        import vtk

        vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_ERROR)
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        keep_display()
        self.size = size
        self._renderer = vtk.vtkOpenGLRenderer()
        self._renderer.SetBackground(0.0, 0.0, 0.0)
        self._renderer.SetBackgroundAlpha(0.0)
        self._renderer.SetUseDepthPeeling(1)
        self._renderer.SetMaximumNumberOfPeels(MORE_THAN_ANY)
        self._renderer.SetOcclusionRatio(0.0)
        for level, look in enumerate(looks):
            self._renderer.AddActor(_actor(surfaces, level, look))
        self._window = make_window(self._renderer, size)
        place(self._renderer, camera)

    def render(self) -> F32:
        """Draw and read back: premultiplied linear RGBA (H, W, 4), row 0 on top."""
        import vtk
        from vtk.util import numpy_support

        edge = self.size
        self._window.Render()
        if not (
            self._renderer.GetLastRenderingUsedDepthPeeling() and self._renderer.IsDualDepthPeelingSupported()
        ):
            raise RuntimeError("VTK did not peel both ways under this driver")
        pixels = vtk.vtkUnsignedCharArray()
        self._window.GetRGBACharPixelData(0, 0, edge - 1, edge - 1, 0, pixels)
        shown: F32 = numpy_support.vtk_to_numpy(pixels).astype(np.float32) / np.float32(255.0)
        return shown.reshape(edge, edge, 4)[::-1]

    def release(self) -> None:
        """Free the window and all that belongs to it."""
        self._renderer.RemoveAllViewProps()
        self._window.Finalize()


def _actor(surfaces: SurfaceSet, level: int, look: Isosurface) -> Any:
    """One isosurface, unlit."""
    import vtk
    from vtk.util import numpy_support

    pieces = surfaces.pieces(level)
    starts = np.cumsum([0, *(len(piece.positions) for piece in pieces[:-1])])
    vertices = np.concatenate([piece.vertices_world(surfaces.geometry) for piece in pieces]).astype(
        np.float32
    )
    triangles = np.concatenate(
        [piece.triangles.astype(np.int64) + start for piece, start in zip(pieces, starts, strict=True)]
    )
    points = vtk.vtkPoints()
    points.SetData(numpy_support.numpy_to_vtk(vertices, deep=True))
    cells = vtk.vtkCellArray()
    offsets = np.arange(0, 3 * len(triangles) + 1, 3, dtype=np.int64)
    cells.SetData(
        numpy_support.numpy_to_vtkIdTypeArray(offsets, deep=True),
        numpy_support.numpy_to_vtkIdTypeArray(triangles.ravel(), deep=True),
    )
    mesh = vtk.vtkPolyData()
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(mesh)
    mapper.ScalarVisibilityOff()
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*look.color)
    actor.GetProperty().SetOpacity(look.opacity)
    actor.GetProperty().LightingOff()
    return actor
