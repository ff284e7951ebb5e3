"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import time
import uuid
from typing import IO, TYPE_CHECKING

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from isosample.errors import IsosampleError

TEMPORARY = ".tmp"
STALE_SECONDS = 3600.0  # a temporary file as old as that was left by a process that was killed


@contextlib.contextmanager
def replacing(
    path: Path, *, error_class: type[IsosampleError] = InputError, make_folder: bool = False
) -> Iterator[IO[bytes]]:
    """Open a file that takes the place of `path` when the block ends well, and vanishes otherwise.

    Parameters
    ----------
    path : Path
        The file to be. What stands there stays until the block has ended well.
    error_class : class
        What to raise if the folder or the file cannot be written.
    make_folder : bool
        Make the folder if it is absent.

    Yields
    ------
    file : binary file
        A temporary one in the same folder.

    Raises
    ------
    error_class
        If the file cannot be written; the message names it and the reason.
    """
    temporary = path.with_name(f".{uuid.uuid4().hex}{TEMPORARY}")  # short, whatever the name
    try:
        with failure_told(path, error_class):
            if make_folder:
                path.parent.mkdir(parents=True, exist_ok=True)
            with temporary.open("xb") as file:
                yield file
            os.replace(temporary, path)  # noqa: PTH105  # named for what it is: the atomic step
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def failure_told(path: Path, error_class: type[IsosampleError] = InputError) -> Iterator[None]:
    """Raise `error_class`, with the path and the reason, where the block cannot write a file."""
    try:
        yield
    except OSError as error:
        raise error_class(
            f"{path} cannot be written: {error.strerror or error}. Choose another path."
        ) from error


def leftovers(folder: Path) -> list[tuple[Path, int]]:
    """Return the temporary files in a folder, with their bytes, that killed processes left while `replacing` a file."""
    found = []
    for path in folder.glob(f".{'[0-9a-f]' * 32}{TEMPORARY}"):
        with contextlib.suppress(FileNotFoundError):  # it was written to its end a moment ago
            state = path.stat()
            if time.time() - state.st_mtime > STALE_SECONDS:
                found.append((path, state.st_size))
    return found


def write_array(file: IO[bytes], array: npt.NDArray[np.generic]) -> None:
    """Write an array as a numpy file; unlike `numpy.save`, whose `OSError` on a full disk lacks the system's reason."""
    import numpy as np

    whole = np.ascontiguousarray(array)
    np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(whole))
    file.write(whole.reshape(-1).view(np.uint8).data)
