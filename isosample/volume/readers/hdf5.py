"""Datasets of HDF5 files, read chunk by chunk when they are sliced."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.grid import Volume
from isosample.volume.lazy import LockedSamples, files_identity
from isosample.volume.readers.chosen import choose_axes
from isosample.volume.readers.samples import number_type

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.volume.grid import SampleArray
    from isosample.volume.readers.samples import ReadOptions

SPACING = "element_size_um"  # of ilastik, Fiji and others: z, y, x


def read_hdf5(path: Path, options: ReadOptions) -> Volume:
    """Open a dataset of an HDF5 file.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `dataset` names it; it may be left out where only one has three axes or more. `channel` and `time` choose
        where there are more than three axes. The attribute `element_size_um` (z, y, x) gives the spacing.

    Raises
    ------
    MissingDependencyError
        If h5py is not installed.
    InputError
        If the file is damaged, or does not hold one array of numbers with three axes to choose.
    """
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError(
            'reading HDF5 needs h5py, which is not installed: pip install "isosample[hdf5]".'
        ) from error
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path.name} is no readable HDF5 file ({reason}). It may be incomplete.") from error
    dataset = _dataset(path.name, file, options.dataset, h5py)
    before, after = choose_axes(path.name, dataset.shape, None, options)
    space = slice(len(before), len(before) + 3)
    samples = LockedSamples(
        dataset,
        before,
        after,
        shape=tuple(dataset.shape[space]),
        dtype=number_type(dataset.dtype),
        chunks=tuple(dataset.chunks[space]) if dataset.chunks else None,
        identity=files_identity([path], dataset.name, before, after),
    )
    spacing = _spacing(dataset)
    return Volume(cast("SampleArray", samples), spacing=spacing, name=path.name)


def _dataset(name: str, file: Any, chosen: str | None, h5py: Any) -> Any:
    """Return the dataset asked for, or the only one that can be a volume."""
    found: dict[str, Any] = {}

    def visit(key: str, member: Any) -> None:
        if isinstance(member, h5py.Dataset) and member.ndim >= 3 and member.dtype.kind in "iufb":
            found[key] = member

    file.visititems(visit)
    if chosen is not None and chosen.strip("/") in found:
        return found[chosen.strip("/")]
    scans = {key: member for key, member in found.items() if member.dtype.kind != "b"} or found
    if chosen is None and len(scans) == 1:  # a mask beside a scan is no rival
        return next(iter(scans.values()))
    listed = ", ".join(f"{key} {member.shape}" for key, member in sorted(found.items())) or "none"
    asked = (
        f"no dataset {chosen!r} with"
        if chosen is not None
        else "more than one dataset with"
        if found
        else "no dataset with"
    )
    raise InputError(
        f"{name} has {asked} three axes of numbers; it holds {listed}. Choose one with --dataset NAME."
    )


def _spacing(dataset: Any) -> tuple[float, float, float]:
    """Spacing along x, y, z from the attributes, or 1."""
    stated = np.atleast_1d(np.asarray(dataset.attrs.get(SPACING, (1.0, 1.0, 1.0)), dtype=np.float64))
    if stated.shape != (3,) or not (np.isfinite(stated) & (stated > 0)).all():
        return (1.0, 1.0, 1.0)
    z, y, x = stated.tolist()
    return (x, y, z)
