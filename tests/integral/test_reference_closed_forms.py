"""The reference integral against closed forms: slabs, ramps, impulses, steps, plateaus, saddles."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.integral.optics import segment_weights
from isosample.integral.reference import DEFAULT_TOLERANCE, integrate_rays
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

WHITE = (1.0, 1.0, 1.0)
RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
# Rounding of a ray of up to 60 cells: some 30 roundings of numbers up to 60 per cell, times an extinction up
# to 1, so 60 · 30 · 60 · 2^-53 = 1.2e-11 at worst; quadrature adds at most the tolerance.
ROUNDING = 1.2e-11
TOLERANCE = DEFAULT_TOLERANCE + ROUNDING


def turned(angles: tuple[float, float, float]) -> F64:
    """Rotation matrix, about z, then y, then x."""
    turn = np.eye(3)
    for axis, angle in enumerate(angles):
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        step = np.eye(3)
        step[[i, j], [i, j]] = math.cos(angle)
        step[i, j], step[j, i] = -math.sin(angle), math.sin(angle)
        turn = turn @ step
    return turn


def random_rays(volume: Volume, count: int, inside: bool) -> tuple[F64, F64]:
    """Rays through random points of a volume, from afar or from inside it."""
    rng = np.random.default_rng(5)
    box = volume.box
    target = box.corner + rng.random((count, 3)) @ box.edges
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return target - (0.0 if inside else 3.0 * box.radius) * directions, directions


def interval(volume: Volume, origins: F64, directions: F64) -> tuple[F64, F64]:
    """Where generic rays enter and leave the box, in front of the origin."""
    unit_from_world = np.linalg.inv(volume.box.edges.T)
    o, d = (origins - volume.box.corner) @ unit_from_world.T, directions @ unit_from_world.T
    with np.errstate(divide="ignore"):
        faces = np.stack([-o / d, (1.0 - o) / d])
    return np.maximum(faces.min(axis=0).max(axis=1), 0.0), faces.max(axis=0).min(axis=1)


def column(values: list[float], tf: TransferFunction, backwards: bool = False) -> Any:
    """Picture of a field that varies along x alone, seen along x."""
    row = np.array(values, dtype=np.float64)
    volume = Volume(np.broadcast_to(row, (2, 2, len(row))).copy())
    start, way = ([len(row) + 3.0, 0.4, 0.3], [-1.0, 0, 0]) if backwards else ([-2.0, 0.4, 0.3], [1.0, 0, 0])
    return integrate_rays(volume, tf, [start], [way])[0]


def absorbing(low: float, high: float, extinction: float = 1.0) -> TransferFunction:
    """Constant extinction between two values, with steps at both."""
    return TransferFunction([ControlPoint(low, WHITE, extinction), ControlPoint(high, WHITE, extinction)])


@pytest.mark.parametrize("inside", [False, True], ids=["eye outside", "eye inside"])
@pytest.mark.parametrize("extinction", [1e-18, 0.3, 1e6])
def test_a_constant_slab_attenuates_by_its_chord(extinction: float, inside: bool) -> None:
    volume = Volume(np.full((5, 6, 7), 3.5), spacing=(1.0, 2.0, 0.5), direction=turned((0.3, 0.5, -0.2)))
    color = (0.2, 0.4, 0.8)
    tf = TransferFunction([ControlPoint(3.0, color, extinction), ControlPoint(4.0, color, extinction)])
    origins, directions = random_rays(volume, 60, inside)
    start, end = interval(volume, origins, directions)
    alpha = -np.expm1(-extinction * (end - start))
    # Relative: an opacity of 1e-18 has all its digits. The chord is a difference of numbers up to 40.
    relative = 40 * 30 * 2.0**-53 / (end - start) + 1e-14
    error = np.abs(integrate_rays(volume, tf, origins, directions) - alpha[:, None] * [*color, 1.0])
    assert np.all(error <= alpha[:, None] * relative[:, None])


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.5, 1.0, 8.0)], ids=["isotropic", "anisotropic"])
@pytest.mark.parametrize("inside", [False, True], ids=["eye outside", "eye inside"])
def test_a_linear_field_under_one_linear_piece_is_one_segment(
    inside: bool, spacing: tuple[float, float, float], offset: float
) -> None:
    z, y, x = np.mgrid[0:11, 0:7, 0:9]
    per_index = np.array([1.0, 0.5, -0.75])  # exact in binary, also with the offset
    samples = offset + np.stack([x, y, z], axis=-1) @ per_index
    volume = Volume(samples, spacing=spacing, origin=(3.0, -2.0, 5.0), direction=turned((0.1, -0.4, 0.7)))
    low, high = volume.value_range
    origins, directions = random_rays(volume, 50, inside)
    plane = np.array([1.0, 0.3, -0.2, 0.0])
    plane[3] = 0.4 - plane[:3] @ volume.box.centre
    for planes in ([], [tuple(plane.tolist())]):
        start, end = interval(volume, origins, directions)
        if planes:
            crossing = -(origins @ plane[:3] + plane[3]) / (directions @ plane[:3])
            start = np.where(directions @ plane[:3] > 0, np.maximum(start, crossing), start)
            end = np.where(directions @ plane[:3] < 0, np.minimum(end, crossing), end)
        length = np.maximum(end - start, 0.0)
        index_from_world = np.linalg.inv(volume.world_from_index)
        for extinctions in [(0.02, 0.3), (0.9, 0.0)]:
            tf = TransferFunction(
                [
                    ControlPoint(low, (1.0, 0.25, 0.0), extinctions[0]),
                    ControlPoint(high, (0.0, 0.5, 1.0), extinctions[1]),
                ]
            )
            ends = []
            for t in (start, end):
                places = (origins + t[:, None] * directions) @ index_from_world[:3, :3].T
                value = (places + index_from_world[:3, 3]) @ per_index - (low - offset)
                ends.append(np.clip(value / (high - low), 0.0, 1.0))
            front, back = (extinctions[0] + u * (extinctions[1] - extinctions[0]) for u in ends)
            weights = segment_weights(front * length, back * length)
            place = weights[:, 0] * ends[0] + weights[:, 1] * ends[1]
            alpha = weights.sum(axis=1)
            expected = np.stack([alpha - place, 0.25 * alpha + 0.25 * place, place, alpha], axis=1)
            rgba = integrate_rays(volume, tf, origins, directions, clip_planes=planes)
            assert np.abs(rgba - expected).max() <= TOLERANCE
            assert expected[:, 3].max() > 0.5


def test_thin_media_keep_all_digits_where_the_colour_changes() -> None:
    """To first order light is extinction times length: 6e-18 in all, red and blue half each, by symmetry."""
    tf = TransferFunction([ControlPoint(0.0, RED, 1e-18), ControlPoint(6.0, BLUE, 1e-18)])
    rgba = column([0, 1, 2, 3, 4, 5, 6], tf)
    assert rgba == pytest.approx([3e-18, 0.0, 3e-18, 6e-18], rel=1e-14, abs=0.0)


def test_impulses_composite_once_each_in_the_order_of_travel() -> None:
    surfaces = [Isosurface(1.25, RED, 0.5), Isosurface(3.0, GREEN, 0.4), Isosurface(5.5, BLUE, 0.3)]
    tf = TransferFunction([], surfaces)
    values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]  # the second isovalue is that of a sample
    assert column(values, tf) == pytest.approx([0.5, 0.2, 0.09, 0.79], abs=1e-15)
    assert column(values, tf, backwards=True) == pytest.approx([0.21, 0.28, 0.3, 0.79], abs=1e-15)
    assert column(values[:4], tf) == pytest.approx([0.5, 0.2, 0.0, 0.7], abs=1e-15)


@pytest.mark.parametrize(
    ("values", "crossings"),
    [
        ([0, 1, 0], 0),  # touches
        ([2, 1, 2], 0),
        ([0, 1, 2], 1),
        ([2, 1, 0], 1),
        ([0, 1, 1, 0], 2),  # goes in, stays, goes out: the isovalue itself is inside
        ([2, 1, 1, 2], 0),
        ([0, 1, 1, 2], 1),
        ([2, 1, 1, 0], 1),
        ([0, 1], 1),  # the box ends at the isovalue
        ([1, 0], 1),
        ([1, 2], 0),
        ([2, 1], 0),
        ([1, 1, 1], 0),
        ([0, 2, 0, 2, 1, 0, 1], 5),
    ],
)
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_a_value_equal_to_the_isovalue_is_inside(values: list[float], crossings: int, offset: float) -> None:
    tf = TransferFunction([], [Isosurface(1.0 + offset, WHITE, 0.5)])
    for backwards in (False, True):
        rgba = column([value + offset for value in values], tf, backwards)
        assert rgba[3] == pytest.approx(1.0 - 0.5**crossings, abs=1e-15)


def step_plateaus() -> None:
    """Plateaus at a step take the extinction from above, at the last control point that from below."""
    step = [
        ControlPoint(0.0, RED, 0.0),
        ControlPoint(1.0, RED, 0.5),
        ControlPoint(1.0, BLUE, 2.0),
        ControlPoint(3.0, BLUE, 2.0),
    ]
    rgba = column([1, 1, 1], TransferFunction(step))
    assert rgba == pytest.approx([0.0, 0.0, -math.expm1(-4.0), -math.expm1(-4.0)], abs=1e-14)
    rgba = column([1, 1, 1], TransferFunction(step[:2]))
    assert rgba == pytest.approx([-math.expm1(-1.0), 0.0, 0.0, -math.expm1(-1.0)], abs=1e-14)
    # Through the step: depth 1/4 below it, then 2 above it.
    rgba = column([0, 1, 2], TransferFunction(step))
    front, back = -math.expm1(-0.25), math.exp(-0.25) * -math.expm1(-2.0)
    assert rgba == pytest.approx([front, 0.0, back, front + back], abs=TOLERANCE)


def test_a_step_has_two_limits() -> None:
    step_plateaus()


def test_a_wrong_one_sided_limit_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = TransferFunction.evaluate

    def from_below(self: TransferFunction, values: npt.ArrayLike, side: Any = "closed") -> tuple[F64, F64]:
        return right(self, values, side="left")

    monkeypatch.setattr(TransferFunction, "evaluate", from_below)
    with pytest.raises(AssertionError):
        step_plateaus()


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_the_diagonals_of_a_saddle_cell_are_parabolas(offset: float) -> None:
    """f = x y on the unit cell: s² along one diagonal of its square, s (1 − s) along the other."""
    samples = np.full((2, 2, 2), offset)
    samples[:, 1, 1] += 1.0
    volume, half = Volume(samples), math.sqrt(0.5)
    along = ([-half, -half, 0.5], [half, half, 0.0], lambda v: math.sqrt(v))
    across = ([-half, 1.0 + half, 0.5], [half, -half, 0.0], None)
    for low, high in pairwise([0.03125, 0.125, 0.1875, 0.234375]):
        rgba = integrate_rays(volume, absorbing(low + offset, high + offset, 0.7), [along[0]], [along[1]])[0]
        depth = 0.7 * math.sqrt(2.0) * (math.sqrt(high) - math.sqrt(low))
        assert rgba[3] == pytest.approx(-math.expm1(-depth), abs=1e-14)
        rgba = integrate_rays(volume, absorbing(low + offset, high + offset, 0.7), [across[0]], [across[1]])[
            0
        ]
        depth = 0.7 * math.sqrt(2.0) * (math.sqrt(1 - 4 * low) - math.sqrt(1 - 4 * high))
        assert rgba[3] == pytest.approx(-math.expm1(-depth), abs=1e-13)
    # The top of the parabola is 1/4: just below it two crossings, at it a touch, above it none.
    for level, crossings in [(0.25 - 2.0**-30, 2), (0.25, 0), (0.25 + 2.0**-30, 0)]:
        tf = TransferFunction([], [Isosurface(level + offset, WHITE, 0.5)])
        rgba = integrate_rays(volume, tf, [[0.0, 1.0, 0.5]], [[half, -half, 0.0]])[0]
        assert rgba[3] == pytest.approx(1.0 - 0.5**crossings, abs=1e-15)


def test_the_space_diagonal_of_a_corner_cell_is_a_cubic() -> None:
    """f = x y z on the unit cell: s³ along the space diagonal."""
    samples = np.zeros((2, 2, 2))
    samples[1, 1, 1] = 1.0
    way = np.full(3, 1.0 / math.sqrt(3.0))
    for low, high in [(1e-9, 1e-6), (0.001, 0.3), (0.5, 1.0)]:
        rgba = integrate_rays(Volume(samples), absorbing(low, high, 2.0), [-way], [way])[0]
        depth = 2.0 * math.sqrt(3.0) * (np.cbrt(high) - np.cbrt(low))
        assert rgba[3] == pytest.approx(-math.expm1(-depth), abs=1e-12)


def test_an_opaque_isosurface_hides_what_is_behind() -> None:
    tf = TransferFunction([], [Isosurface(0.5, RED, 1.0), Isosurface(1.5, GREEN, 1.0)])
    assert column([0, 1, 2], tf).tolist() == [1.0, 0.0, 0.0, 1.0]
    assert column([0, 1, 2], tf, backwards=True).tolist() == [0.0, 1.0, 0.0, 1.0]
