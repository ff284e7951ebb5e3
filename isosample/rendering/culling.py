"""Which pieces of the surfaces a picture needs: those that the view and the clip planes do not rule out.

A ruled out piece changes no bit of the picture. Crossings behind the eye or behind a clip plane tell in which band the
visible part of their ray begins, so a piece is left out only where none of its rays shows anything: beside the picture,
or where the clip planes leave nothing of the box along them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.rendering.tiles import Tile

F64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

# Of the eye's distance and the box's size: the shaders' float32 arithmetic moves a vertex by less than 16 roundings of
# 2^-24 (three products, two sums and the rounded members of the frame block), a quarter of this.
SLACK = 2.0**-18
PADDING = 1.0  # pixels around a tile, for the rasteriser's grid of sub-pixels and the viewport's rounding
DIRECTIONS = 32  # in the image plane, to which the outline of what the clip planes leave is rounded up
NEAREST = 1e-3  # radii of the box: what is nearer to a perspective eye has no outline in the image plane
CONCURRENT = (
    1e-6  # triple product of unit normals: planes that hardly have a corner; others have it within the slack
)
EVERYTHING = np.array([[0.0, 0.0, 0.0, np.inf]])  # a plane outside of which is everything


class Bounds(NamedTuple):
    """Boxes around pieces, local [world].

    Attributes
    ----------
    low, high : (C, 3) float64
        Infinite where nothing is known.
    """

    low: F64
    high: F64


class Pass(NamedTuple):
    """One draw of the meshes.

    Attributes
    ----------
    side : float
        +1 for what is in front of the eye, −1 for what is behind it.
    shown : (C,) bool
        The pieces that it needs.
    """

    side: float
    shown: Bool


class CulledPicture(NamedTuple):
    """What a picture needs of the pieces, and how many it does not.

    Attributes
    ----------
    passes : tuple of Pass
        One per side.
    pieces, outside_view, clipped : int
        All, those beside the picture, and of the others those along whose rays the clip planes leave nothing.
    triangles : int
        Of the pieces that are needed.
    """

    passes: tuple[Pass, ...]
    pieces: int
    outside_view: int
    clipped: int
    triangles: int


class Culling:
    """Rules out pieces of one scene, picture by picture and tile by tile.

    Parameters
    ----------
    chunks : (C,) `CHUNK_DTYPE`
    """

    def __init__(self, chunks: npt.NDArray[np.void]) -> None:
        self._bounds = Bounds(chunks["low"].astype(np.float64), chunks["high"].astype(np.float64))
        self._triangles = chunks["index_count"] // 3

    def picture(
        self, frame: np.void, sides: tuple[float, ...], *, clip: bool, chosen: Bool | None = None
    ) -> CulledPicture:
        """Find the pieces that a picture needs.

        Parameters
        ----------
        frame : struct Frame
        sides : tuple of float
            See `Pass`.
        clip : bool
            Whether clip planes may rule out pieces.
        chosen : (C,) bool, optional
            Pieces of the details that the picture takes, see `DetailChoice`; None: all are.
        """
        slack = slack_of(frame)
        taken = np.ones(len(self._triangles), dtype=bool) if chosen is None else chosen
        width, height = frame["image_size"].tolist()
        view = tile_planes(frame, Tile(0, 0, width, height))
        outline = outline_planes(frame) if clip else None
        passes, beside = [], taken.copy()
        for side in sides:
            outside = ruled_out(self._bounds, view, side, slack)
            beside &= outside
            if outline is not None:
                outside = outside | ruled_out(self._bounds, outline, side, slack)
            passes.append(Pass(side, taken & ~outside))
        shown = np.any([one.shown for one in passes], axis=0)
        return CulledPicture(
            passes=tuple(passes),
            pieces=int(taken.sum()),
            outside_view=int(beside.sum()),
            clipped=int((taken & ~shown & ~beside).sum()),
            triangles=int(self._triangles[shown].sum()),
        )

    def tile(self, frame: np.void, tile: Tile, passes: tuple[Pass, ...]) -> tuple[Pass, ...]:
        """Find what a tile needs of the picture's pieces."""
        width, height = frame["image_size"].tolist()
        if tile.pixel_count == width * height:
            return passes
        planes, slack = tile_planes(frame, tile), slack_of(frame)
        return tuple(
            Pass(one.side, one.shown & ~ruled_out(self._bounds, planes, one.side, slack)) for one in passes
        )


def tile_planes(frame: np.void, tile: Tile) -> F64:
    """(P, 4) planes (normal of unit length, offset) between which the pixels of a tile see; see `ruled_out`.

    Parameters
    ----------
    frame : struct Frame
        As `frame_block` fills it; rounded to float32 as the shaders read it.
    tile : Tile
    """
    width, height = (int(count) for count in frame["image_size"])
    left, right = ((2.0 * x / width - 1.0) for x in (tile.x - PADDING, tile.x + tile.width + PADDING))
    below, above = ((2.0 * y / height - 1.0) for y in (tile.y - PADDING, tile.y + tile.height + PADDING))
    lines = np.array([[1.0, 0.0, right], [-1.0, 0.0, -left], [0.0, 1.0, above], [0.0, -1.0, -below]])
    planes = _planes_of_lines(frame, lines)
    if frame["perspective"] == 0.0:
        return planes
    forward = frame["forward"].astype(np.float64)
    behind = np.array([[*-forward, forward @ frame["eye"].astype(np.float64)]])
    return np.concatenate([planes, behind])


def outline_planes(frame: np.void) -> F64 | None:
    """(P, 4) planes around all rays on which the clip planes leave something of the box; see `ruled_out`.

    Returns
    -------
    planes : (P, 4) float64 or None
        None if that rules out nothing: no clip planes, or what they leave is too near to the eye. One plane that
        rules out everything if they leave nothing.
    """
    if frame["clip_plane_count"] == 0:
        return None
    corners = _corners_of_rest(frame)
    if len(corners) == 0:
        return EVERYTHING
    from_eye = corners - frame["eye"].astype(np.float64)
    depth = np.ones(len(corners))
    if frame["perspective"] != 0.0:
        depth = from_eye @ frame["forward"].astype(np.float64)
        if depth.min() < NEAREST * frame["box_radius"]:
            return None
    right, up = _image_axes(frame)
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    a, b = np.cos(angles), np.sin(angles)
    image = np.stack([from_eye @ right, from_eye @ up]) / depth
    padding = 2.0 * PADDING * (np.abs(a) / frame["image_size"][0] + np.abs(b) / frame["image_size"][1])
    farthest = (np.stack([a, b], axis=1) @ image).max(axis=1) + padding
    return _planes_of_lines(frame, np.stack([a, b, farthest], axis=1))


def ruled_out(bounds: Bounds, planes: F64, side: float, slack: float) -> Bool:
    """(C,) whether a piece lies wholly outside of one of the planes.

    Parameters
    ----------
    bounds : Bounds
    planes : (P, 4) float64
        What is inside has normal · p + offset <= 0, in front of the eye; behind it, drawn through the eye, >= 0.
    side : float
        +1 for what is drawn in front of the eye, −1 for what is behind it.
    slack : float
        How far outside it must be [world]; see `slack_of`.
    """
    outside = np.zeros(len(bounds.low), dtype=bool)
    signed = np.where(np.isinf(planes), planes, side * planes)
    for *normal, offset in signed.tolist():
        nearest = np.full(len(bounds.low), offset)
        for axis, part in enumerate(normal):
            if part != 0.0:
                nearest += part * (bounds.low if part > 0 else bounds.high)[:, axis]
        outside |= nearest > slack
    return outside


def slack_of(frame: np.void) -> float:
    """How far rounding may move a vertex in the shaders [world]."""
    away = float(np.linalg.norm(frame["eye"].astype(np.float64)))
    return SLACK * (away + 2.0 * float(frame["box_radius"]))


def _image_axes(frame: np.void) -> tuple[F64, F64]:
    """Vectors whose product with (position − eye) is the position in the image, times the depth in perspective."""
    right = frame["span_right"].astype(np.float64) * float(frame["inverse_span_right"])
    up = frame["span_up"].astype(np.float64) * float(frame["inverse_span_up"])
    return right, up


def _planes_of_lines(frame: np.void, lines: F64) -> F64:
    """Planes through the eye (or along the rays) and lines a x + b y <= h in the image, of unit normal."""
    right, up = _image_axes(frame)
    a, b, h = (column[:, None] for column in lines.T)
    normals = a * right + b * up
    offsets = np.zeros((len(lines), 1))
    if frame["perspective"] != 0.0:
        normals = normals - h * frame["forward"].astype(np.float64)
    else:
        offsets = -h
    offsets = offsets - (normals @ frame["eye"].astype(np.float64))[:, None]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    planes: F64 = np.concatenate([normals, offsets], axis=1) / length
    return planes


def _corners_of_rest(frame: np.void) -> F64:
    """(N, 3) corners of what the clip planes leave of the box, and a little more, local [world]."""
    rows = np.stack([frame[f"unit_row_{axis}"][:3].astype(np.float64) for axis in "xyz"])
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    halves = np.full((3, 1), 0.5)
    sides = np.concatenate([np.concatenate([s * rows, halves], axis=1) / lengths for s in (1.0, -1.0)])
    cuts = frame["clip_planes"][: int(frame["clip_plane_count"])].astype(np.float64)
    half_spaces = np.concatenate([sides, cuts])
    slack = slack_of(frame)
    half_spaces[:, 3] += 2.0 * slack  # kept where normal · p + offset >= 0
    first, second, third = np.array(
        [(i, j, k) for k in range(len(half_spaces)) for j in range(k) for i in range(j)]
    ).T
    normals, offsets = half_spaces[:, :3], half_spaces[:, 3]
    across = np.cross(normals[second], normals[third])
    determinant = (normals[first] * across).sum(axis=1)
    met = np.abs(determinant) > CONCURRENT
    first, second, third, across = first[met], second[met], third[met], across[met]
    points = (
        offsets[first, None] * across
        + offsets[second, None] * np.cross(normals[third], normals[first])
        + offsets[third, None] * np.cross(normals[first], normals[second])
    ) / -determinant[met, None]
    kept = (points @ normals.T + offsets >= -slack).all(axis=1)
    corners: F64 = points[kept]
    return corners
