"""Plots and false colours: the front is the front, marks stand where the numbers are, scales are logarithmic."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from typing import Any

import hypothesis.strategies as st
import numpy as np
import PIL.Image
import pytest
from hypothesis import given

from isosample.compare import plots, svg
from isosample.compare.false_color import (
    DIFFERENCE_COLORS,
    ERROR_COLORS,
    LUMINANCE,
    Scale,
    difference_png,
    error_png,
    shown,
)
from isosample.compare.verdict import judge
from isosample.defaults import COMPARED_METHODS
from isosample.wording import fraction_text

SVG = "{http://www.w3.org/2000/svg}"
FONT_SIZE = 13.0  # of all texts, see `svg.STYLE`
numbers = st.integers(1, 6).map(float)  # few, so that equal ones are common


def entry(method: str, parameter: str, rmse: float, frame: float) -> dict[str, Any]:
    summary: dict[str, Any] = {"rmse": rmse, "frame_seconds": frame, "evaluations_per_ray": 1000 * frame}
    summary |= {"worst_pixels_share": 0.0, "not_shown": {}}
    return {"method": method, "parameter": parameter, "label": "x < 1", "summary": summary}


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=8))
def test_on_the_front_is_what_nobody_beats(points: list[tuple[float, float]]) -> None:
    front = plots.pareto(points)

    def beaten(own: int) -> bool:
        a, b = points[own]
        return any(
            c <= a and d <= b and ((c, d) != (a, b) or other < own)
            for other, (c, d) in enumerate(points)
            if other != own
        )

    assert sorted(front) == [index for index in range(len(points)) if not beaten(index)]
    assert [points[index][0] for index in front] == sorted(points[index][0] for index in front)


def test_marks_stand_where_the_numbers_are() -> None:
    entries = [
        entry("data-centric", "isovalues per slope", 1e-2, 0.01),
        entry("data-centric", "isovalues per slope", 1e-4, 0.1),
        entry("data-centric", "tolerance", 1e-3, 0.1),
        entry("peak-finding", "step", 1e-3, 0.02),
    ]
    root = ET.fromstring(plots.error_against_time(entries))
    marks = [one for one in root if one.get("class") == "point"]
    places = np.array([re.findall(r"[\d.]+", one.get("transform") or "") for one in marks], dtype=float)
    x, y = places.T
    # two decades of error and one of time between the first two; the third is halfway down
    assert y[2] - y[0] == pytest.approx((y[1] - y[0]) / 2, abs=0.11)  # places have one decimal
    assert (x[3] - x[0]) / (x[1] - x[0]) == pytest.approx(np.log10(2.0), abs=0.002)
    assert (x.min() > svg.LEFT, x.max() < svg.WIDTH, y.min() > svg.TOP, y.max() < svg.HEIGHT) == (True,) * 4
    tips = [one.get("data-tip") or "" for one in marks]
    assert tips[0] == "data-centric, x < 1: RMSE 1.00e-02, 10 ms, 10 per ray, on the Pareto front"
    assert [tip.endswith("on the Pareto front") for tip in tips] == [True, True, False, True]
    lines = [one.get("class") for one in root if (one.get("class") or "").startswith("line")]
    assert lines == ["line s0"]  # settings of one parameter are joined; a single one has no line


def document_of(**least: float) -> dict[str, Any]:
    """Results of methods with one setting each, and these errors."""
    entries = [
        entry(name, "step", rmse, 0.1) | {"name": name, "setup_seconds": 1.0}
        for name, rmse in ((name.replace("_", "-"), rmse) for name, rmse in least.items())
    ]
    return {"entries": entries, "verdict": judge(entries).to_dict()}


def test_time_against_frames_says_at_which_error_and_whom_it_leaves_out_and_why() -> None:
    document = document_of(
        data_centric=0.0086, post_classified=0.12, pre_integrated=0.0004, peak_finding=0.002
    )
    told = (
        "Each method at its fastest setting with an RMSE of at most 0.002. Here data-centric (0.0086 at best) and "
        "post-classified (0.12 at best) never get to 0.002, so they are not drawn."
    )
    assert plots.frames_caption(document) == told
    root = ET.fromstring(plots.time_against_frames(document))
    assert (root.get("aria-label") or "").endswith(told)
    words = [one.text for one in root.iter(f"{SVG}text")]
    assert "RMSE ≤ 0.002" in words
    assert [word for word in words if word in COMPARED_METHODS] == ["pre-integrated", "peak-finding"]


def test_time_against_frames_leaves_out_one_method_or_none() -> None:
    everyone = document_of(data_centric=0.0001, peak_finding=0.001)
    told = "Each method at its fastest setting with an RMSE of at most {}."
    assert plots.frames_caption(everyone) == told.format(0.001)
    one_late = document_of(data_centric=0.0001, pre_integrated=0.001, post_classified=0.0051)
    assert plots.frames_caption(one_late) == (
        f"{told.format(0.001)} Here post-classified (0.0051 at best) never gets to 0.001, so it is not drawn."
    )


def test_no_text_covers_another_however_many_methods_there_are() -> None:
    document = document_of(data_centric=1e-4, post_classified=1e-4, pre_integrated=1e-4, peak_finding=1e-4)
    root = ET.fromstring(plots.time_against_frames(document))
    boxes = []
    for one in root.iter(f"{SVG}text"):
        if one.get("transform"):
            continue
        x, y = float(one.get("x", 0)), float(one.get("y", 0))
        width = 0.65 * FONT_SIZE * len(one.text or "")  # digits of wide sans-serif fonts take 0.64
        start = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[one.get("text-anchor", "start")]
        boxes.append((start, start + width, y - FONT_SIZE, y))
    assert len(boxes) > 10
    for number, (left, right, top, bottom) in enumerate(boxes):
        for other in boxes[:number]:
            assert left > other[1] or right < other[0] or top > other[3] or bottom < other[2]


def test_without_a_race_there_is_no_plot_of_frames_and_the_reason_is_told() -> None:
    document = document_of(data_centric=0.0086, pre_integrated=0.3)
    assert plots.time_against_frames(document) == ""
    assert (
        plots.frames_caption(document)
        == "The time of many frames is not drawn: no method gets to an RMSE of 0.005."
    )


@given(st.floats(1e-9, 1e9), st.floats(1.001, 1e6))
def test_a_logarithmic_axis_has_ticks_within_it(low: float, ratio: float) -> None:
    ticks = svg.around([low, low * ratio], start=0.0, stop=100.0).ticks()
    axis = svg.around([low, low * ratio], start=0.0, stop=100.0)
    assert 1 <= len(ticks) <= 9
    assert all(axis.low * (1 - 1e-6) <= tick <= axis.high * (1 + 1e-6) for tick in ticks)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([0.001, 0.01, 0.1], "0.001 0.01 0.1"),
        ([0.0001, 0.01, 0.1], "10⁻⁴ 10⁻² 10⁻¹"),
        ([1.0, 10.0, 1000.0, 10000.0], "1 10 1000 10000"),
        ([1.0, 1000.0, 100000.0], "10⁰ 10³ 10⁵"),
        ([0.0, 0.0005, 0.001, 0.0015], "0 5·10⁻⁴ 10⁻³ 1.5·10⁻³"),
        ([-20.0, 0.0, 20.0], "-20 0 20"),
        ([0.30000000000000004, 0.1], "0.3 0.1"),
    ],
)
def test_the_numbers_of_an_axis_are_written_in_one_way(values: list[float], words: str) -> None:
    assert " ".join(svg.tick_texts(values)) == words


@pytest.mark.parametrize(
    ("value", "words"), [(0.25, "1/4"), (1 / 255, "1/255"), (2.0, "2"), (0.3, "0.3"), (1.0, "1")]
)
def test_settings_are_written_as_fractions_where_they_are(value: float, words: str) -> None:
    assert fraction_text(value) == words


def test_the_histogram_shows_counts_and_the_transfer_function() -> None:
    scene = {
        "histogram": {"counts": [10, 0, 1000], "edges": [0.0, 1.0, 2.0, 3.0]},
        "transfer_function": {
            "points": [
                {"value": 0.5, "color": [1, 0, 0], "extinction": 0},
                {"value": 1.5, "color": [0, 0, 1], "extinction": 2},
            ],
            "isosurfaces": [{"value": 2.5, "color": [1, 1, 1], "opacity": 0.5}],
        },
    }
    root = ET.fromstring(plots.histogram_plot(scene))
    bars = next(one.get("d") or "" for one in root if one.get("class") == "bars")
    heights = [float(one) for one in re.findall(r"V([\d.]+)", bars)]
    bottom = plots.HISTOGRAM_HEIGHT - svg.BOTTOM
    assert heights[1] == heights[3] == bottom  # the empty bin, and the end
    assert heights[2] < heights[0] < bottom
    colors = [one.get("stop-color") for one in root.iter(f"{SVG}stop")]
    assert (
        colors[21] == "#bc00bc"
    )  # at 1, a third of the way: half red and half blue, sRGB of 0.5 being 187.5
    (impulse,) = [one for one in root if one.get("stroke") == "#ffffff"]
    assert impulse.get("stroke-width") == "3"


def test_a_transfer_function_of_isosurfaces_alone_has_no_highest_extinction() -> None:
    surface = {"value": 2.5, "color": [1, 1, 1], "opacity": 0.5}
    point = {"value": 1.5, "color": [0, 0, 1], "extinction": 2}
    scene: dict[str, Any] = {"histogram": {"counts": [10, 0, 1000], "edges": [0.0, 1.0, 2.0, 3.0]}}
    for points, told in (([], False), ([point, point | {"value": 2.0}], True)):
        transfer_function = {"points": points, "isosurfaces": [surface]}
        drawn = plots.histogram_plot(scene | {"transfer_function": transfer_function})
        assert ("extinction, up to 2 per world unit" in drawn) == told
        assert ("extinction, up to" in drawn) == told


def decoded(png: bytes) -> np.ndarray[Any, np.dtype[np.uint8]]:
    with PIL.Image.open(io.BytesIO(png)) as picture:
        return np.asarray(picture.convert("RGB"))


def rgb(color: str) -> list[int]:
    return [int(color[place : place + 2], 16) for place in (1, 3, 5)]


def test_error_maps_are_logarithmic_between_the_ends_of_the_scale() -> None:
    scale = Scale.up_to([0.03])
    assert (scale.low, scale.high) == pytest.approx((1e-5, 0.1))
    assert scale.ticks == pytest.approx([1e-5, 1e-4, 1e-3, 1e-2, 1e-1])
    truth = np.zeros((1, 5, 4), np.float32)
    image = truth.copy()
    image[0, :, 2] = [0.0, 1e-5, -1e-3, 0.1, 0.7]  # half of four decades in the middle
    found = decoded(error_png(image, truth, scale))[0].tolist()
    assert found[0] == found[1] == rgb(ERROR_COLORS[0])
    assert np.abs(np.subtract(found[2], rgb(ERROR_COLORS[4]))).max() <= 1  # 255 steps have no exact middle
    assert found[3] == found[4] == rgb(ERROR_COLORS[-1])


def test_differences_are_blue_below_and_red_above() -> None:
    scale = Scale.up_to([0.1])
    truth = np.full((1, 3, 4), 0.5, np.float32)
    image = truth.copy()
    image[0, 1, :3] -= 0.2
    image[0, 2, :3] += 0.2
    found = decoded(difference_png(image, truth, scale))[0].tolist()
    assert np.abs(np.subtract(found[0], rgb(DIFFERENCE_COLORS[3]))).max() <= 1
    assert (found[1], found[2]) == (rgb(DIFFERENCE_COLORS[0]), rgb(DIFFERENCE_COLORS[-1]))
    assert sum(LUMINANCE) == pytest.approx(1.0)


def test_a_scale_ends_at_the_power_of_ten_above_and_never_below_what_float32_tells() -> None:
    assert Scale.up_to([0.1]).high == pytest.approx(0.1)
    assert Scale.up_to([0.11]).high == pytest.approx(1.0)
    assert Scale.up_to([0.0]).high == pytest.approx(1e-6)


def test_pictures_are_shown_over_the_backdrop() -> None:
    rgba = np.array([[[0.0, 0.0, 0.0, 0.0], [0.25, 0.0, 0.0, 0.5]]], np.float32)
    found = shown(rgba, (1.0, 0.0, 0.0))
    # sRGB of 0.75 is 0.8808, times 255 is 224.6
    assert found.tolist() == [[[255, 0, 0], [225, 0, 0]]]


def test_every_method_has_its_own_mark() -> None:
    assert len(set(svg.MARKS.values())) == len(svg.MARKS) == len(COMPARED_METHODS)
