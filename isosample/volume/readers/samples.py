"""What every reader needs: options, byte arithmetic, mapped and inflated samples, one channel of many."""

from __future__ import annotations

import contextlib
import gzip
import io
import math
import zlib
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, BinaryIO, cast

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError, IsosampleError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from isosample.volume.grid import F64, SampleArray

DEFLATE_RATIO = 1032  # the most that deflate can shrink: 258 bytes in 2 bits (zlib's technical notes)
INFLATE_BYTES = 1 << 20  # read this many bytes at a time from a compressed stream
LIBRARY_FAILURES = (  # what h5py, zarr and SimpleITK's text entries let through, found by damaging files
    ArithmeticError,
    AttributeError,
    LookupError,
    OSError,
    RuntimeError,
    SystemError,
    TypeError,
    ValueError,
)

Triple = tuple[int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """What the caller says about a file beyond its path.

    Attributes
    ----------
    shape : 3 ints or None
        Number of samples along x, y, z of a headerless file.
    dtype : numpy dtype or None
        Type of the samples in a headerless file.
    channel, time : int or None
        The component and the time step to read from a file that has several.
    dataset : str or None
        The array to read from a file or folder that has several.
    spacing : 3 floats or None
        Replaces what the file says (`open_volume` sees to it): a reader that cannot understand the file's need not.
    """

    shape: Triple | None = None
    dtype: np.dtype[np.generic] | None = None
    channel: int | None = None
    time: int | None = None
    dataset: str | None = None
    spacing: Sequence[float] | None = None


def parse_shape(shape: Sequence[int]) -> Triple:
    """Return three sample counts (x, y, z), or raise."""
    try:
        counts = tuple(int(n) for n in shape)
        whole = counts == tuple(shape)
    except (TypeError, ValueError, OverflowError):
        counts, whole = (), False
    if not whole or len(counts) != 3 or min(counts) < 1:
        raise InputError(f"shape {shape!r} must be three whole numbers >= 1 (x, y, z).")
    return (counts[0], counts[1], counts[2])


def parse_dtype(dtype: npt.DTypeLike) -> np.dtype[np.generic]:
    """Return a sample type, little-endian unless it says otherwise (``>u2``), or raise."""
    try:
        parsed: np.dtype[np.generic] = np.dtype(dtype)
    except TypeError as error:
        raise InputError(
            f"dtype {dtype!r} is unknown; name a numpy type such as uint8, int16, >u2, float32."
        ) from error
    if parsed.kind not in "iuf":
        raise InputError(f"dtype {dtype!r} is no integer or float; name one such as uint8, >u2, float32.")
    return parsed.newbyteorder("<") if parsed.byteorder == "=" else parsed


def choose(name: str, option: str, count: int, chosen: int | None) -> int:
    """Return which of `count` channels or time steps to read.

    Parameters
    ----------
    name : str
        The file, for messages.
    option : {'channel', 'time'}
    count : int
        How many the file has, >= 1.
    chosen : int or None
        The caller's choice; may be None where there is nothing to choose.

    Raises
    ------
    InputError
        If the choice is missing or out of range.
    """
    what = "channels" if option == "channel" else "time steps"
    if chosen is None:
        if count == 1:
            return 0
        raise InputError(
            f"{name} has {count} {what}; a volume has one. Choose with --{option} N (0 to {count - 1})."
        )
    if count == 1 and chosen != 0:
        raise InputError(f"{name} has one {what.removesuffix('s')}; leave out --{option} {chosen}.")
    if not 0 <= chosen < count:
        raise InputError(f"{name} has {count} {what}; --{option} {chosen} must be 0 to {count - 1}.")
    return chosen


def native(array: SampleArray) -> SampleArray:
    """Return the samples in the machine's byte order: the array itself, or a converted copy."""
    return array if array.dtype.isnative else np.asarray(array).astype(array.dtype.newbyteorder("="))


def number_type(dtype: np.dtype[np.generic]) -> np.dtype[np.generic]:
    """Return the type that samples of a file are read in: its own, in the machine's byte order; uint8 for bool."""
    return np.dtype(np.uint8) if dtype == np.bool_ else np.dtype(dtype).newbyteorder("=")


def positive_steps(spacing: F64, direction: F64) -> tuple[tuple[float, float, float], F64]:
    """Return the same placement with every spacing > 0: a negative step becomes a flipped direction."""
    flipped: F64 = direction * np.where(spacing < 0, -1.0, 1.0)
    x, y, z = np.abs(spacing).tolist()
    return (x, y, z), flipped


def map_samples(
    path: Path, dtype: np.dtype[np.generic], size_xyz: Triple, offset: int = 0, *, cure: str
) -> SampleArray:
    """Map the samples of an uncompressed file into memory, read-only.

    Parameters
    ----------
    path : Path
    dtype : numpy dtype
        With its byte order; samples in a foreign order are read and converted instead of mapped.
    size_xyz : 3 ints
    offset : int
        Bytes before the first sample; the file may be longer than needed only when this is not 0.
    cure : str
        What to do where the length does not fit; for messages.

    Returns
    -------
    samples : (Z, Y, X) of `dtype` in the machine's byte order

    Raises
    ------
    InputError
        If the file is too short, or longer than its shape says.
    """
    expected = offset + sample_bytes(dtype, size_xyz)
    actual = path.stat().st_size
    if actual < expected or (actual > expected and offset == 0):
        raise InputError(f"{path.name} has {actual} bytes; {_arithmetic(dtype, size_xyz, offset)}. {cure}")
    mapped = np.memmap(path, dtype=dtype, mode="r", offset=offset, shape=size_xyz[::-1])
    return native(mapped)


def inflate_samples(
    path: Path,
    dtype: np.dtype[np.generic],
    size_xyz: Triple,
    offset: int = 0,
    start: int = 0,
    *,
    cure: str,
) -> SampleArray:
    """Read samples from a gzip or zlib stream, to its end, so that its checksum is verified.

    Parameters and errors are those of `map_samples`, with `offset` counted in inflated bytes; the stream
    begins at byte `start` of the file. A damaged stream also raises.
    """
    needed = sample_bytes(dtype, size_xyz)
    most = path.stat().st_size * DEFLATE_RATIO
    if offset + needed > most:
        raise InputError(
            f"{path.name} can inflate to {most} bytes at most; {_arithmetic(dtype, size_xyz, offset)}. {cure}"
        )
    samples = np.empty(needed, dtype=np.uint8)
    actual = _inflate(path, offset, samples.data, start)
    if actual < offset + needed or (actual > offset + needed and offset == 0):
        raise InputError(
            f"{path.name} holds {actual} bytes when inflated; {_arithmetic(dtype, size_xyz, offset)}. {cure}"
        )
    return native(samples.view(dtype).reshape(size_xyz[::-1]))


def inflated_length(path: Path) -> int:
    """Bytes that a gzip file inflates to; its checksum is verified on the way."""
    return _inflate(path, 0, memoryview(bytearray()))


def sample_bytes(dtype: np.dtype[np.generic], size_xyz: Sequence[int]) -> int:
    """Bytes that the samples of a grid take."""
    return math.prod(size_xyz) * dtype.itemsize


@contextlib.contextmanager
def library_failures(claim: str) -> Iterator[None]:
    """Turn what a format's library lets through on damaged files into one line that begins with a claim."""
    try:
        yield
    except IsosampleError:
        raise
    except LIBRARY_FAILURES as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{claim} ({reason}). It may be damaged or incomplete; fetch it again.") from error


def _arithmetic(dtype: np.dtype[np.generic], size_xyz: Triple, offset: int) -> str:
    """Return how many bytes a grid needs, spelled out."""
    x, y, z = size_xyz
    header = f" after a header of {offset}" if offset else ""
    total = offset + sample_bytes(dtype, size_xyz)
    return f"{x} × {y} × {z} samples of {dtype.name} ({dtype.itemsize} bytes each){header} need {total}"


def _inflating(file: BinaryIO, start: int, most: int) -> IO[bytes]:
    """Open the gzip stream at byte `start`, or inflate at most `most` bytes of the zlib stream there."""
    file.seek(start)
    is_gzipped = file.read(2) == b"\x1f\x8b"
    file.seek(start)
    if is_gzipped:
        return cast("IO[bytes]", gzip.GzipFile(fileobj=file))
    inflater = zlib.decompressobj()
    content = inflater.decompress(file.read(), most)
    if not inflater.eof and len(content) < most:
        raise EOFError("the stream ends early")
    return io.BytesIO(content)


def _inflate(path: Path, offset: int, target: memoryview, start: int = 0) -> int:
    """Fill `target` with the inflated bytes from `offset` on; return how many the whole stream holds."""
    length = filled = 0
    try:
        with path.open("rb") as file, _inflating(file, start, offset + len(target) + 1) as stream:
            length = len(stream.read(offset))
            while filled < len(target) and (count := stream.readinto(target[filled:])):  # type: ignore[attr-defined]
                filled += count
            length += filled
            while rest := stream.read(INFLATE_BYTES):
                length += len(rest)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InputError(
            f"{path.name} holds a damaged or incomplete compressed stream ({error}). Fetch it again."
        ) from error
    return length
