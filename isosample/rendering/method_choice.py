"""Which method shows a scene at the least cost: an estimate from the plan and the data, without rendering."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from isosample.defaults import (
    CHOSEN_FROM,
    DATA_CENTRIC,
    DEFAULT_SIZE,
    EXACT_PEAKS,
    PEAK_FINDING,
    PRE_INTEGRATED,
)
from isosample.errors import InputError
from isosample.gl.context import is_software, shared_context
from isosample.rendering.camera import Camera
from isosample.rendering.cost_estimate import (
    after_search,
    costs_of,
    estimate_cost,
    origin_of_costs,
    seconds_to_read,
    tolerance_needs,
    with_tolerance,
)
from isosample.rendering.quality import Quality, plan_for
from isosample.rendering.raycast_settings import Classification, Crossings, PeakWeight, RaycastSettings
from isosample.rendering.scene_load import LoadEstimator
from isosample.rendering.settings import RenderSettings, check_size
from isosample.surfaces.settings import ExtractionSettings, check_volume
from isosample.transfer.isovalue_plan import Reason
from isosample.transfer.transfer_function import check_is_transfer_function
from isosample.volume.reconstruction import GridSpline
from isosample.wording import duration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.rendering.cost_estimate import CostEstimate
    from isosample.rendering.scene_load import SceneLoad
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.macrocells import MacrocellGrid


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodChoice:
    """A method, and why.

    Attributes
    ----------
    method : str
        ``data-centric``, ``pre-integrated`` or ``peak-finding``.
    reason : str
        In words.
    estimates : tuple of CostEstimate
        Of every method that was possible, the cheapest first.
    load : SceneLoad
        What the estimates are made from.
    macrocells : MacrocellGrid
        Bounds of the volume's field, which a `RayCaster` with as many macrocells can take.
    measured : str
        Where the seconds per unit of work come from.
    estimate_seconds : float
        Processor time that the choice itself took.
    """

    method: str
    reason: str
    estimates: tuple[CostEstimate, ...]
    load: SceneLoad
    macrocells: MacrocellGrid = field(repr=False)
    measured: str
    estimate_seconds: float

    def to_dict(self) -> dict[str, Any]:
        """All of it, JSON-ready."""
        return {
            "method": self.method,
            "reason": self.reason,
            "estimated_seconds": {one.method: one.to_dict() for one in self.estimates},
            "load": self.load.to_dict(),
            "measured": self.measured,
            "estimate_seconds": self.estimate_seconds,
        }


def choose_method(
    volume: Volume,
    transfer_function: TransferFunction,
    *,
    cameras: Sequence[Camera] | None = None,
    size: tuple[int, int] = DEFAULT_SIZE,
    settings: RenderSettings | None = None,
    quality: Quality | None = None,
    raycast: RaycastSettings | None = None,
    among: Sequence[str] = CHOSEN_FROM,
    software: bool | None = None,
    spent_seconds: float = 0.0,
) -> MethodChoice:
    """Choose the method that is expected to take the least time for all frames with their preparation.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    cameras : sequence of Camera, optional
        One per frame; `Camera.default(volume.box, size)` by default: from the front.
    size : (width, height)
        Pixels.
    settings : RenderSettings, optional
    quality : Quality, optional
        Of the data-centric method; with a material in `settings` taken for `lit`. What refined and coarser meshes cost
        is not measured: `refine` and `max_isovalues` must be the defaults, without `details`.
    raycast : RaycastSettings, optional
        Of the ray caster: its step; `raycast_settings_for` says what else it should be. The reconstruction must be that
        of `quality`, where both are given.
    among : sequence of str
        Methods to choose from. Of the ray caster's two only one is estimated: peak finding where the transfer
        function has isosurfaces or peaks too narrow for samples, else pre-integration.
    software : bool, optional
        Whether OpenGL runs on the processor; None: ask the driver.
    spent_seconds : float
        That the job has taken so far, for the estimates of the whole: start-up and reading.

    Returns
    -------
    choice : MethodChoice

    Raises
    ------
    InputError
        If the volume cannot be rendered, there is nothing to choose from, or the methods cannot be compared with such
        a `quality` and `raycast`.
    OpenGLError
        If `software` is None and there is no usable OpenGL.

    Notes
    -----
    With a tolerance the isovalues, triangles and steps are those that tolerances took in measured scenes, and the
    seconds of the search are added: a rough estimate, as only the search itself can tell.

    The load (triangles, fragments, samples and so on) is estimated from bounds of the field, a sample of its cells
    and some rays through a coarse grid of densities; seconds are sums of coefficients times these numbers.
    What was spent before, with the choice itself (processor time), and the reading of samples that stay in their file
    (once more by either method, at the rate of a block that is read for it) come on top.
    """
    started = time.process_time()
    check_size(size)
    settings = settings or RenderSettings()
    quality, raycast = _of_one_field(quality, raycast)
    _check_measured(quality)
    if settings.material is not None:
        quality = dataclasses.replace(quality, lit=True)
    unknown = sorted(set(among) - set(CHOSEN_FROM))
    if unknown or not among:
        raise InputError(f"methods {list(among)} must be some of {', '.join(CHOSEN_FROM)}.")
    check_is_transfer_function(transfer_function)
    check_volume(volume, ExtractionSettings(nan_masked=True, reconstruction=quality.reconstruction))
    cameras = cameras or [Camera.default(volume.box, size)]
    smooth = quality.reconstruction.smooth
    spline = GridSpline.build(volume, quality.reconstruction) if smooth else None
    plan = plan_for(volume, transfer_function, quality, spline=spline)
    needs = None if quality.tolerance is None else tolerance_needs(quality.tolerance)
    step = raycast.step if needs is None else needs["step"]
    methods = _possible(plan, among)
    estimator = LoadEstimator(volume, transfer_function, quality.reconstruction, spline=spline)
    load = estimator.load(plan, cameras, size, settings, step=step)
    load = load if needs is None else with_tolerance(load, needs)
    on_processor = is_software(shared_context()) if software is None else software
    costs = costs_of(software=on_processor)
    shaded = settings.material is not None
    found = [
        estimate_cost(method, load, costs, frames=len(cameras), shaded=shaded, smooth=smooth)
        for method in methods
    ]
    if needs is not None:
        found = [after_search(one, needs) for one in found]
    read_again = seconds_to_read(volume)
    took = time.process_time() - started
    found = [
        dataclasses.replace(one, read_seconds=read_again, spent_seconds=spent_seconds + took) for one in found
    ]
    estimates = tuple(sorted(found, key=lambda one: one.total_seconds))
    return MethodChoice(
        method=estimates[0].method,
        reason=_reason(estimates, among),
        estimates=estimates,
        load=load,
        macrocells=estimator.macrocells,
        measured=origin_of_costs(software=on_processor),
        estimate_seconds=took,
    )


def raycast_settings_for(method: str, template: RaycastSettings | None = None) -> RaycastSettings:
    """Settings of the ray caster that `choose_method` means by a method: exact integration, exact crossings.

    Parameters
    ----------
    method : str
        ``pre-integrated`` or ``peak-finding``.
    template : RaycastSettings, optional
        Everything else.
    """
    template = template or RaycastSettings()
    classification = Classification(method)
    if classification is not Classification.PEAK_FINDING:
        return dataclasses.replace(template, classification=classification)
    return dataclasses.replace(
        template,
        classification=classification,
        peak_weight=PeakWeight(EXACT_PEAKS["peak_weight"]),
        crossings=Crossings(EXACT_PEAKS["crossings"]),
    )


def is_sharp(plan: IsovaluePlan) -> bool:
    """Whether a transfer function has isosurfaces, or peaks that are narrower than meshes can tell."""
    return any(reason in (Reason.IMPULSE, Reason.SHEET) for reason in plan.reasons)


def _of_one_field(
    quality: Quality | None, raycast: RaycastSettings | None
) -> tuple[Quality, RaycastSettings]:
    """Settings of both methods; one that is not given takes the reconstruction of the other."""
    if raycast is None:
        quality = quality or Quality()
        return quality, RaycastSettings(reconstruction=quality.reconstruction)
    quality = quality or Quality(reconstruction=raycast.reconstruction)
    if quality.reconstruction is not raycast.reconstruction:
        raise InputError(
            f"quality has the reconstruction {quality.reconstruction.value}, and raycast "
            f"{raycast.reconstruction.value}; methods are compared on one field: give both the same."
        )
    return quality, raycast


def _check_measured(quality: Quality) -> None:
    """Raise `InputError` for options with which the method through isosurfaces costs what nobody has measured."""
    plain = Quality(tolerance=quality.tolerance)
    for name in ("refine", "details", "max_isovalues"):
        given, measured = getattr(quality, name), getattr(plain, name)
        same_meshes = name == "refine" and quality.most_pieces == plain.most_pieces
        if given != measured and not same_meshes:
            raise InputError(
                f"{name} {given!r}: what it costs is not measured, so that no method can be chosen with it; pass "
                f"{name}={measured!r}, or choose the method yourself."
            )


def _possible(plan: IsovaluePlan, among: Sequence[str]) -> list[str]:
    """Methods to estimate: of the two of the ray caster the one that suits the transfer function, or is left."""
    rays = [method for method in among if method != DATA_CENTRIC]
    wanted = PEAK_FINDING if is_sharp(plan) else PRE_INTEGRATED
    kept = [wanted] if wanted in rays else rays[:1]
    return [DATA_CENTRIC, *kept] if DATA_CENTRIC in among else kept


def _reason(estimates: Sequence[CostEstimate], among: Sequence[str]) -> str:
    first = estimates[0]
    frames = "1 frame" if first.frames == 1 else f"{first.frames} frames"
    if len(estimates) == 1:
        return (
            f"the options leave {first.method} alone"
            if len(among) == 1
            else f"{first.method} suits the options"
        )
    told = " against ".join(f"{duration(one.total_seconds)} by {one.method}" for one in estimates)
    return (
        f"{told} are estimated for {frames} with everything before, of which {duration(first.spent_seconds)} are spent "
        "(start-up, reading, this choice)"
    )
