"""Values of options: from the text of an argument to numbers, or an error that names the text."""

from __future__ import annotations

import argparse
import math
import re
from typing import TYPE_CHECKING, Literal, TypeVar

from isosample.defaults import SMALLEST_ERROR

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Value = TypeVar("Value")
SIZE = re.compile(r"(\d+)[xX×](\d+)", re.ASCII)
BYTES = re.compile(r"(\d{1,15}(?:\.\d{1,15})?) ?([KMGT]i?B)", re.ASCII | re.IGNORECASE)
UNITS = {
    f"{letter}{middle}b": base ** (1 + place)
    for place, letter in enumerate("kmgt")
    for middle, base in (("", 1000), ("i", 1024))
}
LARGEST_MEMORY = 1 << 60
LARGEST_EDGE = 1 << 20
LARGEST_ZOOM = 1e6  # the GPU places vertices in float32: beyond it one pixel shows less than a rounding step
SMALLEST_NORMAL, LARGEST_NORMAL = 1e-100, 1e100  # squares of these stay inside float64


def picture_size(text: str) -> tuple[int, int]:
    """(width, height) in pixels from ``800x600``."""
    found = SIZE.fullmatch(text)
    edges = [int(edge) for edge in found.groups()] if found and len(text) < 40 else []
    if not edges or not all(1 <= edge <= LARGEST_EDGE for edge in edges):
        raise argparse.ArgumentTypeError(f"{text!r} is no picture size; give pixels as WxH, such as 800x600")
    return edges[0], edges[1]


def finite(text: str) -> float:
    """Return a finite number."""
    return _numbers(text, "a finite number", (1,))[0]


def positive(text: str) -> float:
    """Return a finite number above 0."""
    number = finite(text)
    if number <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be above 0")
    return number


def tolerance(text: str) -> float:
    """Return an error up to 1, as a number or a fraction such as 1/255."""
    number = _fraction(text)
    if not SMALLEST_ERROR <= number <= 1.0:
        raise argparse.ArgumentTypeError(
            f"{text!r} must be an error from {SMALLEST_ERROR:g} to 1, such as 1/255 or 0.004"
        )
    return number


def step(text: str) -> float:
    """Return a number above 0, or a fraction such as 1/64."""
    number = _fraction(text)
    if number <= 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number above 0, such as 0.5 or 1/4")
    return number


def refine(text: str) -> int | Literal["auto"]:
    """Return 1, 2, 4 or 8, or ``auto`` as it is."""
    if text == "auto":
        return "auto"
    if text not in ("1", "2", "4", "8"):
        raise argparse.ArgumentTypeError(f"{text!r} must be 1, 2, 4, 8 or auto")
    return int(text)


def details(text: str) -> int:
    """Return how many coarser details, 1 to 5."""
    if text not in ("1", "2", "3", "4", "5"):
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number from 1 to 5")
    return int(text)


def screen_error(text: str) -> float:
    """Return a number of pixels >= 0, or a fraction such as 1/4."""
    top, slash, bottom = text.partition("/")
    try:
        number = finite(top) / (positive(bottom) if slash else 1.0)
    except argparse.ArgumentTypeError:
        number = math.nan
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number of pixels >= 0, such as 0.25 or 1/4")
    return number + 0.0  # never -0


def zoom(text: str) -> float:
    """Return a magnification that float32 can show."""
    factor = positive(text)
    if not 1 / LARGEST_ZOOM <= factor <= LARGEST_ZOOM:
        raise argparse.ArgumentTypeError(
            f"{text!r} must lie between {1 / LARGEST_ZOOM:g} and {LARGEST_ZOOM:g}"
        )
    return factor


def count(text: str) -> int:
    """Return a whole number >= 0."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number >= 0")
    return number


def positive_count(text: str) -> int:
    """Return a whole number >= 1."""
    number = count(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number >= 1")
    return number


def list_of(value: Callable[[str], Value]) -> Callable[[str], tuple[Value, ...]]:
    """Return a reader of different values with commas between."""

    def read(text: str) -> tuple[Value, ...]:
        found = tuple(value(word.strip()) for word in text.split(","))
        if len(set(found)) < len(found):
            raise argparse.ArgumentTypeError(f"{text!r} names a value twice")
        return found

    return read


def words(known: Sequence[str]) -> Callable[[str], tuple[str, ...]]:
    """Return a reader of different words with commas between, each one of `known`."""

    def one(word: str) -> str:
        if word not in known:
            raise argparse.ArgumentTypeError(f"{word!r} must be one of {', '.join(known)}")
        return word

    return list_of(one)


def byte_count(text: str) -> int:
    """Return a number of bytes from ``2GiB``, ``1.5GB`` or ``800MiB``."""
    found = BYTES.fullmatch(text.strip())
    number = float(found[1]) * UNITS[found[2].lower()] if found else math.inf
    if not 1 <= number <= LARGEST_MEMORY:
        raise argparse.ArgumentTypeError(f"{text!r} is no size of memory; give one such as 2GiB or 800MiB")
    return int(number)


def shape(text: str) -> tuple[int, int, int]:
    """Three whole numbers above 0, ``X,Y,Z``."""
    numbers = _numbers(text, "three whole numbers above 0 as X,Y,Z, such as 256,256,128", (3,))
    if not all(number >= 1 and number == int(number) for number in numbers):
        raise argparse.ArgumentTypeError(
            f"{text!r} must be three whole numbers above 0 as X,Y,Z, such as 256,256,128"
        )
    return int(numbers[0]), int(numbers[1]), int(numbers[2])


def spacing(text: str) -> tuple[float, float, float]:
    """Three numbers above 0, ``X,Y,Z``."""
    numbers = _numbers(text, "three numbers above 0 as X,Y,Z, such as 0.5,0.5,2", (3,))
    if min(numbers) <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be three numbers above 0 as X,Y,Z")
    return numbers[0], numbers[1], numbers[2]


def clip_plane(text: str) -> tuple[float, float, float, float]:
    """Four finite numbers ``NX,NY,NZ,D``, the first three not all 0."""
    nx, ny, nz, d = _numbers(text, "four finite numbers as NX,NY,NZ,D, such as 1,0,0,-20", (4,))
    if not (nx or ny or nz):
        raise argparse.ArgumentTypeError(f"{text!r} has a normal of length 0; NX,NY,NZ must not all be 0")
    if not SMALLEST_NORMAL <= math.hypot(nx, ny, nz) <= LARGEST_NORMAL:
        raise argparse.ArgumentTypeError(
            f"{text!r} has a normal that is shorter than {SMALLEST_NORMAL:g} or longer than {LARGEST_NORMAL:g}; "
            "scale the four numbers"
        )
    return nx, ny, nz, d


def background(text: str) -> tuple[float, float, float, float]:
    """Straight linear RGBA in [0, 1] from ``R,G,B`` (alpha 1) or ``R,G,B,A``."""
    expected = "R,G,B or R,G,B,A, each between 0 and 1, such as 1,1,1"
    numbers = _numbers(text, expected, (3, 4))
    if not all(0 <= part <= 1 for part in numbers):
        raise argparse.ArgumentTypeError(f"{text!r} must be {expected}")
    red, green, blue, alpha = (*numbers, 1.0)[:4]
    return red, green, blue, alpha


def _fraction(text: str) -> float:
    """Return a number above 0 that is written as it is or as a fraction; 0 for anything else."""
    top, slash, bottom = text.partition("/")
    try:
        return positive(top) / positive(bottom) if slash else positive(top)
    except argparse.ArgumentTypeError:
        return 0.0


def _numbers(text: str, expected: str, counts: tuple[int, ...]) -> list[float]:
    """Return finite numbers separated by commas, or raise."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(math.isfinite(number) for number in numbers):
        raise argparse.ArgumentTypeError(f"{text!r} must be {expected}")
    return numbers
