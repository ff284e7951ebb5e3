"""Surfaces that go into a store brick by brick are those of memory, bit for bit; what is there is not made again."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from isosample.errors import CacheError, InputError
from isosample.surfaces import memory as memory_module
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.memory import LEAST_BUDGET, Gate, MemoryPlan, peak_bytes, resident_bytes
from isosample.surfaces.out_of_core import SurfaceLists, extract_into_store
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.volume.grid import Volume
from isosample.volume.lazy import LazySamples
from isosample.volume.reconstruction import Reconstruction
from isosample.volume.scan import scan_volume

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.grid import SampleArray
    from isosample.volume.lazy import Block, Triple

MEMORY = 1 << 36  # of the whole process, which holds what other tests left: no limit here
CELLS = 8
LEVELS = (40.0, 71.5, 90.0, 120.0)
SETTINGS = ExtractionSettings(brick_cells=CELLS, residuals=True)


def waves(dtype: str = "uint8") -> SampleArray:
    """(21, 26, 33) samples between 0 and 160, integers, some of which equal a level."""
    z, y, x = np.mgrid[0:21, 0:26, 0:33]
    field = 80 + 50 * np.sin(0.4 * x) * np.cos(0.3 * y) + 30 * np.sin(0.5 * z + 0.1 * x)
    return cast("SampleArray", np.rint(field).astype(dtype))


class Sliced(LazySamples):
    """Samples that are never there as a whole."""

    def __init__(self, samples: SampleArray, chunks: Triple = (4, 6, 5)) -> None:
        super().__init__(cast("Triple", samples.shape), samples.dtype, chunks=chunks)
        self.samples = samples
        self.read_count = 0

    def read(self, block: Block) -> SampleArray:
        self.read_count += 1
        found: SampleArray = self.samples[block].copy()
        return found


def sliced(samples: SampleArray, **placement: object) -> Volume:
    """A volume of such samples."""
    return Volume(cast("SampleArray", Sliced(samples)), **placement)  # type: ignore[arg-type]


def assert_same(found: StoredSurfaces, expected: SurfaceSet) -> None:
    """All meshes, their order, errors, faces and counts are equal, bit for bit."""
    assert found.geometry == expected.geometry
    assert found.value_range == expected.value_range
    assert found.mesh_errors == expected.mesh_errors
    assert found.statistics.triangles == expected.statistics.triangles
    assert found.statistics.vertices == expected.statistics.vertices
    assert len(found.chunk_table) == len(expected.meshes)
    for one, other in zip(found.chunks(), expected.meshes, strict=True):
        assert_same_mesh(one, other)
    for one_face, other_face in zip(found.boundary.faces, expected.boundary.faces, strict=True):
        np.testing.assert_array_equal(one_face, other_face)


def assert_same_mesh(one: BrickMesh, other: BrickMesh) -> None:
    assert (one.isovalue, one.brick, one.start, one.error) == (
        other.isovalue,
        other.brick,
        other.start,
        other.error,
    )
    for name in ("positions", "gradients", "edge_keys", "triangles"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_surfaces_of_a_lazy_volume_are_those_of_memory(tmp_path: Path, dtype: str, mirror: float) -> None:
    samples, direction = waves(dtype), np.diag([1.0, mirror, 1.0])
    found = extract_into_store(
        sliced(samples, direction=direction), LEVELS, MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY
    )
    expected = extract_surfaces(
        Volume(samples, direction=direction), LEVELS, brick_cells=CELLS, residuals=True
    )
    assert_same(found, expected)
    assert found.statistics.brick_visits == expected.statistics.brick_visits
    assert found.statistics.brick_visits_skipped == expected.statistics.brick_visits_skipped


@pytest.mark.parametrize("refine", [1, 2])
def test_refined_and_masked_surfaces_are_those_of_memory(tmp_path: Path, refine: int) -> None:
    samples = waves("float32")
    samples[5:9, 8, 3:20] = np.nan
    settings = ExtractionSettings(brick_cells=CELLS, nan_masked=True, refine=refine)
    found = extract_into_store(sliced(samples), LEVELS, MeshStore(tmp_path), settings=settings, memory=MEMORY)
    expected = extract_surfaces(Volume(samples), LEVELS, brick_cells=CELLS, nan_masked=True, refine=refine)
    assert_same(found, expected)
    assert found.boundary.mask_faces is not None
    assert expected.boundary.mask_faces is not None
    np.testing.assert_array_equal(found.boundary.mask_faces.starts, expected.boundary.mask_faces.starts)
    np.testing.assert_array_equal(found.boundary.mask_faces.values, expected.boundary.mask_faces.values)


def test_a_tight_budget_divides_windows_and_isovalues_and_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = MemoryPlan(total=MEMORY, sample_bytes=8000, mesh_bytes=1)
    monkeypatch.setattr(MemoryPlan, "of", classmethod(lambda _cls, _total: plan))
    samples = waves()
    volume = sliced(samples)
    scan = scan_volume(Volume(samples), CELLS)
    found = extract_into_store(volume, LEVELS, MeshStore(tmp_path), settings=SETTINGS, scan=scan)
    assert_same(found, extract_surfaces(Volume(samples), LEVELS, brick_cells=CELLS, residuals=True))


def test_an_interrupted_extraction_goes_on_where_it_ended(tmp_path: Path) -> None:
    class Interrupted(MeshStore):
        def put(self, key: str, mesh: BrickMesh) -> None:
            if self.written >= 20:
                raise KeyboardInterrupt
            super().put(key, mesh)

    volume = Volume(waves())
    with pytest.raises(KeyboardInterrupt):
        extract_into_store(volume, LEVELS, Interrupted(tmp_path), settings=SETTINGS, memory=MEMORY)
    kept = len(MeshStore(tmp_path).keys())
    assert kept >= 20  # threads that were in the middle may have finished theirs
    store = MeshStore(tmp_path)
    found = extract_into_store(volume, LEVELS, store, settings=SETTINGS, memory=MEMORY)
    assert found.statistics.chunks_reused == kept
    assert found.statistics.brick_visits == store.written
    expected = extract_surfaces(Volume(waves()), LEVELS, brick_cells=CELLS, residuals=True)
    assert kept + store.written == expected.statistics.brick_visits
    assert_same(found, expected)


def test_a_listed_surface_is_neither_extracted_nor_loaded(tmp_path: Path) -> None:
    lists = SurfaceLists(folder=tmp_path, content_hash="c")
    samples = Sliced(waves())
    volume = Volume(cast("SampleArray", samples))
    scan = scan_volume(volume, CELLS)
    first = extract_into_store(
        volume, LEVELS, MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY, scan=scan, lists=lists
    )
    store, reads = MeshStore(tmp_path), samples.read_count
    found = extract_into_store(
        volume, LEVELS[1:], store, settings=SETTINGS, memory=MEMORY, scan=scan, lists=lists
    )
    assert (store.hits, store.misses, store.written) == (0, 0, 0)
    assert samples.read_count - reads == 6  # the faces
    assert found.statistics.levels_reused == 3
    assert found.statistics.triangles == first.statistics.triangles[1:]
    assert_same(found, extract_surfaces(Volume(waves()), LEVELS[1:], brick_cells=CELLS, residuals=True))


def test_a_moved_isovalue_extracts_only_its_own_pieces(tmp_path: Path) -> None:
    lists = SurfaceLists(folder=tmp_path, content_hash="c")
    volume = Volume(waves())
    for levels, new in ((LEVELS, 4), ((40.0, 72.0, 90.0, 120.0), 1)):
        found = extract_into_store(
            volume, levels, MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY, lists=lists
        )
        assert found.statistics.levels_reused == 4 - new
    alone = extract_surfaces(volume, [72.0], brick_cells=CELLS)
    assert found.statistics.brick_visits == alone.statistics.brick_visits


@pytest.mark.parametrize("listed", [False, True])
def test_missing_and_damaged_pieces_alone_are_extracted_again(tmp_path: Path, listed: bool) -> None:
    lists = SurfaceLists(folder=tmp_path, content_hash="c") if listed else None
    volume, store = Volume(waves()), MeshStore(tmp_path)
    first = extract_into_store(volume, LEVELS, store, settings=SETTINGS, memory=MEMORY, lists=lists)
    keys = [key.decode() for key in first.chunk_table["key"].tolist()]
    store.path(keys[0]).unlink()
    damaged = store.path(keys[7])
    data = bytearray(damaged.read_bytes())
    data[-3] ^= 1
    damaged.write_bytes(data)
    with pytest.raises(CacheError, match=r"missing or damaged.*precompute"):
        list(first.chunks())  # finds both, and the store removes what is damaged
    with pytest.raises(CacheError, match=r"isosurface 40\.0 in brick"):
        first.chunk(7)
    store = MeshStore(tmp_path)
    found = extract_into_store(volume, LEVELS, store, settings=SETTINGS, memory=MEMORY, lists=lists)
    assert store.written == found.statistics.brick_visits == 2
    assert_same(found, extract_surfaces(volume, LEVELS, brick_cells=CELLS, residuals=True))


def test_chunks_are_chosen_by_level_and_brick(tmp_path: Path) -> None:
    volume = Volume(waves())
    found = extract_into_store(volume, LEVELS, MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY)
    expected = extract_surfaces(volume, LEVELS, brick_cells=CELLS, residuals=True)
    bricks = [(0, 0, 0), (1, 2, 1)]
    for levels, chosen_bricks in (([1, 3], None), (None, bricks), ([2], bricks), ([], None)):
        chosen = [
            mesh
            for mesh in expected.meshes
            if (levels is None or mesh.isovalue in [LEVELS[level] for level in levels])
            and (chosen_bricks is None or mesh.brick in chosen_bricks)
        ]
        for one, other in zip(found.chunks(levels, chosen_bricks), chosen, strict=True):
            assert_same_mesh(one, other)
    for level in range(len(LEVELS)):
        one_mesh, other_mesh = found.mesh(level), expected.mesh(level)
        np.testing.assert_array_equal(one_mesh.vertices, other_mesh.vertices)
        np.testing.assert_array_equal(one_mesh.triangles, other_mesh.triangles)
    with pytest.raises(InputError, match="level 4 does not exist"):
        found.pieces(4)


def test_the_table_tells_sizes_and_boxes(tmp_path: Path) -> None:
    found = extract_into_store(Volume(waves()), LEVELS, MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY)
    table = found.chunk_table
    for place, mesh in enumerate(found.chunks()):
        assert table["level"][place] == LEVELS.index(mesh.isovalue)
        assert tuple(table["brick"][place]) == mesh.brick
        assert (table["triangles"][place], table["vertices"][place]) == (
            len(mesh.triangles),
            len(mesh.positions),
        )
        world = mesh.vertices_world(found.geometry)  # spacing 1, no origin: index coordinates
        np.testing.assert_array_equal(table["low"][place], world.min(axis=0).astype(np.float32))
        np.testing.assert_array_equal(table["high"][place], world.max(axis=0).astype(np.float32))


def test_isovalues_outside_the_range_give_empty_surfaces(tmp_path: Path) -> None:
    found = extract_into_store(
        Volume(waves()), [-5.0, 500.0], MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY
    )
    assert len(found.chunk_table) == 0
    assert found.statistics.triangles == (0, 0)
    assert found.meshes == ()
    assert [len(found.mesh(level).triangles) for level in (0, 1)] == [0, 0]


def test_progress_counts_pieces(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    found = extract_into_store(
        Volume(waves()),
        LEVELS,
        MeshStore(tmp_path),
        settings=SETTINGS,
        memory=MEMORY,
        progress=lambda done, total: told.append((done, total)),
    )
    total = found.statistics.brick_visits
    assert told[-1] == (total, total)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_a_smooth_reconstruction_cannot_keep_to_a_budget(tmp_path: Path) -> None:
    settings = ExtractionSettings(reconstruction=Reconstruction.CUBIC)
    with pytest.raises(InputError, match=r"cubic reconstruction needs all samples.*--memory"):
        extract_into_store(Volume(waves()), LEVELS, MeshStore(tmp_path), settings=settings)


def test_samples_that_are_not_finite_are_refused_unless_masked(tmp_path: Path) -> None:
    samples = waves("float32")
    samples[3, 3, 3] = np.nan
    with pytest.raises(InputError, match=r"1 NaN and 0 infinite samples"):
        extract_into_store(sliced(samples), LEVELS, MeshStore(tmp_path), settings=SETTINGS, memory=MEMORY)


def test_a_budget_below_what_the_program_takes_is_refused_with_what_would_do() -> None:
    with pytest.raises(InputError, match=r"budget of 100 MiB is too small.*at least \d+ MiB"):
        MemoryPlan.of(100 << 20)


def test_the_shares_of_a_budget_leave_room_for_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_module, "resident_bytes", lambda: 300 << 20)
    plan = MemoryPlan.of(2 << 30)
    assert plan.sample_bytes + plan.mesh_bytes + (300 << 20) < 2 << 30
    assert min(plan.sample_bytes, plan.mesh_bytes) > 256 << 20
    with pytest.raises(InputError):
        MemoryPlan.of(LEAST_BUDGET)


def test_a_gate_lets_in_what_fits_and_one_that_never_does() -> None:
    gate = Gate(10)
    gate.enter(4)
    gate.enter(6)
    gate.leave(4)
    gate.leave(6)
    gate.enter(1000)
    gate.leave(1000)


@pytest.mark.parametrize("first", [6, 1000])
def test_a_gate_holds_back_what_does_not_fit_until_there_is_room(first: int) -> None:
    gate = Gate(10)
    gate.enter(first)
    asked, entered = threading.Event(), threading.Event()

    def second() -> None:
        asked.set()
        gate.enter(5)
        entered.set()

    waiting = threading.Thread(target=second, daemon=True)
    waiting.start()
    assert asked.wait(60.0)
    assert not entered.wait(
        0.2
    )  # what is let in at once has entered long before; what waits, waits however long
    gate.leave(first)
    assert entered.wait(60.0)
    waiting.join()
    gate.enter(5)  # just fits beside the second


def test_the_system_tells_what_the_process_holds() -> None:
    assert 1 << 20 < resident_bytes() <= peak_bytes()
