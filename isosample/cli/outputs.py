"""Files that a command writes: checked before the long work, written whole or not at all."""

from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING, Any

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


def check_suffix(path: Path, suffixes: Sequence[str], what: str) -> None:
    """Raise `InputError` unless a path ends in one of `suffixes`."""
    if path.suffix.lower() not in suffixes:
        found = f"ends in {path.suffix}" if path.suffix else "has no suffix"
        raise InputError(f"{path} {found}; {what} ends in {' or '.join(suffixes)}.")


def check_writable(outputs: Mapping[str, Path | None], inputs: Sequence[Path] = ()) -> None:
    """Raise `InputError` unless every file can be written where it is asked for.

    Parameters
    ----------
    outputs : dict of str to (Path or None)
        Files by the option that names them; None where the option is absent.
    inputs : sequence of Path
        Files that are read, which no output may replace.
    """
    taken = {path.resolve(): f"the input {path}" for path in inputs}
    for option, path in outputs.items():
        if path is None:
            continue
        _check_target(option, path)
        place = path.resolve()
        if place in taken:
            raise InputError(f"{option} {path} is also {taken[place]}; choose another name.")
        taken[place] = f"what {option} names"
    for folder in {path.parent: None for path in outputs.values() if path is not None}:
        probe_folder(folder)


def probe_folder(folder: Path) -> None:
    """Raise `InputError` unless a file can be made in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"cannot write into the folder {folder}: {error.strerror}. Choose another path."
        ) from error


def make_folder(folder: Path) -> Path:
    """Make a folder and those above it where they are absent, and check that files can be made in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the folder {folder}: {error.strerror}. Choose another path."
        ) from error
    probe_folder(folder)
    return folder


def nearest_existing(folder: Path) -> Path:
    """Return the folder itself, or the closest one above it that exists."""
    place = folder.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    return place


def check_driver(size: tuple[int, int]) -> None:
    """Raise before the long work if there is no usable OpenGL, or a picture is larger than it allows.

    Raises
    ------
    OpenGLError, CapacityError
        As `shared_context` and `check_picture_fits`.
    """
    from isosample.gl.context import shared_context
    from isosample.rendering.picture_target import check_picture_fits

    check_picture_fits(shared_context(), size)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a JSON file, whole or not at all."""
    from isosample.cli.console import json_text
    from isosample.files import replacing

    # a file name that is no UTF-8 has lone surrogates: this writes them as JSON's own escapes, such as \udce9
    text = f"{json_text(document)}\n".encode(errors="backslashreplace")
    with replacing(path) as file:
        file.write(text)


def _check_target(option: str, path: Path) -> None:
    """Raise unless `path` names a file in an existing folder."""
    if path.is_dir():
        raise InputError(f"{option} {path} is a folder; name a file in it.")
    if not path.parent.is_dir():
        state = "is not a folder" if path.parent.exists() else "does not exist"
        raise InputError(f"{option} {path}: the folder {path.parent} {state}. Make it first.")
    if path.exists() and not path.is_file():
        raise InputError(f"{option} {path} is not a regular file. Choose another path.")
