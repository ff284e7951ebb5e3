"""The lists of the A-buffer read back: what the resolve pass saw, for tests and diagnosis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.rendering.frame import shared_constants

if TYPE_CHECKING:
    from isosample.rendering.tiles import Tile

I64 = npt.NDArray[np.int64]
U32 = npt.NDArray[np.uint32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FragmentLists:
    """Fragments of some of the pixels of a picture, sorted by pixel, then by distance and in the order of travel.

    Attributes
    ----------
    covered : (P,) int64
        The pixels, ascending, each as row from the top · width + column.
    pixels : (N,) int64
        Of every fragment.
    distances : (N,) float32
        Along the ray [world].
    levels : (N,) int64
        Level index; `DOMAIN_LEVEL` of the shaders for the border of the valid cells.
    rising : (N,) bool
        Whether the value rises along the ray (or the ray enters the valid cells).
    slopes : (N,) float32
        Absolute derivative of the normalised value along the ray, times the box's radius; the tolerance of the
        value [normalised] on the border of the valid cells.
    residuals : (N,) float32
        How far the field is from the isovalue near the fragment [normalised]; the value [normalised] on the
        border of the valid cells.
    """

    covered: I64
    pixels: I64
    distances: npt.NDArray[np.float32]
    levels: I64
    rising: npt.NDArray[np.bool_]
    slopes: npt.NDArray[np.float32]
    residuals: npt.NDArray[np.float32]


def decode_lists(
    tile: Tile, size: tuple[int, int], heads: U32, nodes: npt.NDArray[np.void], *, start: float = 0.0
) -> FragmentLists:
    """Fragments of all lists of a tile.

    Parameters
    ----------
    tile : Tile
    size : (width, height)
        Pixels of the whole picture.
    heads : (tile.height · tile.width,) uint32
        First node of every pixel's list, rows counted upwards.
    nodes : (M,) struct Node of ``shaders/lib/layouts.glsl``
        All that the lists hold, built with RESIDUAL. A list that leads out of them is cut there, and one that leads in
        circles stops the search: other than M fragments are then found.
    start : float
        Distance from the eye at which the distances of the nodes begin [world].
    """
    y, x = np.divmod(np.arange(len(heads)), tile.width)
    pixels = (size[1] - 1 - tile.y - y) * size[0] + tile.x + x
    covered, current = np.sort(pixels), heads.astype(np.int64)
    found_pixels, found_nodes, left = [], [], len(nodes)
    while left >= 0 and len(current := current[alive := current < len(nodes)]):
        pixels, left = pixels[alive], left - len(current)
        found_pixels.append(pixels)
        found_nodes.append(current)
        current = nodes["next_index"][current].astype(np.int64)
    empty = np.empty(0, dtype=np.int64)
    pixels, picked = (np.concatenate([empty, *parts]) for parts in (found_pixels, found_nodes))
    surface = nodes["surface"][picked]
    level = (surface & shared_constants()["LEVEL_MASK"]).astype(np.int64)
    rising = (surface & shared_constants()["RISING_BIT"]) != 0
    travel = np.where(rising, level, -level)  # as `tie_precedes` of shaders/pass/sort_lists.glsl
    order = np.lexsort((nodes["normal"][picked], surface, travel, rising, nodes["distance"][picked], pixels))
    picked, surface = picked[order], surface[order]
    return FragmentLists(
        covered=covered,
        pixels=pixels[order],
        distances=nodes["distance"][picked] + np.float32(start),
        levels=level[order],
        rising=rising[order],
        slopes=(surface >> 16).astype(np.uint16).view(np.float16).astype(np.float32),
        residuals=np.ascontiguousarray(nodes["normal"][picked]).view(np.float32),
    )
