"""Files of the mesh cache: written whole or not at all, and checked against their digest when read."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import zipfile
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import CacheError
from isosample.files import replacing
from isosample.surfaces.stored_arrays import stored_arrays

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

FORMAT_VERSION = 3  # 3: one chunk per isovalue and brick; 2: reconstruction, refinement, residuals
REMEDY = (
    "Run `isosample precompute` again with the same volume, transfer function, options and --cache: only what is "
    "damaged or missing is made anew."
)
OWNER_REMEDY = (  # of volume.json, which says whose a folder is and is never written over
    "Remove this one file and run `isosample precompute` again with the same volume and --cache; the meshes are kept."
)

# What reading a damaged archive raises; RuntimeError comes from flipped encryption and compression flags.
_ARCHIVE_ERRORS = (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)

Arrays = dict[str, npt.NDArray[np.generic]]


def write_json(path: Path, kind: str, entries: Mapping[str, Any]) -> None:
    """Write entries with the format's name and version and a digest of them all."""
    document = {"format": f"isosample {kind}", "version": FORMAT_VERSION, **entries}
    document["sha256"] = _json_digest(document)
    with replacing(path, error_class=CacheError, make_folder=True) as file:
        file.write((json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Return what `write_json` wrote.

    Raises
    ------
    CacheError
        If the file is absent, unreadable, of another kind or version, or changed since it was written.
    """
    try:
        document = json.loads(path.read_bytes())
    except FileNotFoundError as error:
        raise CacheError(
            unfinished(path.parent) if kind == "scene" else f"{path} is missing. {REMEDY}"
        ) from error
    except (OSError, ValueError) as error:
        raise CacheError(f"{path} cannot be read ({error}). {_remedy(kind)}") from error
    if not isinstance(document, dict) or document.get("format") != f"isosample {kind}":
        raise CacheError(
            f"{path} is not an isosample {kind}. Name a folder that `isosample precompute` made."
        )
    _check_version(path, document)
    digest = document.pop("sha256", None)
    if digest != _json_digest(document):
        raise CacheError(f"{path} is damaged: its content does not match its digest. {_remedy(kind)}")
    return document


@contextlib.contextmanager
def understood(path: Path, kind: str) -> Iterator[None]:
    """Raise `CacheError` where what is made of a document's entries fails: they are whole, but not of this version."""
    try:
        yield
    except (ValueError, KeyError, TypeError) as error:
        raise CacheError(
            f"{path} has entries that this version does not understand ({str(error).rstrip('.')}). {_remedy(kind)}"
        ) from error


def unfinished(folder: Path) -> str:
    """Return what there is to say of a folder without a scene."""
    return (
        f"{folder} was not finished: it has no scene.json yet. Run `isosample precompute` with the same volume and "
        "--cache: what was extracted is kept, and it goes on from there."
    )


def _remedy(kind: str) -> str:
    """Return what helps where a document is damaged."""
    return OWNER_REMEDY if kind == "cache" else REMEDY


def write_arrays(path: Path, header: Mapping[str, Any], arrays: Arrays) -> str:
    """Write arrays behind a header, and return the digest of the arrays."""
    digest = _arrays_digest(arrays)
    text = json.dumps({"version": FORMAT_VERSION, **header, "payload_sha256": digest})
    with replacing(path, error_class=CacheError, make_folder=True) as file:
        np.savez(file, header=np.frombuffer(text.encode(), dtype=np.uint8), **arrays)  # type: ignore[arg-type]
    return digest


def read_arrays(path: Path, header: Mapping[str, Any], *, digest: str | None = None) -> tuple[Arrays, str]:
    """Return what `write_arrays` wrote, and its digest.

    Parameters
    ----------
    path : Path
    header : mapping
        Entries that the file's own header must agree with.
    digest : str, optional
        Digest that the arrays must have; without one, the digest in the file.

    Raises
    ------
    CacheError
        If the file is absent, unreadable, of another version, about something else, or damaged.
    """
    try:
        data = path.read_bytes()
        arrays = stored_arrays(data)
        if arrays is None:
            with np.load(io.BytesIO(data), allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
        found = json.loads(arrays.pop("header").tobytes())
    except FileNotFoundError as error:
        raise CacheError(f"{path} is missing. {REMEDY}") from error
    except _ARCHIVE_ERRORS as error:
        raise CacheError(f"{path} is damaged ({error}). {REMEDY}") from error
    _check_version(path, found)
    expected = {**header, "payload_sha256": digest or found.get("payload_sha256")}
    for entry, value in expected.items():
        if found.get(entry) != value:
            raise CacheError(f"{path} has {entry} {found.get(entry)!r}, expected {value!r}. {REMEDY}")
    if _arrays_digest(arrays) != expected["payload_sha256"]:
        raise CacheError(f"{path} is damaged: its arrays do not match their digest. {REMEDY}")
    return arrays, str(expected["payload_sha256"])


def digest_of(entries: Mapping[str, Any]) -> str:
    """Return the sha256 of entries in a canonical form, hexadecimal."""
    return hashlib.sha256(json.dumps(entries, sort_keys=True, allow_nan=False).encode()).hexdigest()


def _json_digest(document: Mapping[str, Any]) -> str:
    return digest_of({entry: value for entry, value in document.items() if entry != "sha256"})


def _check_version(path: Path, document: Mapping[str, Any]) -> None:
    version = document.get("version")
    if version != FORMAT_VERSION:
        raise CacheError(
            f"{path} has format version {version}; this program reads and writes {FORMAT_VERSION}. Nothing was "
            "changed: take another --cache folder, or delete this one and run `isosample precompute` again."
        )


def _arrays_digest(arrays: Arrays) -> str:
    """Return the sha256 of names, dtypes, shapes and samples, in the order of the names."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()
