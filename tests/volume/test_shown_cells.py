"""The box around the cells in which a field has some values is the smallest one, whatever it takes to find it."""

from __future__ import annotations

import math
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.volume import shown_cells
from isosample.volume.bricks import BRICK_CELLS, bricks_of
from isosample.volume.geometry import GridGeometry
from isosample.volume.grid import Volume
from isosample.volume.lazy import LazySamples
from isosample.volume.scan import scan_volume
from isosample.volume.shown_cells import shown_span
from isosample.volume.windows import brick_windows, samples_read

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, SampleArray
    from isosample.volume.lazy import Block
    from isosample.volume.shown_cells import Span

INTERVALS = np.array([[0.5, 0.6], [0.55, 0.8], [2.0, 3.0]])


class InFile(LazySamples):
    """Samples as if they stayed in a file, in chunks."""

    def __init__(self, samples: SampleArray, chunks: tuple[int, int, int] = (5, 7, 9)) -> None:
        super().__init__((samples.shape[0], samples.shape[1], samples.shape[2]), samples.dtype, chunks=chunks)
        self.samples = samples
        self.decoded = 0  # samples of all chunks that were touched, at every read

    def read(self, block: Block) -> SampleArray:
        counts = [
            size * (-(-part.stop // size) - part.start // size)
            for part, size in zip(block, self.chunks, strict=True)
        ]
        self.decoded += math.prod(counts)
        found: SampleArray = self.samples[block].copy()
        return found


def span_by_every_cell(samples: F64, intervals: F64, levels: Sequence[float] = ()) -> Span | None:
    """The same, cell by cell and interval by interval."""
    corners = np.stack(
        [
            samples[z : z - 1 or None, y : y - 1 or None, x : x - 1 or None]
            for z, y, x in product((0, 1), repeat=3)
        ]
    )
    whole = np.isfinite(corners).all(axis=0)
    low, high = corners.min(axis=0), corners.max(axis=0)
    shown = np.zeros(whole.shape, dtype=np.bool_)
    for first, last in intervals.tolist():
        shown |= whole & (low <= last) & (high >= first)
    for level in levels:
        shown |= whole & (low < level) & (high >= level)
    if not shown.any():
        return None
    cells = np.argwhere(shown)[:, ::-1]
    (x, y, z), (u, v, w) = cells.min(axis=0).tolist(), (cells.max(axis=0) + 1).tolist()
    return (x, y, z), (u, v, w)


def bumps(shape: tuple[int, int, int], seed: int) -> F64:
    """Nothing but a few boxes of values from 0 to 1, near each other, which may touch a face of the grid."""
    random = np.random.default_rng(seed)
    samples = np.zeros(shape)
    for _ in range(3):
        first = [int(random.integers(0, count)) for count in shape]
        part = tuple(slice(start, start + int(random.integers(1, 9))) for start in first)
        samples[part] = random.random(samples[part].shape)
    return samples


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("masked", [False, True])
def test_the_span_is_that_of_all_cells(seed: int, masked: bool) -> None:
    """In memory, with what a scan knows, and from a file; over several bricks, with samples that are not finite."""
    samples = bumps((36, 70, 101), seed)
    if masked:
        spoilt = np.random.default_rng(seed).random(samples.shape) < 0.05
        samples[spoilt] = np.where(np.arange(samples[spoilt].size) % 3, np.nan, np.inf)
    volume = Volume(samples)
    expected = span_by_every_cell(samples, INTERVALS)
    assert shown_span(volume, INTERVALS) == expected
    assert shown_span(volume, INTERVALS, scan=scan_volume(volume)) == expected
    assert (
        shown_span(volume, INTERVALS, scan=scan_volume(volume, 7)) == expected
    )  # of other bricks: of no use
    in_file = Volume(cast("SampleArray", InFile(samples)))
    assert in_file.stays_in_file
    assert shown_span(in_file, INTERVALS, budget_bytes=4 << 20) == expected


def test_several_seeds_show_something_and_in_several_bricks() -> None:
    found = [span_by_every_cell(bumps((36, 70, 101), seed), INTERVALS) for seed in range(12)]
    spans = [span for span in found if span is not None]
    assert len(spans) > 8
    assert sum(max(np.subtract(last, first)) > BRICK_CELLS for first, last in spans) > 4


def test_where_no_cell_has_such_a_value_there_is_no_span() -> None:
    volume = Volume(bumps((9, 9, 9), 1))
    assert shown_span(volume, [[7.0, 8.0]]) is None
    assert shown_span(volume, np.empty((0, 2))) is None
    assert shown_span(volume, [[-1.0, 8.0]]) == ((0, 0, 0), (8, 8, 8))
    with pytest.raises(InputError, match="first <= last"):
        shown_span(volume, [[2.0, 1.0]])


def test_values_between_samples_count_and_those_beside_do_not() -> None:
    samples = np.zeros((5, 6, 7))
    samples[2, 3, 4] = 1.0
    assert shown_span(Volume(samples), [[0.4, 0.5]]) == ((3, 2, 1), (5, 4, 3))
    assert shown_span(Volume(samples), [[1.0, 1.0]]) == ((3, 2, 1), (5, 4, 3))
    assert shown_span(Volume(samples), [[np.nextafter(1.0, 2.0), 2.0]]) is None


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("levels", [[0.0], [1.0], [0.0, 2.0, -1.0], [0.5, 0.0], []])
def test_a_level_is_seen_where_the_field_crosses_it(seed: int, levels: list[float]) -> None:
    """And not where it is just that everywhere, as these bumps are 0 outside and, rounded, 1 in places."""
    samples = np.rint(3.0 * bumps((36, 70, 101), seed)) / 2.0 - 0.5 * bumps((36, 70, 101), seed + 1)
    intervals = np.array([[1.4, 1.4]])
    expected = span_by_every_cell(samples, intervals, levels)
    volume = Volume(samples)
    assert shown_span(volume, intervals, levels=levels) == expected
    assert shown_span(volume, intervals, levels=levels, scan=scan_volume(volume)) == expected


def test_a_background_at_a_level_is_no_surface_and_its_border_is_one_from_below() -> None:
    samples = np.zeros((5, 6, 7))
    assert shown_span(Volume(samples), [], levels=[0.0]) is None
    samples[2, 3, 4] = 1.0
    assert shown_span(Volume(samples), [], levels=[0.0]) is None  # nothing is below
    assert shown_span(Volume(samples), [], levels=[1.0]) == ((3, 2, 1), (5, 4, 3))
    assert shown_span(Volume(-samples), [], levels=[0.0]) == ((3, 2, 1), (5, 4, 3))
    assert shown_span(Volume(-samples), [], levels=[-1.0]) is None


def test_a_brick_whose_range_alone_has_such_a_value_does_not_end_the_search() -> None:
    """The outermost bricks have samples on both sides of it, with masked ones between; a cell has it in the middle."""
    samples = np.zeros((5 * BRICK_CELLS,) * 3, dtype=np.float32)
    samples[80, 80, 80] = 1.0
    for axis, place in product(range(3), (10, 150)):
        around: list[slice | int] = [slice(79, 82)] * 3
        around[axis] = slice(place - 1, place + 2)
        samples[tuple(around)] = np.nan
        middle: list[slice | int] = [80] * 3
        middle[axis] = place
        samples[tuple(middle)] = 1.0
    assert shown_span(Volume(samples), [[0.4, 0.5]]) == ((79, 79, 79), (81, 81, 81))


def test_only_bricks_at_the_border_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = (
        np.random.default_rng(1)
        .random((5 * BRICK_CELLS, 4 * BRICK_CELLS, 3 * BRICK_CELLS))
        .astype(np.float32)
    )
    looked_at: list[tuple[int, int, int]] = []
    look = shown_cells._shown_in

    def noted(volume: Volume, brick: Brick, intervals: F64, levels: F64) -> Span | None:
        looked_at.append(brick.index)
        return look(volume, brick, intervals, levels)

    monkeypatch.setattr(shown_cells, "_shown_in", noted)
    assert shown_span(Volume(samples), INTERVALS) == (
        (0, 0, 0),
        tuple(count - 1 for count in samples.shape[::-1]),
    )
    assert len(looked_at) == len(set(looked_at)) == 5 * 4 * 3 - 3 * 2 * 1


@pytest.mark.parametrize("chunks", [(1, 1, 1), (4, 4, 4), (1, 96, 96), (96, 96, 1)])
def test_of_a_file_the_faces_are_read_and_not_what_is_between(
    monkeypatch: pytest.MonkeyPatch, chunks: tuple[int, int, int]
) -> None:
    """Or every chunk once, where chunks reach from face to face."""
    count, cells = 96, 8
    monkeypatch.setattr(shown_cells, "BRICK_CELLS", cells)
    monkeypatch.setattr(shown_cells, "bricks_of", partial(bricks_of, cells=cells))
    samples = np.random.default_rng(1).random((count,) * 3).astype(np.float32)
    # A face of bricks is 9 samples deep, with one more behind; all chunks are whole.
    face = -(-(cells + 2) // chunks[0]) * chunks[0] * count**2
    most = 6 * face if max(chunks) < count else count**3
    scan = scan_volume(Volume(samples), cells)
    in_file = InFile(samples, chunks)
    told: list[tuple[int, int]] = []
    span = shown_span(
        Volume(cast("SampleArray", in_file)), INTERVALS, scan=scan, progress=lambda *now: told.append(now)
    )
    assert span == ((0, 0, 0), (count - 1,) * 3)
    assert in_file.decoded <= most
    bricks = (count // cells) ** 3
    assert [total for _, total in told] == [bricks] * len(told)
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1] == (bricks, bricks)


@pytest.mark.parametrize("chunks", [(1, 1, 1), (5, 7, 9), (3, 70, 101), (36, 70, 101)])
@pytest.mark.parametrize("budget_bytes", [4 << 20, 512 << 20])
def test_what_will_be_read_is_foretold(chunks: tuple[int, int, int], budget_bytes: int) -> None:
    in_file = InFile(bumps((36, 70, 101), 1), chunks)
    volume = Volume(cast("SampleArray", in_file))
    bricks = bricks_of(volume.size_xyz)
    told = samples_read(volume, bricks, budget_bytes=budget_bytes)
    for _ in brick_windows(volume, bricks, budget_bytes=budget_bytes):
        pass
    assert in_file.decoded == told
    assert samples_read(Volume(in_file.samples), bricks, budget_bytes=budget_bytes) == 0


def test_the_box_of_a_span_is_where_its_samples_are() -> None:
    turned = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, -1.0]])
    geometry = GridGeometry(
        size_xyz=(9, 8, 7),
        spacing=(0.5, 1.5, 2.0),
        origin=(10.0, -3.0, 4.0),
        direction=turned,
        patient_axes=True,
    )
    box = geometry.box_of((1, 2, 3), (5, 4, 6))
    assert box.patient_axes
    for bits, corner in zip(product((0, 1), repeat=3), box.corners()[[0, 4, 2, 6, 1, 5, 3, 7]], strict=True):
        index = np.where(bits, (5, 4, 6), (1, 2, 3))
        # Sums of four numbers below 20: 2^-53 of 20 each.
        np.testing.assert_allclose(
            corner, (geometry.world_from_index @ [*index, 1.0])[:3], atol=80 * 2.0**-53
        )
    whole, same = geometry.box, geometry.box_of((0, 0, 0), (8, 7, 6))
    assert np.array_equal(whole.corner, same.corner)
    assert np.array_equal(whole.edges, same.edges)
