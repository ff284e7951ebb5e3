"""The chunk codec: every mesh comes back bit for bit, in few bytes, and no damage goes unseen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_checks import closed_noise

from isosample.errors import CacheError, InputError
from isosample.surfaces import chunk_encoding, encoding_kernels
from isosample.surfaces.chunk_decoding import decode, decode_all
from isosample.surfaces.chunk_encoding import encode
from isosample.surfaces.chunk_header import NO_NAME, OtherVersionError
from isosample.surfaces.chunk_layout import ChunkHeader
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mesh import BrickMesh
from isosample.surfaces.mesh_error import MeshError, round_residuals
from isosample.volume.analytic import GaussianMixture, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

ARRAYS = ("positions", "gradients", "edge_keys", "triangles", "residuals")


def assert_same(found: BrickMesh, expected: BrickMesh) -> None:
    assert (found.isovalue, found.brick, found.start) == (expected.isovalue, expected.brick, expected.start)
    assert found.error == expected.error
    for name in ARRAYS:
        left, right = getattr(found, name), getattr(expected, name)
        assert (left.dtype, left.shape) == (right.dtype, right.shape)
        assert left.tobytes() == right.tobytes(), name


def any_mesh(count: int = 5, **fields: Any) -> BrickMesh:
    """Vertices in no order, of no grid edge, with triangles at random."""
    generator = np.random.default_rng(count)
    arrays: dict[str, Any] = {
        "positions": (generator.integers(0, 32 * 2**19, (count, 3)) / 2**19).astype(np.float32),
        "gradients": generator.normal(size=(count, 3)).astype(np.float32),
        "edge_keys": generator.integers(-(2**63), 2**63, count),
        "triangles": generator.integers(0, max(count, 1), (2 * count, 3)).astype(np.int32),
        "residuals": generator.random((count, 2)).astype(np.float32),
    }
    return BrickMesh(isovalue=0.1, brick=(1, 2, 3), start=(32, 64, 96), **{**arrays, **fields})


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"residuals": True},
        {"refine": 4},
        {"reconstruction": Reconstruction.CUBIC, "refine": 2, "residuals": True},
        {"brick_cells": 5},
        {"brick_cells": 1},
    ],
    ids=str,
)
def test_extracted_meshes_come_back_bit_for_bit(options: dict[str, Any]) -> None:
    volume = Volume(closed_noise(4, size=9), direction=np.diag([1.0, 1.0, -1.0]))
    meshes = extract_surfaces(volume, [-0.5, 0.0, 0.25], **options).meshes
    assert len(meshes) >= 3
    for mesh in meshes:
        assert_same(decode(encode(mesh)), mesh)


def test_integers_at_integer_levels_come_back_bit_for_bit() -> None:
    samples = np.random.default_rng(2).integers(0, 4, (12, 13, 14)).astype(np.uint8)
    for mesh in extract_surfaces(Volume(samples), [1.0, 2.0, 3.0]).meshes:
        assert_same(decode(encode(mesh)), mesh)


@pytest.mark.parametrize("count", [0, 1, 2, 300])
def test_any_mesh_comes_back_bit_for_bit(count: int) -> None:
    mesh = any_mesh(count)
    assert_same(decode(encode(mesh)), mesh)


@pytest.mark.parametrize(
    "gradient",
    [
        (0.0, -0.0, 0.0),
        (1.0, -0.0, 2.0**-15),
        (-0.0, -1.0, 32767 / 32768),
        (1e-45, 0.0, -1e-45),  # the smallest float32
        (3.4e38, -3.4e38, 1.0),
        (np.inf, -np.inf, np.nan),
        (1.0, 1e-30, 0.0),
    ],
    ids=str,
)
def test_any_gradients_come_back_bit_for_bit(gradient: tuple[float, float, float]) -> None:
    gradients = np.array([(1.0, 0.5, 0.25), gradient, (-8.0, 4.0, 0.0)] * 2, dtype=np.float32)
    mesh = any_mesh(6, gradients=gradients)
    assert_same(decode(encode(mesh)), mesh)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_hypothesis_finds_no_mesh_that_changes(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 6))
    numbers = st.integers(-32767, 32767)
    exponents = data.draw(st.lists(st.integers(-120, 100), min_size=count, max_size=count))
    mantissas = data.draw(st.lists(st.tuples(numbers, numbers, numbers), min_size=count, max_size=count))
    scale = np.ldexp(1.0, np.array(exponents) - 15)
    places = st.integers(0, 4 * 2**19)
    positions = data.draw(st.lists(st.tuples(places, places, places), min_size=count, max_size=count))
    keys = data.draw(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=count, max_size=count))
    mesh = any_mesh(
        count,
        gradients=(np.array(mantissas) * scale[:, None]).astype(np.float32),
        positions=(np.array(positions) / 2**19).astype(np.float32),
        edge_keys=np.array(keys, dtype=np.int64),
    )
    assert_same(decode(encode(mesh)), mesh)


def test_the_error_and_the_name_come_back() -> None:
    mesh = any_mesh(
        4, error=MeshError(area=1 / 3, flat_rms=0.1, flat_largest=0.2, curved_rms=1e-9, curved_largest=5e-324)
    )
    data = encode(mesh, name=bytes(range(32)))
    assert_same(decode(data, name=bytes(range(32))), mesh)
    header = ChunkHeader.read(data)
    assert (header.name, header.isovalue, header.brick) == (bytes(range(32)), 0.1, (1, 2, 3))
    assert (header.vertex_count, header.triangle_count) == (4, 8)
    with pytest.raises(CacheError, match=r"it is named 0001.*expected 0000"):
        decode(data, name=NO_NAME)


def test_a_smooth_surface_takes_at_most_six_bytes_per_triangle() -> None:
    """In memory these are 12 of indices and half a vertex of 40: 32."""
    field = GaussianMixture(centres=((0.0, 0.0, 0.0),), widths=(0.5,), amplitudes=(1.0,))
    volume = sample_field(field, (33, 33, 33), lower=(-1.0,) * 3, upper=(1.0,) * 3, name="blob")
    (mesh,) = extract_surfaces(volume, [0.5]).meshes
    assert len(encode(mesh)) < 6.0 * len(mesh.triangles)
    (measured,) = extract_surfaces(volume, [0.5], residuals=True).meshes
    assert len(encode(measured)) < 8.0 * len(
        mesh.triangles
    )  # two bytes for each of two residuals, half a vertex


def test_residuals_are_rounded_up_to_what_two_bytes_hold() -> None:
    sizes = 10.0 ** np.random.default_rng(1).uniform(-37, 37, 1000)
    exact = np.concatenate([sizes, [0.0, 1.0, 1.0 + 2.0**-8, 1.0 + 2.0**-23, 65504.0, 1e-300, 3.5e38, 1e300]])
    rounded = round_residuals(exact.reshape(-1, 2)).reshape(-1)
    assert (rounded >= exact).all()
    assert (rounded[:1000] < exact[:1000] * (1.0 + 2.0**-8)).all()
    assert rounded[1000:1004].tolist() == [0.0, 1.0, 1.0 + 2.0**-8, 1.0 + 2.0**-8]
    assert np.isinf(rounded[-2:]).all()
    assert not (rounded.view(np.uint32) & 0x80007FFF).any()


@pytest.mark.parametrize("place", [(0.1, 0.0, 0.0), (-1.0, 0.0, 0.0), (np.nan, 0.0, 0.0), (2000.0, 0.0, 0.0)])
def test_positions_that_cannot_be_kept_are_refused(place: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match=r"2\^-19|cannot be kept"):
        encode(any_mesh(1, positions=np.array([place], dtype=np.float32)))


def test_every_flipped_bit_is_found() -> None:
    """The header and the frame have 32-bit checksums; bits that Zstandard does not use may change nothing."""
    mesh = any_mesh(12)
    data = encode(mesh)
    found = 0
    for place in range(len(data)):
        changed = data[:place] + bytes([data[place] ^ 1 << place % 8]) + data[place + 1 :]
        try:
            assert_same(decode(changed), mesh)
        except CacheError:
            found += 1
    assert found >= len(data) - 2


def test_every_truncation_is_found() -> None:
    data = encode(any_mesh(12))
    for length in range(len(data)):
        with pytest.raises(CacheError):
            decode(data[:length])
    with pytest.raises(CacheError, match="bytes, expected"):
        decode(data + b"\0")


def test_another_version_is_told_from_damage() -> None:
    data = encode(any_mesh(2))
    with pytest.raises(OtherVersionError, match="format version 2; this program reads and writes 3"):
        decode(data[:8] + b"\2\0" + data[10:])


def with_wrong_corners(mesh: BrickMesh, name: bytes = NO_NAME) -> bytes:
    """A chunk as a faulty program might write it: the checksums hold, and corners are no vertices."""
    outside = replace(mesh, triangles=np.full_like(mesh.triangles, len(mesh.positions)))
    with pytest.MonkeyPatch.context() as faulty:
        faulty.setattr(chunk_encoding, "check_mesh", lambda _: None)
        faulty.setattr(encoding_kernels, "cell_codes", lambda *_: False)  # would look the corners up
        return encode(outside, name=name)


@pytest.mark.parametrize("whole", [0, 1, 3])
def test_a_chunk_whose_checksums_hold_and_whose_content_does_not_is_refused(whole: int) -> None:
    """Among any number of whole ones, which come as alone."""
    chunks = [encode(any_mesh(20 + number)) for number in range(whole)]
    chunks.insert(whole // 2, with_wrong_corners(any_mesh(12)))
    found = decode_all(chunks, [None] * len(chunks))
    wrong = found.pop(whole // 2)
    assert isinstance(wrong, CacheError)
    assert "a triangle of it has a corner that is no vertex" in str(wrong)
    for number, mesh in enumerate(found):
        assert isinstance(mesh, BrickMesh)
        assert_same(mesh, any_mesh(20 + number))


def test_a_mesh_with_a_corner_that_is_no_vertex_is_refused() -> None:
    volume = Volume(closed_noise(4, size=5))
    mesh = extract_surfaces(volume, [0.0]).meshes[0]
    outside = replace(mesh, triangles=np.full_like(mesh.triangles, len(mesh.positions)))
    with pytest.raises(InputError, match="corner"):
        encode(outside)
