"""The volume on the GPU: its normalised samples, or spline coefficients, as a float32 texture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import CapacityError
from isosample.gl.context import limits
from isosample.gl.memory import with_room
from isosample.rendering.frame import shared_constants
from isosample.rendering.raycast_settings import Filtering
from isosample.tally import VOLUME_UPLOADS, tally
from isosample.volume.lazy import lazily
from isosample.volume.reconstruction import GridSpline, check_smooth

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl
    import numpy.typing as npt

    from isosample.rendering.scene import ValueScale
    from isosample.volume.grid import Volume
    from isosample.volume.reconstruction import Reconstruction

    F32 = npt.NDArray[np.float32]

NOT_THERE = 1e38  # of a sample that is not finite
REMEDY = "Crop or downsample the volume, or use the data-centric method, which needs no texture."
UPLOAD_SAMPLES = 1 << 22  # so many samples are converted to float32 at once
SHADER, HARDWARE_PAIRS, HARDWARE_TRIPLES = 0, 1, 2  # values of FILTERING, see shaders/pass/field.glsl


class DeviceVolume:
    """Samples of a volume, or its spline's coefficients, normalised and in float32.

    Parameters
    ----------
    ctx : moderngl.Context
    volume : Volume
    scale : ValueScale
        What is normalised to [0, 1].
    reconstruction : Reconstruction
    filtering : Filtering
        With `SHADER` the texture is an array of layers, from which four samples are gathered at a time; with
        `HARDWARE` it is three-dimensional and filtered linearly.
    spline : GridSpline, optional
        Of this volume and reconstruction, if it is at hand.

    Raises
    ------
    CapacityError
        If the driver takes no texture of that size, or has no room for it.
    InputError
        If the reconstruction is smooth and the volume has no such spline.

    Notes
    -----
    A sample that is not finite becomes `NOT_THERE`: what is interpolated from it with a weight above 1e-18 is above
    MASKED_VALUE, and that is a product of three fractions of float32 coordinates unless all are below 1e-6.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        volume: Volume,
        scale: ValueScale,
        reconstruction: Reconstruction,
        filtering: Filtering = Filtering.SHADER,
        *,
        spline: GridSpline | None = None,
    ) -> None:
        self._smooth, self._size_xyz = reconstruction.smooth, volume.size_xyz
        self._kernel, negative = None, False
        x, y, z = (count + 2 * self._smooth for count in volume.size_xyz)
        layered = filtering is Filtering.SHADER
        _check_size(ctx, (x, y, z), layered=layered)
        if self._smooth:
            check_smooth(volume, reconstruction)
            spline = GridSpline.build(volume, reconstruction) if spline is None else spline
            self._kernel, negative = spline.kernel.astype(np.float32), spline.absolute_sum > 1.0
        hardware = HARDWARE_TRIPLES if negative else HARDWARE_PAIRS
        self._filtering = SHADER if layered else hardware
        tally(VOLUME_UPLOADS)
        room = (f"a texture of {x} x {y} x {z} samples", 4 * x * y * z, REMEDY)
        self._texture = with_room(ctx, _new_texture(ctx, (x, y, z), layered=layered), *room)
        try:
            for z_start, block in _layers(volume if spline is None else spline, scale):
                self._texture.write(block, (0, 0, z_start, x, y, len(block)))
            with_room(ctx, self._texture, *room)  # some drivers look for it when it is filled
        except BaseException:
            self.release()
            raise

    def bind(self) -> None:
        """Bind the texture to its unit."""
        self._texture.use(shared_constants()["UNIT_VOLUME"])

    def samplers(self) -> dict[str, str]:
        """Type of the texture by its name in the shaders."""
        return {"volume": "sampler2DArray" if self._filtering == SHADER else "sampler3D"}

    def constants(self) -> dict[str, int]:
        """Compile-time constants of ``shaders/pass/field.glsl``."""
        return {"RECONSTRUCTION": int(self._smooth), "FILTERING": self._filtering}

    def fill(self, block: np.void) -> None:
        """Fill in what a struct Raycast says of the samples: their number and the kernel."""
        block["samples"] = self._size_xyz
        if self._kernel is not None:
            block["kernel"] = self._kernel

    def release(self) -> None:
        """Free the texture."""
        self._texture.release()


def _layers(source: Volume | GridSpline, scale: ValueScale) -> Iterator[tuple[int, F32]]:
    """Yield the first z, and normalised layers from there on, about `UPLOAD_SAMPLES` at once."""
    samples = source.coefficients if isinstance(source, GridSpline) else lazily(source.array)
    depth = max(1, UPLOAD_SAMPLES // (samples.shape[1] * samples.shape[2]))
    for start in range(0, samples.shape[0], depth):
        block = np.asarray(samples[start : start + depth])
        finite = np.isfinite(block)
        if finite.all():
            yield start, scale.normalise(block).astype(np.float32)
            continue
        there = np.where(finite, block, scale.low)
        yield start, np.where(finite, scale.normalise(there), NOT_THERE).astype(np.float32)


def _check_size(ctx: moderngl.Context, size: tuple[int, int, int], *, layered: bool) -> None:
    """Raise a `CapacityError` where an edge is longer than the driver takes."""
    found, layers = limits(ctx), ctx.info["GL_MAX_ARRAY_TEXTURE_LAYERS"]
    longest = (found.texture_size, found.texture_size, layers) if layered else (found.texture_3d_size,) * 3
    if any(count > most for count, most in zip(size, longest, strict=True)):
        raise CapacityError(
            f"a texture of {' x '.join(map(str, size))} samples is beyond the {' x '.join(map(str, longest))} of "
            f"{ctx.info['GL_RENDERER']}. {REMEDY}"
        )


def _new_texture(
    ctx: moderngl.Context, size: tuple[int, int, int], *, layered: bool
) -> moderngl.TextureArray | moderngl.Texture3D:
    """Empty float32 texture, clamped to its border."""
    texture: moderngl.TextureArray | moderngl.Texture3D
    if layered:
        texture = ctx.texture_array(size, 1, dtype="f4")
    else:
        texture = solid = ctx.texture3d(size, 1, dtype="f4")
        solid.repeat_z = False
    texture.repeat_x = texture.repeat_y = False
    kind = ctx.NEAREST if layered else ctx.LINEAR
    texture.filter = (kind, kind)
    return texture
