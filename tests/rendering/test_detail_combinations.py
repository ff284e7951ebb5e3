"""Details together with what else decides about the pieces that are drawn: budgets, clip planes, an eye inside the box.

What is left out, what is loaded in batches and how a picture is tiled change none of its bits, so every promise here is
one of equal bits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering import picture_frame
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.culling import CulledPicture, Culling
from isosample.rendering.device_meshes import bytes_of
from isosample.rendering.frame import storage_dtype
from isosample.rendering.scene import Scene
from isosample.rendering.settings import ClipPlane, RenderSettings
from rendering.test_details import SIZE, blobs, cameras, chosen, plan_of, surfaces_of

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

    from isosample.rendering.camera import Camera

INSIDE = 2  # of the four cameras: its pieces are drawn in front of the eye, and behind it
COARSE = 2.0  # pixels: several details in one picture
SMALLEST = 1 << 16  # bytes: the least budget of meshes, and of fragments


@pytest.fixture(scope="module")
def scene() -> Scene:
    volume = blobs()
    plan = plan_of(volume)
    return Scene.build(surfaces_of(volume, plan), plan)


def bytes_needed(scene: Scene, camera: Camera) -> int:
    """Bytes of the pieces of the details that a picture takes, in view or not."""
    return int(bytes_of(scene.chunks()[chosen(scene, camera, COARSE)]).sum())


def planes_of(camera: Camera) -> tuple[ClipPlane, ...]:
    """Leave what is to the right of the target, and farther than a plane between the eye and the target."""
    rays = camera.rays(SIZE[0] / SIZE[1])
    target = np.array(camera.target)
    way = min(0.5 * float(np.linalg.norm(target - rays.eye)), 0.5 * blobs().box.radius)
    right = rays.span_right / np.linalg.norm(rays.span_right)
    planes = ((right, target), (rays.forward, target - way * rays.forward))
    return tuple(ClipPlane(*np.append(n, -n @ point).tolist()) for n, point in planes)


def test_details_that_a_picture_takes_stay_where_all_of_them_would_not_fit(
    gl: moderngl.Context, scene: Scene
) -> None:
    far, near = cameras(blobs())[0], cameras(blobs())[2]
    budget = max(bytes_needed(scene, far), bytes_needed(scene, near))
    assert budget < int(bytes_of(scene.chunks()).sum())
    tight = RenderSettings(screen_error=COARSE, mesh_budget_bytes=budget)
    with ABuffer(gl, scene) as abuffer, ABuffer(gl, scene) as roomy:
        batches = []
        for camera in (far, far, near, near, far):
            expected, whole = roomy.render(camera, SIZE, RenderSettings(screen_error=COARSE))
            found, part = abuffer.render(camera, SIZE, tight)
            np.testing.assert_array_equal(found, expected)
            assert part.mesh_bytes <= budget
            assert whole.mesh_bytes == int(bytes_of(scene.chunks()).sum())  # all details, for all views
            batches.append(part.mesh_batches)
    assert batches == [
        1,
        0,
        1,
        0,
        1,
    ]  # the same view again loads nothing, other details take the place of these


@pytest.mark.parametrize("clipped", [False, True])
@pytest.mark.parametrize("number", range(4))
def test_details_in_batches_give_the_bits_of_all_at_once(
    gl: moderngl.Context, scene: Scene, number: int, clipped: bool
) -> None:
    camera = cameras(blobs())[number]
    planes = planes_of(camera) if clipped else ()
    with ABuffer(gl, scene) as abuffer:
        expected, whole = abuffer.render(
            camera, SIZE, RenderSettings(screen_error=COARSE, clip_planes=planes)
        )
    for fragments in (RenderSettings().fragment_budget_bytes, SMALLEST):
        tight = RenderSettings(
            screen_error=COARSE,
            clip_planes=planes,
            mesh_budget_bytes=SMALLEST,
            fragment_budget_bytes=fragments,
        )
        with ABuffer(gl, scene) as abuffer:
            found, part = abuffer.render(camera, SIZE, tight)
        np.testing.assert_array_equal(found, expected)
        assert (part.chunks_coarser, part.triangles_drawn) == (whole.chunks_coarser, whole.triangles_drawn)
        assert part.mesh_bytes <= SMALLEST
    assert part.mesh_batches > 1
    assert (part.tiles > 1) == (whole.fragments > SMALLEST // storage_dtype("Node").itemsize)
    assert whole.chunks_coarser > 0


@pytest.mark.parametrize("clipped", [False, True])
@pytest.mark.parametrize("number", range(4))
def test_what_clip_planes_and_view_rule_out_of_the_details_changes_no_bit(
    gl: moderngl.Context, scene: Scene, monkeypatch: pytest.MonkeyPatch, number: int, clipped: bool
) -> None:
    camera = cameras(blobs())[number]
    settings = RenderSettings(screen_error=COARSE, clip_planes=planes_of(camera) if clipped else ())
    with ABuffer(gl, scene) as abuffer:
        found, culled = abuffer.render(camera, SIZE, settings)
    monkeypatch.setattr(picture_frame, "Culling", Everything)
    with ABuffer(gl, scene) as abuffer:
        expected, whole = abuffer.render(camera, SIZE, settings)
    np.testing.assert_array_equal(found, expected)
    assert (culled.chunks_clipped > 0) == clipped
    assert culled.chunks_coarser == whole.chunks_coarser > 0
    left_out = culled.chunks_clipped + culled.chunks_outside_view
    assert (culled.triangles_drawn < whole.triangles_drawn) == (left_out > 0 or number == INSIDE)
    assert np.ptp(expected[..., 3]) > 0.1


class Everything(Culling):
    """Rules out nothing but what the choice of details leaves out."""

    def picture(
        self,
        frame: np.void,
        sides: tuple[float, ...],
        *,
        clip: bool,
        chosen: npt.NDArray[np.bool_] | None = None,
    ) -> CulledPicture:
        found = super().picture(frame, sides, clip=clip, chosen=chosen)
        assert chosen is not None
        passes = tuple(one._replace(shown=chosen) for one in found.passes)
        triangles = int(self._triangles[chosen].sum()) * len(sides)
        return found._replace(passes=passes, triangles=triangles)


@pytest.mark.parametrize("number", range(4))
def test_coarser_pictures_with_clip_planes_hardly_differ_and_lose_no_crossing(
    gl: moderngl.Context, scene: Scene, number: int
) -> None:
    camera = cameras(blobs())[number]
    fine, coarse = (RenderSettings(screen_error=e, clip_planes=planes_of(camera)) for e in (0.0, 0.25))
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, SIZE, fine)
        found, told = abuffer.render(camera, SIZE, coarse)
    assert (told.lost_fragments, told.unrepaired_pixels, told.band_violations) == (0, 0, 0)
    # As in test_coarser_pictures_lose_no_crossing_and_hardly_differ: outlines that move by a quarter of a pixel, of
    # which clip planes leave fewer. Where a plane cuts a band, its light ends at the same place for both.
    assert (np.abs(found - expected).max(axis=-1) > 0.02).mean() < 0.05
