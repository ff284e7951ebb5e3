"""The format of a file: by its first bytes, then by its suffix."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

from isosample.errors import InputError
from isosample.volume.readers.layouts import first_bytes

if TYPE_CHECKING:
    from pathlib import Path


class Format(enum.Enum):
    """A file format, by the name that messages use."""

    NRRD = "NRRD"
    NIFTI = "NIfTI"
    META = "MetaImage"
    VTI = "VTK image"
    TIFF = "TIFF"
    NPY = "NumPy"
    DICOM = "DICOM"
    DAT = "Inviwo .dat"
    RAW = "raw"
    HDF5 = "HDF5"


SUFFIXES = {
    ".nrrd": Format.NRRD,
    ".nhdr": Format.NRRD,
    ".nii": Format.NIFTI,
    ".nii.gz": Format.NIFTI,
    ".mhd": Format.META,
    ".mha": Format.META,
    ".vti": Format.VTI,
    ".tif": Format.TIFF,
    ".tiff": Format.TIFF,
    ".npy": Format.NPY,
    ".dcm": Format.DICOM,
    ".dat": Format.DAT,
    ".raw": Format.RAW,
    ".raw.gz": Format.RAW,
    ".h5": Format.HDF5,
    ".hdf5": Format.HDF5,
}
START_BYTES = 540  # up to the end of a NIfTI-2 header


def detect_format(path: Path, *, headerless: bool) -> Format:
    """Return the format of a file.

    Parameters
    ----------
    path : Path
    headerless : bool
        Whether the caller describes the samples: then a file that no magic number or suffix names is raw.

    Raises
    ------
    InputError
        If neither the first bytes nor the suffix are known, or the content is not what the suffix says.
    """
    start = first_bytes(path, START_BYTES)
    by_content = _by_content(start)
    by_suffix = _by_suffix(path.name.lower())
    if by_suffix is Format.DAT and headerless and b"resolution" not in start.lower():
        return Format.RAW  # many programs call bare samples .dat
    if by_content is not None:
        return by_content
    if by_suffix in (Format.RAW, Format.DAT, Format.META) or (by_suffix is None and headerless):
        return by_suffix or Format.RAW
    if by_suffix is not None:
        raise InputError(
            f"{path.name} does not start like a {by_suffix.value} file. Is it damaged, or its suffix wrong?"
        )
    raise InputError(
        f"{path.name} is of no known format; known suffixes are {', '.join(SUFFIXES)}, or a folder of DICOM "
        "slices or of Zarr chunks. A headerless file needs --shape X,Y,Z and --dtype."
    )


def _by_suffix(name: str) -> Format | None:
    """Format by the longest suffix that fits."""
    fitting = [suffix for suffix in SUFFIXES if name.endswith(suffix)]
    return SUFFIXES[max(fitting, key=len)] if fitting else None


def _by_content(start: bytes) -> Format | None:
    """Format by magic numbers, or None."""
    magic = {
        b"NRRD000": Format.NRRD,
        b"\x93NUMPY": Format.NPY,
        b"\x89HDF\r\n\x1a\n": Format.HDF5,
        b"II*\0": Format.TIFF,
        b"MM\0*": Format.TIFF,
        b"II+\0": Format.TIFF,
        b"MM\0+": Format.TIFF,
    }
    for beginning, found in magic.items():
        if start.startswith(beginning):
            return found
    if start[344:348] in (b"n+1\0", b"ni1\0") or start[4:8] in (b"n+2\0", b"ni2\0"):
        return Format.NIFTI
    if start[128:132] == b"DICM":
        return Format.DICOM
    if b"<VTKFile" in start:
        return Format.VTI
    first_line = start.split(b"\n", 1)[0].replace(b" ", b"")
    if first_line.startswith((b"ObjectType=", b"NDims=")):
        return Format.META
    return None
