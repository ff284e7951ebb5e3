"""DICOM: one series in a folder, through SimpleITK's GDCM; slices sorted, rescaled, checked for gaps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import InputError
from isosample.volume.grid import Volume
from isosample.volume.readers.itk import itk_failures, read_through_itk, simpleitk
from isosample.volume.readers.samples import ReadOptions, choose, library_failures

if TYPE_CHECKING:
    from collections.abc import Mapping

    from isosample.volume.grid import F64, SampleArray

STEP_TOLERANCE = 0.02  # of the slice distance: positions are written with a few decimals
POSITION, COSINES = "0020|0032", "0020|0037"
SLOPE, INTERCEPT = "0028|1053", "0028|1052"
DESCRIPTION = "0008|103e"
STORAGE_CLASS = b"\x02\x00\x02\x00UI"  # always little-endian with explicit types, whatever follows
START_BYTES = 1024


def read_dicom_folder(folder: Path, options: ReadOptions) -> Volume:
    """Read the one DICOM series in a folder.

    Parameters
    ----------
    folder : Path
    options : ReadOptions
        `channel` chooses from colour slices.

    Returns
    -------
    volume : Volume
        Slices sorted along their normal; each with its own rescale slope applied.

    Raises
    ------
    MissingDependencyError
        If SimpleITK is not installed.
    InputError
        If the folder holds no series, several series, a single slice, slices at unequal distances, or one that
        cannot be read.
    """
    sitk = simpleitk("reading DICOM")
    with itk_failures(folder.name, "DICOM"):
        series = sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(folder))
    if not series:
        raise InputError(f"{folder} holds no DICOM series. Name a volume file or a folder of DICOM slices.")
    files = {uid: _files(sitk, folder, uid) for uid in series}
    _refuse_unread(folder, files)
    if len(series) > 1:
        listed = "; ".join(f"{uid} ({_title(sitk, names)})" for uid, names in files.items())
        raise InputError(
            f"{folder.name} holds {len(series)} DICOM series: {listed}. Put the wanted one in its own folder."
        )
    return _read_series(sitk, folder.name, files[series[0]], options)


def read_dicom_file(path: Path, options: ReadOptions) -> Volume:
    """Read one DICOM file with many frames; a file with one slice raises, naming its folder."""
    volume = read_through_itk(path, options, "DICOM", "GDCMImageIO", None)
    if volume.size_xyz[2] == 1:
        raise InputError(f"{path.name} is a single DICOM slice. Name its folder instead: {path.parent}")
    return volume


def _read_series(sitk: Any, name: str, files: tuple[str, ...], options: ReadOptions) -> Volume:
    """Read sorted slices, check their distances, and choose the channel."""
    if len(files) == 1:
        raise InputError(f"{name} holds a single DICOM slice; a volume needs at least two.")
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(files)
    reader.MetaDataDictionaryArrayUpdateOn()
    with itk_failures(name, "DICOM"):
        image = reader.Execute()
    with library_failures(f"{name} could not be read as DICOM"):
        positions = _slice_positions(reader, len(files))
        uneven = _is_rescaled_unevenly(reader, len(files))
    _check_steps(name, positions)
    array: SampleArray = sitk.GetArrayFromImage(image)
    if array.dtype.kind in "iu" and uneven:
        reader.SetOutputPixelType(sitk.sitkFloat64)  # the first slice's integers would truncate the others
        with itk_failures(name, "DICOM"):
            array = sitk.GetArrayFromImage(reader.Execute())
    channel = choose(name, "channel", image.GetNumberOfComponentsPerPixel(), options.channel)
    choose(name, "time", 1, options.time)
    return Volume(
        np.ascontiguousarray(array[..., channel]) if array.ndim == 4 else array,
        spacing=image.GetSpacing(),
        origin=image.GetOrigin(),
        direction=np.array(image.GetDirection()).reshape(3, 3),
        name=name,
        patient_axes=True,
    )


def _files(sitk: Any, folder: Path, uid: str) -> tuple[str, ...]:
    """File names of one series, sorted along the slice normal."""
    with itk_failures(folder.name, "DICOM"):
        names: tuple[str, ...] = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder), uid)
    return names


def _refuse_unread(folder: Path, files: Mapping[str, tuple[str, ...]]) -> None:
    """Raise where a file begins as the slices of a series do, but is in none: the library passes over damaged ones."""
    read = {Path(name).name for names in files.values() for name in names}
    classes = {_storage_class(Path(names[0])) for names in files.values()} - {None}
    for path in sorted(folder.iterdir()):
        if path.name not in read and path.is_file() and _storage_class(path) in classes:
            raise InputError(
                f"{folder.name}: {path.name} begins like a slice, but cannot be read. It may be damaged or incomplete; "
                "fetch it again."
            )


def _storage_class(path: Path) -> bytes | None:
    """What kind of object a DICOM file says to be at its beginning (0002,0002); None where it is no DICOM file."""
    with path.open("rb") as stream:
        start = stream.read(START_BYTES)
    _, found, rest = start.partition(STORAGE_CLASS)
    if start[128:132] != b"DICM" or not found:
        return None
    return rest[2 : 2 + int.from_bytes(rest[:2], "little")]


def _title(sitk: Any, files: tuple[str, ...]) -> str:
    """Return description and slice count of a series, for the list of choices."""
    reader = sitk.ImageFileReader()
    reader.SetFileName(files[0])
    with itk_failures(files[0], "DICOM"):
        reader.ReadImageInformation()
    described = reader.GetMetaData(DESCRIPTION).strip() if reader.HasMetaDataKey(DESCRIPTION) else "no title"
    return f"{described}, {len(files)} slices"


def _slice_positions(reader: Any, count: int) -> F64 | None:
    """(S, 3) positions in the slices' own axes (row, column, normal) [mm]; None where a file carries none."""
    positions = np.empty((count, 3))
    for i in range(count):
        if not (reader.HasMetaDataKey(i, POSITION) and reader.HasMetaDataKey(i, COSINES)):
            return None
        row, column = np.array(reader.GetMetaData(i, COSINES).split("\\"), dtype=np.float64).reshape(2, 3)
        position = np.array(reader.GetMetaData(i, POSITION).split("\\"), dtype=np.float64)
        if not np.isfinite([row, column, position]).all():
            raise ValueError(
                f"slice {i} is at {position.tolist()}, along {row.tolist()} and {column.tolist()}"
            )
        positions[i] = np.stack([row, column, np.cross(row, column)]) @ position
    return positions


def _check_steps(name: str, positions: F64 | None) -> None:
    """Raise where slices are missing, doubled, unequally far apart or shifted sideways: no even grid."""
    if positions is None:
        return
    steps = np.abs(np.diff(positions[:, 2]))
    moving = steps[steps > 0]
    usual = float(np.quantile(moving, 0.5, method="lower")) if moving.size else 1.0
    odd = np.flatnonzero(np.abs(steps - usual) > STEP_TOLERANCE * usual)
    if odd.size:
        at = int(odd[0])
        raise InputError(
            f"{name}: slices {at} and {at + 1} are {steps[at]:g} mm apart, most are {usual:g} mm. Slices are "
            "missing, doubled (several time steps or echoes?) or uneven; give a folder with one even stack."
        )
    if np.abs(np.diff(positions[:, :2], axis=0)).max() > STEP_TOLERANCE * usual:
        raise InputError(
            f"{name}: the slices are shifted sideways (a tilted gantry); sheared grids are not supported. "
            "Resample the series."
        )


def _is_rescaled_unevenly(reader: Any, count: int) -> bool:
    """Whether slices have different rescale slopes or intercepts."""
    pairs = {
        tuple(
            float(reader.GetMetaData(i, key)) for key in (SLOPE, INTERCEPT) if reader.HasMetaDataKey(i, key)
        )
        for i in range(count)
    }
    return len(pairs) > 1
