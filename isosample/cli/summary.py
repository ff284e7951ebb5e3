"""What `render` and `precompute` tell at their end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.cli.console import note, say, say_fields, seconds
from isosample.defaults import AUTO_DISTANCE, DEFAULT_MAX_TRIANGLES, SHOWN_QUANTILE
from isosample.errors import UnrepairedError
from isosample.wording import counted, percentage, thousands

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from isosample.cli.scenes import PreparedScene
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.settings import RenderSettings
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume
    from isosample.volume.reconstruction import Reconstruction

# Statistics that are 0 in a picture without flaws.
FLAWS = ("band_violations", "repaired_pixels", "unrepaired_pixels", "saturated_segments")
MANY_REPAIRED = (
    1.0 - SHOWN_QUANTILE
)  # of the pixels: errors and tolerances leave so many out, and fewer are not told
FINER_MESHES = "finer meshes (--refine auto, where they are extracted)"
OTHER_CURES = (
    "a smoother volume (isosample filter), or its picture without isosurfaces (--method pre-integrated)"
)


def check_strict(stats: dict[str, Any]) -> None:
    """Raise `UnrepairedError` if a picture has pixels that were drawn by a guess."""
    pixels = stats["unrepaired_pixels"]
    if pixels:
        raise UnrepairedError(
            f"{pixels} pixels lack a crossing whose place nothing tells, and --strict is given; no picture is "
            "written. Finer meshes (--refine) or a smoother volume (isosample filter) may cure it; without --strict "
            "the pixels are drawn by a guess."
        )


def lit_words(report: Mapping[str, Any]) -> str:
    """How far the lit pictures of a tolerance's views are off; plans of older caches do not say."""
    if "lit" not in report:
        return "how far the lit picture may be off is not known"
    return f"of the same views, lit, all but 0.1 % err less than {report['lit']['reached']:.2g}"


def tolerance_fields(plan: IsovaluePlan) -> dict[str, str]:
    """Rows about the tolerance that a plan was made for; none without one."""
    report = plan.report
    if not report:
        return {}
    verdict = "reached" if report["missed"] is None else f"NOT reached, {report['missed']}"
    views = len(report["views"])
    return {
        "tolerance": f"{report['tolerance']:.3g}: {verdict}; all but 0.1 % of the pixels of {views} views, unlit, "
        f"err less than {report['reached']:.2g}, measured against the reference"
        + (f"; {lit_words(report)}" if "lit" in report else ""),
        "plan": report["reason"],
    }


def say_flaws(stats: Mapping[str, int], pixels: int, *, refined: bool = False) -> None:
    """Tell what is wrong with a picture or a film where it is more than a little, how much of it, and what cures it.

    Parameters
    ----------
    stats : mapping of str to int
        With `FLAWS`; those of another method have none of them.
    pixels : int
        Of all pictures.
    refined : bool
        Whether the meshes are as fine as they may be, so that another cure is needed.
    """
    share = stats.get("repaired_pixels", 0) / pixels
    if share > MANY_REPAIRED:
        guessed = stats["unrepaired_pixels"]
        by_guess = f", in {counted(guessed, 'pixel')} by a guess (--strict: an error)" if guessed else ""
        say(
            f"{percentage(share)} of the pixels may be visibly off, as noise makes them: crossings of isosurfaces were "
            f"missing on their rays, and were put in{by_guess}; what helps: "
            f"{OTHER_CURES if refined else f'{FINER_MESHES}, {OTHER_CURES}'}"
        )
    if stats.get("saturated_segments"):
        say(
            f"{counted(stats['saturated_segments'], 'segment')} with an opacity above 1 by the first-order formula, "
            "which was cut to 1; more isovalues per slope (--per-slope) make them shorter"
        )


def details_field(surfaces: SurfaceSet | StoredSurfaces) -> dict[str, str]:
    """Row about the coarser details; none without them."""
    if not surfaces.details:
        return {}
    found = [one.statistics for one in surfaces.details]
    triangles, reused = sum(sum(one.triangles) for one in found), sum(one.chunks_reused for one in found)
    return {"details": f"{len(found)} ({thousands(triangles)} triangles, {thousands(reused)} pieces reused)"}


def screen_error_field(surfaces: SurfaceSet | StoredSurfaces, screen_error: float) -> dict[str, str]:
    """Row about how far coarser meshes may be off; none where there are no coarser ones."""
    return {"screen error": f"at most {screen_error:g} pixel"} if surfaces.details else {}


def summarise(
    image: Image,
    scene: PreparedScene,
    path: Path,
    duration: float,
    errors: dict[str, float] | None = None,
) -> None:
    """Write the picture's path, what it took, and how far it may be off."""
    stats = image.stats
    width, height = stats["size"]
    fields = {
        "picture": f"{path} ({width} x {height} pixels)",
        "isovalues": _isovalues(len(stats["isovalues"]), scene),
        "triangles": _triangles(stats),
        **screen_error_field(scene.surfaces, stats["screen_error"]),
        "fragments": f"{thousands(stats['fragments'])} (at most {stats['max_depth_complexity']} per pixel, "
        f"lost {stats['lost_fragments']})",
        **tolerance_fields(scene.plan),
    }
    if errors is not None:
        fields["error"] = error_line(errors)
    say_fields(fields | {"seconds": seconds(duration)})
    say_if_coarse(scene)
    say_flaws(stats, width * height, refined=is_refined(scene))
    if errors is not None and scene.plan.report:
        say_tolerance(errors, scene.plan)


def is_refined(scene: PreparedScene) -> bool:
    """Whether the meshes of a scene are as fine as there are any, or as an automatic refinement or a search ended."""
    from isosample.surfaces.settings import REFINEMENTS

    searched = scene.mesh_distance is not None or bool(scene.plan.report)
    return searched or scene.surfaces.settings.refine == REFINEMENTS[-1]


def say_if_coarse(scene: PreparedScene) -> None:
    """Tell of an automatic refinement that did not come near enough, why it ended, and what helps."""
    distance, refine = scene.mesh_distance, scene.surfaces.settings.refine
    if distance is not None and distance > AUTO_DISTANCE:
        say(
            f"--refine auto ended at {refine}, {_why_ended(refine)}: the meshes are {distance:.2g} voxel (rms) from "
            f"the isosurfaces, not within {AUTO_DISTANCE:g}; isosample filter smooths what bends so much"
        )


def _why_ended(refine: int) -> str:
    """Return why an automatic refinement did not go on, with what helps."""
    from isosample.surfaces.settings import REFINEMENTS

    if refine == REFINEMENTS[-1]:
        return "the finest that there is"
    return (
        f"as finer meshes might have more than {thousands(DEFAULT_MAX_TRIANGLES)} triangles (fewer isovalues, as by "
        f"--per-slope, leave room for them, and --refine {2 * refine} makes them all the same)"
    )


def _triangles(stats: dict[str, Any]) -> str:
    coarser, pieces = stats["skipped"]["chunks_coarser"], stats["skipped"]["chunks_of"]
    drawn = thousands(stats["triangles"]["drawn"])
    return f"{drawn} ({thousands(coarser)} of {thousands(pieces)} pieces coarser)" if coarser else drawn


def note_if_empty(plan: IsovaluePlan, transfer_function: TransferFunction) -> bool:
    """Tell why pictures will be empty, with both ranges: the transfer function may be in other units than the volume.

    Returns
    -------
    told : bool
        Whether the transfer function shows nothing of the volume's range.
    """
    if shows_something(plan):
        return False
    slopes = [slope for slope in transfer_function.slopes() if slope.visible]
    visible = [point.value for slope in slopes for point in (slope.low, slope.high)]
    visible += [one.value for one in transfer_function.isosurfaces]
    where = f"its visible part is {min(visible):g} to {max(visible):g}" if visible else "it has none at all"
    low, high = plan.value_range
    note(
        "nothing is visible: the transfer function has no extinction inside the volume's range, "
        f"{low:g} to {high:g}; {where}"
    )
    return True


def note_if_volume_is_empty(
    volume: Volume, transfer_function: TransferFunction, reconstruction: Reconstruction
) -> bool:
    """Tell the same of pictures of a volume for which there is no plan yet; return whether that was so."""
    from isosample.rendering.quality import Quality, plan_for
    from isosample.transfer.isovalues import plan_isovalues

    of_samples = plan_isovalues(transfer_function, volume.value_range, per_slope=1)
    if reconstruction.interpolates and shows_something(of_samples):
        return False  # what the samples reach, a field through them reaches too: no spline needs to be built
    quality = Quality(per_slope=1, reconstruction=reconstruction)
    return note_if_empty(plan_for(volume, transfer_function, quality), transfer_function)


def say_if_nothing_is_seen(image: Image, box: Box, camera: Camera, settings: RenderSettings) -> None:
    """Tell why a picture is empty though the transfer function shows something."""
    from isosample.rendering.emptiness import is_empty, why_empty

    if is_empty(image, settings):
        height, width = image.rgba.shape[:2]
        say(why_empty(box, camera, (width, height), settings))


def shows_something(plan: IsovaluePlan) -> bool:
    """Whether anything of the volume's range is visible."""
    return bool(len(plan.isovalues) or plan.band_visible.any())


def scene_fields(scene: PreparedScene, screen_error: float) -> dict[str, str]:
    """Rows about a scene of which there are many pictures."""
    return {
        "isovalues": _isovalues(len(scene.plan.isovalues), scene),
        "triangles": thousands(sum(scene.surfaces.statistics.triangles)),
        **screen_error_field(scene.surfaces, screen_error),
        **tolerance_fields(scene.plan),
    }


def _isovalues(count: int, scene: PreparedScene) -> str:
    reused = scene.surfaces.statistics.levels_reused
    return f"{count}" + (f" ({reused} from the cache)" if reused else "")


def error_line(errors: dict[str, float]) -> str:
    """The 99.9 percentiles of an error map: first the one to go by, then what it is made of."""
    estimates = errors["indicator"], errors["mesh"]
    return (
        f"probably below {max(estimates):.2g} for 99.9 % of the pixels, unlit: the larger of two estimates, "
        f"{estimates[0]:.2g} between crossings (|cubic - linear|) and {estimates[1]:.2g} of the meshes, none of them "
        f"measured; were the crossings exact, the guaranteed interval, which is not tight: ± {errors['interval']:.2g}"
    )


def say_tolerance(errors: dict[str, float], plan: IsovaluePlan) -> None:
    """Tell where this view may miss the tolerance that its plan was made for."""
    from isosample.rendering.expected_error import expected_error

    tolerance, expected = plan.report["tolerance"], expected_error(errors, plan.report)
    if expected > tolerance:
        say(
            f"this view may miss the tolerance: an error of about {expected:.2g} is expected, {tolerance:.2g} was "
            "asked for; a smaller --tolerance adds isovalues"
        )
