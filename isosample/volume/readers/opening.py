"""`open_volume`: any supported file or folder as a Volume."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

from isosample.errors import InputError
from isosample.volume.readers import dicom, hdf5, itk, npy, raw, tiff, vti, zarr
from isosample.volume.readers.detect import Format, detect_format
from isosample.volume.readers.samples import ReadOptions, parse_dtype, parse_shape

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    import numpy.typing as npt

    from isosample.volume.grid import Volume

    Vector = tuple[float, float, float]  # that there are three is for Volume to check

READERS = {
    Format.NRRD: itk.read_nrrd,
    Format.NIFTI: itk.read_nifti,
    Format.META: itk.read_meta,
    Format.VTI: vti.read_vti,
    Format.TIFF: tiff.read_tiff,
    Format.NPY: npy.read_npy,
    Format.DICOM: dicom.read_dicom_file,
    Format.DAT: raw.read_dat,
    Format.RAW: raw.read_raw,
    Format.HDF5: hdf5.read_hdf5,
}


def open_volume(
    path: str | os.PathLike[str],
    *,
    shape: Sequence[int] | None = None,
    dtype: npt.DTypeLike | None = None,
    spacing: Sequence[float] | None = None,
    channel: int | None = None,
    time: int | None = None,
    dataset: str | None = None,
) -> Volume:
    """Open a volume file, or a folder of DICOM slices or Zarr chunks, recognised by content, then by suffix.

    Parameters
    ----------
    path : path-like
        NRRD (.nrrd, .nhdr), NIfTI (.nii, .nii.gz), MetaImage (.mhd, .mha), VTK image (.vti), TIFF stack,
        NumPy (.npy), HDF5 (.h5, .hdf5), Zarr or OME-Zarr folder, DICOM folder, Inviwo .dat, or headerless samples
        (.raw, .raw.gz).
    shape : 3 ints, optional
        Samples along x, y, z; for headerless files only, and required there.
    dtype : numpy dtype, optional
        Type of the samples; for headerless files only, and required there. Little-endian unless it says
        otherwise (``>u2``).
    spacing : 3 floats, optional
        Distance between samples along x, y, z [world]; replaces what the file says.
    channel, time : int, optional
        Which channel or time step to read from a file with several.
    dataset : str, optional
        Which array to read from an HDF5 file or a Zarr group with several.

    Returns
    -------
    volume : Volume
        In the file's own sample type (in the machine's byte order); rescaled files are floating point.
        Memory-mapped where the file is neither compressed nor rescaled nor of foreign byte order; HDF5 and Zarr are
        read when they are sliced.

    Raises
    ------
    MissingDependencyError
        If the format needs a package that is not installed.
    InputError
        If the file is missing, damaged, incomplete, of an unknown format, or not one scalar volume, or if an
        option is not as above.
    """
    path = Path(path)
    options = ReadOptions(
        shape=None if shape is None else parse_shape(shape),
        dtype=None if dtype is None else parse_dtype(dtype),
        channel=channel,
        time=time,
        dataset=dataset,
        spacing=spacing,
    )
    try:
        volume = _read(path, options)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    if spacing is None:
        return volume
    return replace(volume, spacing=cast("Vector", spacing))


def _read(path: Path, options: ReadOptions) -> Volume:
    """Read by the format's own reader."""
    is_described = options.shape is not None or options.dtype is not None
    _check_is_there(path)
    if path.is_dir() and zarr.is_zarr(path):
        _refuse_description(path, "Zarr", is_described=is_described)
        return zarr.read_zarr(path, options)
    if options.dataset is not None and not _has_datasets(path):
        raise InputError(
            f"{path.name} is no HDF5 file and no Zarr group; leave out --dataset {options.dataset}."
        )
    if path.is_dir():
        _refuse_description(path, "DICOM", is_described=is_described)
        return dicom.read_dicom_folder(path, options)
    if path.stat().st_size == 0:
        raise InputError(f"{path} is empty; a volume file was expected. Fetch it again.")
    found = detect_format(path, headerless=is_described)
    if found is not Format.RAW:
        _refuse_description(path, found.value, is_described=is_described)
    return READERS[found](path, options)


def _check_is_there(path: Path) -> None:
    """Raise unless a path is a file or a folder: readers go back and forth in what they read."""
    if path.is_file() or path.is_dir():
        return
    streamed = "standard input" if str(path) == "-" else "a pipe or a device" if path.exists() else None
    if streamed is not None:
        raise InputError(
            f"{path} is {streamed}, from which no volume can be read. Save it to a file, and name that."
        )
    raise InputError(f"{path} does not exist. Check the path.")


def _has_datasets(path: Path) -> bool:
    """Whether a file may hold several arrays by name."""
    return path.is_file() and path.stat().st_size > 0 and detect_format(path, headerless=True) is Format.HDF5


def _refuse_description(path: Path, kind: str, *, is_described: bool) -> None:
    """Raise where shape or type are given for a file that states its own."""
    if is_described:
        raise InputError(f"{path.name} states its own size and type ({kind}); leave out --shape and --dtype.")
