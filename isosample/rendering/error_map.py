"""How far a picture may be off, pixel by pixel: an indicator, a guaranteed interval and the mesh's share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.defaults import IMAGE_SUFFIXES
from isosample.errors import InputError, MissingDependencyError
from isosample.files import replacing, write_array
from isosample.integral.list_errors import judge_lists
from isosample.rendering.picture_lists import crossing_lists, least_sheet_slope, visible_parts
from isosample.rendering.shown_error import shown_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.rendering.abuffer import ABuffer
    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings
    from isosample.surfaces.extract import SurfaceSet
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.transfer.isovalue_plan import IsovaluePlan

F32 = npt.NDArray[np.float32]

PART_BYTES = 64 << 20  # lists that are read back and judged at once
SMALLEST_SHOWN = 1e-6  # of the colour scale: below it float32 pictures do not tell
PANELS = {
    "indicator": "|cubic − linear|",
    "interval": "guaranteed interval ± (exact crossings)",
    "mesh": "estimate of the mesh's error",
}


@dataclass(frozen=True, slots=True, eq=False)
class ErrorMap:
    """How far every pixel may be off, in premultiplied linear RGBA, the largest of the four components.

    Attributes
    ----------
    indicator : (H, W) float32
        Difference of the pictures with cubic and with linear segments: large where the course of the data
        between crossings matters. It exceeds the cubic picture's own error nearly everywhere, often by far,
        but promises nothing.
    interval : (H, W) float32
        Half the width of an interval that holds the true value for any field which crosses the isovalues where
        the mesh does, and nowhere else. It does not cover the mesh's own error, nor crossings that the mesh
        misses or invents.
    mesh : (H, W) float32
        Estimate of what the distance between the mesh and the isosurface changes, to first order, from points
        sampled inside the triangles at extraction. It does not see silhouettes: a ray that passes the polygon
        and meets the surface, or the other way round.
    """

    indicator: F32
    interval: F32
    mesh: F32

    @property
    def array(self) -> F32:
        """(H, W, 3) float32: indicator, interval, mesh."""
        return np.stack([self.indicator, self.interval, self.mesh], axis=-1)

    def percentiles(self) -> dict[str, float]:
        """Error that no more than a thousandth of the pixels exceed, by name."""
        return {name: shown_error(getattr(self, name)) for name in PANELS}

    def save(self, path: str | Path) -> Path:
        """Write the maps; the file appears whole or not at all.

        Parameters
        ----------
        path : path
            ``.npy`` (`array` as it is) or ``.png`` (three maps in false colours over one logarithmic scale, with
            a colour bar).

        Raises
        ------
        InputError
            If the suffix is another, or the file cannot be written.
        MissingDependencyError
            If a PNG is asked for and matplotlib is not installed.
        """
        path = Path(path)
        if path.suffix.lower() not in IMAGE_SUFFIXES:
            raise InputError(f"cannot write {path}: an error map is {' or '.join(IMAGE_SUFFIXES)}.")
        if path.suffix.lower() == ".npy":
            with replacing(path) as file:
                write_array(file, self.array)
            return path
        figure = self._figure()
        with replacing(path) as file:
            figure.savefig(file, format="png")
        return path

    def _figure(self) -> Any:
        figure_type, canvas_type, norm_type = _matplotlib()
        height, width = self.indicator.shape
        panel = 4.2
        figure = figure_type(
            figsize=(3 * panel + 1.0, panel * height / width + 0.9), dpi=120, layout="constrained"
        )
        canvas_type(figure)
        top = max(float(self.array.max(initial=0.0)), 10 * SMALLEST_SHOWN)
        norm = norm_type(vmin=max(SMALLEST_SHOWN, 1e-5 * top), vmax=top)
        axes = figure.subplots(1, len(PANELS))
        for place, (name, title) in zip(axes, PANELS.items(), strict=True):
            values = getattr(self, name)
            shown = place.imshow(
                np.maximum(values, norm.vmin), norm=norm, cmap="magma", interpolation="nearest"
            )
            place.set_title(f"{title}\n99.9 % of the pixels below {shown_error(values):.2g}", fontsize=10)
            place.set_axis_off()
        bar = figure.colorbar(shown, ax=axes, shrink=0.9, pad=0.01)
        bar.set_label("error of a component, premultiplied linear RGBA")
        return figure


def error_map(
    abuffer: ABuffer,
    surfaces: SurfaceSet | StoredSurfaces,
    plan: IsovaluePlan,
    camera: Camera,
    size: tuple[int, int],
    settings: RenderSettings,
    progress: Callable[[int, int], None] | None = None,
) -> ErrorMap:
    """How far a picture with cubic segments may be off.

    Parameters
    ----------
    abuffer : ABuffer
        Of the scene of `surfaces` and `plan`.
    surfaces : SurfaceSet
    plan : IsovaluePlan
    camera, size, settings
        As for `ABuffer.render`. Of the unlit picture: a highlight adds light that nothing here covers.
    progress : callable, optional
        Called with pixels done and pixels in all.

    Returns
    -------
    errors : ErrorMap

    Raises
    ------
    InputError
        If the surfaces were extracted without `residuals`.
    CapacityError
        As `ABuffer.render`.

    Notes
    -----
    The lists of the picture are read back and integrated in float64 (`judge_lists`), part by part.
    """
    if not surfaces.settings.residuals:
        raise InputError(
            "an error map needs to know how far the meshes are from the isosurfaces; extract them with residuals=True."
        )
    width, height = size
    in_parts = replace(settings, fragment_budget_bytes=min(PART_BYTES, settings.fragment_budget_bytes))
    origins, directions = (
        part.reshape(-1, 3) for part in camera.rays(width / height).origins_and_directions(width, height)
    )
    reach = abuffer.reach(camera, size, settings)
    maps = np.zeros((3, height * width), dtype=np.float32)
    done, of = 0, width * height
    if progress is not None:
        progress(done, of)
    for part in abuffer.fragment_list_parts(camera, size, in_parts):
        lines = (origins[part.covered], directions[part.covered])
        errors = judge_lists(
            crossing_lists(part, surfaces, *lines),
            plan,
            reach=reach,
            visible=visible_parts(*lines, settings.clip_planes),
            least_slope=least_sheet_slope(surfaces.value_range, surfaces.geometry.box),
            progress=None if progress is None else partial(_after, progress, done, of),
        )
        half_width = 0.5 * (errors.interval[:, 1] - errors.interval[:, 0]).max(axis=-1)
        maps[:, part.covered] = (errors.indicator, half_width, errors.mesh)
        done += len(part.covered)
    return ErrorMap(*maps.reshape(3, height, width))


def _after(progress: Callable[[int, int], None], before: int, of: int, done: int, _: int) -> None:
    """Tell of pixels done in a part after those of the parts before it, and of all pixels."""
    progress(before + done, of)


def check_matplotlib() -> None:
    """Raise `MissingDependencyError` if an error map cannot be written as PNG here."""
    _matplotlib()


def _matplotlib() -> tuple[Any, Any, Any]:
    """Figure, canvas and logarithmic scale."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.colors import LogNorm
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            'an error map as .png needs matplotlib. Install it with: pip install "isosample[plot]", or write .npy.'
        ) from error
    return Figure, FigureCanvasAgg, LogNorm
