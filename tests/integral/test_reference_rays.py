"""Rays that are easily lost: in faces, along edges, through corners; eyes inside, cuts, holes; wrong input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.integral.compositing import over
from isosample.integral.reference import ReferenceTracer, integrate_rays
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import F64, Volume

TF = TransferFunction(
    [ControlPoint(0.1, (1.0, 0.0, 0.0), 0.2), ControlPoint(0.9, (0.0, 0.5, 1.0), 1.5)],
    [Isosurface(0.5, (0.0, 1.0, 0.0), 0.25)],
)
SLOPES = TransferFunction(TF.points)


def noise(**placement: Any) -> Volume:
    return Volume(0.1 + 0.8 * np.random.default_rng(2).random((9, 20, 7)), **placement)


def through(volume: Volume, first: list[float], second: list[float]) -> tuple[F64, F64]:
    """A ray through two places given in sample indices, from far outside."""
    matrix = volume.world_from_index
    a, b = (matrix[:3, :3] @ np.array(place) + matrix[:3, 3] for place in (first, second))
    way = (b - a) / np.linalg.norm(b - a)
    return a - 50.0 * way, way


PLACES: dict[str, tuple[list[float], list[float]]] = {
    "along an edge of cells": ([3, 4, 0], [3, 4, 8]),
    "in a face, along an axis": ([3, 4.5, 0], [3, 4.5, 8]),
    "in a face, askew": ([3, 0, 0], [3, 19, 7]),
    "in a face, along its diagonal": ([0, 5, 0], [6, 5, 6]),
    "through corners of cells": ([0, 0, 0], [6, 6, 6]),
    "through edges of cells": ([0, 0, 0.25], [6, 6, 0.25]),
    "backwards through corners": ([6, 10, 8], [0, 4, 2]),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("turn", ["straight", "turned", "flipped"])
def test_rays_in_faces_and_edges_are_limits_of_their_neighbours(place: str, turn: str) -> None:
    c, s = 0.8, 0.6
    turns = {
        "straight": np.eye(3),
        "turned": np.array([[c, -s, 0], [s * c, c * c, -s], [s * s, s * c, c]]),
        "flipped": np.diag([1.0, -1.0, -1.0]),
    }
    volume = noise(spacing=(1.0, 0.5, 2.0), origin=(1.0, -3.0, 2.0), direction=turns[turn])
    first, second = PLACES[place]
    origin, way = through(volume, first, second)
    sideways = volume.world_from_index[:3, :3] @ np.array([1.0, 1.3, 0.7])
    sideways -= (sideways @ way) * way
    near = [origin + shift * sideways for shift in (-1e-9, 1e-9)]
    rgba = integrate_rays(volume, SLOPES, [origin, *near], [way] * 3)
    # A shift by 1e-9 moves values by at most 4e-9, and the picture by 1.75 per unit over a length of 20.
    assert np.abs(rgba[0] - rgba[1]).max() <= 2e-7
    assert np.abs(rgba[0] - rgba[2]).max() <= 2e-7
    assert rgba[0, 3] > 0.5


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [0, 1])
def test_a_ray_in_a_face_of_the_box_is_the_limit_from_inside(axis: int, side: int) -> None:
    volume = noise(direction=np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]]))
    last = np.array(volume.size_xyz) - 1.0
    first, second = 0.3 * last, 0.8 * last
    first[axis] = second[axis] = side * last[axis]
    origin, way = through(volume, first.tolist(), second.tolist())
    inwards = (1 - 2 * side) * volume.world_from_index[:3, axis]
    rgba = integrate_rays(
        volume, SLOPES, [origin, origin + 1e-9 * inwards, origin - 1e-9 * inwards], [way] * 3
    )
    assert np.abs(rgba[0] - rgba[1]).max() <= 2e-7
    assert rgba[0, 3] > 0.5
    assert rgba[2].tolist() == [0.0] * 4


def test_a_turned_and_moved_volume_gives_the_same_picture() -> None:
    """With exact numbers in the placement; positions up to 100 are rounded at 1e-14, times slopes below 10."""
    straight = noise(spacing=(1.0, 0.5, 2.0))
    turn = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # left-handed placements are legal
    moved = noise(spacing=(1.0, 0.5, 2.0), origin=(64.0, 32.0, -8.0), direction=turn)
    rng = np.random.default_rng(4)
    target = rng.random((40, 3)) @ straight.box.edges
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = target - 30 * ways
    expected = integrate_rays(straight, TF, origins, ways)
    rgba = integrate_rays(moved, TF, origins @ turn.T + moved.origin, ways @ turn.T)
    assert np.abs(rgba - expected).max() <= 1e-10
    assert expected[:, 3].max() > 0.9


def test_the_parts_of_a_cut_ray_compose_to_the_whole() -> None:
    volume = noise()
    rng = np.random.default_rng(6)
    origins = np.array([3.0, 9.0, 4.0]) + rng.normal(size=(40, 3)) * 0.5  # eyes inside the volume
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    whole = integrate_rays(volume, TF, origins, ways)
    normal = np.array([2.0, -1.0, 0.5])
    plane = (*normal.tolist(), float(-normal @ [3.2, 9.7, 4.1]))
    other = tuple(-number for number in plane)
    kept = integrate_rays(volume, TF, origins, ways, clip_planes=[plane])
    rest = integrate_rays(volume, TF, origins, ways, clip_planes=[other])
    starts_kept = (origins @ normal + plane[3] >= 0)[:, None]
    composed = np.where(starts_kept, over(kept, rest), over(rest, kept))
    assert np.abs(composed - whole).max() <= 2e-10
    # An eye moved back by s sees the same behind a plane through its old place.
    for origin, way, expected in zip(origins[:5], ways[:5], whole[:5], strict=True):
        cut = (*way.tolist(), float(-way @ origin))
        again = integrate_rays(volume, TF, [origin - 7.0 * way], [way], clip_planes=[cut])[0]
        assert np.abs(again - expected).max() <= 2e-10
    assert not integrate_rays(volume, TF, origins, ways, clip_planes=[plane, other]).any()


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_cells_that_touch_a_sample_that_is_not_finite_are_empty(wrong: float) -> None:
    whole = noise()
    samples = whole.array.astype(np.float64)
    samples[:, 8, :] = wrong  # masks 7 <= y <= 9
    rng = np.random.default_rng(8)
    ways = rng.normal(size=(30, 3)) * [0.3, 1.0, 0.3]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.array([3.0, 8.0, 4.0]) - 30.0 * ways
    below = integrate_rays(whole, SLOPES, origins, ways, clip_planes=[(0.0, -1.0, 0.0, 7.0)])
    above = integrate_rays(whole, SLOPES, origins, ways, clip_planes=[(0.0, 1.0, 0.0, -9.0)])
    expected = np.where(ways[:, 1:2] > 0, over(below, above), over(above, below))
    rgba = integrate_rays(Volume(samples), SLOPES, origins, ways)
    assert np.abs(rgba - expected).max() <= 2e-10
    assert np.count_nonzero((below[:, 3] > 0.1) & (above[:, 3] > 0.1)) > 20


def test_blocks_without_extinction_are_skipped_and_nothing_is_lost() -> None:
    z, y, x = np.mgrid[0:40, 0:40, 0:40]
    distance = np.sqrt((x - 20.0) ** 2 + (y - 20.0) ** 2 + (z - 20.0) ** 2)
    volume = Volume(distance)
    tf = TransferFunction(
        [ControlPoint(2.0, (1.0, 0.0, 0.0), 1.0), ControlPoint(4.0, (1.0, 0.0, 0.0), 1.0)],
        [Isosurface(18.0, (0.0, 1.0, 0.0), 0.5)],
    )
    rng = np.random.default_rng(9)
    ways = rng.normal(size=(60, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = 20.0 + rng.normal(size=(60, 3)) * 4.0 - 60.0 * ways
    tracer = ReferenceTracer.build(volume, tf)
    rgba, counts = tracer.integrate(origins, ways)
    assert counts[:, 2].sum() > 0
    assert not tracer.grid.visible.all()
    tracer.grid.visible[:] = True
    everything, more = tracer.integrate(origins, ways)
    assert np.abs(rgba - everything).max() <= 1e-13
    assert more[:, 0].sum() > counts[:, 0].sum()
    # Every ray passes the outer isosurface twice; those that stay clear of the inner shell show only that.
    closest = np.linalg.norm(np.cross(origins - 20.0, ways), axis=1)
    clear = (closest > 4.5) & (closest < 17.5)
    assert clear.any()
    assert rgba[clear] == pytest.approx(np.tile([0.0, 0.75, 0.0, 0.75], (clear.sum(), 1)), abs=1e-15)


@pytest.mark.parametrize("place", [(8, 4, 4), (4, 8, 4), (4, 4, 8), (8, 8, 8), (24, 0, 24)])
def test_a_sample_between_blocks_is_seen_from_every_block(place: tuple[int, int, int]) -> None:
    """All else is invisible; the picture is that of a volume in which no block is skipped."""
    samples = np.zeros((25, 25, 25))
    samples[place] = 1.0
    tf = TransferFunction([ControlPoint(0.3, (1.0, 0.0, 0.0), 1.0), ControlPoint(1.0, (1.0, 0.0, 0.0), 1.0)])
    ways = np.random.default_rng(12).normal(size=(60, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.array(place[::-1]) + 0.2 * ways[::-1] - 30.0 * ways
    tracer = ReferenceTracer.build(Volume(samples), tf)
    assert not tracer.grid.visible.all()
    rgba = tracer.integrate(origins, ways)[0]
    tracer.grid.visible[:] = True
    assert np.abs(rgba - tracer.integrate(origins, ways)[0]).max() <= 1e-13
    assert np.count_nonzero(rgba[:, 3] > 0.1) > 10


def test_progress_counts_every_ray_once() -> None:
    seen: list[tuple[int, int]] = []
    origins, ways = np.tile([3.0, 9.0, -5.0], (1200, 1)), np.tile([0.0, 0.0, 1.0], (1200, 1))
    rgba = integrate_rays(noise(), TF, origins, ways, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(512, 1200), (1024, 1200), (1200, 1200)]
    assert np.all(rgba == rgba[0])
    assert integrate_rays(noise(), TF, np.empty((0, 3)), np.empty((0, 3))).shape == (0, 4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"origins": [[0.0, 0.0]]}, r"origins has shape \(1, 2\)"),
        ({"origins": [0.0, 0.0, 0.0]}, r"must both be \(N, 3\)"),
        ({"origins": [[0.0, np.nan, 0.0]]}, r"origins\[0\] is"),
        ({"directions": [[0.0, 0.0, 2.0]]}, r"directions\[0\] has length .*2.0.*expected 1"),
        ({"clip_planes": [(0.0, 0.0, 0.0, 1.0)]}, r"clip plane \(0.0, 0.0, 0.0, 1.0\) must be"),
        ({"tolerance": 1e-15}, r"tolerance 1e-15 must be between 1e-13 and 0.01"),
        ({"panels": 0}, "panels 0 must be"),
        ({"volume": Volume(np.zeros((3, 1, 3)))}, r"has \(3, 1, 3\) samples"),
    ],
)
def test_wrong_input_is_named(changes: dict[str, Any], message: str) -> None:
    arguments = {"origins": [[0.0, 0.0, -1.0]], "directions": [[0.0, 0.0, 1.0]]} | changes
    volume = arguments.pop("volume", None) or noise()
    with pytest.raises(InputError, match=message):
        integrate_rays(volume, TF, **arguments)


def test_opacity_is_the_same_there_and_back_on_integers() -> None:
    """Isovalues and steps at sample values, plateaus, touches: every crossing is met from both sides."""
    samples = np.random.default_rng(11).integers(0, 4, (12, 11, 13))
    volume = Volume(samples.astype(np.float64))
    tf = TransferFunction(
        [
            ControlPoint(0.0, (1.0, 0.0, 0.0), 0.1),
            ControlPoint(1.0, (1.0, 0.0, 0.0), 0.2),
            ControlPoint(1.0, (0.0, 0.0, 1.0), 0.05),
            ControlPoint(3.0, (0.0, 1.0, 1.0), 0.02),
        ],
        [Isosurface(float(value), (0.0, 1.0, 0.0), 0.1) for value in (1, 2, 3)],
    )
    places = np.stack(np.meshgrid(np.arange(0.0, 10.0, 0.25), np.arange(0.0, 10.0, 0.25)), axis=-1).reshape(
        -1, 2
    )
    for axis in range(3):
        origins, ways = np.insert(places, axis, -4.0, axis=1), np.zeros((len(places), 3))
        ways[:, axis] = 1.0
        there = integrate_rays(volume, tf, origins, ways)[:, 3]
        back = integrate_rays(volume, tf, origins + 24.0 * ways, -ways)[:, 3]
        # 13 cells, each a few roundings of the light that is left; a crossing too many would be 0.1 of it.
        assert np.abs(there - back).max() <= 1e-13
        assert np.ptp(there) > 0.1
