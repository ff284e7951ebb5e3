"""What every pass of the A-buffer uses on the GPU: the scene, the lists, the programs and the frame block."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.ownership import Owner
from isosample.gl.timer import StageTimer
from isosample.rendering.crossing_slots import CrossingSlots
from isosample.rendering.device_scene import DeviceScene
from isosample.rendering.fragment_pool import FragmentPool
from isosample.rendering.frame import set_tile, shared_constants, uniform_dtype
from isosample.rendering.programs import Programs

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.picture_frame import PictureFrame
    from isosample.rendering.scene import Scene
    from isosample.rendering.tiles import Tile


class PassResources:
    """Made once per scene, shared by the passes.

    Parameters
    ----------
    ctx : moderngl.Context
    scene : Scene

    Attributes
    ----------
    timer : StageTimer
    programs : Programs
    scene : DeviceScene
    pool : FragmentPool
    slots : CrossingSlots

    Raises
    ------
    CapacityError
        If the scene has more levels or larger tables than the device takes.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene) -> None:
        self.ctx = ctx
        self.timer = StageTimer(ctx)
        with Owner() as made:
            self.programs = made.keep(Programs(ctx))
            with self.timer.stage("upload"):
                self.scene = made.keep(DeviceScene(ctx, scene))
            self.pool = made.keep(FragmentPool(ctx))
            self.slots = made.keep(CrossingSlots(ctx))
            self._frame_buffer = made.keep(ctx.buffer(reserve=uniform_dtype("Frame").itemsize))
            self._made = made.pop_all()

    def bind(self, tile: Tile, frame: PictureFrame) -> None:
        """Write the frame block and bind every buffer."""
        set_tile(frame.block, tile, self.pool.capacity)
        self._frame_buffer.write(frame.block.tobytes())
        self._frame_buffer.bind_to_uniform_block(shared_constants()["BINDING_FRAME"])
        self.scene.bind()
        self.pool.bind()
        self.slots.bind()

    def release(self) -> None:
        """Free everything on the GPU."""
        self._made.close()
