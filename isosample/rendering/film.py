"""Films: frames one after the other into an MP4, a GIF or numbered pictures, which appear whole or not at all."""

from __future__ import annotations

import importlib.util
import math
from contextlib import ExitStack, suppress
from fractions import Fraction
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from isosample.defaults import DEFAULT_FRAME_RATE, FILM_SUFFIXES, IMAGE_SUFFIXES, LARGEST_GIF_RATE
from isosample.errors import InputError
from isosample.files import failure_told, replacing
from isosample.rendering.image import Image, srgb_from_linear

if TYPE_CHECKING:
    from types import TracebackType

    import PIL.Image

LARGEST_FRAME_RATE = 1000.0
LARGEST_COUNT = 100_000
LEAST_DIGITS = 3
MP4_QUALITY = "16"  # x264's rate factor: what is lost is not seen; 0 loses nothing, 51 nearly all


class Film:
    """Frames on their way into files; a film that is not finished leaves no file.

    Parameters
    ----------
    path : str or Path
        ``.mp4`` (H.264) or ``.gif``: one file; ``.png`` or ``.npy``: files with the number of the frame before the
        suffix, such as ``head-000.png``.
    size : (width, height)
        Pixels.
    count : int
        Frames that will be added.
    frame_rate : float
        Frames per second of MP4 and GIF; a GIF has delays of whole hundredths of a second.

    Raises
    ------
    InputError
        If the suffix is another, `count` is below 1, the size or the frame rate is none that such a file can have, the
        file cannot be written, or ``.mp4`` is asked for without the library `av` (extra ``video``).

    Notes
    -----
    Use as a context manager: the files take their places where the block ends well and all frames are there. MP4 and
    GIF have no transparency: what is transparent lies on black.
    """

    def __init__(
        self, path: str | Path, size: tuple[int, int], count: int, *, frame_rate: float = DEFAULT_FRAME_RATE
    ) -> None:
        self._path, self._size, self._count = Path(path), size, count
        check_film(self._path, size, count, frame_rate)
        self._frame_rate = frame_rate
        self._files = ExitStack()
        self._writer: _Writer | None = None
        self._added = 0

    @property
    def paths(self) -> list[Path]:
        """The files that the film will be."""
        return film_paths(self._path, self._count)

    def __enter__(self) -> Self:
        suffix = self._path.suffix.lower()
        if suffix in IMAGE_SUFFIXES:
            self._writer = _Numbered(self.paths, self._files)
            return self
        with ExitStack() as opened:
            file = opened.enter_context(replacing(self._path))
            self._writer = (_Mp4 if suffix == ".mp4" else _Gif)(file, self._size, self._frame_rate)
            self._files = opened.pop_all()
        return self

    def add(self, image: Image) -> None:
        """Add the next frame.

        Raises
        ------
        InputError
            If it has another size than the film, the film has all its frames, or the file cannot be written.
        """
        assert self._writer is not None
        height, width = image.rgba.shape[:2]
        if (width, height) != tuple(self._size):
            raise InputError(f"a frame of {width} x {height} pixels does not fit a film of {self._size}.")
        if self._added == self._count:
            raise InputError(f"the film was to have {self._count} frames, and one more is added.")
        with failure_told(self._path):
            self._writer.add(image)
        self._added += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        assert self._writer is not None
        if error is None and self._added == self._count:
            with self._files:
                self._finish(self._writer)
            return
        self._writer.abandon()
        # InputError: a full disk fails once more where files are closed.
        with suppress(_AbandonedError, InputError), self._files:
            raise _AbandonedError
        if error is None:
            raise InputError(f"the film was to have {self._count} frames, and has {self._added}.")

    @staticmethod
    def _finish(writer: _Writer) -> None:
        """Complete the file, or let go of it."""
        try:
            writer.finish()
        except BaseException:
            writer.abandon()
            raise


class _AbandonedError(Exception):
    """Tells the files of a film that they are not to be."""


def film_paths(path: Path, count: int) -> list[Path]:
    """Files of a film of `count` frames: one, or one per frame."""
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        return [path]
    digits = max(LEAST_DIGITS, len(str(count - 1)))
    return [path.with_name(f"{path.stem}-{number:0{digits}}{path.suffix}") for number in range(count)]


def check_film(path: Path, size: tuple[int, int], count: object, frame_rate: float) -> None:
    """Raise `InputError` unless such a film can be made, so that long work does not end in that; see `Film`."""
    suffix = path.suffix.lower()
    if suffix not in FILM_SUFFIXES:
        raise InputError(
            f"cannot write {path}: unknown suffix {path.suffix!r}; a film ends in {', '.join(FILM_SUFFIXES)}."
        )
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= LARGEST_COUNT:
        raise InputError(f"a film of {count!r} frames is impossible; ask for 1 to {LARGEST_COUNT}.")
    largest = LARGEST_GIF_RATE if suffix == ".gif" else LARGEST_FRAME_RATE
    if not (math.isfinite(frame_rate) and 1.0 <= frame_rate <= largest):
        raise InputError(
            f"a frame rate of {frame_rate!r} must lie between 1 and {largest:g} for {suffix} files."
        )
    if suffix == ".mp4":
        _check_mp4(path, size)


def _check_mp4(path: Path, size: tuple[int, int]) -> None:
    even = tuple(length + length % 2 for length in size)
    if even != tuple(size):
        raise InputError(
            f"{path}: a picture of {size[0]}x{size[1]} has an odd edge, and H.264 stores colours for pairs of pixels; "
            f"ask for {even[0]}x{even[1]}, or for a .gif."
        )
    if importlib.util.find_spec("av") is None:
        raise InputError(
            f"{path}: MP4 films need the library av. Install it: pip install 'isosample[video]', or ask for a .gif."
        )


class _Writer(Protocol):
    """What takes the frames of one kind of film."""

    def add(self, image: Image) -> None: ...

    def finish(self) -> None:
        """Complete the file."""
        ...

    def abandon(self) -> None:
        """Free what the file is not needed for any more; raises nothing."""
        ...


class _Numbered:
    """One file per frame; all of them get their names when the film is finished."""

    def __init__(self, paths: list[Path], files: ExitStack) -> None:
        self._paths = iter(paths)
        self._files = files

    def add(self, image: Image) -> None:
        path = next(self._paths)
        file = self._files.enter_context(replacing(path))
        with failure_told(path):
            image.write(file, path.suffix)
            file.close()  # a long film has more frames than a process may have open files

    def finish(self) -> None: ...

    def abandon(self) -> None: ...


class _Gif:
    """A palette of 256 colours per frame, dithered."""

    def __init__(self, file: IO[bytes], size: tuple[int, int], frame_rate: float) -> None:
        del size
        self._file = file
        self._milliseconds = 10 * round(100.0 / frame_rate)
        self._frames: list[PIL.Image.Image] = []

    def add(self, image: Image) -> None:
        import PIL.Image

        picture = PIL.Image.fromarray(on_black(image))
        self._frames.append(picture.quantize(256, method=PIL.Image.Quantize.MEDIANCUT))

    def finish(self) -> None:
        first, *others = self._frames
        # Pillow joins equal neighbours into one frame that stays longer: the film shows the same.
        first.save(
            self._file,
            format="GIF",
            save_all=True,
            append_images=others,
            duration=self._milliseconds,
            loop=0,
            disposal=1,
        )

    def abandon(self) -> None:
        self._frames = []


class _Mp4:
    """H.264 by the library `av`, with the colours of ITU-R BT.709."""

    def __init__(self, file: IO[bytes], size: tuple[int, int], frame_rate: float) -> None:
        import av
        from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

        self._frame_of, self._error = av.VideoFrame.from_ndarray, av.FFmpegError
        self._colors: dict[str, Any] = {"format": "yuv420p", "dst_colorspace": Colorspace.ITU709}
        self._container = av.open(file, "w", format="mp4")
        rate = Fraction(frame_rate).limit_denominator(1000)
        self._stream = self._container.add_stream("libx264", rate=rate, options={"crf": MP4_QUALITY})
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        codec = self._stream.codec_context
        codec.colorspace, codec.color_range = Colorspace.ITU709, ColorRange.MPEG
        codec.color_primaries, codec.color_trc = ColorPrimaries.BT709, ColorTrc.IEC61966_2_1

    def add(self, image: Image) -> None:
        frame = self._frame_of(on_black(image), format="rgb24").reformat(**self._colors)
        self._container.mux(self._stream.encode(frame))

    def finish(self) -> None:
        self._container.mux(self._stream.encode(None))
        self._container.close()

    def abandon(self) -> None:
        # Closing writes, perhaps onto the full disk for whose sake the film is given up.
        with suppress(OSError, self._error):
            self._container.close()


def on_black(image: Image) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8, sRGB of a picture in front of black; colours above 1 saturate."""
    encoded = srgb_from_linear(np.clip(image.rgba[..., :3], 0.0, 1.0))
    return np.ascontiguousarray(np.rint(255.0 * encoded).astype(np.uint8))
