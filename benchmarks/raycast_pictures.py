"""The pictures of docs/raycasting.md: `python -m benchmarks.raycast_pictures [NAME ...]`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import raycast_picture_scenes as scenes
from benchmarks.accuracy_scenes import SCANS
from isosample.rendering.image import srgb_from_linear

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.raycast_picture_scenes import Panel
    from isosample.volume.grid import F64

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
BACKGROUND = 0.02  # linear grey under the pictures
DPI = 80
PANEL_INCHES = 3.3


def draw_dirac(path: Path) -> None:
    """Figure 3 of the paper: a near-Dirac peak and a smooth feature."""
    _draw(path, scenes.dirac_panels(), columns=4)


def draw_moire(path: Path) -> None:
    """The same, lit and from near: where a table of 256 values makes bands of what is one surface."""
    _draw(path, scenes.moire_panels(), columns=3)


def draw_peaks(path: Path) -> None:
    """Figure 5 of the paper: isosurfaces so close together that one step crosses several."""
    _draw(path, scenes.neighbour_panels(), columns=4)


def draw_noise(path: Path) -> None:
    """Figures 4 and 6 of the paper: narrow peaks in noisy data at low rates."""
    _draw(path, scenes.noise_panels(), columns=3)


def draw_sampling(path: Path) -> None:
    """Figures 6 and 7 of the paper: uniform and differential steps, close up and from afar."""
    _draw(path, [*scenes.sampling_panels(near=True), *scenes.sampling_panels(near=False)], columns=4)


def draw_weights(path: Path) -> None:
    """The paper's weights, shares of the integral, and the reference; opacities along the middle row."""
    figure, axes = _figure(2, 4)
    for row, half_width in zip(axes, (scenes.HALF_WIDTH, scenes.WIDE), strict=True):
        panels = scenes.weight_panels(half_width)
        for place, panel in zip(row, panels, strict=False):
            _show(place, panel)
        profile = row[3]
        for panel, name, style in zip(
            panels, ("paper", "integral", "reference"), ("r-", "c-", "k--"), strict=True
        ):
            profile.plot(panel.rgba[panel.rgba.shape[0] // 2, :, 3], style, label=name, linewidth=1.2)
        profile.set_title("opacity along the middle row", fontsize=9)
        profile.set_box_aspect(1.0)
        profile.tick_params(labelsize=7)
        profile.legend(fontsize=8, loc="lower center")
    figure.savefig(path, dpi=DPI, bbox_inches="tight", pad_inches=0.05)


PICTURES: dict[str, Callable[[Path], None]] = {
    "dirac": draw_dirac,
    "moire": draw_moire,
    "peaks": draw_peaks,
    "noise": draw_noise,
    "sampling": draw_sampling,
    "weights": draw_weights,
}
OF_SCANS = {"noise": "embryo.nrrd", "sampling": "embryo.nrrd"}


def main(names: list[str]) -> None:
    """Draw the named pictures, or all of them, into docs/images."""
    for name in names or PICTURES:
        scan = OF_SCANS.get(name)
        if scan is not None and not (SCANS / scan).is_file():
            print(f"left out: {name}, as there is no {scan} in the folder of scans (ISOSAMPLE_VOLUMES)")
            continue
        path = IMAGES / f"raycast-{name}.png"
        PICTURES[name](path)
        print(f"written to {path}", flush=True)


def _draw(path: Path, panels: list[Panel], *, columns: int) -> None:
    """One panel per place, with what it is and how far it is from the reference."""
    figure, axes = _figure(-(-len(panels) // columns), columns)
    for place, panel in zip(axes.ravel(), panels, strict=False):
        _show(place, panel)
    for place in axes.ravel()[len(panels) :]:
        place.set_axis_off()
    figure.savefig(path, dpi=DPI, bbox_inches="tight", pad_inches=0.05)


def _figure(rows: int, columns: int) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = (PANEL_INCHES * columns, (PANEL_INCHES + 0.5) * rows + 0.1)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _show(place: Any, panel: Panel) -> None:
    place.imshow(_srgb(panel.rgba), interpolation="nearest")
    place.set_title(f"{panel.title}\n{panel.figures}", fontsize=8)
    place.set_axis_off()


def _srgb(rgba: F64) -> F64:
    over = rgba[..., :3] + (1.0 - rgba[..., 3:]) * BACKGROUND
    return np.asarray(srgb_from_linear(np.clip(over, 0.0, 1.0)))


if __name__ == "__main__":
    main(sys.argv[1:])
