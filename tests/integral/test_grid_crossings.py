"""Exact crossings of rays with the isosurfaces of a grid: analytic roots, walks that continue, borders, holes."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isosample.errors import InputError
from isosample.integral.bernstein import (
    halve_polynomial,
    is_monotone,
    polynomial_bounds,
    polynomial_mean,
    polynomial_root,
    polynomial_value_slope,
)
from isosample.integral.crossing_lists import BORDER, CrossingLists, checked_lists
from isosample.integral.grid_crossings import ROWS_PER_RAY, grid_crossings
from isosample.integral.reference import integrate_rays
from isosample.transfer.control_points import Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import F64, Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction

U = 2.0**-53
EVERY = list(Reconstruction)
KEEPS_LINEAR = [Reconstruction.TRILINEAR, Reconstruction.CUBIC, Reconstruction.BSPLINE]
TURN = np.array([[0.8, -0.36, -0.48], [0.6, 0.48, 0.64], [0.0, -0.8, 0.6]])


def random_rays(volume: Volume, count: int, seed: int = 1, distance: float = 0.0) -> tuple[F64, F64]:
    """Rays through random points of a volume, which lie at a distance in front of the origins."""
    rng = np.random.default_rng(seed)
    box = volume.box
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return box.corner + rng.random((count, 3)) @ box.edges - distance * ways, ways


def awkward_rays(volume: Volume, seed: int) -> tuple[F64, F64]:
    """Rays in faces and along edges of cells, through samples, askew; from inside and from afar."""
    rng = np.random.default_rng(seed)
    last = np.array(volume.size_xyz) - 1.0
    places, ways = rng.random((24, 3)) * last, rng.normal(size=(24, 3))
    places[:12] = np.round(places[:12])
    ways[:6] = np.eye(3)[rng.integers(0, 3, 6)] * rng.choice([-1.0, 1.0], 6)[:, None]
    ways[6:16] = np.round(ways[6:16])
    ways[np.abs(ways).sum(axis=1) == 0.0] = [1.0, 1.0, 0.0]
    matrix = volume.world_from_index
    ways = ways @ matrix[:3, :3].T
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = places @ matrix[:3, :3].T + matrix[:3, 3]
    origins[::2] -= 3.0 * volume.box.radius * ways[::2]
    return origins, ways


def assert_walks_continue(lists: CrossingLists, isovalues: F64) -> None:
    """From the band of the value on entry, step by step, to that of the value on leaving."""
    band: int | None = None
    for n in range(len(lists.level)):
        level, rising = int(lists.level[n]), bool(lists.rising[n])
        if level == BORDER:
            here = int(np.searchsorted(isovalues, lists.value[n], side="right"))
            assert band is None if rising else band == here
            band = here if rising else None
        else:
            assert band == (level if rising else level + 1), f"entry {n}"
            band = level + 1 if rising else level
    assert band is None


def values_at(volume: Volume, points: F64, reconstruction: Reconstruction) -> F64:
    """The field at world positions, by other means than the crossings are found."""
    matrix = np.linalg.inv(volume.world_from_index)
    last = np.array(volume.size_xyz) - 1.0
    places = np.clip(points @ matrix[:3, :3].T + matrix[:3, 3], 0.0, last)
    if reconstruction.smooth:
        return GridSpline.build(volume, reconstruction).evaluate(places)[0]
    cell = np.minimum(np.floor(places), last - 1.0).astype(int)
    u = places - cell
    total = np.zeros(len(places))
    for corner in range(8):
        bits = np.array([corner & 1, corner >> 1 & 1, corner >> 2])
        x, y, z = (cell + bits).T
        total += volume.array[z, y, x].astype(float) * np.prod(np.where(bits, u, 1.0 - u), axis=1)
    return total


@pytest.mark.parametrize("reconstruction", KEEPS_LINEAR)
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_crossings_of_a_linear_field_are_where_they_must_be(
    reconstruction: Reconstruction, offset: float
) -> None:
    per_index = np.array([1.0, 0.5, -0.75])  # exact in binary, also with the offset
    z, y, x = np.mgrid[0:5, 0:7, 0:9]
    volume = Volume(
        offset + np.stack([x, y, z], axis=-1) @ per_index,
        spacing=(1.0, 2.0, 0.5),
        origin=(3.0, -2.0, 5.0),
        direction=TURN,
    )
    gradient = volume.world_gradient_from_index_gradient @ per_index
    isovalues = offset + np.arange(-2.9, 11.0, 0.8)
    origins, ways = random_rays(volume, 80)  # eyes inside: half of each chord lies behind
    lists = checked_lists(
        grid_crossings(volume, isovalues, origins, ways, reconstruction=reconstruction), len(isovalues)
    )
    rate, at_origin = ways @ gradient, offset + (origins - np.array(volume.origin)) @ gradient
    ray, crossing = lists.ray, lists.level >= 0
    # Values up to `scale` of coefficients, 3 fits, 9 de Casteljau steps, positions up to 20: some 500 roundings.
    error = 500 * U * (abs(offset) + 100.0)
    row, level = ray[crossing], lists.level[crossing]
    expected = (isovalues[level] - at_origin[row]) / rate[row]
    assert np.all(np.abs(lists.distance[crossing] - expected) * np.abs(rate[row]) <= error)
    assert np.all(np.abs(lists.slope[crossing] - np.abs(rate[row])) <= error)
    assert np.array_equal(lists.rising[crossing], rate[row] > 0)
    assert np.count_nonzero(lists.distance < 0) > 100
    borders = ~crossing
    assert np.array_equal(np.bincount(ray[borders]), np.full(80, 2))
    at_border = at_origin[ray[borders]] + lists.distance[borders] * rate[ray[borders]]
    assert np.abs(lists.value[borders] - at_border).max() <= error
    assert lists.rising[borders].tolist() == [True, False] * 80
    first, last = lists.value[lists.first[:-1]], lists.value[lists.first[1:] - 1]
    between = np.searchsorted(isovalues, np.maximum(first, last), side="right") - np.searchsorted(
        isovalues, np.minimum(first, last), side="right"
    )
    assert np.array_equal(np.bincount(row, minlength=80), between)  # none is lost, none is doubled
    assert not lists.residual.any()
    assert not lists.tolerance.any()


@pytest.mark.parametrize("reconstruction", [Reconstruction.TRILINEAR, Reconstruction.CUBIC])
def test_three_roots_along_a_ray_are_those_of_the_three_factors(reconstruction: Reconstruction) -> None:
    """f = (x − a)(y − b)(z − c) is trilinear over all cells: along a ray it vanishes where a factor does."""
    roots = np.array([3.3, 2.6, 3.1])
    z, y, x = np.mgrid[0:7, 0:6, 0:8]
    volume = Volume((x - roots[0]) * (y - roots[1]) * (z - roots[2]))
    origins, ways = random_rays(volume, 200, distance=20.0)
    lists = grid_crossings(volume, [0.0], origins, ways, reconstruction=reconstruction)
    crossing = lists.level == 0
    found = 0
    for ray in range(200):
        times = (roots - origins[ray]) / ways[ray]
        rows = slice(lists.first[ray], lists.first[ray + 1])
        start, end = lists.distance[rows][[0, -1]]
        expected = np.sort(times[(times > start + 1e-9) & (times < end - 1e-9)])
        times_found = lists.distance[rows][crossing[rows]]
        assert len(times_found) == len(expected)
        slopes = np.array(
            [np.prod([ways[ray, i] * (t - times[i]) for i in range(3) if times[i] != t]) for t in expected]
        ) * [ways[ray, np.argmin(np.abs(times - t))] for t in expected]
        # Coefficients up to 150 with some 500 roundings, over the slope; the slope's own change with the place.
        error = 500 * U * 150.0
        if len(expected) and np.abs(slopes).min() > 1e-3:
            assert np.all(np.abs(times_found - expected) <= error / np.abs(slopes))
            assert np.all(
                np.abs(lists.slope[rows][crossing[rows]] - np.abs(slopes))
                <= error * (1 + 100 / np.abs(slopes))
            )
            found += len(expected)
    assert found > 200


@pytest.mark.parametrize("reconstruction", EVERY)
@pytest.mark.parametrize("kind", ["noise", "integers"])
def test_between_crossings_the_field_is_in_the_band_that_they_say(
    reconstruction: Reconstruction, kind: str
) -> None:
    rng = np.random.default_rng(3)
    shape = (6, 5, 7)
    samples = rng.random(shape) * 4.0 if kind == "noise" else rng.integers(0, 4, shape).astype(float)
    volume = Volume(samples, spacing=(1.0, 0.5, 2.0), origin=(1.0, -3.0, 2.0), direction=TURN)
    isovalues = np.array([0.5, 1.0, 1.7, 2.0, 3.0])
    origins, ways = random_rays(volume, 60)
    lists = checked_lists(grid_crossings(volume, isovalues, origins, ways, reconstruction=reconstruction), 5)
    assert_walks_continue(lists, isovalues)
    for ray in range(60):
        rows = slice(lists.first[ray], lists.first[ray + 1])
        distance, level, rising = lists.distance[rows], lists.level[rows], lists.rising[rows]
        t = np.linspace(distance[0], distance[-1], 2001)[1:-1]
        values = values_at(volume, origins[ray] + t[:, None] * ways[ray], reconstruction)
        steps = np.where(level < 0, 0, np.where(rising, 1, -1))
        bands = np.searchsorted(isovalues, lists.value[rows][0], side="right") + np.cumsum(steps)
        said = bands[np.searchsorted(distance, t, side="right") - 1]
        clear = np.abs(values[:, None] - isovalues).min(axis=1) > 1e-12  # 64 taps of 10 with 60 roundings
        assert np.array_equal(said[clear], np.searchsorted(isovalues, values[clear], side="right"))
        assert clear.mean() > 0.9
    at = lists.level >= 0
    places = origins[lists.ray[at]] + lists.distance[at][:, None] * ways[lists.ray[at]]
    off = values_at(volume, places, reconstruction) - isovalues[lists.level[at]]
    # Distances up to 12 with 8 roundings, times slopes below 60; values as above.
    assert np.abs(off).max() <= 8 * 12 * U * 60 + 1e-12


@given(
    samples=arrays(
        np.float64,
        st.tuples(*[st.integers(2, 5)] * 3),
        elements=st.one_of(
            st.integers(0, 3).map(float), st.floats(0.0, 3.0, width=32, allow_subnormal=False)
        ),
    ),
    offset=st.sampled_from([0.0, 100.0, -1000.3, 1e6 / 3.0]),
    reconstruction=st.sampled_from(EVERY),
    seed=st.integers(0, 1000),
)
def test_crossings_always_continue_each_other(
    samples: F64, offset: float, reconstruction: Reconstruction, seed: int
) -> None:
    """On samples that are isovalues, on plateaus, in faces and through corners; net sum and every single step."""
    volume = Volume(samples + offset, spacing=(1.0, 0.75, 2.0), direction=TURN)
    isovalues = np.array([0.0, 0.25, 1.0, 1.5, 2.0, 3.0]) + offset
    lists = grid_crossings(volume, isovalues, *awkward_rays(volume, seed), reconstruction=reconstruction)
    assert_walks_continue(checked_lists(lists, len(isovalues)), isovalues)


def test_a_lost_crossing_would_be_noticed() -> None:
    volume = Volume(np.random.default_rng(5).random((5, 5, 5)))
    isovalues = np.array([0.4, 0.6])
    lists = grid_crossings(volume, isovalues, *random_rays(volume, 20))
    assert_walks_continue(lists, isovalues)
    kept = np.ones(len(lists.level), dtype=np.bool_)
    kept[np.flatnonzero(lists.level >= 0)[7]] = False
    with pytest.raises(AssertionError):
        assert_walks_continue(lists.keep(kept), isovalues)


@pytest.mark.parametrize("reconstruction", EVERY)
def test_isosurfaces_of_the_reference_integral_are_crossed_as_often(reconstruction: Reconstruction) -> None:
    """Opacity is the product over crossings in front of the eye: any one more or less would change it by 20 %."""
    volume = Volume(np.random.default_rng(6).random((7, 6, 8)), spacing=(1.0, 0.5, 2.0), direction=TURN)
    isovalues = np.array([0.35, 0.5, 0.65])
    tf = TransferFunction([], [Isosurface(value, (1.0, 1.0, 1.0), 0.2) for value in isovalues.tolist()])
    origins, ways = random_rays(volume, 300)
    lists = grid_crossings(volume, isovalues, origins, ways, reconstruction=reconstruction)
    passed = (lists.level >= 0) & (lists.distance > 0)
    counts = np.bincount(lists.ray[passed], minlength=300)
    rgba = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction)
    assert np.abs(rgba[:, 3] - (1.0 - 0.8**counts)).max() <= 1e-13
    assert counts.max() > 4


@pytest.mark.parametrize("reconstruction", KEEPS_LINEAR)
def test_a_value_met_at_a_face_between_cells_is_crossed_once(reconstruction: Reconstruction) -> None:
    """Isovalues near 0, which a rising field takes at a face, where the roundings of two cells differ by some 1e-15."""
    z, y, x = np.mgrid[0:6, 0:7, 0:8]
    volume = Volume(np.sqrt(2.0) * (x - 3.0) + np.sqrt(3.0) * (y - 2.6) + np.sqrt(0.7) * (z - 2.1))
    rng = np.random.default_rng(11)
    place_y = 2.6 + 0.8 * (rng.random(60) - 0.5)
    places = np.stack([np.full(60, 3.0), place_y, 2.1 - np.sqrt(3.0 / 0.7) * (place_y - 2.6)], axis=1)
    ways = 0.1 + rng.random((60, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    for isovalue in (np.arange(-12, 13) * 2.5e-16).tolist():
        for way in (ways, -ways):
            lists = grid_crossings(volume, [isovalue], places - 1.5 * way, way, reconstruction=reconstruction)
            assert lists.level.tolist() == [-1, 0, -1] * 60
            tf = TransferFunction([], [Isosurface(isovalue, (1.0, 1.0, 1.0), 0.1)])
            alpha = integrate_rays(volume, tf, places - 1.5 * way, way, reconstruction=reconstruction)[:, 3]
            assert np.abs(alpha - 0.1).max() <= 1e-15


def test_where_samples_are_missing_the_ray_leaves_and_enters() -> None:
    """A NaN takes out the eight cells around it; the border points lie on their faces, with the values there."""
    samples = np.broadcast_to(np.arange(9.0), (3, 3, 9)).copy()
    samples[1, 1, 4] = np.nan
    lists = grid_crossings(Volume(samples), [2.5, 4.0, 6.0], [[-5.0, 0.5, 0.5]], [[1.0, 0.0, 0.0]])
    assert lists.distance == pytest.approx([5.0, 7.5, 8.0, 10.0, 11.0, 13.0], abs=13 * 4 * U)
    assert lists.level.tolist() == [-1, 0, -1, -1, 2, -1]
    assert lists.rising.tolist() == [True, True, False, True, True, False]
    assert lists.value[[0, 2, 3, 5]] == pytest.approx([0.0, 3.0, 5.0, 8.0], abs=8 * 4 * U)


def test_a_value_equal_to_an_isovalue_is_inside() -> None:
    """Along x: on entry, at a touch from below and from above, on a plateau, at the end."""
    row = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 2.0, 1.0, 2.0, 1.0, 1.0, 0.0, 1.0])
    volume = Volume(np.broadcast_to(row, (2, 2, 12)).copy())
    there = grid_crossings(volume, [1.0], [[-1.0, 0.3, 0.4]], [[1.0, 0.0, 0.0]])
    # Falls at once; reaches 1 at x = 2 and turns back; passes 1 at 4.5; touches it at 6; stays at 8 to 9, falls
    # there; ends on it.
    expected = [-1, 0, 0, 0, 0, -1]
    assert there.level.tolist() == expected
    assert there.distance == pytest.approx([1.0, 1.0, 5.5, 10.0, 12.0, 12.0], abs=12 * 8 * U)
    assert there.rising.tolist() == [True, False, True, False, True, False]
    back = grid_crossings(volume, [1.0], [[12.0, 0.3, 0.4]], [[-1.0, 0.0, 0.0]])
    assert back.level.tolist() == expected
    assert (13.0 - back.distance)[::-1] == pytest.approx(there.distance, abs=13 * 8 * U)
    assert there.slope[1:5] == pytest.approx([1.0, 2.0, 1.0, 1.0], abs=16 * U)


def test_rays_beside_the_volume_meet_nothing() -> None:
    volume = Volume(np.random.default_rng(7).random((3, 3, 3)))
    origins = [[-1.0, 5.0, 1.0], [0.0, 0.0, 2.0 + 1e-9], [1.0, 1.0, -9.0]]
    ways = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    lists = grid_crossings(volume, [0.5], origins, ways)
    assert lists.first[:3].tolist() == [0, 0, 0]
    assert lists.first[3] >= 2
    nothing = grid_crossings(volume, [], np.empty((0, 3)), np.empty((0, 3)))
    assert nothing.first.tolist() == [0]
    assert len(checked_lists(nothing, 0).distance) == 0


def test_blocks_of_rays_and_longer_lists_make_no_difference() -> None:
    """More rays than a block has, and more entries than there is room for at first."""
    volume = Volume(np.random.default_rng(8).random((6, 6, 6)))
    isovalues = np.linspace(0.01, 0.99, 99)
    origins, ways = random_rays(volume, 600, distance=20.0)
    seen: list[int] = []
    lists = grid_crossings(volume, isovalues, origins, ways, progress=lambda done, _: seen.append(done))
    assert seen == [512, 600]
    assert lists.first[-1] > 2 * ROWS_PER_RAY * 600
    for ray in (0, 511, 512, 599):
        alone = grid_crossings(volume, isovalues, origins[ray : ray + 1], ways[ray : ray + 1])
        rows = slice(lists.first[ray], lists.first[ray + 1])
        for whole, single in zip(lists[1:], alone[1:], strict=True):
            assert np.array_equal(whole[rows], single)
    assert_walks_continue(lists, isovalues)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"isovalues": [1.0, 1.0]}, "isovalues .* must be finite numbers that ascend"),
        ({"isovalues": [np.nan]}, "must be finite numbers that ascend"),
        ({"isovalues": 1.0}, "must be finite numbers that ascend"),
        ({"directions": [[0.0, 0.0, 2.0]]}, r"directions\[0\] has length"),
        ({"origins": [[0.0, 0.0]]}, r"origins has shape \(1, 2\)"),
        ({"volume": Volume(np.zeros((3, 1, 3)))}, r"has \(3, 1, 3\) samples"),
        (
            {"volume": Volume(np.array([[[np.nan, 1], [0, 1]]] * 2)), "reconstruction": Reconstruction.CUBIC},
            "2 NaN and 0 infinite samples; the cubic reconstruction needs finite ones",
        ),
    ],
)
def test_wrong_input_is_named(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "volume": Volume(np.zeros((2, 2, 2))),
        "isovalues": [0.5],
        "origins": [[0.0, 0.0, -1.0]],
        "directions": [[0.0, 0.0, 1.0]],
    } | changes
    with pytest.raises(InputError, match=message):
        grid_crossings(**arguments)


@settings(max_examples=40)
@given(
    arrays(np.float64, 10, elements=st.floats(-4.0, 4.0, width=32, allow_subnormal=False)),
    st.floats(0.0, 1.0),
)
def test_polynomials_in_bernstein_form(coefficients: F64, s: float) -> None:
    """Value, slope, mean, bounds and halves against the power basis, whose terms are below 4 · 4^9 in sum."""
    from math import comb

    def basis(u: float, degree: int) -> F64:
        return np.array([comb(degree, i) * u**i * (1.0 - u) ** (degree - i) for i in range(degree + 1)])

    tolerance = 4.0 * 40 * U
    value, slope = polynomial_value_slope(coefficients, s, np.empty(10))
    assert value == pytest.approx(basis(s, 9) @ coefficients, abs=tolerance)
    assert slope == pytest.approx(9.0 * (basis(s, 8) @ np.diff(coefficients)), abs=18.0 * tolerance)
    assert polynomial_mean(coefficients) == pytest.approx(coefficients.mean(), abs=tolerance)
    assert polynomial_bounds(coefficients) == (coefficients.min(), coefficients.max())
    back, front = coefficients.copy(), np.empty(10)
    halve_polynomial(back, front)
    assert front[0] == coefficients[0]
    assert back[9] == coefficients[9]
    assert front[9] == back[0]
    for half, place in ((front, 0.5 * s), (back, 0.5 + 0.5 * s)):
        assert basis(s, 9) @ half == pytest.approx(basis(place, 9) @ coefficients, abs=2 * tolerance)
    rising = np.sort(coefficients)
    assert is_monotone(rising)
    assert is_monotone(rising[::-1])
    assert is_monotone(coefficients) == (
        np.array_equal(coefficients, rising) or np.array_equal(coefficients, rising[::-1])
    )
    if rising[0] < rising[9]:
        level = float(rising[0] + s * (rising[9] - rising[0]))
        root = polynomial_root(rising, level, True, np.empty(10))
        nearby = [
            polynomial_value_slope(rising, float(np.clip(root + d, 0, 1)), np.empty(10))[0]
            for d in (-1e-15, 1e-15)
        ]
        assert nearby[0] - tolerance <= level <= nearby[1] + tolerance


def test_compiled_polynomials_do_what_their_source_says() -> None:
    coefficients = np.random.default_rng(9).normal(size=10)
    interpreted: Any = cast("Any", polynomial_value_slope).py_func
    for s in (0.0, 0.3, 1.0):
        assert polynomial_value_slope(coefficients, s, np.empty(10)) == pytest.approx(
            interpreted(coefficients, s, np.empty(10)), abs=100 * U
        )
