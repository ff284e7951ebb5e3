"""Zarr arrays and OME-Zarr images (versions 2 and 3 of the format), read chunk by chunk when they are sliced."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.grid import Volume
from isosample.volume.lazy import LazySamples, files_identity
from isosample.volume.readers.chosen import choose_axes
from isosample.volume.readers.samples import library_failures, number_type

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from isosample.volume.grid import SampleArray
    from isosample.volume.lazy import Block, Triple
    from isosample.volume.readers.samples import ReadOptions

METADATA = ("zarr.json", ".zarray", ".zgroup", ".zattrs")


class ZarrSamples(LazySamples):
    """Three axes of a Zarr array; the library reads chunks in parallel by itself."""

    def __init__(self, array: Any, before: tuple[int, ...], after: tuple[int, ...], folder: Path) -> None:
        space = slice(len(before), len(before) + 3)
        super().__init__(
            cast("Triple", tuple(array.shape[space])),
            number_type(array.dtype),
            chunks=cast("Triple", tuple(array.chunks[space])),
            identity=files_identity((path for path in folder.rglob("*") if path.is_file()), before, after),
        )
        self._array = array
        self._before, self._after = before, after

    def read(self, block: Block) -> SampleArray:
        """Read a block; chunks that are not there hold the fill value."""
        with library_failures(f"a chunk of {self._array.store_path} cannot be read"):
            samples = self._array[(*self._before, *block, *self._after)]
        return np.ascontiguousarray(samples, dtype=self.dtype)


def is_zarr(folder: Path) -> bool:
    """Tell whether a folder is a Zarr array or group."""
    return any((folder / name).is_file() for name in METADATA)


def read_zarr(path: Path, options: ReadOptions) -> Volume:
    """Open a Zarr array, or an array of a group.

    Parameters
    ----------
    path : Path
        Folder of an array, or of a group; an OME-Zarr image gives its finest resolution with its scale and shift.
    options : ReadOptions
        `dataset` names the array inside a group; `channel` and `time` choose where there are more than three axes.

    Raises
    ------
    MissingDependencyError
        If zarr is not installed.
    InputError
        If the folder cannot be read, or does not hold one array of numbers with three axes to choose.
    """
    zarr = _library()
    with library_failures(f"{path.name} is no readable Zarr folder"):
        return _volume(path, zarr.open(path, mode="r"), options)


def _volume(path: Path, opened: Any, options: ReadOptions) -> Volume:
    """Open the array that the options choose."""
    image = _image(opened)
    name = options.dataset
    if name is None and image is not None:
        name = str(image["datasets"][0]["path"])
    array = _array(path, opened, name)
    axes = _axes(array, image)
    before, after = choose_axes(path.name, array.shape, axes, options)
    samples = ZarrSamples(array, before, after, path)
    spacing, origin = _placement(image, name, axes)
    return Volume(cast("SampleArray", samples), spacing=spacing, origin=origin, name=path.name)


def _library() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise MissingDependencyError(
            'reading Zarr needs zarr, which is not installed: pip install "isosample[zarr]".'
        ) from error
    return zarr


def _array(path: Path, opened: Any, name: str | None) -> Any:
    """Return the array to read: the folder itself, the one named, or the only one in a group."""
    if hasattr(opened, "chunks"):
        if name is not None:
            raise InputError(f"{path.name} is a Zarr array, not a group; leave out --dataset {name}.")
        return opened
    found = dict(opened.members(max_depth=None))
    arrays = {key: member for key, member in found.items() if hasattr(member, "chunks")}
    if name is not None and name in arrays:
        return arrays[name]
    if name is None and len(arrays) == 1:
        return next(iter(arrays.values()))
    listed = ", ".join(f"{key} {member.shape}" for key, member in sorted(arrays.items())) or "no array"
    asked = f"no array {name!r}" if name is not None else "more than one array" if arrays else "no array"
    raise InputError(f"{path.name} has {asked}; it holds {listed}. Choose one with --dataset NAME.")


def _image(opened: Any) -> dict[str, Any] | None:
    """Return the first multiscale image of OME metadata (0.4 or 0.5), or None."""
    attributes = dict(opened.attrs)
    images = attributes.get("ome", attributes).get("multiscales")
    return images[0] if isinstance(images, list) and images and images[0].get("datasets") else None


def _axes(array: Any, image: dict[str, Any] | None) -> tuple[str, ...] | None:
    """Return the names of the axes where the file says them."""
    if image is not None and len(image.get("axes", ())) == array.ndim:
        entries = [entry if isinstance(entry, str) else str(entry.get("name")) for entry in image["axes"]]
        return tuple(entry.lower() for entry in entries)
    named = getattr(array.metadata, "dimension_names", None)
    return tuple(str(name).lower() for name in named) if named and all(named) else None


def _placement(
    image: dict[str, Any] | None, name: str | None, axes: Sequence[str] | None
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Spacing and origin along x, y, z of one resolution of an image."""
    spacing, origin = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
    if image is not None and axes is not None and {"x", "y", "z"} <= set(axes):
        own: dict[str, Any] = next((entry for entry in image["datasets"] if str(entry["path"]) == name), {})
        steps = [*own.get("coordinateTransformations", ()), *image.get("coordinateTransformations", ())]
        places = [axes.index(axis) for axis in "xyz"]
        for step in steps:
            if step.get("type") == "scale":
                factors = [float(step["scale"][place]) for place in places]
                spacing = [old * factor for old, factor in zip(spacing, factors, strict=True)]
                origin = [old * factor for old, factor in zip(origin, factors, strict=True)]
            elif step.get("type") == "translation":
                moved = [float(step["translation"][place]) for place in places]
                origin = [old + shift for old, shift in zip(origin, moved, strict=True)]
    return (spacing[0], spacing[1], spacing[2]), (origin[0], origin[1], origin[2])
