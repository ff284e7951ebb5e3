"""A turn of the camera, and what its frames share: nothing that does not depend on the view is made twice."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import moderngl
import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering.camera import Camera, Projection, UpAxis
from isosample.rendering.pipeline import Renderer
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.turntable import FrameLog, turned, turntable
from isosample.tally import tally
from isosample.volume.analytic import nucleon_like, sample_field
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.rendering.image import Image
    from isosample.volume.geometry import Box

SIZE = (40, 32)
MADE = (
    "program",
    "compute_shader",
    "framebuffer",
    "empty_framebuffer",
    "texture",
    "texture_array",
    "texture3d",
)


def box() -> Box:
    return sample_field(
        nucleon_like(), (9, 9, 9), lower=(0.0, 0.0, 0.0), upper=(40.0, 30.0, 20.0), name="nucleon"
    ).box


@pytest.mark.parametrize("projection", Projection)
@pytest.mark.parametrize("up", UpAxis)
def test_a_turn_at_no_elevation_is_that_of_the_azimuth(projection: Projection, up: UpAxis) -> None:
    first = Camera.orbit(box(), azimuth=15.0, projection=projection, up_axis=up)
    for number, camera in enumerate(turntable(first, 8)):
        expected = Camera.orbit(box(), azimuth=15.0 + 45.0 * number, projection=projection, up_axis=up)
        np.testing.assert_allclose(
            camera.eye, expected.eye, atol=1e-12 * 60.0
        )  # rounding of lengths up to 60
        assert (camera.target, camera.up, camera.height) == (first.target, first.up, first.height)
    assert turntable(first, 8)[0] is first


def test_a_turn_keeps_the_height_above_the_target() -> None:
    first = Camera(
        projection=Projection.PERSPECTIVE, eye=(3, 4, 5), target=(1, 1, 1), up=(0, 2, 0), fov_y_degrees=30
    )
    quarter = turned(first, 90.0)
    # Seen from above, z is to the right of x by a quarter: (2, 4) becomes (4, -2).
    np.testing.assert_allclose(quarter.eye, (1 + 4, 4, 1 - 2), atol=1e-14)


@pytest.mark.parametrize("count", [1, 0, 2.5, True])
def test_a_turn_of_less_than_two_frames_is_refused(count: Any) -> None:
    with pytest.raises(InputError, match="at least 2"):
        turntable(Camera.orbit(box()), count)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts what is made in OpenGL, by the bindings' own methods."""
    found: Counter[str] = Counter()

    def counted(name: str) -> Callable[..., Any]:
        original = getattr(moderngl.Context, name)

        def call(self: moderngl.Context, *args: Any, **options: Any) -> Any:
            found[name] += 1
            return original(self, *args, **options)

        return call

    for name in (*MADE, "buffer"):
        monkeypatch.setattr(moderngl.Context, name, counted(name))
    return found


def draw(
    kind: str, size: tuple[int, int] = SIZE
) -> tuple[Callable[[Camera], Image], Callable[[], None], Box]:
    volume = sample_field(nucleon_like(), (17,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon")
    tf = ramp_tf(0.2, 0.8, (0.0, 0.2))
    renderer: Renderer | RayCaster
    if kind == "surfaces":
        surfaces, plan, _, _ = prepare_surfaces(volume, tf, Quality(per_slope=3))
        renderer = Renderer(surfaces, plan)
    else:
        renderer = RayCaster(volume, tf)
    return lambda camera: renderer.render(camera=camera, size=size), renderer.release, volume.box


@pytest.mark.parametrize("kind", ["surfaces", "rays"])
def test_only_the_first_frame_makes_anything(gl: moderngl.Context, kind: str, made: Counter[str]) -> None:
    log = FrameLog()
    render, release, place = draw(kind)
    for camera in turntable(Camera.orbit(place, azimuth=45.0, elevation=30.0), 6):
        with log.frame():
            render(camera)
        if len(log.seconds) == 1:
            assert made["program"] + made["compute_shader"] >= 1
            assert made["framebuffer"] == (
                1 if kind == "surfaces" else 2
            )  # the picture; the spans of its blocks
            made.clear()
    release()
    assert {name: made[name] for name in MADE if made[name]} == {}
    assert made["buffer"] == 0
    assert log.made_again == {}
    uploads = "mesh_uploads" if kind == "surfaces" else "volume_uploads"
    assert log.made_once[uploads] == 1


def test_a_pool_that_grows_for_a_later_frame_is_told(gl: moderngl.Context) -> None:
    log = FrameLog()
    render, release, place = draw("surfaces", (160, 128))  # more fragments than a row of the pool holds
    for zoom in (0.25, 1.0, 1.02):
        with log.frame():
            render(Camera.orbit(place, zoom=zoom))
    release()
    # Once: the third picture, a little larger, finds room. (Other lengths of lists may need another program.)
    assert log.made_again["fragment_pools"] == 1


def test_the_log_shares_the_preparation_among_the_frames() -> None:
    log = FrameLog()
    tally("test_things")
    for _ in range(4):
        with log.frame():
            tally("test_frames")
    assert log.made_once == {"test_things": 1, "test_frames": 1}
    assert log.made_again == {"test_frames": 3}
    told = log.to_dict()["seconds"]
    assert told["amortised_frame"] == (told["preparation"] + sum(told["frames"])) / 4
    assert told["preparation"] + sum(told["frames"]) <= log.elapsed
    assert told["first_frame"] == told["frames"][0]
    assert told["median_frame"] == sorted(told["frames"][1:])[1]
