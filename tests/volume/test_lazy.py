"""Samples in a file slice like an array, are read once, and are told apart from those of a changed file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.volume import cell_sample
from isosample.volume.bricks import brick_ranges, bricks_of
from isosample.volume.grid import Volume
from isosample.volume.lazy import LazySamples, MappedSamples, Window, identity_of, lazily
from isosample.volume.scan import scan_volume
from isosample.volume.statistics import gradient_at_values, histogram
from isosample.volume.windows import COPIES, brick_windows

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.volume.grid import SampleArray
    from isosample.volume.lazy import Block, Triple

SHAPE = (21, 18, 25)
SAMPLES = np.random.default_rng(7).integers(0, 200, SHAPE).astype(np.uint8)


class Counted(LazySamples):
    """Counts how often each sample is read."""

    def __init__(self, samples: SampleArray, chunks: Triple) -> None:
        super().__init__(cast("Triple", samples.shape), samples.dtype, chunks=chunks)
        self.samples = samples
        self.reads = np.zeros(samples.shape, dtype=np.int64)
        self.largest = 0

    def read(self, block: Block) -> SampleArray:
        self.reads[block] += 1
        found: SampleArray = self.samples[block].copy()
        self.largest = max(self.largest, found.nbytes)
        return found


def counted(chunks: Triple = (4, 4, 4), samples: SampleArray = SAMPLES) -> tuple[Counted, Volume]:
    """A lazily sliced volume and its samples."""
    lazy = Counted(samples, chunks)
    return lazy, Volume(cast("SampleArray", lazy))


entries = st.one_of(
    st.integers(-18, 17),
    st.builds(slice, st.integers(-20, 20), st.integers(-20, 20), st.integers(1, 5)),
    st.just(slice(None)),
)


@given(key=st.lists(entries, max_size=3).map(tuple), dots=st.booleans())
def test_lazy_samples_slice_like_an_array(key: tuple[Any, ...], dots: bool) -> None:
    lazy = counted()[0]
    chosen = (Ellipsis, *key) if dots else key
    np.testing.assert_array_equal(lazy[chosen], SAMPLES[chosen])


@pytest.mark.parametrize("key", [(0, 0, 0, 0), 21, -22, slice(None, None, -1), 1.5, "z", (None, 1)])
def test_what_cannot_be_read_is_an_index_error(key: Any) -> None:
    with pytest.raises(IndexError):
        counted()[0][key]


def test_the_whole_is_an_array_in_its_own_type() -> None:
    lazy, volume = counted()
    whole = np.asarray(lazy)
    assert whole.dtype == np.uint8
    np.testing.assert_array_equal(whole, SAMPLES)
    loaded = volume.in_memory()
    assert isinstance(loaded.array, np.ndarray)
    np.testing.assert_array_equal(loaded.array, SAMPLES)


@pytest.mark.parametrize("chunks", [(1, 1, 1), (4, 5, 6), (50, 50, 50)])
@pytest.mark.parametrize("block_bytes", [1, 700, 1 << 20])
def test_blocks_hold_every_sample_once(chunks: Triple, block_bytes: int) -> None:
    lazy, volume = counted(chunks)
    found = np.concatenate([block.ravel() for block in volume.blocks(block_bytes)])
    np.testing.assert_array_equal(np.sort(found), np.sort(SAMPLES.ravel()))
    assert (lazy.reads == 1).all()


@pytest.mark.parametrize("chunks", [(1, 1, 1), (4, 4, 4), (8, 16, 16), (5, 7, 30)])
def test_a_scan_reads_every_sample_once_and_finds_what_an_array_has(chunks: Triple) -> None:
    lazy, volume = counted(chunks)
    found, expected = scan_volume(volume, 4), scan_volume(Volume(SAMPLES), 4)
    assert (lazy.reads == 1).all()
    np.testing.assert_array_equal(found.digests, expected.digests)
    np.testing.assert_array_equal(found.ranges, brick_ranges(Volume(SAMPLES), bricks_of((25, 18, 21), 4)))
    assert found.content == expected.content
    assert found.value_range == (SAMPLES.min(), SAMPLES.max())


def test_a_small_budget_reads_columns_and_finds_the_same() -> None:
    lazy, volume = counted()
    budget = 3000
    found = scan_volume(volume, 4, budget_bytes=budget)
    np.testing.assert_array_equal(found.digests, scan_volume(Volume(SAMPLES), 4).digests)
    assert lazy.largest * COPIES <= budget


def test_a_budget_too_small_for_one_brick_is_refused_with_what_it_takes() -> None:
    # 4 cells, 1 shared sample and 1 on each side: 7, and up to 3 more for the chunks: 10 · 7 · 7 samples, 3 times
    with pytest.raises(InputError, match=r"100 bytes .* one brick .* takes 1470\. .*--memory"):
        scan_volume(counted()[1], 4, budget_bytes=100)


def test_only_what_some_bricks_need_is_read() -> None:
    lazy, volume = counted((1, 1, 1))
    bricks = [brick for brick in bricks_of((25, 18, 21), 4) if brick.index in ((0, 0, 0), (1, 0, 4))]
    for window in brick_windows(volume, bricks, budget_bytes=1 << 20):
        for row in window.rows:
            np.testing.assert_array_equal(
                window.volume.array[bricks[row].slices], SAMPLES[bricks[row].slices]
            )
    read = np.zeros(SHAPE, dtype=bool)
    read[0:6, 0:6, 0:10] = read[15:21, 0:6, 0:10] = True  # both columns at once: they are neighbours
    np.testing.assert_array_equal(lazy.reads, read)


def test_a_digest_tells_samples_their_type_and_their_place() -> None:
    changed = SAMPLES.copy()
    changed[8, 8, 8] += 1  # a corner of eight bricks, and next to no other
    differs = (scan_volume(Volume(changed), 4).digests != scan_volume(Volume(SAMPLES), 4).digests).any(axis=1)
    near = [
        all(first - 1 <= 8 <= last + 1 for first, last in zip(brick.start, brick.stop, strict=True))
        for brick in bricks_of((25, 18, 21), 4)
    ]
    np.testing.assert_array_equal(differs, near)
    flat = Volume(np.zeros(SHAPE, dtype=np.uint8))
    same = scan_volume(flat, 4).digests
    assert len(np.unique(same, axis=0)) == len(same)
    assert (scan_volume(Volume(np.zeros(SHAPE, dtype=np.int8)), 4).digests != same).any(axis=1).all()


@pytest.mark.parametrize("dtype", [">u2", "<u2", ">f4", ">i8"])
def test_a_digest_is_of_the_values_whatever_the_order_of_their_bytes(dtype: str) -> None:
    samples = SAMPLES.astype(dtype)
    expected = scan_volume(Volume(SAMPLES.astype(np.dtype(dtype).newbyteorder("="))), 4)
    found = scan_volume(Volume(samples), 4)
    np.testing.assert_array_equal(found.digests, expected.digests)
    np.testing.assert_array_equal(found.ranges, expected.ranges)
    other = samples.view(samples.dtype.newbyteorder())  # the same bytes
    swapped = scan_volume(Volume(other), 4).digests
    assert (swapped != expected.digests).any(axis=1).all()


def test_samples_that_are_not_finite_are_counted_once() -> None:
    samples = SAMPLES.astype(np.float32)
    samples[4, 4, 4] = samples[0, 0, 0] = samples[-1, -1, -1] = np.nan
    samples[8, 4, 20] = np.inf
    volume = Volume(samples)
    found = scan_volume(volume, 4)
    assert found.nonfinite_counts == volume.nonfinite_counts == (3, 1)
    fresh = Volume(samples)
    found.tell(fresh)
    assert vars(fresh)["nonfinite_counts"] == (3, 1)
    assert vars(fresh)["value_range"] == volume.value_range


def test_statistics_of_a_file_are_those_of_an_array() -> None:
    volume = counted((8, 8, 8))[1]
    expected = Volume(SAMPLES)
    np.testing.assert_array_equal(histogram(volume)[0], histogram(expected)[0])
    assert gradient_at_values(volume, [50.5, 120]) == gradient_at_values(expected, [50.5, 120])


@pytest.mark.parametrize("chunk", [1, 4, 8, 32])
def test_chunks_are_decoded_once_for_typical_gradients(monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    lazy, volume = counted((chunk,) * 3)
    gradient_at_values(volume, [50.5])
    # A pair of slices lies on both sides of every border of two layers of chunks: the lower one is read once more.
    borders = (SHAPE[0] - 1) // chunk
    assert lazy.reads.sum() == (SHAPE[0] + borders - (chunk == 1)) * SAMPLES[0].size
    monkeypatch.setattr(cell_sample, "SLAB_BYTES", 1)
    few, same = counted((chunk,) * 3)
    assert gradient_at_values(same, [50.5]) == gradient_at_values(volume, [50.5])
    assert few.largest <= 2 * SAMPLES[0].nbytes


def test_a_window_answers_in_the_place_it_has_in_the_volume() -> None:
    window = Window(SAMPLES[3:9, 2:7, 5:11], (3, 2, 5), SHAPE)
    np.testing.assert_array_equal(window[4:6, 2:4, 7], SAMPLES[4:6, 2:4, 7])
    with pytest.raises(IndexError, match="not in the window"):
        window[0]


def test_mapped_samples_are_those_of_the_file(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    mapped = np.load(tmp_path / "a.npy", mmap_mode="r")
    lazy = MappedSamples(mapped[2:, ::2])
    np.testing.assert_array_equal(np.asarray(lazy), SAMPLES[2:, ::2])
    np.testing.assert_array_equal(
        scan_volume(Volume(mapped), 4).digests, scan_volume(Volume(SAMPLES), 4).digests
    )


def test_a_file_keeps_its_identity_until_it_changes(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, SAMPLES)
    first = identity_of(np.load(path, mmap_mode="r"))
    assert first is not None
    assert identity_of(np.load(path, mmap_mode="r")) == first
    assert identity_of(np.load(path, mmap_mode="r")[1:]) != first
    assert identity_of(SAMPLES) is None
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))
    assert identity_of(np.load(path, mmap_mode="r")) != first


def test_what_was_written_to_a_copy_on_write_mapping_stays(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    mapped = np.load(tmp_path / "a.npy", mmap_mode="c")
    mapped[mapped < 100] = 100
    expected = np.maximum(SAMPLES, 100)
    volume = Volume(mapped)
    assert volume.value_range == (100, SAMPLES.max())
    np.testing.assert_array_equal(scan_volume(volume, 4).digests, scan_volume(Volume(expected), 4).digests)
    np.testing.assert_array_equal(volume.array, expected)
    assert not isinstance(lazily(mapped[2:]), LazySamples)


@pytest.mark.parametrize("mode", ["c", "r+"])
def test_a_mapping_that_can_be_written_to_has_no_identity(tmp_path: Path, mode: Literal["c", "r+"]) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    assert identity_of(np.load(tmp_path / "a.npy", mmap_mode=mode)) is None
