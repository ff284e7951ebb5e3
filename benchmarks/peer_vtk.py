"""VTK's GPU ray caster, set to the conventions of this project and read back in float32."""

from __future__ import annotations

import itertools
import os
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.rendering.camera import Camera
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

    F32 = npt.NDArray[np.float32]

# VTK makes its tables as wide as two neighbouring points ask for; its own choice for two tents (1024) limits the
# picture to an RMSE of 8e-4, this width to 9e-5. The widest texture of most drivers is 16384.
TABLE_WIDTH = 16000
NODES_PER_SLOPE = 32  # opacity is not linear in the value where extinction is
# What the mapper reads from a depth buffer. Its copy of the depth comes from the window and not from the float
# framebuffer, and then hides everything; there is nothing else in the scene, so that the far plane is right.
DEPTH_READ = "vec4 l_depthValue = texture2D(in_depthSampler, fragTexCoord);"
NO_DEPTH = "vec4 l_depthValue = vec4(1.0);"


class VtkRayCaster:
    """One volume, transfer function, camera and step, ready to be rendered again and again.

    Linear colours without shading; opacity per unit distance 1 − exp(−τ · unit); no jitter, no automatic
    sample distance; the framebuffer holds float32 (VTK's window holds 8 bits) unless `eight_bits`. Samples are
    given as float32 unless `as_stored`: the software driver interpolates textures of 8 bits to 8 bits, faster.
    """

    def __init__(
        self,
        volume: Volume,
        transfer_function: TransferFunction,
        camera: Camera,
        size: int,
        *,
        step: float,
        eight_bits: bool = False,
        as_stored: bool = False,
        table_width: int = TABLE_WIDTH,
    ) -> None:
        import vtk

        vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_ERROR)
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        _keep_display()
        self.size = size
        self._mapper = _mapper(volume, step, None if as_stored else np.float32)
        self._property = _property(transfer_function, volume, table_width)
        if transfer_function.isosurfaces:
            self._show_isosurfaces(transfer_function)
        self._actor = vtk.vtkVolume()
        self._actor.SetMapper(self._mapper)
        self._actor.SetProperty(self._property)
        self._renderer = vtk.vtkOpenGLRenderer()
        self._renderer.SetBackground(0.0, 0.0, 0.0)
        self._renderer.SetBackgroundAlpha(0.0)
        self._renderer.AddVolume(self._actor)
        self._frame = None if eight_bits else self._render_to_float()
        self._window = _window(self._renderer, size)
        _place(self._renderer, camera)

    def render(self) -> F32:
        """Draw and read back: premultiplied linear RGBA (H, W, 4), row 0 on top."""
        import vtk
        from vtk.util import numpy_support

        edge = self.size
        self._window.Render()
        if self._frame is None:
            pixels = vtk.vtkUnsignedCharArray()
            self._window.GetRGBACharPixelData(0, 0, edge - 1, edge - 1, 0, pixels)
            shown: F32 = numpy_support.vtk_to_numpy(pixels).astype(np.float32) / np.float32(255.0)
            return shown.reshape(edge, edge, 4)[::-1]
        buffer = self._frame.GetColorTexture().Download()
        rgba = np.empty((edge, edge, 4), dtype=np.float32)
        if not buffer.Download2D(vtk.VTK_FLOAT, rgba, (edge, edge), 4, (0, 0)):
            raise RuntimeError("VTK gave no picture back")
        return rgba[::-1]

    def driver(self) -> str:
        """OpenGL renderer and version of VTK's context."""
        lines = self._window.ReportCapabilities().splitlines()
        found = [
            line.split(":", 1)[1].strip()
            for line in lines
            if line.startswith(("OpenGL renderer", "OpenGL version"))
        ]
        return ", ".join(found)

    def release(self) -> None:
        """Free the window and all that belongs to it."""
        self._renderer.RemoveAllViewProps()
        self._renderer.SetPass(None)
        if self._frame is not None:
            self._frame.ReleaseGraphicsResources(self._window)
        self._window.Finalize()

    def _render_to_float(self) -> Any:
        """Pass that draws into float32 colours; its shader reads no depth, see `DEPTH_READ`."""
        import vtk

        steps = vtk.vtkSequencePass()
        passes = vtk.vtkRenderPassCollection()
        for part in (vtk.vtkLightsPass(), vtk.vtkOpaquePass(), vtk.vtkVolumetricPass()):
            passes.AddItem(part)
        steps.SetPasses(passes)
        through_camera = vtk.vtkCameraPass()
        through_camera.SetDelegatePass(steps)
        frame = vtk.vtkFramebufferPass()
        frame.SetColorFormat(vtk.vtkTextureObject.Float32)
        frame.SetDelegatePass(through_camera)
        self._renderer.SetPass(frame)
        self._actor.GetShaderProperty().AddFragmentShaderReplacement(DEPTH_READ, False, NO_DEPTH, True)
        return frame

    def _show_isosurfaces(self, transfer_function: TransferFunction) -> None:
        """Isosurfaces in place of a volume: VTK cannot show both; their opacity is the table's at their value."""
        import vtk

        self._mapper.SetBlendModeToIsoSurface()
        contours = self._property.GetIsoSurfaceValues()
        contours.SetNumberOfContours(len(transfer_function.isosurfaces))
        colors, opacities = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
        for row, surface in enumerate(transfer_function.isosurfaces):
            contours.SetValue(row, surface.value)
            colors.AddRGBPoint(surface.value, *surface.color)
            opacities.AddPoint(surface.value, surface.opacity)
        self._property.SetColor(colors)
        self._property.SetScalarOpacity(opacities)


@cache
def _keep_display() -> Any:
    """Window that stays: VTK ends the driver's display, other contexts included, with the last one."""
    import vtk

    window = _window(vtk.vtkOpenGLRenderer(), 8)
    window.Render()
    return window


def _mapper(volume: Volume, step: float, dtype: type[np.float32] | None) -> Any:
    """Mapper with a fixed step [voxel] and nothing automatic."""
    import vtk
    from vtk.util import numpy_support

    image = vtk.vtkImageData()
    image.SetDimensions(*volume.size_xyz)
    image.SetSpacing(*volume.spacing)
    image.SetOrigin(*volume.origin)
    image.SetDirectionMatrix(*volume.direction.ravel().tolist())
    samples = np.ascontiguousarray(volume.array, dtype=dtype).reshape(-1)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(samples, deep=True))
    mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetLockSampleDistanceToInputSpacing(0)
    mapper.SetUseJittering(0)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(step * min(volume.spacing))
    mapper.SetBlendModeToComposite()
    return mapper


def _property(transfer_function: TransferFunction, volume: Volume, table_width: int) -> Any:
    """Colours and opacities with the same control points, and points between them where opacity is curved."""
    import vtk

    unit = min(volume.spacing)
    colors, opacities = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    colors.SetColorSpaceToRGB()
    for each in (colors, opacities):
        each.ClampingOff()
    points = transfer_function.points
    for point in points:
        colors.AddRGBPoint(point.value, *point.color)
    for low, high in itertools.pairwise(points):
        for share in np.linspace(0.0, 1.0, NODES_PER_SLOPE + 1).tolist():
            extinction = (1.0 - share) * low.extinction + share * high.extinction
            value = (1.0 - share) * low.value + share * high.value
            opacities.AddPoint(value, -float(np.expm1(-extinction * unit)))
    if points:
        low, high = points[0], points[1]
        narrow = (volume.value_range[1] - volume.value_range[0]) / table_width
        share = narrow / (high.value - low.value)  # a redundant point: on the same line, and close
        extinction = (1.0 - share) * low.extinction + share * high.extinction
        opacities.AddPoint(low.value + narrow, -float(np.expm1(-extinction * unit)))
    made = vtk.vtkVolumeProperty()
    made.SetColor(colors)
    made.SetScalarOpacity(opacities)
    made.SetScalarOpacityUnitDistance(unit)
    made.SetInterpolationTypeToLinear()
    made.ShadeOff()
    return made


def _window(renderer: Any, size: int) -> Any:
    """Off-screen window by EGL: the driver that the rest of the benchmark uses."""
    import vtk

    window = vtk.vtkEGLRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetAlphaBitPlanes(1)
    window.SetMultiSamples(0)
    window.SetSize(size, size)
    window.AddRenderer(renderer)
    return window


def _place(renderer: Any, camera: Camera) -> None:
    """Give the renderer the same orthographic camera."""
    assert camera.height is not None
    shown = renderer.GetActiveCamera()
    shown.SetPosition(*camera.eye)
    shown.SetFocalPoint(*camera.target)
    shown.SetViewUp(*camera.up)
    shown.SetParallelProjection(1)
    shown.SetParallelScale(camera.height / 2.0)
    renderer.ResetCameraClippingRange()
