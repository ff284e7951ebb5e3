"""Datasets of HDF5 files, read chunk by chunk when they are sliced."""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.grid import Volume
from isosample.volume.lazy import LazySamples, files_identity
from isosample.volume.readers.chosen import choose_axes
from isosample.volume.readers.samples import library_failures, number_type

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.volume.grid import SampleArray
    from isosample.volume.lazy import Block
    from isosample.volume.readers.samples import ReadOptions

SPACING = "element_size_um"  # of ilastik, Fiji and others: z, y, x


class Hdf5Samples(LazySamples):
    """Three axes of a dataset; the library must be asked by one thread at a time.

    Parameters
    ----------
    dataset : h5py.Dataset
        Of at least three axes.
    before, after : tuples of int
        Indices along the axes before and behind the three of the volume.
    name : str
        The file, for messages.
    **about
        As for `LazySamples`.
    """

    def __init__(
        self, dataset: Any, before: tuple[int, ...], after: tuple[int, ...], *, name: str, **about: Any
    ) -> None:
        super().__init__(**about)
        self._dataset, self._name = dataset, name
        self._before, self._after = before, after
        self._lock = threading.Lock()

    def read(self, block: Block) -> SampleArray:
        """Read a block under the lock.

        Raises
        ------
        InputError
            If the library cannot read it.
        """
        with self._lock, library_failures(f"a chunk of {self._name} cannot be read"):
            samples = self._dataset[(*self._before, *block, *self._after)]
        return np.ascontiguousarray(samples, dtype=self.dtype)


def read_hdf5(path: Path, options: ReadOptions) -> Volume:
    """Open a dataset of an HDF5 file.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `dataset` names it; it may be left out where only one has three axes or more. `channel` and `time` choose
        where there are more than three axes. The attribute `element_size_um` (z, y, x) gives the spacing, where
        `spacing` does not.

    Raises
    ------
    MissingDependencyError
        If h5py is not installed.
    InputError
        If the file is damaged, does not hold one array of numbers with three axes to choose, or its
        `element_size_um` is no spacing.
    """
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError(
            'reading HDF5 needs h5py, which is not installed: pip install "isosample[hdf5]".'
        ) from error
    with library_failures(f"{path.name} is no readable HDF5 file"):
        return _volume(path, h5py, options)


def _volume(path: Path, h5py: Any, options: ReadOptions) -> Volume:
    """Open the dataset that the options choose."""
    file = h5py.File(path, "r")
    dataset = _dataset(path.name, file, options.dataset, h5py)
    before, after = choose_axes(path.name, dataset.shape, None, options)
    space = slice(len(before), len(before) + 3)
    samples = Hdf5Samples(
        dataset,
        before,
        after,
        shape=tuple(dataset.shape[space]),
        dtype=number_type(dataset.dtype),
        chunks=tuple(dataset.chunks[space]) if dataset.chunks else None,
        identity=files_identity([path], dataset.name, before, after),
        name=path.name,
    )
    spacing = _spacing(path.name, dataset) if options.spacing is None else (1.0, 1.0, 1.0)
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


def _spacing(name: str, dataset: Any) -> tuple[float, float, float]:
    """Spacing along x, y, z from the attributes; 1 where they say nothing."""
    if SPACING not in dataset.attrs:
        return (1.0, 1.0, 1.0)
    stated = dataset.attrs[SPACING]
    try:
        z, y, x = np.asarray(stated, dtype=np.float64).tolist()
        if min(z, y, x) > 0 and math.isfinite(z + y + x):
            return (x, y, z)
    except (TypeError, ValueError):  # no numbers, or not three
        pass
    raise InputError(
        f"{name}: {dataset.name} has {SPACING} {stated!r:.80}; expected three numbers above 0 (z, y, x). Give "
        "--spacing X,Y,Z."
    )
