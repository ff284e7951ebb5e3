"""Isosurfaces of a volume that memory cannot hold: window by window from its file, brick by brick into a store."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isosample.errors import CacheError, InputError
from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.chunk_table import ChunkTable, chunk_row
from isosample.surfaces.field import Field, active_levels
from isosample.surfaces.memory import DEFAULT_MEMORY, Gate, MemoryPlan
from isosample.surfaces.settings import ExtractionSettings, check_isovalues, check_volume
from isosample.surfaces.store import chunk_key
from isosample.surfaces.stored_surfaces import StoredSurfaces
from isosample.surfaces.surface_files import read_rows, surface_key, write_rows
from isosample.surfaces.surface_set import ExtractionStatistics
from isosample.volume.bricks import bricks_of
from isosample.volume.scan import scan_volume
from isosample.volume.windows import HALO, brick_windows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from concurrent.futures import Future
    from pathlib import Path

    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.stored_surfaces import ChunkStore
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume
    from isosample.volume.scan import BrickScan

# What one brick takes while it is extracted, at most: a checkerboard has 3 vertices and 4 triangles per cell, a vertex
# takes 64 bytes in the kernel's and the mesh's arrays together, a triangle 12; measured: 172 bytes per cell and level.
MESH_BYTES_PER_CELL = 3 * 64 + 4 * 12
# A coarser detail needs for a vertex 73 bytes more (positions and gradients in float64, its list of corners),
# for a triangle 24.
DETAIL_BYTES_PER_CELL = 3 * 73 + 4 * 24
SAMPLE_BYTES = 80  # per sample of a brick: padded, differentiated, and the kernel's own arrays


class Job(NamedTuple):
    """Isosurfaces to extract in one brick: its row among the bricks, the isovalues, the keys of their chunks."""

    row: int
    isovalues: F64
    keys: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceLists:
    """Lists of the pieces of complete surfaces in a cache folder.

    Attributes
    ----------
    folder : Path
    content_hash : str
        Of the volume.
    """

    folder: Path
    content_hash: str

    def read(self, isovalue: float, settings: ExtractionSettings) -> Rows | None:
        """Return the rows of a surface, None where it is not listed, or its list is damaged or outdated."""
        key = surface_key(self.content_hash, isovalue, settings)
        try:
            return read_rows(self.folder, key, isovalue)[0]
        except CacheError:
            return None  # a list only saves time: the store itself tells what it has

    def write(self, isovalue: float, settings: ExtractionSettings, rows: Rows) -> None:
        """List a surface; raises `CacheError` if the file cannot be written."""
        write_rows(self.folder, surface_key(self.content_hash, isovalue, settings), rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """Where the pieces go, and what decides about them."""

    store: ChunkStore
    settings: ExtractionSettings


def extract_into_store(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    store: ChunkStore,
    *,
    settings: ExtractionSettings | None = None,
    memory: int = DEFAULT_MEMORY,
    scan: BrickScan | None = None,
    lists: SurfaceLists | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> StoredSurfaces:
    """Extract the pieces of isosurfaces that a store lacks, with a memory budget.

    Parameters
    ----------
    volume : Volume
        Lazily sliced or memory-mapped, or in memory (then the budget is for what is needed besides).
    isovalues : (K,) float64
        As for `extract_surfaces`.
    store : ChunkStore
        What it holds is not extracted again; every new piece goes into it as soon as it is there, so that an
        interrupted extraction goes on where it ended.
    settings : ExtractionSettings, optional
        The reconstruction must be trilinear: a spline depends on all samples at once.
    memory : int
        Bytes that the whole process may take at its peak.
    scan : BrickScan, optional
        Of this volume with ``settings.brick_cells``; None: it is made.
    lists : SurfaceLists, optional
        Files that list the pieces of the surfaces that are complete in the store, so that these need not be loaded
        to know their sizes; new surfaces are added to them.
    progress : callable, optional
        Called with (pieces done, pieces to do) after every brick that is extracted.

    Returns
    -------
    surfaces : StoredSurfaces
        Its pieces are those of `extract_surfaces`, bit for bit.

    Raises
    ------
    InputError
        As `extract_surfaces`; also if the reconstruction is smooth or the budget is too small.
    CacheError
        If the store cannot be written.
    """
    settings = settings or ExtractionSettings()
    levels = check_isovalues(isovalues)
    _check_local(settings)
    plan = MemoryPlan.of(memory)
    scan = scan or scan_volume(volume, settings.brick_cells, budget_bytes=plan.sample_bytes)
    scan.tell(volume)
    check_volume(volume, settings)
    bricks = bricks_of(volume.size_xyz, settings.brick_cells)
    jobs = _jobs(volume, scan, levels, settings)
    listed = {} if lists is None else {value: lists.read(value, settings) for value in levels.tolist()}
    found, missing = _divide(store, jobs, listed)
    new = _extract(volume, bricks, missing, _Place(store=store, settings=settings), plan, progress)
    table = ChunkTable.of(levels, [*found, *new])
    lacking = {value for job in missing for value in job.isovalues.tolist()}
    if lists is not None:
        for value in levels.tolist():
            if value in lacking or listed[value] is None:
                lists.write(value, settings, table.rows[table.rows["isovalue"] == value])
    extracted = sum(len(job.keys) for job in missing)
    wanted = sum(len(job.keys) for job in jobs)
    return StoredSurfaces(
        geometry=volume.geometry,
        isovalues=levels,
        boundary=BoundarySlices.from_volume(volume),
        value_range=volume.value_range,
        settings=settings,
        store=store,
        chunk_table=table,
        statistics=ExtractionStatistics(
            bricks_total=len(bricks),
            brick_visits=extracted,
            brick_visits_skipped=len(bricks) * len(levels) - wanted,
            triangles=table.per_level("triangles"),
            vertices=table.per_level("vertices"),
            levels_reused=sum(value not in lacking for value in levels.tolist()),
            chunks_reused=wanted - extracted,
        ),
    )


def _check_local(settings: ExtractionSettings) -> None:
    """Raise `InputError` where a piece depends on more than its brick and one sample around it."""
    if settings.reconstruction.smooth:
        raise InputError(
            f"a {settings.reconstruction.value} reconstruction needs all samples at once, in float64, so that it "
            "cannot keep to a memory budget. Leave out --memory (and read the volume whole), or the reconstruction."
        )


def _jobs(volume: Volume, scan: BrickScan, levels: F64, settings: ExtractionSettings) -> list[Job]:
    """Isosurfaces to extract in every brick that has some."""
    active = active_levels(scan.ranges, levels)
    mirrored = volume.geometry.left_handed
    jobs = []
    for row in np.flatnonzero(active.any(axis=1)).tolist():
        values = levels[active[row]]
        content = scan.digests[row].tobytes().hex()
        keys = [
            chunk_key(content, value, volume.spacing, settings, mirrored=mirrored)
            for value in values.tolist()
        ]
        jobs.append(Job(row, values, tuple(keys)))
    return jobs


def _divide(
    store: ChunkStore, jobs: Sequence[Job], listed: Mapping[float, Rows | None]
) -> tuple[list[Rows], list[Job]]:
    """Rows of the pieces that the store has, and jobs for the others; what is not listed is loaded to know."""
    complete = {value for value, rows in listed.items() if rows is not None}
    all_rows = [rows for rows in listed.values() if rows is not None]
    by_key = {bytes(row["key"]): row.reshape(1) for rows in all_rows for row in rows}

    def look(job: Job) -> tuple[list[Rows], Job | None]:
        rows: list[Rows] = []
        lacking = []
        for place, (isovalue, key) in enumerate(zip(job.isovalues.tolist(), job.keys, strict=True)):
            row = by_key.get(key.encode())
            if isovalue in complete and (row is None or store.has(key)):  # what is not in the list is empty
                rows += [] if row is None else [row]
                continue
            mesh = store.get(key) if store.has(key) else None
            if mesh is None:
                lacking.append(place)
            else:
                rows.append(chunk_row(mesh, job.row, key))
        if not lacking:
            return rows, None
        return rows, Job(job.row, job.isovalues[lacking], tuple(job.keys[place] for place in lacking))

    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        looked = list(pool.map(look, jobs))
    return [row for rows, _ in looked for row in rows], [job for _, job in looked if job is not None]


def _extract(
    volume: Volume,
    bricks: Sequence[Brick],
    jobs: Sequence[Job],
    place: _Place,
    plan: MemoryPlan,
    progress: Callable[[int, int], None] | None,
) -> Iterator[Rows]:
    """Extract jobs into the store, window by window, and yield the rows of the pieces."""
    by_row = {job.row: job for job in jobs}
    rows = sorted(by_row)
    total, done = sum(len(job.keys) for job in jobs), 0
    gate = Gate(plan.mesh_bytes)
    pool = ThreadPoolExecutor(max_workers=os.cpu_count())
    try:
        for window in brick_windows(volume, [bricks[row] for row in rows], budget_bytes=plan.sample_bytes):
            running: list[tuple[int, Future[list[Rows]]]] = []
            for number in window.rows:
                brick = bricks[rows[number]]
                for part, cost in _parts(by_row[rows[number]], brick, place.settings, plan.mesh_bytes):
                    gate.enter(cost)
                    work = partial(_visit, window.volume, brick, part, place)
                    running.append((len(part.keys), pool.submit(_leaving, gate, cost, work)))
            for count, future in running:
                yield from future.result()
                done += count
                if progress is not None:
                    progress(done, total)
            del running, window
    finally:
        pool.shutdown(cancel_futures=True)


def _leaving(gate: Gate, cost: int, work: Callable[[], list[Rows]]) -> list[Rows]:
    with gate.leaving(cost):
        return work()


def _parts(job: Job, brick: Brick, settings: ExtractionSettings, budget: int) -> Iterator[tuple[Job, int]]:
    """Divide a job into groups of isovalues that the budget can hold, with the bytes of each."""
    cells = samples = 1
    for count in brick.size_xyz:
        cells *= count - 1
        samples *= count + 2 * HALO
    per_cell = MESH_BYTES_PER_CELL + (DETAIL_BYTES_PER_CELL if settings.detail else 0)
    per_level = cells * per_cell * settings.refine**2
    fixed = samples * SAMPLE_BYTES
    at_once = max(1, (budget - fixed) // per_level)
    for first in range(0, len(job.keys), at_once):
        group = slice(first, first + at_once)
        part = Job(job.row, job.isovalues[group], job.keys[group])
        yield part, fixed + len(part.keys) * per_level


def _visit(volume: Volume, brick: Brick, job: Job, place: _Place) -> list[Rows]:
    """Extract one brick, keep its pieces, and tell what they are."""
    pieces = Field(volume, place.settings).pieces(brick, job.isovalues)
    rows = []
    for key, mesh in zip(job.keys, pieces, strict=True):
        place.store.put(key, mesh)
        rows.append(chunk_row(mesh, job.row, key))
    return rows
