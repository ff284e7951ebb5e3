"""Folders of DICOM slices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from pathlib import Path

SERIES = "1.2.826.0.1.3680043.2.1125.1"


def write_series(
    folder: Path, *, heights: list[float], uid: str = SERIES, shift: float = 0.0, first: int = 0
) -> np.ndarray:
    """Write one slice per height [mm] and return the samples (Z, Y, X)."""
    sitk = pytest.importorskip("SimpleITK")
    folder.mkdir(exist_ok=True)
    samples = np.random.default_rng(9).integers(0, 1000, (len(heights), 6, 5)).astype(np.int16)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k, height in enumerate(heights):
        image = sitk.GetImageFromArray(samples[k])
        image.SetSpacing((0.5, 0.75))
        entries = {
            "0008|0016": "1.2.840.10008.5.1.4.1.1.2",
            "0008|0018": f"{uid}.{k + 1}",
            "0008|0060": "CT",
            "0008|103e": "phantom",
            "0020|000e": uid,
            "0020|0013": str(k + 1),
            "0020|0032": f"{1 + shift * k}\\2\\{height}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
        }
        for key, value in entries.items():
            image.SetMetaData(key, value)
        writer.SetFileName(str(folder / f"{first + (7 * k) % 10:03d}.dcm"))  # names out of order
        writer.Execute(image)
    return samples
