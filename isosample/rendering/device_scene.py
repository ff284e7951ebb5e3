"""A scene on the GPU: meshes, bands, levels and boundary, drawn by every pass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError
from isosample.gl.context import drawing_into, limits
from isosample.gl.memory import with_room
from isosample.gl.ownership import Owner
from isosample.rendering.device_meshes import CURVED, FLAT, DeviceMeshes
from isosample.rendering.frame import shared_constants, storage_dtype
from isosample.rendering.supplies import storage_bindings

if TYPE_CHECKING:
    from collections.abc import Sequence

    import moderngl

    from isosample.rendering.culling import Pass
    from isosample.rendering.scene import Scene
    from isosample.rendering.tiles import Tile


REMEDY = "Crop the volume, or use fewer isovalues."
PADDING = {"start": "3x4", "face": "1x4", "values": "4x4"}  # of a member that a program does not read


class DeviceScene:
    """Buffers of one scene.

    Parameters
    ----------
    ctx : moderngl.Context
    scene : Scene

    Raises
    ------
    CapacityError
        If the scene has more levels or larger tables than the device takes, or has room for.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene) -> None:
        _check_tables(scene, limits(ctx).storage_block_bytes, ctx.info["GL_RENDERER"])
        self._ctx = ctx
        self._mask_count = 0 if scene.mask is None else len(scene.mask)
        self._mask_arrays: dict[int, moderngl.VertexArray] = {}
        with Owner() as made:
            self.meshes = made.keep(DeviceMeshes(ctx, scene))
            self._mask = None if scene.mask is None else made.keep(_table(ctx, scene.mask))
            self._table = made.keep(_table_image(ctx, scene))
            self._boundary = made.keep(_table(ctx, scene.boundary))
            self._made = made.pop_all()
        self.face_band, self.faces_seen = _faces(scene)
        shown = np.any(scene.level_optics[..., 3] != 0, axis=0)  # whether there are impulses, and sheets
        # Of the resolve pass: what no pixel needs is not compiled.
        self.constants = {
            "SMOOTH_FACES": int(scene.face_kernel is not None),
            "EXTINCTION": int(np.any(scene.band_optics[..., 3] > 0)),
            "LEVEL_LIGHT": 2 if shown[1] else int(shown[0]),
        }

    def bind(self) -> None:
        """Bind the tables that the resolve pass reads."""
        self._table.bind_to_image(shared_constants()["BINDING_TABLE"], read=True, write=False)
        self._boundary.bind_to_storage_buffer(storage_bindings()["Boundary"])

    @property
    def has_mask(self) -> bool:
        """Whether the border of the valid cells is drawn too."""
        return self._mask is not None

    def draw(
        self,
        program: moderngl.Program,
        mask_program: moderngl.Program | None,
        target: moderngl.Framebuffer,
        tile: Tile,
        passes: Sequence[Pass],
        budget_bytes: int,
        *,
        curved: bool = False,
    ) -> None:
        """Rasterise the levels, and the border of the valid cells, within a tile of a framebuffer.

        Parameters
        ----------
        program : moderngl.Program
            With ``build.vert``; must stay alive as long as this object.
        mask_program : moderngl.Program or None
            With ``build_mask.vert``; needed if the scene has a mask.
        target : moderngl.Framebuffer
            Without attachments: with a colour attachment llvmpipe loses fragments in silence.
        tile : Tile
        passes : sequence of Pass
            What is drawn in front of the eye, and what behind it.
        budget_bytes : int
            Vertex data on the GPU at once.
        curved : bool
            Which residuals a program gets that reads them: of the curved triangles, or of the flat ones.

        Raises
        ------
        CapacityError
            If one piece alone exceeds the budget.
        """
        residual = residual_column(curved) if "residual" in program else None
        needed = np.any([one.shown for one in passes], axis=0)
        target.scissor = (tile.x, tile.y, tile.width, tile.height)
        with drawing_into(self._ctx, target):
            for batch in self.meshes.batches(needed, budget_bytes, residual):
                for one in passes:
                    program["side"] = one.side
                    batch.draw(program, one.shown)
            if self._mask is None or mask_program is None:
                return
            for one in passes:
                mask_program["side"] = one.side
                self._mask_vertex_array(mask_program).render(vertices=6, instances=self._mask_count)

    def release(self) -> None:
        """Free every buffer."""
        for vertex_array in self._mask_arrays.values():
            vertex_array.release()
        self._mask_arrays = {}
        self._made.close()

    def _mask_vertex_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        key = id(program)
        if key not in self._mask_arrays:
            named = {"start": "3f", "face": "1i", "values": "4f"}
            used = [name for name in named if name in program]
            layout = " ".join(form if name in program else PADDING[name] for name, form in named.items())
            self._mask_arrays[key] = self._ctx.vertex_array(program, [(self._mask, f"{layout} /i", *used)])
        return self._mask_arrays[key]


def residual_column(curved: bool) -> int:
    """Column of the residuals that belongs to curved or flat triangles."""
    return CURVED if curved else FLAT


def _check_tables(scene: Scene, block_bytes: int, renderer: str) -> None:
    level_limit = shared_constants()["MAX_LEVELS"] - 1
    if len(scene.level_optics) > level_limit:
        raise CapacityError(
            f"{len(scene.level_optics)} isovalues are more than {level_limit}; use fewer per slope."
        )
    if scene.boundary.nbytes > block_bytes:
        raise CapacityError(
            f"the volume's faces take {scene.boundary.nbytes} bytes; storage blocks of {renderer} hold "
            f"{block_bytes}. Crop the volume or use another driver."
        )


def _band_table(scene: Scene) -> npt.NDArray[np.void]:
    """(K + 1,) Band for upload."""
    table = np.zeros(len(scene.band_values), dtype=storage_dtype("Band"))
    table["low"], table["high"] = scene.band_optics[:, 0], scene.band_optics[:, 1]
    table["value_low"], table["value_high"] = scene.band_values[:, 0], scene.band_values[:, 1]
    table["extinction_max"] = scene.band_optics[:, :, 3].max(axis=1)
    width = scene.band_values[:, 1] - scene.band_values[:, 0]
    table["inverse_width"] = np.divide(1.0, width, out=np.zeros_like(width), where=width > 0)
    return table


def _table_image(ctx: moderngl.Context, scene: Scene) -> moderngl.Texture:
    """Bands, each with the level at its upper end, as texels."""
    constants = shared_constants()
    row, texels = constants["TABLE_ROW"], constants["TABLE_TEXELS"]
    bands, levels = _band_table(scene), scene.level_optics
    rows = -(-len(bands) // row)
    content = np.zeros((rows * row, texels, 4), dtype=np.float32)
    content[: len(bands), :3] = bands.view(np.float32).reshape(-1, 3, 4)
    content[: len(levels), 3:] = levels
    image = ctx.texture((row * texels, rows), 4, content, dtype="f4")
    return with_room(ctx, image, "a table of the scene", content.nbytes, REMEDY)


def _faces(scene: Scene) -> tuple[int, bool]:
    """What the faces of the box show.

    Returns
    -------
    band : int
        The band in which all their values lie, if nothing is visible in it; else -1.
    seen : bool
        Whether something may be visible in one of the bands in which they lie.
    """
    if scene.mask is not None or scene.face_kernel is not None or not scene.boundary.size:
        return -1, True
    inner = scene.band_values[:-1, 1].astype(np.float32)
    ends = np.array([scene.boundary.min(), scene.boundary.max()])
    if not np.all(np.isfinite(ends)):
        return -1, True
    first, last = np.searchsorted(inner, ends, side="right").tolist()
    seen = bool(np.any(scene.band_optics[first : last + 1, :, 3] > 0))
    return (first if first == last and not seen else -1), seen


def _table(ctx: moderngl.Context, array: npt.NDArray[Any]) -> moderngl.Buffer:
    """Buffer of an array, or of one zero element in place of an empty one: OpenGL has no empty buffers."""
    content = array if array.size else np.zeros(1, dtype=array.dtype)
    return with_room(ctx, ctx.buffer(content), "a table of the scene", content.nbytes, REMEDY)
