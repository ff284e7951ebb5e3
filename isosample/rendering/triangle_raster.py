"""The build pass by compute shaders: rasterises small triangles, in place of the graphics pipeline.

A software renderer sets triangles up one after the other, on one processor; compute shaders take several at a time, on
all of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError
from isosample.gl.context import is_software, limits
from isosample.gl.memory import with_room
from isosample.rendering.chunk_stream import VERTEX_DTYPE
from isosample.rendering.frame import shared_constants
from isosample.rendering.group_shares import GroupShares
from isosample.rendering.mesh_batch import INDEX_BYTES
from isosample.rendering.settings import BuildStage
from isosample.rendering.stage import run_interleaved
from isosample.rendering.supplies import project_supply, raster_supply

if TYPE_CHECKING:
    from collections.abc import Sequence

    import moderngl

    from isosample.rendering.culling import Pass
    from isosample.rendering.group_shares import Call
    from isosample.rendering.mesh_batch import Batch
    from isosample.rendering.pass_resources import PassResources
    from isosample.rendering.picture_frame import PictureFrame
    from isosample.volume.geometry import GridGeometry

Bool = npt.NDArray[np.bool_]

SUBPIXEL_BITS = 8  # of the grid of the corners: LARGEST_TRIANGLE of the shaders goes with it
WINDOW_SLACK = 64  # items: a window may begin at so many, less one, before the first that is read
LARGEST_CELL = 24.0  # of the volume [pixel]: the triangles of larger ones the pipeline fills faster
RESTING = 8  # pictures that are not tried after one that was tried in vain
SAME_SIZE = 0.99  # cells are as large: those of a turning camera differ by rounding
COMPONENTS = {"places": 2, "corners": 4, "positions": 4}  # float32 numbers per vertex
REMEDY = "Render with RenderSettings(build_stage=BuildStage.FRAGMENT), which needs none."


class TriangleRaster:
    """Rasterises the meshes of one scene.

    Parameters
    ----------
    shared : PassResources
    geometry : GridGeometry
        Of the scene.
    """

    def __init__(self, shared: PassResources, geometry: GridGeometry) -> None:
        self._shared = shared
        self._geometry = geometry
        self._images: dict[str, moderngl.Texture] = {}
        self._vertices, self._triangles = (GroupShares(shared.ctx, REMEDY) for _ in range(2))
        self._projected: tuple[Batch, PictureFrame] | None = None  # whose places the images have
        self._resting = 0  # pictures that are not tried,
        self._too_large = np.inf  # with cells as large as that [pixel]

    def release(self) -> None:
        """Free the images of the vertices, and the shares of the work groups."""
        self._vertices.release()
        self._triangles.release()
        for image in self._images.values():
            image.release()
        self._images, self._projected = {}, None

    @property
    def size_bytes(self) -> int:
        """Memory of the images and of the shares."""
        shares = self._vertices.size_bytes + self._triangles.size_bytes
        row = 4 * shared_constants()["VERTEX_ROW"]
        return shares + sum(row * COMPONENTS[name] * image.height for name, image in self._images.items())

    def begin_picture(self, frame: PictureFrame) -> None:
        """Leave a picture to the pipeline if one before, with cells that were not larger, was tried in vain."""
        asked = frame.settings.build_stage is BuildStage.COMPUTE
        if not self._resting or asked or not self.suits(frame):
            return
        if self._largest_cell(frame) >= SAME_SIZE * self._too_large:
            self._resting -= 1
            frame.unsuited = True

    def rest(self, frame: PictureFrame) -> None:
        """Leave the rest of a picture to the pipeline, and those like it that follow."""
        frame.unsuited = True
        before = self._too_large if self._resting else np.inf
        self._resting, self._too_large = RESTING, min(before, self._largest_cell(frame))

    def suits(self, frame: PictureFrame) -> bool:
        """Whether a picture is to be tried: by what is asked for, and by the size of the volume's cells in it.

        Where triangles turn out to be too large or to reach behind the eye, the counter ``unsuited`` tells afterwards.
        """
        asked = frame.settings.build_stage
        if (
            asked is BuildStage.FRAGMENT
            or frame.unsuited
            or self._shared.scene.has_mask
            or len(frame.passes) > 1
        ):
            return False
        if asked is BuildStage.AUTO and not is_software(self._shared.ctx):
            return False
        return asked is BuildStage.COMPUTE or self._largest_cell(frame) <= LARGEST_CELL

    def build(self, frame: PictureFrame, passes: Sequence[Pass], *, slots: int = 0) -> bool:
        """Append all crossings of a tile, which is bound, to its lists; False where there is no room for that.

        Parameters
        ----------
        frame : PictureFrame
        passes : sequence of Pass
            Of the tile.
        slots : int
            How many a pixel has; 0: the lists are linked.

        Raises
        ------
        CapacityError
            If the driver has no room, and compute shaders were asked for.
        """
        shown = np.any([one.shown for one in passes], axis=0)
        budget = frame.settings.mesh_budget_bytes
        for batch in self._shared.scene.meshes.batches(shown, budget, frame.residual):
            try:
                if not self._has_room(batch, frame):
                    return False
                self._build(batch, frame, shown, slots)
            except CapacityError:
                if frame.settings.build_stage is BuildStage.COMPUTE:
                    raise
                return False
        return True

    def _build(self, batch: Batch, frame: PictureFrame, shown: Bool, slots: int) -> None:
        """Project what a batch has of a picture, unless that is done already, and rasterise what it has of a tile."""
        self._bind_images()  # also where they are projected already: others may have drawn since the last tile
        if self._projected is None or self._projected[0] is not batch or self._projected[1] is not frame:
            self._project(batch, frame)
            self._projected = (batch, frame)
        self._rasterise(batch, frame, shown, slots)

    def _largest_cell(self, frame: PictureFrame) -> float:
        """Edge of the volume's nearest cell in the picture [pixel]; infinite where the box reaches behind the eye."""
        block = frame.block[0]
        height = float(np.linalg.norm(block["span_up"]))
        box = self._geometry.box
        nearest = 1.0
        if block["perspective"] != 0.0:
            centre = float(-(block["eye"] @ block["forward"]))
            nearest = centre - box.radius
        if nearest <= 0.0:
            return float("inf")
        pixels_per_world = 0.5 * float(block["image_size"][1]) / (height * nearest)
        return max(self._geometry.spacing) * pixels_per_world

    def _has_room(self, batch: Batch, frame: PictureFrame) -> bool:
        """Make the images large enough for a batch, if they and its buffers can be as large as that.

        Raises
        ------
        CapacityError
            If the driver has no room.
        """
        row = shared_constants()["VERTEX_ROW"]
        rows = -(-max(batch.vertex_count, 1) // row)
        names = [name for name in COMPONENTS if name != "positions" or frame.curved]
        size = sum(4 * COMPONENTS[name] for name in names) * row * rows
        allowed = limits(self._shared.ctx)
        if rows > allowed.texture_size or batch.residual_bytes > allowed.storage_block_bytes:
            return False
        for name in names:
            held = self._images.get(name)
            if held is None or held.height < rows:
                if held is not None:
                    self._images.pop(name).release()
                self._projected = None
                image = self._shared.ctx.texture((row, rows), COMPONENTS[name], dtype="f4")
                self._images[name] = with_room(self._shared.ctx, image, "projected vertices", size, REMEDY)
        return True

    def _project(self, batch: Batch, frame: PictureFrame) -> None:
        """Project the vertices of what a batch has of a picture, other tiles of it included."""
        shown = np.any([one.shown for one in frame.passes], axis=0)
        first, count = batch.vertex_runs(shown)
        calls = self._vertices.fill(
            first, count, np.zeros_like(first), self._most_items(VERTEX_DTYPE.itemsize)
        )
        self._vertices.bind()
        program = self._shared.programs.compute("project.comp", project_supply(), CURVED=int(frame.curved))
        for call in calls:
            binding = shared_constants()["BINDING_VERTICES"]
            program["window_vertex"] = batch.bind_vertices(binding, *call.window)
            self._run(program, call)
        self._shared.ctx.memory_barrier()

    def _rasterise(self, batch: Batch, frame: PictureFrame, shown: Bool, slots: int) -> None:
        """Rasterise the triangles of a batch."""
        constants = {
            **frame.build_constants,
            **(self._shared.slots if slots else self._shared.pool).constants,
            "PERSPECTIVE": int(frame.block[0]["perspective"] != 0.0),
            "SUBPIXEL_BITS": SUBPIXEL_BITS,
            "SLOTS": int(slots > 0),
        }
        level, first, count = batch.runs(shown)
        calls = self._triangles.fill(first // 3, count // 3, level, self._most_items(3 * INDEX_BYTES))
        self._triangles.bind()
        batch.bind_residuals(shared_constants()["BINDING_RESIDUALS"])
        program = self._shared.programs.compute("build.comp", raster_supply(), **constants)
        if slots:
            program["slot_count"] = slots
        for call in calls:
            binding = shared_constants()["BINDING_INDICES"]
            program["window_index"] = batch.bind_indices(binding, *(3 * part for part in call.window))
            self._run(program, call)
        self._shared.ctx.memory_barrier()  # the next batch is projected into the same images

    def _run(self, program: moderngl.ComputeShader, call: Call) -> None:
        program["first_share"], program["share_count"] = call.first, call.groups
        run_interleaved(self._shared.ctx, program, call.groups)

    def _most_items(self, item: int) -> int:
        """Items of so many bytes that one call can read: a storage block holds them, wherever in it the first is."""
        return limits(self._shared.ctx).storage_block_bytes // item - WINDOW_SLACK

    def _bind_images(self) -> None:
        for name, image in self._images.items():
            image.bind_to_image(shared_constants()[f"BINDING_{name.upper()}"], read=True, write=True)
