"""The plot of a histogram: a whole PNG, whatever the transfer function and the volume."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError, MissingDependencyError
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.plot import plot_histogram
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from pathlib import Path

STEP = [ControlPoint(2.0, (1.0, 0.0, 0.0), 0.0), ControlPoint(5.0, (0.0, 1.0, 0.0), 1.0)]
STEP += [ControlPoint(5.0, (0.0, 0.0, 1.0), 0.2), ControlPoint(20.0, (0.0, 0.0, 1.0), 0.2)]
TFS = {
    "none": None,
    "a step": TransferFunction(STEP),
    "impulses alone": TransferFunction([], [Isosurface(3.0, (1.0, 1.0, 0.0), 0.5)]),
    "outside the range": TransferFunction([ControlPoint(100.0, (1.0, 0.0, 0.0), 1.0)] * 2),
}


def volume() -> Volume:
    return Volume(np.arange(64, dtype=np.int16).reshape(4, 4, 4) % 10)


@pytest.mark.parametrize("name", TFS)
def test_every_transfer_function_gives_a_whole_png(tmp_path: Path, name: str) -> None:
    pytest.importorskip("matplotlib")
    tf = TFS[name]
    plan = None if tf is None else plan_isovalues(tf, volume().value_range)
    path = plot_histogram(volume(), tf, path=tmp_path / "h.png", plan=plan)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in tmp_path.iterdir()] == ["h.png"]


def test_the_transfer_function_changes_the_picture(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pictures = {plot_histogram(volume(), tf, path=tmp_path / "h.png").read_bytes() for tf in TFS.values()}
    assert len(pictures) >= len(TFS) - 1  # one that lies outside the range draws its axis alone


def test_a_constant_volume_has_a_histogram_too(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    assert plot_histogram(Volume(np.full((3, 3, 3), 7)), path=tmp_path / "h.png").stat().st_size > 1000


def test_a_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    with pytest.raises(InputError, match="cannot be written"):
        plot_histogram(volume(), path=tmp_path / "absent" / "h.png")


def test_without_matplotlib_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r"isosample\[plot\]"):
        plot_histogram(volume(), path=tmp_path / "h.png")


def test_the_legend_covers_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = []
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    save = Figure.savefig

    def watched(figure: Figure, *args: Any, **options: Any) -> None:
        figures.append(figure)
        save(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", watched)
    tf = TFS["a step"]
    assert tf is not None
    plot_histogram(volume(), tf, path=tmp_path / "h.png", plan=plan_isovalues(tf, volume().value_range))
    (figure,) = figures
    (legend,) = (found for axes in figure.axes if (found := axes.get_legend()) is not None)
    assert legend.get_window_extent().y0 >= max(axes.get_window_extent().y1 for axes in figure.axes)
    assert figure.bbox.x1 >= legend.get_window_extent().x1
    assert figure.bbox.y1 >= legend.get_window_extent().y1
