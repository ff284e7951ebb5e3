"""VTK's ray casters, set to the conventions of this project and read back in float32."""

from __future__ import annotations

import ctypes
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
FIXED_ONE = 32767  # what the fixed-point mapper takes for 1
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
    With `fixed_point` VTK's ray caster on the processor, all cores, which composites numbers of 15 bits; its own
    picture is read, as its display in a window of n pixels magnifies by n / (n − 1) (an RMSE of 0.01 for two tents).
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
        fixed_point: bool = False,
        table_width: int = TABLE_WIDTH,
    ) -> None:
        import vtk

        vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_ERROR)
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        keep_display()
        self.size = size
        self._fixed_point = fixed_point
        made = _fixed_point_mapper() if fixed_point else _gpu_mapper()
        self._mapper = _set_up(made, volume, step, None if as_stored else np.float32)
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
        self._frame = None if eight_bits or fixed_point else self._render_to_float()
        self._window = make_window(self._renderer, size)
        place(self._renderer, camera)

    def render(self) -> F32:
        """Draw and read back: premultiplied linear RGBA (H, W, 4), row 0 on top."""
        import vtk
        from vtk.util import numpy_support

        edge = self.size
        self._window.Render()
        if self._fixed_point:
            return _cast_image(self._mapper, edge)[::-1]
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
def keep_display() -> Any:
    """Window that stays: VTK ends the driver's display, other contexts included, with the last one."""
    import vtk

    window = make_window(vtk.vtkOpenGLRenderer(), 8)
    window.Render()
    return window


def _gpu_mapper() -> Any:
    """VTK's ray caster in a shader, without jitter."""
    import vtk

    mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetUseJittering(0)
    return mapper


def _fixed_point_mapper() -> Any:
    """VTK's ray caster on the processor."""
    import vtk

    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetNumberOfThreads(os.cpu_count() or 1)
    mapper.SetIntermixIntersectingGeometry(0)
    return mapper


def _cast_image(mapper: Any, edge: int) -> F32:
    """What the rays of a fixed-point mapper left: premultiplied RGBA (edge, edge, 4), row 0 at the bottom."""
    image = mapper.GetRayCastImage()
    stored_width, stored_height = image.GetImageMemorySize()
    (left, low), (width, height) = image.GetImageOrigin(), image.GetImageInUseSize()
    address = int(image.GetImage().split("_")[1], 16)  # VTK wraps the pointer as "_address_p_void"
    channels = (ctypes.c_uint16 * (4 * stored_width * stored_height)).from_address(address)
    stored = np.frombuffer(channels, dtype=np.uint16).reshape(stored_height, stored_width, 4)
    shown = np.zeros((edge, edge, 4), dtype=np.float32)
    shown[low : low + height, left : left + width] = stored[:height, :width] / np.float32(FIXED_ONE)
    return shown


def _set_up(mapper: Any, volume: Volume, step: float, dtype: type[np.float32] | None) -> Any:
    """The mapper with a volume, a fixed step [voxel] and nothing automatic."""
    import vtk
    from vtk.util import numpy_support

    image = vtk.vtkImageData()
    image.SetDimensions(*volume.size_xyz)
    image.SetSpacing(*volume.spacing)
    image.SetOrigin(*volume.origin)
    image.SetDirectionMatrix(*volume.direction.ravel().tolist())
    samples = np.ascontiguousarray(volume.array, dtype=dtype).reshape(-1)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(samples, deep=True))
    mapper.SetInputData(image)
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetLockSampleDistanceToInputSpacing(0)
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


def make_window(renderer: Any, size: int) -> Any:
    """Off-screen window by EGL: the driver that the rest of the benchmark uses."""
    import vtk

    window = vtk.vtkEGLRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetAlphaBitPlanes(1)
    window.SetMultiSamples(0)
    window.SetSize(size, size)
    window.AddRenderer(renderer)
    return window


def place(renderer: Any, camera: Camera) -> None:
    """Give the renderer the same orthographic camera."""
    assert camera.height is not None
    shown = renderer.GetActiveCamera()
    shown.SetPosition(*camera.eye)
    shown.SetFocalPoint(*camera.target)
    shown.SetViewUp(*camera.up)
    shown.SetParallelProjection(1)
    shown.SetParallelScale(camera.height / 2.0)
    renderer.ResetCameraClippingRange()
