"""A film appears whole or not at all, and shows the frames that were added."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import PIL.Image
import pytest

from isosample.errors import InputError
from isosample.rendering.film import Film, film_paths, on_black
from isosample.rendering.image import Image

if TYPE_CHECKING:
    from collections.abc import Iterator

SIZE = (32, 24)
COUNT = 5


def frames(count: int = COUNT) -> list[Image]:
    """Pictures that differ: a disc of another colour wanders over a half transparent ground."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    found = []
    for number in range(count):
        rgba = np.full((SIZE[1], SIZE[0], 4), (0.1, 0.05, 0.0, 0.5), dtype=np.float32)
        rgba[np.hypot(x - 6 - 4 * number, y - 12) < 6] = (number / count, 0.5, 1.0 - number / count, 1.0)
        found.append(Image(rgba))
    return found


def write(path: Path) -> list[Path]:
    with Film(path, SIZE, COUNT) as film:
        for image in frames():
            film.add(image)
    return film.paths


def test_an_mp4_has_every_frame_in_its_place(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="extra video")
    write(tmp_path / "film.mp4")
    with av.open(str(tmp_path / "film.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate) == (*SIZE, 20)
        shown = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(video=0)]
    assert len(shown) == COUNT
    for number, image in enumerate(frames()):
        # The coding loses most at the disc's edge, where colours are stored for pairs of pixels; other frames differ
        # by all of the disc.
        errors = [np.abs(found - on_black(image)).mean() for found in shown]
        assert min(errors[:number] + errors[number + 1 :]) > 2.0 * errors[number]


def test_an_mp4_keeps_the_colours(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="extra video")
    quarters = np.ones((48, 64, 4), dtype=np.float32)
    colors = ((0.8, 0.1, 0.1), (0.1, 0.1, 0.9), (0.1, 0.7, 0.2), (0.5, 0.5, 0.5))
    for number, color in enumerate(colors):
        quarters[24 * (number // 2) :, 32 * (number % 2) :, :3] = color
    with Film(tmp_path / "film.mp4", (64, 48), 1) as film:
        film.add(Image(quarters))
    with av.open(str(tmp_path / "film.mp4")) as container:
        (shown,) = (frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(video=0))
    expected = on_black(Image(quarters))
    # Steps of luma and chroma are 255/219 and 255/224, a blue takes 1.86 of the latter: half of each, there and back.
    # The matrix of BT.601 in place of BT.709 errs by 13 in the red quarter.
    for y, x in ((12, 16), (12, 48), (36, 16), (36, 48)):
        assert np.abs(shown[y, x] - expected[y, x]).max() <= 3


def test_a_gif_has_every_frame_and_its_pace(tmp_path: Path) -> None:
    write(tmp_path / "film.gif")
    with PIL.Image.open(tmp_path / "film.gif") as film:
        assert (film.size, film.n_frames) == (SIZE, COUNT)  # type: ignore[attr-defined]
        for number, image in enumerate(frames()):
            film.seek(number)
            assert film.info["duration"] == 50
            found = np.asarray(film.convert("RGB")).astype(int)
            np.testing.assert_array_equal(found, on_black(image))  # five colours fit a palette


def test_numbered_files_are_the_pictures_themselves(tmp_path: Path) -> None:
    paths = write(tmp_path / "film.npy")
    assert [path.name for path in paths] == [f"film-{number:03}.npy" for number in range(COUNT)]
    for path, image in zip(paths, frames(), strict=True):
        np.testing.assert_array_equal(np.load(path), image.rgba)
    for path, image in zip(write(tmp_path / "film.PNG"), frames(), strict=True):
        with PIL.Image.open(path) as shown:
            np.testing.assert_array_equal(np.asarray(shown), image.srgb8())


def test_numbers_have_as_many_digits_as_the_last_one_needs() -> None:
    assert [path.name for path in film_paths(Path("a.b.png"), 1000)][::999] == ["a.b-000.png", "a.b-999.png"]
    assert film_paths(Path("a.png"), 1001)[0].name == "a-0000.png"
    assert film_paths(Path("a.gif"), 1001) == [Path("a.gif")]


@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".png", ".npy"])
@pytest.mark.parametrize("fault", ["interrupted", "short", "wrong size", "disk"])
def test_a_film_that_is_not_finished_leaves_what_was_there(tmp_path: Path, suffix: str, fault: str) -> None:
    if suffix == ".mp4":
        pytest.importorskip("av", reason="extra video")
    path = tmp_path / f"film{suffix}"
    old = film_paths(path, COUNT)[0]
    old.write_bytes(b"old")
    raised = {"interrupted": KeyboardInterrupt, "disk": OSError}.get(fault, InputError)

    def make() -> None:
        with Film(path, SIZE, COUNT) as film:
            for image in frames(3):
                film.add(image)
            if fault == "wrong size":
                film.add(Image(np.zeros((8, 8, 4), np.float32)))
            if fault != "short":
                raise raised

    with pytest.raises(raised):
        make()
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [(old.name, b"old")]


@pytest.mark.parametrize("limit", [40, 1_500, 9_000])
@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".png", ".npy"])
def test_a_film_that_does_not_fit_is_told_with_the_reason_and_vanishes(
    tmp_path: Path, suffix: str, limit: int
) -> None:
    """The system's limit for the size of a file stands for a full disk; frames of noise take more than any of these."""
    if suffix == ".mp4":
        pytest.importorskip("av", reason="extra video")
    count = 80 if suffix == ".mp4" else COUNT  # the encoder looks about 40 frames ahead before it writes
    noise = np.random.default_rng(4).random((count, 64, 64, 4), dtype=np.float32)
    path = tmp_path / f"film{suffix}"

    def make() -> None:
        with Film(path, (64, 64), count) as film:
            for rgba in noise:
                film.add(Image(rgba))

    with limited_files(limit), pytest.raises(InputError) as told:
        make()
    failed = film_paths(path, count)[0]
    assert str(told.value) == f"{failed} cannot be written: File too large. Choose another path."
    assert not list(tmp_path.iterdir())


@contextmanager
def limited_files(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond `size` bytes."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_more_frames_than_announced_are_refused(tmp_path: Path) -> None:
    film = Film(tmp_path / "film.gif", SIZE, 1)
    first, second = frames(2)

    def make() -> None:
        with film:
            film.add(first)
            film.add(second)

    with pytest.raises(InputError, match="1 frames, and one more"):
        make()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "size", "count", "rate", "told"),
    [
        ("film.avi", SIZE, 2, 20.0, r"\.avi.*\.mp4"),
        ("film.mp4", (33, 24), 2, 20.0, "33x24 .* 34x24"),
        ("film.gif", SIZE, 2, 60.0, "60.0 .* 1 and 50"),
        ("film.gif", SIZE, 2, float("nan"), "nan"),
        ("film.mp4", SIZE, 2, 1e4, "10000.0 .* 1000"),
        ("film.gif", SIZE, 0, 20.0, "0 frames"),
        ("none/film.gif", SIZE, 2, 20.0, "cannot be written"),
    ],
)
def test_a_film_that_cannot_be_is_refused(
    tmp_path: Path, name: str, size: tuple[int, int], count: int, rate: float, told: str
) -> None:
    with pytest.raises(InputError, match=told), Film(tmp_path / name, size, count, frame_rate=rate):
        pass
    assert not list(tmp_path.iterdir())


def test_an_mp4_without_its_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(InputError, match=r"isosample\[video\]"):
        Film(tmp_path / "film.mp4", SIZE, 2)
