"""The main job in one call: volume and transfer function in, picture out."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal, Self

from isosample.defaults import DATA_CENTRIC, DEFAULT_MAX_ISOVALUES, DEFAULT_SIZE
from isosample.errors import InputError
from isosample.gl.context import shared_context
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera
from isosample.rendering.image import Image
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings, check_size
from isosample.rendering.stage_progress import of_stage
from isosample.transfer.transfer_function import TransferFunction, check_is_transfer_function
from isosample.volume.grid import check_is_volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.error_map import ErrorMap
    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.rendering.stage_progress import Progress
    from isosample.surfaces.extract import SurfaceSet
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.grid import Volume


def render(
    volume: Volume,
    transfer_function: TransferFunction | None = None,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = DEFAULT_SIZE,
    per_slope: int | None = None,
    tolerance: float | None = None,
    max_isovalues: int = DEFAULT_MAX_ISOVALUES,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int | Literal["auto"] | None = None,
    settings: RenderSettings | None = None,
    nan_masked: bool = False,
    progress: Progress | None = None,
) -> Image:
    """Render a volume through its isosurfaces.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction, optional
        `TransferFunction.suggest(volume)` by default.
    camera : Camera, optional
        `Camera.default(volume.box, size)` by default: from the front.
    size : (width, height)
        Pixels.
    per_slope : int, optional
        Isovalues inside each visible slope of the transfer function (default 5).
    tolerance : float, optional
        In place of `per_slope`: largest error of a component of a pixel, for all but a thousandth of the pixels.
        Isovalues and refinement are searched for; ``image.stats["tolerance"]`` says what was reached.
    max_isovalues : int
        At most so many for a tolerance.
    reconstruction : Reconstruction
        The field between the samples: trilinear, or a smooth one.
    refine : int or "auto", optional
        Into how many pieces an edge of the mesh may be divided: 1 (default), 2, 4 or 8; for a tolerance the
        largest that may be chosen (default 8). "auto": as many as the meshes, or the tolerance, need (`Quality`).
    settings : RenderSettings, optional
        Segment rule, shading, background, clip planes. With a material the plan is one for light (`Quality.lit`); a
        tolerance is that of the picture without light.
    nan_masked : bool
        Leave out the cells that touch a NaN or infinite sample; otherwise such samples are an error.
    progress : callable, optional
        Called with the stage ("extract", "render"), steps done and steps in all.

    Returns
    -------
    image : Image
        Premultiplied linear RGBA, float32, with statistics.

    Raises
    ------
    InputError
        If the volume cannot be rendered as asked (thin, constant, not finite) or an option is out of range.
    OpenGLError
        If there is no usable OpenGL.
    """
    check_size(size)
    check_is_volume(volume)
    if transfer_function is not None:
        check_is_transfer_function(transfer_function)
    shared_context()  # a missing driver is told before the long work
    if transfer_function is None:
        transfer_function = TransferFunction.suggest(volume)
    quality = Quality(
        per_slope=per_slope,
        tolerance=tolerance,
        max_isovalues=max_isovalues,
        reconstruction=reconstruction,
        refine=refine,
        lit=settings is not None and settings.material is not None,
    )
    _check_tolerance(quality, settings)
    surfaces, plan, seconds, _ = prepare_surfaces(
        volume, transfer_function, quality, nan_masked=nan_masked, progress=progress
    )
    return render_surfaces(
        surfaces, plan, camera=camera, size=size, settings=settings, progress=progress, seconds=seconds
    )


def _check_tolerance(quality: Quality, settings: RenderSettings | None) -> None:
    """Raise unless a picture with a tolerance is the kind of picture that the search looks at."""
    if quality.tolerance is None or settings is None:
        return
    if settings.segment is not SegmentRule.CUBIC or settings.curved is not None:
        raise InputError(
            f"tolerance {quality.tolerance:g} is searched for with cubic segments and the crossings that the "
            f"reconstruction asks for; segment {settings.segment.value} with curved {settings.curved} makes another "
            "picture."
        )


def render_surfaces(
    surfaces: SurfaceSet | StoredSurfaces,
    plan: IsovaluePlan,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = DEFAULT_SIZE,
    settings: RenderSettings | None = None,
    progress: Progress | None = None,
    seconds: dict[str, float] | None = None,
) -> Image:
    """Render surfaces that were extracted before; no volume is needed.

    Parameters
    ----------
    surfaces : SurfaceSet
        From `extract_surfaces` or a cache folder.
    plan : IsovaluePlan
        Its isovalues must be among those of the surfaces. For light it should be one for it (`plan_isovalues` with
        ``lit=True``), or slopes of constant extinction and colour are lit by the normals of their two ends alone.
    camera, size, settings, progress
        As for `render`.
    seconds : dict of str to float, optional
        Seconds of earlier stages, for the statistics.

    Raises
    ------
    InputError
        As `Scene.build` and `ABuffer.render`.
    OpenGLError
        If there is no usable OpenGL.
    """
    with Renderer(surfaces, plan, seconds=seconds) as renderer:
        return renderer.render(camera=camera, size=size, settings=settings, progress=progress)


class Renderer:
    """Surfaces on the GPU, for as many pictures as you like: only the first one pays for the upload.

    Parameters
    ----------
    surfaces : SurfaceSet
        From `extract_surfaces` or a cache folder.
    plan : IsovaluePlan
        Its isovalues must be among those of the surfaces.
    seconds : dict of str to float, optional
        Seconds of earlier stages, for the statistics of the pictures.

    Raises
    ------
    InputError
        As `Scene.build`.
    OpenGLError
        If there is no usable OpenGL.

    Notes
    -----
    Use as a context manager, or call `release`.
    """

    def __init__(
        self,
        surfaces: SurfaceSet | StoredSurfaces,
        plan: IsovaluePlan,
        *,
        seconds: dict[str, float] | None = None,
    ) -> None:
        self._ctx = shared_context()
        self._surfaces = surfaces
        start = time.perf_counter()
        self._scene = Scene.build(surfaces, plan)
        self._seconds = dict(seconds or {}) | {"merge": time.perf_counter() - start}
        self._abuffer = ABuffer(self._ctx, self._scene)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free everything on the GPU."""
        self._abuffer.release()

    def render(
        self,
        *,
        camera: Camera | None = None,
        size: tuple[int, int] = DEFAULT_SIZE,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
    ) -> Image:
        """Render one picture; parameters and errors as `render_surfaces`."""
        width, height = check_size(size)
        camera = camera or Camera.default(self._surfaces.geometry.box, (width, height))
        rgba, frame = self._abuffer.render(
            camera, (width, height), settings or RenderSettings(), of_stage(progress, "render")
        )
        seconds = self._seconds | self._abuffer.timer.seconds
        self._seconds = {}
        self._abuffer.timer.seconds.clear()
        stats = statistics_of(self._ctx, self._surfaces, self._scene, frame, (width, height), seconds)
        return Image(rgba, stats | {"screen_error": (settings or RenderSettings()).screen_error})

    def error_map(
        self,
        *,
        camera: Camera | None = None,
        size: tuple[int, int] = DEFAULT_SIZE,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
    ) -> ErrorMap:
        """How far the picture may be off, pixel by pixel; parameters and errors as `render_surfaces`."""
        from isosample.rendering.error_map import error_map

        width, height = check_size(size)
        camera = camera or Camera.default(self._surfaces.geometry.box, (width, height))
        timer, before = self._abuffer.timer, dict(self._abuffer.timer.seconds)
        found = error_map(
            self._abuffer,
            self._surfaces,
            self._scene.plan,
            camera,
            (width, height),
            settings or RenderSettings(),
            of_stage(progress, "error map"),
        )
        timer.seconds = before | {"upload": timer.seconds.get("upload", 0.0)}  # not done again for a picture
        return found


def statistics_of(
    ctx: moderngl.Context,
    surfaces: SurfaceSet | StoredSurfaces,
    scene: Scene,
    frame: FrameStatistics,
    size: tuple[int, int],
    seconds: dict[str, float],
) -> dict[str, Any]:
    """What a picture cost and what was skipped, JSON-ready; see docs/manual.md, "Statistics"."""
    counts = {one.name: getattr(frame, one.name) for one in fields(frame)}
    extraction = surfaces.statistics
    pixels = size[0] * size[1]
    return {
        "renderer": ctx.info["GL_RENDERER"],
        "method": DATA_CENTRIC,
        "size": list(size),
        "seconds": {stage: round(time, 6) for stage, time in seconds.items()},
        "isovalues": scene.plan.isovalues.tolist(),
        "triangles": {"extracted": sum(extraction.triangles), "drawn": counts.pop("triangles_drawn")},
        "fragments": counts.pop("fragments"),
        "max_depth_complexity": counts.pop("max_depth_complexity"),
        "lost_fragments": counts.pop("lost_fragments"),
        "samples_per_ray": {"mean": frame.fragments / pixels, "max": frame.max_depth_complexity},
        "skipped": {
            "brick_visits": extraction.brick_visits_skipped,
            "brick_visits_of": extraction.brick_visits + extraction.brick_visits_skipped,
            "rays_ended_early": counts.pop("terminated_rays"),
            "chunks_outside_view": counts.pop("chunks_outside_view"),
            "chunks_clipped": counts.pop("chunks_clipped"),
            "chunks_of": counts.pop("chunks"),
            "chunks_coarser": counts.pop("chunks_coarser"),
            **{f"plan: {reason}": count for reason, count in scene.plan.skipped.items()},
        },
        **counts,
        "reconstruction": surfaces.settings.reconstruction.value,
        "refine": surfaces.settings.refine,
        **({"tolerance": scene.plan.report} if scene.plan.report else {}),
    }
