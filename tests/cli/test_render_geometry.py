"""`render` draws a volume where it lies and as thick as it is: closed forms and patient axes, from end to end."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest

import isosample
from cli.rendered import ROUNDING, opacity_after, pixels, write_slab
from cli.test_info import write_turned
from isosample.cli.methods import METHODS

if TYPE_CHECKING:
    from cli.harness import Run

pytestmark = pytest.mark.usefixtures("gl")


def column_x(width: int = 16) -> npt.NDArray[np.float64]:
    """x of every pixel column's centre in the default view of the slab, whose bounding sphere fits."""
    radius = math.sqrt(9**2 + 8**2 + 7**2) / 2
    centres: npt.NDArray[np.float64] = 4.5 + radius * (2 * (np.arange(width) + 0.5) / width - 1)
    return centres


def test_a_slab_has_the_opacity_of_its_thickness(run: Run) -> None:
    write_slab()
    assert run("render slab.npy --tf white.json --size 16x16 -o out.npy").status == 0
    np.testing.assert_allclose(pixels()[8, 8], opacity_after(7), rtol=0, atol=ROUNDING)  # white: all four
    assert not pixels()[0].any()


def test_spacing_lengthens_the_way_through_a_raw_slab(run: Run) -> None:
    write_slab()
    Path("slab.raw").write_bytes(np.load("slab.npy").astype("u1").tobytes())
    read = "--shape 10,9,8 --dtype uint8"
    assert run(f"render slab.raw {read} --tf white.json --size 16x16 -o one.npy").status == 0
    assert run("render slab.npy --tf white.json --size 16x16 -o float.npy").status == 0
    np.testing.assert_allclose(pixels("one.npy"), pixels("float.npy"), rtol=0, atol=ROUNDING)
    assert run(f"render slab.raw {read} --spacing 1,1,2 --tf white.json --size 16x16 -o two.npy").status == 0
    np.testing.assert_allclose(pixels("two.npy")[8, 8], opacity_after(14), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("clip", ["--clip -1,0,0,4", "--clip=-1,0,0,4", "--clip -.25,0,0,1"])
def test_a_clip_plane_keeps_the_side_where_it_is_positive(run: Run, clip: str) -> None:
    write_slab()
    assert run(f"render slab.npy --tf white.json --size 16x16 {clip} -o out.npy").status == 0
    x = column_x()
    inside = (x >= 0) & (x <= 4)
    assert inside.any()
    expected = np.where(inside, opacity_after(7), 0.0)
    np.testing.assert_allclose(pixels()[8, :, 3], expected, rtol=0, atol=ROUNDING)


def test_clip_planes_across_the_view_thin_the_slab(run: Run) -> None:
    write_slab()
    clips = "--clip 0,0,-1,5.5 --clip 0,0,1,-2"  # 2 <= z <= 5.5
    assert run(f"render slab.npy --tf white.json --size 16x16 {clips} -o out.npy").status == 0
    np.testing.assert_allclose(pixels()[8, 8, 3], opacity_after(3.5), rtol=0, atol=ROUNDING)


def test_frame_index_gives_the_picture_of_the_bare_samples(run: Run) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    view = "--tf tf.json --size 24x16 --azimuth 20 --up y"
    assert run(f"render turned.mha --frame index {view} -o index.npy").status == 0
    assert run(f"render blob.npy --spacing 0.5,1,2 {view} -o bare.npy").status == 0
    assert run(f"render turned.mha {view} -o world.npy").status == 0
    np.testing.assert_array_equal(pixels("index.npy"), pixels("bare.npy"))
    assert not np.array_equal(pixels("index.npy"), pixels("world.npy"))


@pytest.mark.parametrize("method", METHODS)
def test_scans_in_patient_axes_are_seen_from_the_front_head_up(run: Run, method: str) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    view = f"--tf tf.json --size 24x16 --azimuth 20 --method {method}"
    pictures = {}
    for name, source, up in (
        ("default", "turned.mha", ""),
        ("z", "turned.mha", "--up z"),
        ("y", "turned.mha", "--up y"),
        ("index", "turned.mha --frame index", ""),
        ("index y", "turned.mha --frame index", "--up y"),
    ):
        assert run(f"render {source} {view} {up} -o out.npy").status == 0
        pictures[name] = pixels()
    np.testing.assert_array_equal(pictures["default"], pictures["z"])
    assert not np.array_equal(pictures["default"], pictures["y"])
    np.testing.assert_array_equal(pictures["index"], pictures["index y"])


def test_an_orbit_in_python_is_the_view_of_the_same_options(run: Run) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    assert (
        run("render turned.mha --tf tf.json --size 24x24 --azimuth 30 --elevation 20 -o out.npy").status == 0
    )
    volume = isosample.open_volume("turned.mha")
    camera = isosample.Camera.orbit(volume.box, azimuth=30, elevation=20)  # as the README does it
    image = isosample.render(volume, isosample.TransferFunction.load("tf.json"), camera=camera, size=(24, 24))
    np.testing.assert_array_equal(image.rgba, pixels())


def test_a_cache_and_a_film_of_a_scan_in_patient_axes_begin_at_its_front(run: Run) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    assert run("render turned.mha --tf tf.json --size 24x16 -o volume.npy").status == 0
    assert run("precompute turned.mha --tf tf.json --cache turned_meshes").status == 0
    assert run("render turned_meshes --size 24x16 -o cache.npy").status == 0
    np.testing.assert_array_equal(pixels("cache.npy"), pixels("volume.npy"))
    assert run("render turned_meshes --size 24x16 --turntable 2 -o film.npy").status == 0
    np.testing.assert_array_equal(pixels("film-000.npy"), pixels("volume.npy"))
    volume = isosample.open_volume("turned.mha")
    image = isosample.render(volume, isosample.TransferFunction.load("tf.json"), size=(24, 16))
    np.testing.assert_array_equal(image.rgba, pixels("volume.npy"))
