"""Samples that stay where they lie, in a file or a folder of chunks, and are read block by block."""

from __future__ import annotations

import abc
import contextlib
import hashlib
import mmap
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from isosample.volume.grid import SampleArray

READ_BYTES = 32 << 20  # read about so much of a file at once

Triple = tuple[int, int, int]
Block = tuple[slice, slice, slice]


class LazySamples(abc.ABC):
    """(Z, Y, X) samples of which only those that are asked for are in memory.

    Slices by integers and slices like a numpy array and gives numpy arrays; `numpy.asarray` reads everything.

    Parameters
    ----------
    shape : 3 ints
    dtype : numpy dtype
        Of what is read, in the machine's byte order.
    chunks : 3 ints, optional
        How many samples the file keeps together: reading fewer costs as much. None: single samples.
    identity : str, optional
        Changes when the file does; None where that cannot be told.
    """

    ndim = 3

    def __init__(
        self,
        shape: Triple,
        dtype: npt.DTypeLike,
        *,
        chunks: Triple | None = None,
        identity: str | None = None,
    ) -> None:
        self.shape = shape
        self.dtype: np.dtype[np.generic] = np.dtype(dtype)
        self.chunks = chunks or (1, 1, 1)
        self.identity = identity

    @abc.abstractmethod
    def read(self, block: Block) -> SampleArray:
        """Return the samples of a block, whose slices have a start, a stop and no step, as an array of its own.

        Several threads may read at once.
        """

    @property
    def size(self) -> int:
        """Number of samples."""
        z, y, x = self.shape
        return z * y * x

    @property
    def nbytes(self) -> int:
        """Bytes that all samples would take in memory."""
        return self.size * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> SampleArray:
        places = _full_key(key)
        spans = [_span(place, count) for place, count in zip(places, self.shape, strict=True)]
        z, y, x = (slice(low, high) for low, high, _ in spans)
        read = self.read((z, y, x))
        steps = tuple(0 if step is None else slice(None, None, step) for _, _, step in spans)
        return read[steps]

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        if copy is False:
            raise ValueError("samples that lie in a file cannot become an array without a copy")
        everything = self.read(cast("Block", tuple(slice(0, count) for count in self.shape)))
        return np.asarray(everything, dtype=dtype)


class MappedSamples(LazySamples):
    """A memory-mapped array whose pages are given back after every read, so that they do not add up.

    Parameters
    ----------
    mapped : (Z, Y, X) numpy.memmap
        Or a view of one; not copy-on-write (see `lazily`), as pages that were written to would be lost.
    """

    def __init__(self, mapped: np.memmap[Any, Any]) -> None:
        super().__init__(cast("Triple", mapped.shape), mapped.dtype, identity=_mapped_identity(mapped))
        self.mapped = mapped

    def read(self, block: Block) -> SampleArray:
        """Copy a block out of the mapped file."""
        z, y, x = block
        samples = np.empty([part.stop - part.start for part in block], dtype=self.dtype)
        step = max(
            1, READ_BYTES // max(1, abs(self.mapped.strides[0]))
        )  # a thin block touches every page it spans
        for low in range(z.start, z.stop, step):
            high = min(low + step, z.stop)
            samples[low - z.start : high - z.start] = self.mapped[low:high, y, x]
            self._give_back()
        return samples

    def _give_back(self) -> None:
        """Drop the pages of the file from this process; only a hint, without which they stay until memory is short."""
        pages = getattr(self.mapped, "_mmap", None)
        if isinstance(pages, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            with contextlib.suppress(OSError):
                pages.madvise(mmap.MADV_DONTNEED)


class Window(LazySamples):
    """A block of samples in memory that answers in the place which it has in the whole volume.

    Parameters
    ----------
    held : (z, y, x) array
    start : 3 ints
        Place [z, y, x] of its first sample.
    shape : 3 ints
        Of the whole volume.
    """

    def __init__(self, held: SampleArray, start: Triple, shape: Triple) -> None:
        super().__init__(shape, held.dtype)
        self.held = held
        self.start = start

    def read(self, block: Block) -> SampleArray:
        """Return a view of a block, which must lie inside the window."""
        shifted = []
        for part, first, count in zip(block, self.start, self.held.shape, strict=True):
            if part.start < first or part.stop > first + count:
                raise IndexError(
                    f"samples {block} are not in the window at {self.start} of {self.held.shape}"
                )
            shifted.append(slice(part.start - first, part.stop - first))
        return self.held[tuple(shifted)]


def lazily(samples: SampleArray | LazySamples) -> SampleArray | LazySamples:
    """Return samples as they are, but memory-mapped ones so that what is read does not stay in memory.

    Copy-on-write mappings are left alone: what was written to them is in their pages and nowhere else.
    """
    if isinstance(samples, np.memmap) and samples.mode != "c" and getattr(samples, "_mmap", None) is not None:
        return MappedSamples(samples)
    return samples


def blocks_of(samples: SampleArray | LazySamples, block_bytes: int) -> Iterator[SampleArray]:
    """Yield blocks of about `block_bytes` that hold every sample once, z before y.

    Samples in a file are read by whole rows of its chunks, and cut into blocks then.
    """
    source = lazily(samples)
    if not isinstance(source, LazySamples):
        yield from _slabs(source, block_bytes)
        return
    depth, height, _ = source.chunks
    z_count, y_count, x_count = source.shape
    row_bytes = x_count * source.dtype.itemsize
    height = min(y_count, max(1, max(block_bytes, READ_BYTES) // (depth * row_bytes * height)) * height)
    depth = min(z_count, max(1, max(block_bytes, READ_BYTES) // (depth * row_bytes * height)) * depth)
    for z in range(0, z_count, depth):
        for y in range(0, y_count, height):
            block = (
                slice(z, min(z + depth, z_count)),
                slice(y, min(y + height, y_count)),
                slice(0, x_count),
            )
            yield from _slabs(source.read(block), block_bytes)


def _slabs(samples: SampleArray, block_bytes: int) -> Iterator[SampleArray]:
    """Yield whole z slices of an array, together about `block_bytes`."""
    step = max(1, block_bytes // max(1, samples[0].nbytes))
    for z in range(0, len(samples), step):
        yield np.asarray(samples[z : z + step])


def chunks_of(samples: SampleArray | LazySamples) -> Triple:
    """Return how many samples along z, y, x are read at once at least."""
    return samples.chunks if isinstance(samples, LazySamples) else (1, 1, 1)


def identity_of(samples: SampleArray | LazySamples) -> str | None:
    """Return what tells whether the file behind samples is still the same, or None where nothing does."""
    found = lazily(samples)
    return found.identity if isinstance(found, LazySamples) else None


def files_identity(files: Iterable[Path], *more: object) -> str:
    """Return a digest of the names, sizes and times of change of files, and of whatever else is named."""
    digest = hashlib.sha256(repr(more).encode())
    for path in sorted(files):
        state = path.stat()
        digest.update(
            f"{path.absolute()} {state.st_size} {state.st_mtime_ns};".encode(errors="surrogateescape")
        )
    return digest.hexdigest()


def _mapped_identity(mapped: np.memmap[Any, Any]) -> str | None:
    """Identity of a mapped file and of the part of it that an array shows; None where it can be written to."""
    if mapped.mode != "r":
        return None  # the file's time of change says nothing of the second change to a page
    if not isinstance(mapped.filename, str | Path) or not Path(mapped.filename).is_file():
        return None
    pages = getattr(mapped, "_mmap", None)
    first = np.frombuffer(pages, dtype=np.uint8).ctypes.data if pages is not None else 0
    place = mapped.ctypes.data - first + mapped.offset
    return files_identity([Path(mapped.filename)], place, mapped.shape, mapped.strides, mapped.dtype.str)


def _full_key(key: Any) -> tuple[Any, Any, Any]:
    """Return an index with one entry per axis."""
    entries = key if isinstance(key, tuple) else (key,)
    if any(entry is Ellipsis for entry in entries):
        at = next(place for place, entry in enumerate(entries) if entry is Ellipsis)
        missing = [slice(None)] * (4 - len(entries))
        entries = (*entries[:at], *missing, *entries[at + 1 :])
    entries = (*entries, *[slice(None)] * (3 - len(entries)))
    if len(entries) != 3:
        raise IndexError(f"a volume has three axes, got the index {key!r}")
    return entries


def _span(place: Any, count: int) -> tuple[int, int, int | None]:
    """First sample, last + 1 and step of an entry of an index; step None for a single sample."""
    if isinstance(place, slice):
        start, stop, step = place.indices(count)
        if step < 1:
            raise IndexError(f"samples of a file are read forwards, got the slice {place}")
        return start, max(start, stop), step
    try:
        single = place.__index__()
    except (AttributeError, TypeError) as error:
        raise IndexError(
            f"samples of a file are chosen by whole numbers and slices, got {place!r}"
        ) from error
    if not -count <= single < count:
        raise IndexError(f"sample {single} does not exist; the axis has {count}")
    single %= count
    return single, single + 1, None
