"""The picture that every method is measured against: the reference integral along the ray of every pixel."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import DEFAULT_SIZE, REFERENCE
from isosample.integral.reference import DEFAULT_TOLERANCE, ReferenceTracer, processors
from isosample.rendering.camera import Camera
from isosample.rendering.image import Image
from isosample.rendering.settings import RenderSettings, check_size
from isosample.rendering.stage_progress import of_stage
from isosample.surfaces.extract import ExtractionSettings, check_volume
from isosample.transfer.transfer_function import check_is_transfer_function
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.rendering.settings import Material
    from isosample.rendering.stage_progress import Progress
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]


def render_reference(
    volume: Volume,
    transfer_function: TransferFunction,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = DEFAULT_SIZE,
    settings: RenderSettings | None = None,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    tolerance: float = DEFAULT_TOLERANCE,
    nan_masked: bool = False,
    progress: Progress | None = None,
) -> Image:
    """Render a reconstruction of a volume to a given tolerance, without OpenGL.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    camera : Camera, optional
        `Camera.default(volume.box, size)` by default: from the front.
    size : (width, height)
        Pixels; rays go through their centres.
    settings : RenderSettings, optional
        Shading, background and clip planes count. What belongs to the A-buffer (segment rule, stage, budget,
        `min_transmittance`) has no meaning here: a ray ends at a transmittance of 1e-14.
    reconstruction : Reconstruction
        The field between the samples.
    tolerance : float
        Largest absolute error of a component, 1e-13 (with shading 1e-12) to 1e-2, see `integrate_rays`; the
        picture is then rounded to float32.
    nan_masked : bool
        Leave out the cells that touch a NaN or infinite sample; otherwise, and always with a smooth
        reconstruction, such samples are an error.
    progress : callable, optional
        Called with the stage ("render"), rays done and rays in all.

    Returns
    -------
    image : Image
        Premultiplied linear RGBA, float32, with statistics.

    Raises
    ------
    InputError
        If the volume is thin or not finite, or an option is out of range.
    CapacityError
        If the light of a ray is not known to within the tolerance, because the gradient vanishes along it.
    """
    check_size(size)
    renderer = ReferenceRenderer(
        volume,
        transfer_function,
        reconstruction=reconstruction,
        tolerance=tolerance,
        nan_masked=nan_masked,
        material=None if settings is None else settings.material,
    )
    return renderer.render(camera=camera, size=size, settings=settings, progress=progress)


class ReferenceRenderer:
    """A volume and a transfer function, prepared for as many reference pictures as you like.

    Parameters
    ----------
    volume, transfer_function, reconstruction, tolerance, nan_masked
        As for `render_reference`.
    material : Material, optional
        What is prepared for; settings with another material are prepared for when they are met.

    Raises
    ------
    InputError
        As `render_reference`.
    """

    def __init__(
        self,
        volume: Volume,
        transfer_function: TransferFunction,
        *,
        reconstruction: Reconstruction = Reconstruction.TRILINEAR,
        tolerance: float = DEFAULT_TOLERANCE,
        nan_masked: bool = False,
        material: Material | None = None,
    ) -> None:
        check_is_transfer_function(transfer_function)
        check_volume(volume, ExtractionSettings(nan_masked=nan_masked))
        self._volume, self._transfer_function = volume, transfer_function
        self._reconstruction, self._tolerance = reconstruction, tolerance
        self._prepare(material)

    def _prepare(self, material: Material | None) -> None:
        """Prepare the volume for a material."""
        started = time.perf_counter()
        self._material = material
        self._tracer = ReferenceTracer.build(
            self._volume,
            self._transfer_function,
            reconstruction=self._reconstruction,
            material=None if material is None else material.factors,
            tolerance=self._tolerance,
        )
        self._seconds = {"prepare": time.perf_counter() - started}

    def render(
        self,
        *,
        camera: Camera | None = None,
        size: tuple[int, int] = DEFAULT_SIZE,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
    ) -> Image:
        """Render one picture; parameters and errors as `render_reference`."""
        width, height = check_size(size)
        settings = settings or RenderSettings()
        if settings.material != self._material:
            self._prepare(settings.material)
        camera = camera or Camera.default(self._volume.box, (width, height))
        started = time.perf_counter()
        origins, directions = camera.rays(width / height).origins_and_directions(width, height)
        rgba, counts = self._tracer.integrate(
            origins.reshape(-1, 3),
            directions.reshape(-1, 3),
            clip_planes=[(plane.nx, plane.ny, plane.nz, plane.d) for plane in settings.clip_planes],
            progress=of_stage(progress, "render"),
        )
        rgba += (1.0 - rgba[:, 3:]) * np.array(settings.background_premultiplied)
        seconds = self._seconds | {"render": time.perf_counter() - started}
        self._seconds = {}
        statistics = _statistics(self._tracer, self._reconstruction, counts, (width, height), seconds)
        return Image(rgba.reshape(height, width, 4).astype(np.float32), statistics)


def _statistics(
    tracer: ReferenceTracer,
    reconstruction: Reconstruction,
    counts: I64,
    size: tuple[int, int],
    seconds: dict[str, float],
) -> dict[str, Any]:
    """What the picture cost and what was skipped, JSON-ready; a sample is a cell or a quadrature panel."""
    from isosample.integral.ray_cells import COUNT_NAMES

    totals = dict(zip(COUNT_NAMES, counts.sum(axis=0).tolist(), strict=True))
    samples = counts[:, COUNT_NAMES.index("cells")]
    return {
        "renderer": f"numba, float64, {processors()} threads",
        "method": REFERENCE,
        "reconstruction": reconstruction.value,
        "size": list(size),
        "seconds": {stage: round(spent, 6) for stage, spent in seconds.items()},
        "isovalues": (tracer.optics.bands.edges[1:-1] + tracer.grid.base).tolist(),
        "triangles": {"extracted": 0, "drawn": 0},
        "fragments": 0,
        "max_depth_complexity": 0,
        "lost_fragments": 0,
        "samples_per_ray": {"mean": float(samples.mean()), "max": int(samples.max())},
        "cells_visited": totals["cells"],
        "quadrature_panels": totals["quadrature_panels"],
        "skipped": {
            "cells_without_extinction": totals["cells_without_extinction"],
            "cells_masked": totals["cells_masked"],
            "block_visits": totals["blocks_skipped"],
        },
    }
