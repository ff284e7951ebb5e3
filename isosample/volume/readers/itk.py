"""NRRD, NIfTI and MetaImage through SimpleITK, in its LPS convention; plain samples are mapped."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.grid import Volume
from isosample.volume.readers.layouts import (
    Layout,
    is_gzip,
    meta_layout,
    nifti_header,
    nifti_layout,
    nrrd_layout,
)
from isosample.volume.readers.samples import (
    ReadOptions,
    choose,
    inflate_samples,
    inflated_length,
    map_samples,
    native,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from isosample.volume.grid import SampleArray


NRRD_SPACE = "NRRD_space"
PATIENT_SPACES = (
    "right-anterior-superior",
    "left-anterior-superior",
    "left-posterior-superior",
)  # ITK makes all LPS
PIXELS = {
    "i1": "sitkInt8",
    "u1": "sitkUInt8",
    "i2": "sitkInt16",
    "u2": "sitkUInt16",
    "i4": "sitkInt32",
    "u4": "sitkUInt32",
    "i8": "sitkInt64",
    "u8": "sitkUInt64",
    "f4": "sitkFloat32",
    "f8": "sitkFloat64",
}


def read_nrrd(path: Path, options: ReadOptions) -> Volume:
    """Read an NRRD file, attached or detached; see `read_through_itk`."""
    return read_through_itk(path, options, "NRRD", "NrrdImageIO", nrrd_layout(path))


def read_meta(path: Path, options: ReadOptions) -> Volume:
    """Read a MetaImage file, with its samples inside or beside it; see `read_through_itk`."""
    return read_through_itk(path, options, "MetaImage", "MetaImageIO", meta_layout(path))


def read_nifti(path: Path, options: ReadOptions) -> Volume:
    """Read a NIfTI file, gzipped or not; see `read_through_itk`.

    Notes
    -----
    The library fills up a file that ends early without a word, so the length is checked here.
    """
    header = nifti_header(path)
    layout = nifti_layout(path, header)
    if header.single_file and (layout is None or len(header.sizes) > 3):
        actual = inflated_length(path) if is_gzip(path) else path.stat().st_size
        if actual < header.end:
            raise InputError(
                f"{path.name} has {actual} bytes; its sizes {header.sizes} need {header.end}. "
                "The file is incomplete; fetch it again."
            )
    return read_through_itk(path, options, "NIfTI", "NiftiImageIO", layout)


def read_through_itk(
    path: Path, options: ReadOptions, kind: str, image_io: str, layout: Layout | None
) -> Volume:
    """Read a file whose placement, and samples where they are not plain, SimpleITK decodes.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `channel` and `time` choose from vector and four-dimensional images.
    kind : str
        Name of the format, for messages.
    image_io : str
        SimpleITK's name for it.
    layout : Layout or None
        Where plain samples lie; those are mapped (or inflated with their checksum verified).

    Returns
    -------
    volume : Volume
        Origin and direction in the LPS convention; `patient_axes` where the file is in patient coordinates.

    Raises
    ------
    MissingDependencyError
        If SimpleITK is not installed.
    InputError
        If the file is damaged, sheared, or not a three-dimensional scalar image and no choice is given.
    """
    sitk = simpleitk(f"reading {kind}")
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    reader.SetImageIO(image_io)
    with itk_failures(path.name, kind):
        reader.ReadImageInformation()
    if reader.GetDimension() not in (3, 4):
        raise InputError(
            f"{path.name} is a {reader.GetDimension()}-dimensional image; "
            "a volume has three axes. Save one volume of it."
        )
    samples = _samples(sitk, reader, path, options, kind, layout)
    direction = np.array(reader.GetDirection()).reshape(reader.GetDimension(), -1)
    return Volume(
        samples,
        spacing=reader.GetSpacing()[:3],
        origin=reader.GetOrigin()[:3],
        direction=direction[:3, :3],
        name=path.name,
        patient_axes=_has_patient_axes(reader, kind),
    )


def _has_patient_axes(reader: Any, kind: str) -> bool:
    """Whether a file is in patient coordinates: all NIfTI and MetaImage files, and NRRD files with such a space."""
    space = reader.GetMetaData(NRRD_SPACE) if reader.HasMetaDataKey(NRRD_SPACE) else ""
    return kind != "NRRD" or space in PATIENT_SPACES


def simpleitk(task: str) -> Any:
    """Return the SimpleITK module, or raise saying that a task needs it and how to install it."""
    try:
        import SimpleITK
    except ImportError as error:
        raise MissingDependencyError(
            f'{task} needs SimpleITK, which is not installed: pip install "isosample[medical]".'
        ) from error
    return SimpleITK


@contextlib.contextmanager
def itk_failures(name: str, kind: str) -> Iterator[None]:
    """Turn SimpleITK's failures into one clear line, and keep its C++ warnings off standard error."""
    try:
        with quiet_standard_error():
            yield
    except RuntimeError as error:
        reason = itk_reason(str(error))
        if "orthonormal" in reason:
            raise InputError(
                f"{name}: its direction is not orthonormal; sheared grids are not supported. Resample it."
            ) from error
        raise InputError(
            f"{name} could not be read as {kind} ({reason}). It may be damaged or incomplete."
        ) from error


@contextlib.contextmanager
def quiet_standard_error() -> Iterator[None]:
    """Discard what C and C++ code writes to file descriptor 2: MetaIO and NIfTI bypass ITK's switch."""
    sys.stderr.flush()
    kept = os.dup(2)
    discard = os.open(os.devnull, os.O_WRONLY)
    os.dup2(discard, 2)
    os.close(discard)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def itk_reason(text: str) -> str:
    """Return the telling part of an ITK message: without places in ITK's source, and its last cause only."""
    lines = [line for line in text.splitlines() if line.strip() and "Exception thrown" not in line]
    lines = [re.sub(r"^(ITK ERROR: )?(\[nrrd\] )?(_?\w+(\(0x[0-9a-f]+\))?: ?)?", "", line) for line in lines]
    lines = [line.strip() for line in lines if line.strip() and not line.startswith("Reason: Success")]
    return lines[-1].rstrip(".") if lines else "no reason given"


def _samples(
    sitk: Any, reader: Any, path: Path, options: ReadOptions, kind: str, layout: Layout | None
) -> SampleArray:
    """Return one channel and one time step: mapped or inflated where they are plain, else decoded."""
    size = reader.GetSize()
    time = choose(path.name, "time", size[3] if len(size) == 4 else 1, options.time)
    channel = choose(path.name, "channel", reader.GetNumberOfComponents(), options.channel)
    is_plain = len(size) == 3 and reader.GetNumberOfComponents() == 1
    if layout is not None and is_plain and reader.GetPixelID() == getattr(sitk, PIXELS[layout.dtype.str[1:]]):
        cure = "The file is damaged or incomplete; fetch it again."
        if layout.path != path:
            cure = f"It does not belong to {path.name}, or is incomplete; fetch both again."
        if layout.is_deflated:
            return inflate_samples(layout.path, layout.dtype, size, layout.offset, layout.start, cure=cure)
        return map_samples(layout.path, layout.dtype, size, layout.offset, cure=cure)
    if len(size) == 4:
        reader.SetExtractIndex([0, 0, 0, time])
        reader.SetExtractSize([*size[:3], 1])
    with itk_failures(path.name, kind):
        array: SampleArray = sitk.GetArrayFromImage(reader.Execute())
    if len(size) == 4:
        array = array[0]
    return native(np.ascontiguousarray(array[..., channel]) if array.ndim == 4 else array)
