"""What a picture is asked to look like, besides the scene and the camera."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.defaults import DEFAULT_MESH_BUDGET_BYTES, DEFAULT_SCREEN_ERROR, MAX_CLIP_PLANES
from isosample.errors import InputError
from isosample.integral.segment_rule import SegmentRule as SegmentRule

if TYPE_CHECKING:
    from collections.abc import Sequence

DEFAULT_FRAGMENT_BUDGET_BYTES = 512 << 20
DEFAULT_MIN_TRANSMITTANCE = (
    2.0**-20
)  # what is left behind changes a pixel by less than 1e-6 of the brightest colour


class BuildStage(enum.Enum):
    """Shader stage that rasterises the surfaces.

    FRAGMENT is the graphics pipeline. COMPUTE are compute shaders, as long as all triangles in the picture lie in front
    of the eye and each in a box of 120 pixels, and no cells are masked; else FRAGMENT takes its place, for the tile
    where that is found and those that follow it (`FrameStatistics.compute_tiles`). Projected vertices take 24 bytes
    each, of curved triangles 40, beside the mesh budget, and work groups 12 for every 64 triangles or vertices
    (`FrameStatistics.projected_bytes`).
    Where they rasterise, lists are in slots of their pixels (`FrameStatistics.slot_tiles`) as long as none is longer
    than 256 or `sort_capacity`, if `stage` is AUTO and the fragment budget has room for an eighth of the picture at a
    time; from the first longer list on, or where too many are no chains, those of the picture are linked.
    AUTO is COMPUTE on software renderers where cells of the volume are at most 24 pixels large, else FRAGMENT. After a
    picture that did not suit COMPUTE, or slots, AUTO leaves up to 8 like it to FRAGMENT, or to linked lists, at once.
    """

    AUTO = "auto"
    FRAGMENT = "fragment"
    COMPUTE = "compute"


class ResolveStage(enum.Enum):
    """Shader stage of the resolve pass.

    AUTO takes FRAGMENT on software renderers and COMPUTE on GPUs; for lists in slots (see `BuildStage`) always COMPUTE.
    """

    AUTO = "auto"
    FRAGMENT = "fragment"
    COMPUTE = "compute"


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """Blinn–Phong coefficients for a white light at the eye; all unitless and >= 0."""

    ambient: float = 0.35
    diffuse: float = 0.65
    specular: float = 0.2
    shininess: float = 32.0

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "shininess"):
            number = getattr(self, name)
            if not (math.isfinite(number) and number >= 0):
                raise InputError(f"material {name} {number!r} must be a finite number >= 0.")

    @property
    def factors(self) -> tuple[float, float, float, float]:
        """Ambient, diffuse, specular, shininess: as `integral.shading` and the shaders have them."""
        return (self.ambient, self.diffuse, self.specular, self.shininess)


@dataclass(frozen=True, slots=True)
class ClipPlane:
    """A plane nx·x + ny·y + nz·z + d = 0 in world space; the side where that is >= 0 is kept."""

    nx: float
    ny: float
    nz: float
    d: float

    def __post_init__(self) -> None:
        numbers = (self.nx, self.ny, self.nz, self.d)
        if not all(math.isfinite(number) for number in numbers) or not any(numbers[:3]):
            raise InputError(f"clip plane {numbers} needs four finite numbers and a normal that is not zero.")

    def about(
        self, centre: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    ) -> tuple[float, float, float, float]:
        """The plane with a unit normal, for positions relative to `centre`: (nx, ny, nz, d)."""
        normal = np.array([self.nx, self.ny, self.nz])
        length = math.hypot(*normal)  # neither under- nor overflows
        unit = normal / length
        return (float(unit[0]), float(unit[1]), float(unit[2]), float(self.d / length + unit @ centre))


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSettings:
    """Settings of one picture.

    Attributes
    ----------
    segment : SegmentRule
    curved : bool or None
        Whether every crossing is moved from its triangle onto the curved surface through the vertices; None:
        if the surfaces are those of a smooth reconstruction.
    screen_error : float
        How far the triangles of coarser meshes may be from their isosurface [pixel], where the scene has details: each
        piece is shown at the coarsest detail that is not farther away. 0: the finest.
    material : Material or None
        None: colours as they are; else lit.
    background : 4 floats
        Straight linear RGBA behind the volume, each in [0, 1]; transparent by default.
    clip_planes : tuple of ClipPlane
        At most 8; what lies on the kept side of all of them is shown.
    build_stage : BuildStage
    stage : ResolveStage
    fragment_budget_bytes : int
        Memory for the fragment lists; larger pictures are rendered in tiles. At least one pixel's list must
        fit.
    mesh_budget_bytes : int
        Memory for the meshes on the GPU; larger ones are uploaded, drawn and freed in batches, in every pass
        and tile. At least one piece, (isovalue, brick), must fit.
    min_transmittance : float
        A ray ends where less than this share of the light behind would come through; 0 never.
    sort_capacity : int
        Lists up to this length may be sorted in registers or in a local array; longer ones are sorted on their links.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    segment: SegmentRule = SegmentRule.CUBIC
    curved: bool | None = None
    screen_error: float = DEFAULT_SCREEN_ERROR
    material: Material | None = None
    background: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    clip_planes: tuple[ClipPlane, ...] = ()
    build_stage: BuildStage = BuildStage.AUTO
    stage: ResolveStage = ResolveStage.AUTO
    fragment_budget_bytes: int = DEFAULT_FRAGMENT_BUDGET_BYTES
    mesh_budget_bytes: int = DEFAULT_MESH_BUDGET_BYTES
    min_transmittance: float = DEFAULT_MIN_TRANSMITTANCE
    sort_capacity: int = 256

    def __post_init__(self) -> None:
        if len(self.background) != 4 or not all(0.0 <= part <= 1.0 for part in self.background):
            raise InputError(f"background {self.background} must be R, G, B, A, each between 0 and 1.")
        if len(self.clip_planes) > MAX_CLIP_PLANES:
            raise InputError(
                f"{len(self.clip_planes)} clip planes are given; at most {MAX_CLIP_PLANES} are possible."
            )
        if not (math.isfinite(self.screen_error) and self.screen_error >= 0.0):
            raise InputError(
                f"screen_error {self.screen_error!r} must be a number of pixels >= 0, for instance 0.25."
            )
        if not 0.0 <= self.min_transmittance < 1.0:
            raise InputError(f"min_transmittance {self.min_transmittance} must be at least 0 and below 1.")
        if self.fragment_budget_bytes < 1 << 16:
            raise InputError(
                f"a fragment budget of {self.fragment_budget_bytes} bytes is too small; give 64 KiB or more."
            )
        if self.mesh_budget_bytes < 1 << 16:
            raise InputError(
                f"a mesh budget of {self.mesh_budget_bytes} bytes is too small; give 64 KiB or more."
            )
        if self.sort_capacity not in range(1, 257):
            raise InputError(f"sort_capacity {self.sort_capacity!r} must be a whole number from 1 to 256.")
        planes: tuple[object, ...] = self.clip_planes
        for plane in planes:
            if not isinstance(plane, ClipPlane):
                raise InputError(f"clip plane {plane!r} must be a ClipPlane(nx, ny, nz, d).")

    @property
    def background_premultiplied(self) -> tuple[float, float, float, float]:
        """The background as the picture stores it."""
        red, green, blue, alpha = self.background
        return (red * alpha, green * alpha, blue * alpha, alpha)


def check_size(size: Sequence[object]) -> tuple[int, int]:
    """Return (width, height) if both are whole numbers >= 1, else raise `InputError`."""
    if not isinstance(size, (tuple, list)):
        raise InputError(f"picture size {size!r} must be two whole numbers >= 1 (width, height).")
    whole = [int(n) for n in size if isinstance(n, (int, np.integer)) and n >= 1]
    if len(size) != 2 or len(whole) != 2:
        raise InputError(f"picture size {size!r} must be two whole numbers >= 1 (width, height).")
    return (whole[0], whole[1])
