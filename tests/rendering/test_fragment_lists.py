"""The lists on the GPU against lists computed on the CPU from the same triangles, in float64."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

    from isosample.rendering.fragment_lists import FragmentLists
    from isosample.rendering.rays import Rays

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]

SIZE = (96, 80)
SNAP = (
    1.0 / 256
)  # vertices are snapped to a grid of this many pixels or finer (OpenGL needs 4 bits, drivers have 8)


def random_scene() -> tuple[Volume, TransferFunction]:
    """Smooth random field in a rotated, anisotropic grid, with three impulse levels."""
    rng = np.random.default_rng(7)
    z, y, x = np.meshgrid(*[np.linspace(0, 1, n) for n in (9, 11, 13)], indexing="ij")
    samples = np.zeros(x.shape)
    for wave in rng.uniform(-9, 9, (6, 3)):
        samples += np.cos(wave[0] * x + wave[1] * y + wave[2] * z + rng.uniform(0, 6))
    angle = 0.4
    direction = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, -1.0]]
    )
    volume = Volume(samples, spacing=(1.0, 1.5, 2.5), origin=(100.0, -50.0, 20.0), direction=direction)
    low, high = volume.value_range
    levels = low + (high - low) * np.array([0.3, 0.5, 0.7])
    return volume, TransferFunction([], [Isosurface(float(v), (1.0, 1.0, 1.0), 0.5) for v in levels])


@dataclass(frozen=True)
class CpuLists:
    """Crossings sorted by pixel and distance, and the pixels that rounding may decide otherwise.

    `conditions` is 1 / cosine of the ray and the normal, plus the slenderness of the triangle's image.
    `doubtful` holds the pixels whose centre lies within the snapping distance of a triangle edge's image.
    """

    distances: F64
    pixels: I64
    levels: I64
    rising: npt.NDArray[np.bool_]
    conditions: F64
    doubtful: set[int]


def cpu_lists(scene: Scene, camera: Camera) -> CpuLists:
    """Crossings of every pixel's line with every triangle."""
    width, height = SIZE
    centre = scene.geometry.box.centre
    rays = camera.rays(width / height)
    origins, directions = rays.origins_and_directions(width, height)
    o, d = (origins - centre).reshape(-1, 3), directions.reshape(-1, 3)
    rows: list[tuple[F64, I64, I64, F64, F64]] = []
    doubtful: set[int] = set()
    for part in scene.levels:
        triangles = scene.indices[part.first_index : part.first_index + part.index_count].reshape(-1, 3)
        for corners in scene.vertices["position"][triangles].astype(np.float64):
            image = image_of(corners + centre, rays)
            index, inside, near = cover(image)
            doubtful.update(index[near].tolist())
            index = index[inside]
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            normal /= np.linalg.norm(normal)
            cosine = d[index] @ normal
            hit = cosine != 0
            condition = np.full(len(index), slenderness(image))
            t = ((corners[0] - o[index]) @ normal)[hit] / cosine[hit]
            rows.append((t, index[hit], np.full(hit.sum(), part.level), cosine[hit], condition[hit]))
    distances, pixels, levels, cosines, conditions = (
        np.concatenate(column) for column in zip(*rows, strict=True)
    )
    order = np.lexsort((distances, pixels))
    return CpuLists(
        distances=distances[order],
        pixels=pixels[order],
        levels=levels[order],
        rising=cosines[order] < 0,  # normals point to falling values
        conditions=(1.0 / np.abs(cosines) + conditions)[order],
        doubtful=doubtful,
    )


def image_of(points: F64, rays: Rays) -> F64:
    """Pixel coordinates (column, row from the top) of world points."""
    from_eye = points - rays.eye
    w = from_eye @ rays.forward if rays.perspective else np.ones(len(points))
    plane = [from_eye @ span / (span @ span) / w for span in (rays.span_right, -rays.span_up)]
    image: F64 = (np.stack(plane, axis=1) + 1.0) * 0.5 * np.array(SIZE)
    return image


def cover(corners: F64) -> tuple[I64, npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Pixels about the image of a triangle: index, is the centre inside, is it near an edge."""
    low = np.floor(corners.min(axis=0) - 1).astype(int).clip(0, SIZE)
    high = np.ceil(corners.max(axis=0) + 1).astype(int).clip(0, SIZE)
    columns, lines = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    points = np.stack([columns.ravel() + 0.5, lines.ravel() + 0.5], axis=1)
    edges = np.roll(corners, -1, axis=0) - corners
    offset = points[:, None] - corners
    area: F64 = edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0]
    along = (offset * edges).sum(axis=-1) / np.maximum((edges**2).sum(axis=-1), 1e-30)
    to_edge = np.linalg.norm(offset - along.clip(0, 1)[..., None] * edges, axis=-1).min(axis=1)
    inside = np.asarray((area > 0).all(axis=1) | (area < 0).all(axis=1))
    return (lines * SIZE[0] + columns).ravel(), inside, to_edge < SNAP


def slenderness(corners: F64) -> float:
    """Longest edge over the smallest altitude of a triangle in the image."""
    edges = np.roll(corners, -1, axis=0) - corners
    area = abs(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    return float((edges**2).sum(axis=1).max() / max(area, 1e-30))


@pytest.mark.parametrize("projection", Projection)
def test_gpu_lists_equal_cpu_lists_pixel_by_pixel(gl: moderngl.Context, projection: Projection) -> None:
    volume, tf = random_scene()
    plan = plan_isovalues(tf, volume.value_range)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    camera = Camera.orbit(volume.box, azimuth=25, elevation=40, projection=projection, zoom=1.3)
    with ABuffer(gl, scene) as abuffer:
        gpu = abuffer.fragment_lists(camera, SIZE, RenderSettings())
    cpu = cpu_lists(scene, camera)
    assert len(cpu.pixels) > 10_000
    # A distance is interpolated from three vertices: about 24 roundings of numbers up to `reach` in positions
    # and weights, magnified where the ray meets the triangle under a small angle and where its image is thin.
    reach = float(np.linalg.norm(np.asarray(camera.eye) - volume.box.centre)) + volume.box.radius
    rounding = 24 * 2.0**-24 / (1 - 24 * 2.0**-24) * reach
    different = set()
    for pixel in range(SIZE[0] * SIZE[1]):
        of_gpu, of_cpu = rows_of(gpu, pixel), rows_of(cpu, pixel)
        if not np.array_equal(signature(gpu, of_gpu), signature(cpu, of_cpu)):
            different.add(pixel)
            continue
        error = np.abs(gpu.distances[of_gpu] - cpu.distances[of_cpu])
        if np.any(error > rounding * cpu.conditions[of_cpu]):
            different.add(pixel)
    assert different <= cpu.doubtful
    assert len(different) < 0.001 * SIZE[0] * SIZE[1]


def rows_of(lists: FragmentLists | CpuLists, pixel: int) -> slice:
    """Rows of one pixel's list."""
    first, last = np.searchsorted(lists.pixels, [pixel, pixel + 1])
    return slice(int(first), int(last))


def signature(lists: FragmentLists | CpuLists, rows: slice) -> I64:
    """Levels and directions of one pixel's list, in order."""
    coded: I64 = 2 * lists.levels[rows] + lists.rising[rows]
    return coded


def test_slopes_are_the_derivative_along_the_ray(gl: moderngl.Context) -> None:
    z, y, x = np.mgrid[0:6, 0:7, 0:8]
    volume = Volume(0.5 * x + 0.25 * y - 0.125 * z, spacing=(1.0, 2.0, 0.5))
    tf = TransferFunction([], [Isosurface(1.5, (1.0, 1.0, 1.0), 0.5)])
    plan = plan_isovalues(tf, volume.value_range)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    camera = Camera.orbit(volume.box, azimuth=50, elevation=20)
    with ABuffer(gl, scene) as abuffer:
        lists = abuffer.fragment_lists(camera, SIZE, RenderSettings())
    low, high = volume.value_range
    along = np.array([0.5, 0.125, -0.25]) @ camera.rays(1.0).forward
    expected = abs(along) / (high - low) * volume.box.radius
    assert len(lists.slopes) > 100
    assert np.allclose(lists.slopes, expected, rtol=2.0**-11 + 1e-6, atol=0)  # half floats have 11 bits
    assert np.all(lists.rising == (along > 0))


def test_crossings_with_triangles_seen_from_their_edge_stay_near_them(gl: moderngl.Context) -> None:
    """A rough surface along the rays: distances run from one end of the box to the other and hardly further.

    Its triangles are seen so nearly from the edge that the grid to which the rasteriser moves vertices decides which
    pixels they cover, also ones whose centre is beside the triangle. What they interpolate there is then extrapolated.
    """
    _, y, x = np.meshgrid(*[np.arange(9.0)] * 3, indexing="ij")
    rough = np.random.default_rng(1).standard_normal(x.shape)
    eye, target = (4.0, 4.0, 20.0), (4.0, 4.0, 0.0)
    camera = Camera(projection=Projection.ORTHOGRAPHIC, eye=eye, target=target, height=8.0)
    tf = TransferFunction([], [Isosurface(0.0, (1.0, 1.0, 1.0), 0.5)])
    found = 0
    for roughness in 10.0 ** np.linspace(-6, -2, 17):
        volume = Volume(x + 0.73 * y - 6.93 + roughness * rough)
        plan = plan_isovalues(tf, volume.value_range, per_slope=0)
        with ABuffer(gl, Scene.build(extract_surfaces(volume, plan.isovalues), plan)) as abuffer:
            lists = abuffer.fragment_lists(camera, (500, 500), RenderSettings())
        distances = lists.distances[lists.levels == 0]
        found += len(distances)
        # the box is met from 12 to 20; what is taken for a crossing is at most a cell's diagonal away from it
        assert (np.abs(distances - 16.0) <= 4.0 + np.sqrt(3.0)).all(), roughness
    assert found > 4000  # of 500² pixels
