"""All isovalues of a brick in one call: bit for bit what a plain numpy program gives one by one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hypothesis_numpy
from march_oracle import march_oracle
from mesh_checks import (
    assert_watertight,
    closed_noise,
    euler_characteristic,
    extract_mesh,
    index_grid,
    noise_with_holes,
)

from isosample.surfaces import vertex_kernels
from isosample.surfaces.brick_samples import load_brick
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.march_kernels import COUNTED_LEVELS
from isosample.surfaces.marching_cubes import march_levels
from isosample.surfaces.positions import (
    LARGEST_MANTISSA,
    POSITION_STEPS,
    SMALLEST_FRACTION,
    round_gradients,
)
from isosample.volume.bricks import bricks_of
from isosample.volume.grid import Volume

F64 = npt.NDArray[np.float64]
Samples = npt.NDArray[np.generic]


def scenes() -> dict[str, tuple[Samples, list[float]]]:
    """Samples that are hard on extraction, and isovalues."""
    random = np.random.default_rng(4)
    x, y, z = index_grid((9, 8, 7))
    masked = random.standard_normal((8, 7, 6))
    masked[3] = np.nan  # no cells between layers 1 and 4, whose planes 2 and 4 share their slots
    plateau = np.zeros((9, 9, 9), dtype=np.int16)
    plateau[2:7, 2:7, 2:7] = 5
    return {
        "noise": (random.standard_normal((11, 13, 12)), np.linspace(-3, 3, 23).tolist()),
        "many levels": (closed_noise(8, size=5), np.linspace(-3, 3, 2 * COUNTED_LEVELS + 1).tolist()),
        "integers": (
            random.integers(0, 5, (9, 10, 11)).astype(np.uint8),
            [0.0, 0.5, 1.0, 2.0, 3.0, 3.5, 4.0],
        ),
        "signed": (random.integers(-3, 3, (6, 7, 8)).astype(np.int8), [-3.0, -1.0, 0.0, 1.0]),
        "checkerboard": (((x + y + z) % 2).astype(np.float32), [0.0, 1e-9, 0.5, 1.0]),
        "plateau": (plateau, [0.0, 2.5, 5.0, 6.0]),
        "ramp": (x + 0.25 * y, [0.0, 1.0, 1.1, 2.0, 3.25]),
        "two by two by two": (random.standard_normal((2, 2, 2)), [-0.5, 0.0, 0.5]),
        "a slab": (random.standard_normal((2, 9, 9)), [-0.5, 0.0, 0.5]),
        "holes": (noise_with_holes(3), [-1.0, 0.0, 0.25, 1.0]),
        "steep": (random.standard_normal((5, 5, 5)) * 1e30, [0.0, 1e29]),
        "tiny": (random.standard_normal((5, 5, 5)) * 1e-42, [0.0, 1e-43]),
        "many integer levels": (
            random.integers(0, 90, (5, 6, 7)).astype(np.uint8),
            np.arange(0.0, 90.0, 0.5).tolist(),
        ),
        "layers apart": (masked, [-0.5, 0.0, 0.5]),
        "one plane": (np.where(x > 4, 1.0, 0.0), [1.0]),
    }


@pytest.mark.parametrize("brick_cells", [3, 32])
@pytest.mark.parametrize("name", scenes())
def test_every_level_agrees_bit_for_bit_with_a_plain_program(name: str, brick_cells: int) -> None:
    samples, levels = scenes()[name]
    assert_as_the_oracle(samples, levels, brick_cells)


@given(
    samples=hypothesis_numpy.arrays(
        np.float64,
        hypothesis_numpy.array_shapes(min_dims=3, max_dims=3, min_side=2, max_side=5),
        elements=st.one_of(st.integers(-2, 2).map(float), st.floats(-3, 3), st.just(float("nan"))),
    ),
    levels=st.lists(
        st.one_of(st.integers(-2, 2).map(float), st.floats(-3, 3)), min_size=1, max_size=6, unique=True
    ),
)
def test_no_small_volume_disagrees_with_a_plain_program(samples: F64, levels: list[float]) -> None:
    samples.flat[0] = 0.0  # a volume without a finite sample is refused
    assert_as_the_oracle(samples, sorted(levels), 2)


def assert_as_the_oracle(samples: Samples, levels: list[float], brick_cells: int) -> None:
    """Same vertices, gradients, names and triangles at every level."""
    volume = Volume(samples)
    surfaces = extract_surfaces(volume, levels, brick_cells=brick_cells, nan_masked=True)
    for level, isovalue in enumerate(levels):
        expected = march_oracle(samples, isovalue)
        pieces = surfaces.pieces(level)
        assert sum(len(mesh.triangles) for mesh in pieces) == len(expected.triangles)
        if not pieces:
            continue
        found: dict[int, bytes] = {}
        for mesh in pieces:
            rows = np.hstack([mesh.positions.astype(np.float64) + np.array(mesh.start), mesh.gradients])
            for key, row in zip(mesh.edge_keys.tolist(), rows, strict=True):
                assert found.setdefault(key, row.tobytes()) == row.tobytes()
        rows = np.hstack([expected.positions, expected.gradients])
        assert found == {key: row.tobytes() for key, row in zip(expected.keys.tolist(), rows, strict=True)}
        triangles = np.concatenate([mesh.edge_keys[mesh.triangles] for mesh in pieces])
        assert np.array_equal(in_order(triangles), in_order(expected.triangles))


def in_order(triangles: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Rows turned until their smallest key is first, and sorted."""
    first = triangles.argmin(axis=1)
    turned = triangles[np.arange(len(triangles))[:, None], (first[:, None] + np.arange(3)) % 3]
    ordered: npt.NDArray[np.int64] = turned[np.lexsort(turned.T)]
    return ordered


def test_levels_together_give_the_bits_of_each_alone() -> None:
    volume = Volume(closed_noise(12, size=14))
    levels = np.linspace(-2.5, 2.5, 11)
    (brick,) = bricks_of(volume.size_xyz)
    samples = load_brick(volume, brick)
    for level, together in zip(levels, march_levels(samples, levels), strict=True):
        (alone,) = march_levels(samples, np.array([level]))
        for name in ("positions", "gradients", "keys", "triangles"):
            assert np.array_equal(getattr(alone, name), getattr(together, name)), name


def test_levels_outside_the_brick_are_empty() -> None:
    volume = Volume(closed_noise(1, size=4))
    (brick,) = bricks_of(volume.size_xyz)
    for mesh in march_levels(load_brick(volume, brick), np.array([-99.0, 99.0])):
        assert (len(mesh.positions), len(mesh.keys), len(mesh.triangles)) == (0, 0, 0)


def test_vertices_are_numbered_as_they_are_first_met_without_gaps() -> None:
    """What makes indices near each other: a new vertex has the number after the largest so far, inside a cell."""
    volume = Volume(closed_noise(2, size=9))
    (brick,) = bricks_of(volume.size_xyz)
    (mesh,) = march_levels(load_brick(volume, brick), np.array([0.3]))
    assert np.array_equal(np.unique(mesh.triangles), np.arange(len(mesh.keys)))
    largest = np.maximum.accumulate(mesh.triangles.max(axis=1).astype(np.int64))
    assert np.diff(largest, prepend=-1).max() <= 13  # a cell has 12 edges and one centre


def test_positions_are_exact_in_float32_and_never_at_a_sample() -> None:
    samples = np.random.default_rng(0).integers(0, 3, (33, 33, 33)).astype(np.uint8)
    surfaces = extract_surfaces(Volume(samples), [1.0, 1.5])
    for mesh in surfaces.meshes:
        steps = mesh.positions.astype(np.float64) * POSITION_STEPS
        assert np.array_equal(steps, np.rint(steps))
        assert mesh.positions.max() <= 32.0
        fraction = (mesh.positions % 1).max(axis=1)
        assert ((fraction >= SMALLEST_FRACTION) & (fraction <= 1 - SMALLEST_FRACTION)).all()


def test_rounded_gradients_share_an_exponent_and_err_by_its_15th_bit_at_most() -> None:
    random = np.random.default_rng(9)
    gradients = random.standard_normal((4000, 3)) * 2.0 ** random.integers(-30, 30, (4000, 3))
    gradients[:5] = [
        [0, 0, 0],
        [1, 0, -1],
        [1 - 2.0**-20, 0, 0],
        [3e38, -1.0, 1e30],
        [2.0**-149, 0, 2.0**-140],
    ]
    rounded = round_gradients(gradients)
    largest = np.abs(gradients).max(axis=1, keepdims=True)
    assert (np.abs(rounded - gradients) <= np.maximum(2.0**-15 * largest, 2.0**-142)).all()
    assert np.array_equal(rounded, round_gradients(rounded))
    assert np.array_equal(rounded, rounded.astype(np.float32))
    exponent = np.maximum(np.frexp(largest)[1], -126)
    mantissa = np.ldexp(rounded, 15 - exponent)
    assert np.array_equal(mantissa, np.rint(mantissa))
    assert np.abs(mantissa).max() == LARGEST_MANTISSA
    assert not np.signbit(rounded[rounded == 0]).any()


@pytest.mark.parametrize(("name", "expected"), [("ball", 2), ("two balls", 4), ("torus", 0), ("shell", 4)])
def test_the_euler_characteristic_is_that_of_the_solid(name: str, expected: int) -> None:
    x, y, z = (axis - 12.0 for axis in index_grid((25, 25, 25)))
    ring = np.hypot(x, y) - 7.3
    fields = {
        "ball": 8.1 - np.sqrt(x**2 + y**2 + z**2),
        "two balls": 4.2 - np.minimum(np.hypot(np.hypot(x - 5, y), z), np.hypot(np.hypot(x + 5, y), z)),
        "torus": 3.1 - np.hypot(ring, z),
        "shell": 1.7 - np.abs(np.sqrt(x**2 + y**2 + z**2) - 7.6),
    }
    mesh = extract_mesh(Volume(fields[name]), 0.0, brick_cells=7)
    assert_watertight(mesh)
    assert euler_characteristic(mesh) == expected


@pytest.mark.parametrize("name", ["noise", "smooth"])
def test_vertices_are_those_of_scikit_image_and_surfaces_within_half_a_cell(name: str) -> None:
    """Both interpolate linearly: ours to 2**-20 voxel, scikit-image's in float32 [here up to 20, slopes over 0.05]."""
    measure = pytest.importorskip("skimage.measure")
    spatial = pytest.importorskip("scipy.spatial")
    x, y, z = index_grid((20, 19, 18))
    samples = {"noise": closed_noise(7, size=16), "smooth": np.sin(0.4 * x) + np.cos(0.3 * y) * z / 9}[name]
    level = 0.123
    (brick,) = extract_surfaces(Volume(samples), [level]).meshes
    own = brick.positions[brick.edge_keys < 3 * samples.size].astype(np.float64)
    theirs = measure.marching_cubes(samples, level)[0][:, ::-1].astype(np.float64)
    on_edge = (np.abs(theirs - np.rint(theirs)) < 1e-9).sum(axis=1) >= 2
    nearest, _ = spatial.cKDTree(theirs).query(own)
    lattice = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6.0
    points = np.einsum("li,tix->tlx", lattice, brick.positions[brick.triangles].astype(np.float64))
    back, _ = spatial.cKDTree(points.reshape(-1, 3)).query(theirs)
    assert len(own) > 500
    assert nearest.max() < 1e-3
    assert back[on_edge].max() < 1e-3
    # vertices inside cells: in noise scikit-image joins sheets inside a cell that stay apart here
    assert np.quantile(back, 1.0 if name == "smooth" else 0.99) < 0.5
    assert back.max() < 1.0


@pytest.mark.parametrize("name", scenes())
def test_slopes_looked_for_at_vertices_are_those_of_all_samples(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Which of the two is done depends on the number of vertices, and may change no bit."""
    samples, isovalues = scenes()[name]
    volume = Volume(samples)
    brick = load_brick(volume, bricks_of(volume.size_xyz)[0])
    found = []
    for nodes_per_vertex in (0, 10**9):
        monkeypatch.setattr(vertex_kernels, "NODES_PER_VERTEX", nodes_per_vertex)
        found.append(march_levels(brick, np.array(isovalues)))
    for at_vertices, at_samples in zip(*found, strict=True):
        for field in ("positions", "gradients", "keys", "triangles"):
            assert getattr(at_vertices, field).tobytes() == getattr(at_samples, field).tobytes(), field
