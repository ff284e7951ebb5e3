"""Pictures with closed forms: slabs, ramps, impulse spheres; every projection, cuts, spacings and offsets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.settings import ClipPlane, ResolveStage
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from rendering.scenes import F64, box_interval, clip_interval, linear_slab, picture, ramp_tf

if TYPE_CHECKING:
    import moderngl

SIZE = (48, 40)
VIEW = np.array([1.0, 2.0, 3.0])
ORIGIN = np.array([3.0, -2.0, 5.0])
U = 2.0**-24  # unit roundoff of float32
QUADRATURE = 3.8e-6  # shaders/lib/optics.glsl: error of segment_weights, roundings included


def gamma(roundings: int) -> float:
    """Bound on the relative error of so many roundings in float32 (Higham 2002, lemma 3.1)."""
    return roundings * U / (1.0 - roundings * U)


def ramp_volume(spacing: tuple[float, float, float], offset: float) -> tuple[Volume, F64]:
    """A field linear in space, and its world gradient."""
    gradient = np.array([1.0, 0.5, -0.7]) / np.asarray(spacing)
    z, y, x = np.mgrid[0:11, 0:7, 0:9]
    samples = offset + (np.stack([x, y, z], axis=-1) * spacing) @ gradient
    return Volume(samples, spacing=spacing, origin=tuple(ORIGIN)), gradient


def camera_of(kind: str, volume: Volume) -> Camera:
    """Cameras outside and inside the box."""
    box = volume.box
    if kind == "inside":
        eye = tuple(box.centre + np.array([0.1, 0.05, -0.1]) @ box.edges)
        target = tuple(np.asarray(eye) + VIEW)
        return Camera(projection=Projection.PERSPECTIVE, eye=eye, target=target, fov_y_degrees=80.0)
    if kind == "inside orthographic":
        eye, target = tuple(box.centre), tuple(box.centre + VIEW)
        return Camera(projection=Projection.ORTHOGRAPHIC, eye=eye, target=target, height=box.radius)
    if kind == "along an axis":
        return Camera.orbit(box)
    return Camera.orbit(box, azimuth=33, elevation=21, projection=Projection(kind))


KINDS = ["orthographic", "perspective", "inside", "inside orthographic", "along an axis"]


def ramp_picture(
    volume: Volume, gradient: F64, tf: TransferFunction, camera: Camera, planes: list[tuple[float, ...]]
) -> tuple[F64, F64]:
    """The picture of a linear field under one linear piece, and its tolerance per pixel."""
    low, high = volume.value_range
    origins, directions = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    entry, leave = box_interval(volume.box, origins, directions)
    start, end = clip_interval(entry, leave, origins, directions, planes)  # type: ignore[arg-type]
    hit = end > start
    length = np.where(hit, end - start, 0.0)

    def optics(distance: F64) -> F64:
        points = origins + np.where(hit, distance, 0.0)[..., None] * directions
        value = volume.array[0, 0, 0] + (points - ORIGIN) @ gradient
        color, extinction = tf.evaluate(np.clip(value, low, high))
        return np.concatenate([color, extinction[..., None]], axis=-1)

    expected = linear_slab(optics(start), optics(end), length) * hit[..., None]
    # Distances: about 12 roundings on numbers up to `reach`; a face or plane that the ray meets under a small
    # angle magnifies them by 1 / cosine. Vertices lie on multiples of 2^-19 voxel, so a crossing has a value
    # wrong by 2^-18 steps; both act on an optical depth and on colours in [0, 1] (factor 2 each).
    reach = float(np.linalg.norm(np.asarray(camera.eye) - volume.box.centre)) + volume.box.radius
    edges = volume.box.edges / np.linalg.norm(volume.box.edges, axis=1, keepdims=True)
    cuts = np.array([plane[:3] for plane in planes]).reshape(-1, 3)
    normals = np.concatenate([edges, cuts / np.linalg.norm(cuts, axis=1, keepdims=True)])
    cosines = np.abs(directions @ normals.T)
    cosine = np.where(cosines > 1e-9, cosines, 1.0).min(axis=-1)
    extinction_max = float(tf.evaluate([low, high])[1].max())
    value_error = 2.0**-18 * np.abs(gradient * volume.spacing).sum() / (high - low)
    depth_error = extinction_max * (gamma(12) * reach / cosine + value_error * length)
    return expected, QUADRATURE + gamma(30) + 4.0 * depth_error


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 10.0)], ids=["isotropic", "1:1:10"])
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("kind", KINDS)
def test_a_linear_field_under_a_linear_piece_is_exact(
    gl: moderngl.Context, kind: str, offset: float, spacing: tuple[float, float, float]
) -> None:
    volume, gradient = ramp_volume(spacing, offset)
    camera = camera_of(kind, volume)
    centre = volume.box.centre
    plane = (1.0, 0.3, -0.2, float(0.1 - np.array([1.0, 0.3, -0.2]) @ centre))
    for extinctions in [(0.02, 0.3), (2.0, 0.0)]:
        tf = ramp_tf(*volume.value_range, extinctions)
        for planes in ([], [plane]):
            expected, tolerance = ramp_picture(volume, gradient, tf, camera, planes)  # type: ignore[arg-type]
            rgba, statistics = picture(
                gl, volume, tf, camera, SIZE, clip_planes=tuple(ClipPlane(*p) for p in planes)
            )
            error = np.abs(rgba - expected).max(axis=-1)
            assert np.all(error <= tolerance), f"{error.max():.1e} at {np.argmax(error / tolerance)}"
            assert statistics.band_violations == 0
            assert expected[..., 3].max() > 0.2  # there is something in the picture


def test_the_closed_form_is_not_met_by_a_wrong_extinction(gl: moderngl.Context) -> None:
    volume, gradient = ramp_volume((1.0, 1.0, 1.0), 0.0)
    camera = camera_of("orthographic", volume)
    expected, tolerance = ramp_picture(
        volume, gradient, ramp_tf(*volume.value_range, (0.02, 0.3)), camera, []
    )
    rgba, _ = picture(gl, volume, ramp_tf(*volume.value_range, (0.02, 0.3003)), camera, SIZE)
    with pytest.raises(AssertionError):
        assert np.all(np.abs(rgba - expected).max(axis=-1) <= tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_slab_attenuates_by_its_chord(gl: moderngl.Context, kind: str) -> None:
    volume = Volume(np.full((5, 6, 7), 3.5), spacing=(1.0, 2.0, 0.5))
    tf = TransferFunction([ControlPoint(3.0, (0.2, 0.4, 0.8), 0.3), ControlPoint(4.0, (0.2, 0.4, 0.8), 0.3)])
    camera = camera_of(kind, volume)
    origins, directions = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    start, end = box_interval(volume.box, origins, directions)
    length = np.maximum(end - np.maximum(start, 0.0), 0.0)
    alpha = -np.expm1(-0.3 * length)
    expected = np.concatenate([alpha[..., None] * [0.2, 0.4, 0.8], alpha[..., None]], axis=-1)
    background = np.array([0.5, 0.25, 0.125, 1.0])
    expected += (1.0 - alpha[..., None]) * background * [*background[3:].repeat(3), 1.0]
    for rule in SegmentRule:
        if rule is SegmentRule.CONSTANT_FIRST_ORDER:
            continue  # one segment of depth up to 3 is outside its range; see below
        rgba, _ = picture(gl, volume, tf, camera, SIZE, segment=rule, background=tuple(background))
        edge = np.abs(directions / np.linalg.norm(directions, axis=-1, keepdims=True)).min(axis=-1)
        reach = float(np.linalg.norm(np.asarray(camera.eye) - volume.box.centre)) + volume.box.radius
        tolerance = QUADRATURE + gamma(30) + 0.3 * gamma(12) * reach / np.where(edge > 1e-9, edge, 1.0)
        assert np.all(np.abs(rgba - expected).max(axis=-1) <= 2.0 * tolerance)


def test_first_order_opacity_is_extinction_times_length_and_counts_saturation(gl: moderngl.Context) -> None:
    volume = Volume(np.full((5, 5, 5), 1.0))
    camera = Camera.orbit(volume.box)
    for extinction, alpha, saturated in [(0.125, 0.5, 0), (0.3, 1.0, 16 * 16)]:
        tf = TransferFunction(
            [ControlPoint(0.0, (1.0, 1.0, 1.0), extinction), ControlPoint(2.0, (1.0, 1.0, 1.0), extinction)]
        )
        rgba, statistics = picture(gl, volume, tf, camera, (16, 16), segment=SegmentRule.CONSTANT_FIRST_ORDER)
        inside = rgba[..., 3] > 0
        assert np.allclose(rgba[inside], alpha, atol=gamma(12) * 20, rtol=0)
        assert (statistics.saturated_segments == 0) == (saturated == 0)


def sphere_volume(offset: float, spacing: tuple[float, float, float]) -> Volume:
    """Distance from the centre of a box of about 24 world units, on a grid of the given spacing."""
    counts = [max(8, int(24 / s)) + 1 for s in spacing]
    axes = [(np.arange(n) - 0.5 * (n - 1)) * s for n, s in zip(counts, spacing, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    return Volume(
        offset + np.sqrt(x * x + y * y + z * z), spacing=spacing, origin=(axes[0][0], axes[1][0], axes[2][0])
    )


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.12, 0.12, 1.2)], ids=["isotropic", "1:1:10"])
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("kind", ["orthographic", "perspective", "inside"])
def test_nested_impulse_spheres_composite_exactly_away_from_silhouettes(
    gl: moderngl.Context, kind: str, offset: float, spacing: tuple[float, float, float]
) -> None:
    volume = sphere_volume(offset, spacing)
    radii = [4.0, 7.0, 10.0]
    colors = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    opacities = [0.5, 0.3, 0.2]
    tf = TransferFunction(
        [], [Isosurface(offset + r, c, a) for r, c, a in zip(radii, colors, opacities, strict=True)]
    )
    camera = camera_of(kind, volume)
    if kind == "inside":
        camera = Camera(
            projection=Projection.PERSPECTIVE,
            eye=(0.5, 0.0, 5.0),
            target=(1.0, 2.0, -3.0),
            fov_y_degrees=80.0,
        )
    planes = [(0.0, 1.0, 0.2, 1.5)]
    origins, directions = camera.rays(1.0).origins_and_directions(64, 64)
    closest = -(origins * directions).sum(axis=-1)
    miss = np.sqrt(np.maximum((origins**2).sum(axis=-1) - closest**2, 0.0))
    # Chords of a mesh edge of length e sag by e² / 8r, and the trilinear field errs as much.
    sag = sum(s * s for s in spacing) / (8.0 * min(radii)) * 2.0
    for cuts in ([], planes):
        crossings = []
        clear = np.ones(miss.shape, dtype=bool)
        for radius, color, opacity in zip(radii, colors, opacities, strict=True):
            half = np.sqrt(np.maximum(radius**2 - miss**2, 0.0))
            clear &= np.abs(miss - radius) > sag
            for t in (closest - half, closest + half):
                points = origins + t[..., None] * directions
                shown = (miss < radius) & (t > 0)
                clear &= (np.abs(t) > 1.5 * sag) | (miss >= radius)  # the eye is 1.5 sags off or more
                for plane in cuts:
                    height = points @ np.asarray(plane[:3]) + plane[3]
                    shown &= height > 0
                    clear &= (np.abs(height) > 6 * sag) | (miss >= radius)
                crossings.append((t, shown, np.array([*color, 1.0]) * opacity))
        expected = np.zeros((64, 64, 4))
        order = np.argsort(np.stack([t for t, _, _ in crossings]), axis=0)
        layers = np.stack([shown[..., None] * paint for _, shown, paint in crossings])
        for layer in np.take_along_axis(layers, order[..., None], axis=0):
            expected += (1.0 - expected[..., 3:]) * layer
        rgba, statistics = picture(
            gl, volume, tf, camera, (64, 64), clip_planes=tuple(ClipPlane(*plane) for plane in cuts)
        )
        assert clear.mean() > 0.2
        # 6 crossings, 3 roundings each.
        assert np.abs(rgba - expected)[clear].max() <= gamma(18)
        assert statistics.band_violations == 0


def test_both_stages_and_every_sort_capacity_give_the_same_bits(gl: moderngl.Context) -> None:
    volume = sphere_volume(0.0, (1.0, 1.0, 1.0))
    tf = ramp_tf(2.0, 11.0, (0.0, 0.4))
    camera = camera_of("orthographic", volume)
    reference, _ = picture(gl, volume, tf, camera, SIZE, per_slope=40)
    for stage in (ResolveStage.FRAGMENT, ResolveStage.COMPUTE):
        for capacity in (1, 8, 64):
            rgba, _ = picture(gl, volume, tf, camera, SIZE, per_slope=40, stage=stage, sort_capacity=capacity)
            assert np.array_equal(rgba, reference)
