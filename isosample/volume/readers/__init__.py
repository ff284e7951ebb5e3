"""Readers of volume files, one module per family of formats."""

from __future__ import annotations

from isosample.volume.readers.opening import open_volume

__all__ = ["open_volume"]
