"""Volume files: NRRD, NIfTI and MetaImage through SimpleITK, or the bare samples as a numpy file."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import VOLUME_SUFFIXES
from isosample.errors import InputError
from isosample.files import replacing, write_array
from isosample.volume.readers.itk import NRRD_SPACE, itk_reason, quiet_standard_error, simpleitk
from isosample.volume.readers.layouts import is_gzip, nifti_header
from isosample.volume.readers.samples import inflated_length

if TYPE_CHECKING:
    from isosample.volume.grid import Volume

PROBE = bytes(1 << 20)  # what is tried to write where SimpleITK does not say why it could not


def volume_suffix(path: Path) -> str:
    """Return which of the suffixes that can be written a path ends in.

    Raises
    ------
    InputError
        If none.
    """
    name = path.name.lower()
    for suffix in VOLUME_SUFFIXES:
        if name.endswith(suffix):
            return suffix
    raise InputError(
        f"{path} is no volume file that can be written; it ends in {' or '.join(VOLUME_SUFFIXES)}."
    )


def check_can_write(path: Path) -> None:
    """Raise unless `save_volume` could write a file of that name, as far as can be told before.

    Raises
    ------
    InputError
        If the suffix is none of those that can be written.
    MissingDependencyError
        If the format needs SimpleITK, which is not installed.
    """
    if volume_suffix(path) != ".npy":
        simpleitk(f"writing {path.name}")


def save_volume(volume: Volume, path: Path) -> None:
    """Write a volume, whole or not at all.

    Parameters
    ----------
    volume : Volume
    path : Path
        Ends in one of `isosample.defaults.VOLUME_SUFFIXES`. NRRD, NIfTI and MetaImage keep spacing, origin and
        direction (NIfTI in float32), NRRD also whether the axes are a patient's, which the other two always mean; a
        numpy file holds the samples alone.

    Raises
    ------
    InputError
        If the suffix is another one, or the file cannot be written.
    MissingDependencyError
        If the format needs SimpleITK, which is not installed.
    """
    suffix = volume_suffix(path)
    samples = np.asarray(volume.in_memory().array)
    if suffix == ".npy":
        with replacing(path) as file:
            write_array(file, samples)
        return
    sitk = simpleitk(f"writing {path.name}")
    stored = samples.astype(np.float32) if samples.dtype == np.float16 else samples
    image = sitk.GetImageFromArray(np.ascontiguousarray(stored, dtype=stored.dtype.newbyteorder("=")))
    image.SetSpacing(volume.spacing)
    image.SetOrigin(volume.origin)
    image.SetDirection(volume.direction.ravel().tolist())
    if not volume.patient_axes:
        image.SetMetaData(NRRD_SPACE, "3D-right-handed")  # ITK would name an anatomical space
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as folder:
            whole = Path(folder) / f"volume{suffix}"
            _write_image(sitk, image, whole)
            os.replace(whole, path)  # noqa: PTH105  # named for what it is: the atomic step
    except OSError as error:
        raise InputError(
            f"{path} cannot be written: {error.strerror or error}. Choose another path."
        ) from error


def _write_image(sitk: Any, image: Any, path: Path) -> None:
    """Write an image, and raise `OSError` with the system's reason where it can be had, if not all of it is there."""
    try:
        with quiet_standard_error():
            sitk.WriteImage(image, str(path), useCompression=path.suffix == ".nrrd")
        if ".nii" in path.name:
            _check_whole(path)
    except (RuntimeError, InputError) as error:
        with path.open("ab") as file:  # on a full disk, and at a limit for the size of a file, this fails too
            file.write(PROBE)
        raise OSError(itk_reason(str(error))) from error


def _check_whole(path: Path) -> None:
    """Raise `InputError` for a NIfTI file that ends early: the library does not look whether all was written."""
    header = nifti_header(path)
    length = inflated_length(path) if is_gzip(path) else path.stat().st_size
    if length < header.end:
        raise InputError(f"{length} of {header.end} bytes were written")
