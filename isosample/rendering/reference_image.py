"""The picture that every method is measured against: the reference integral along the ray of every pixel."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import DEFAULT_SIZE, REFERENCE
from isosample.errors import InputError
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
        Background and clip planes count; shading is not possible. What belongs to the A-buffer (segment rule,
        stage, budget, `min_transmittance`) has no meaning here: a ray ends at a transmittance of 1e-14.
    reconstruction : Reconstruction
        The field between the samples.
    tolerance : float
        Largest absolute error of a component, 1e-13 to 1e-2, see `integrate_rays`; the picture is then rounded
        to float32.
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
        If shading is asked for, the volume is thin or not finite, or an option is out of range.
    """
    check_size(size)
    check_unlit(settings)
    renderer = ReferenceRenderer(
        volume, transfer_function, reconstruction=reconstruction, tolerance=tolerance, nan_masked=nan_masked
    )
    return renderer.render(camera=camera, size=size, settings=settings, progress=progress)


class ReferenceRenderer:
    """A volume and a transfer function, prepared for as many reference pictures as you like.

    Parameters
    ----------
    volume, transfer_function, reconstruction, tolerance, nan_masked
        As for `render_reference`.

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
    ) -> None:
        check_is_transfer_function(transfer_function)
        check_volume(volume, ExtractionSettings(nan_masked=nan_masked))
        self._box, self._reconstruction = volume.box, reconstruction
        started = time.perf_counter()
        self._tracer = ReferenceTracer.build(
            volume, transfer_function, reconstruction=reconstruction, tolerance=tolerance
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
        check_unlit(settings)
        camera = camera or Camera.default(self._box, (width, height))
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


def check_unlit(settings: RenderSettings | None) -> None:
    """Raise `InputError` if light is asked for, which the reference does not have."""
    if settings is not None and settings.material is not None:
        raise InputError(
            "the reference has no shading, but a material is given; render it without shading (material=None)."
        )


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
