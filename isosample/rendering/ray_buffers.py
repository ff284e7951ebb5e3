"""What the ray caster and its shaders tell each other, besides textures: blocks, counters, states of rays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.gl.ownership import Owner
from isosample.rendering.frame import shared_constants, storage_dtype, uniform_dtype
from isosample.rendering.supplies import storage_bindings

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt


class RayBuffers:
    """Buffers of a ray caster.

    Parameters
    ----------
    ctx : moderngl.Context
    ray_count : int
        Rays whose states are kept at once.
    """

    def __init__(self, ctx: moderngl.Context, ray_count: int) -> None:
        state_bytes = ray_count * storage_dtype("RayState").itemsize
        with Owner() as made:
            self._frame = made.keep(ctx.buffer(reserve=uniform_dtype("Frame").itemsize))
            self._raycast = made.keep(ctx.buffer(reserve=uniform_dtype("Raycast").itemsize))
            self._counters = made.keep(ctx.buffer(reserve=storage_dtype("RayCounters").itemsize))
            self._states = made.keep(ctx.buffer(reserve=state_bytes))
            self._states.clear()
            self._made = made.pop_all()

    def write(self, frame: npt.NDArray[np.void], raycast: npt.NDArray[np.void]) -> None:
        """Write the uniform blocks, structs Frame and Raycast, and bind all buffers."""
        self._frame.write(frame.tobytes())
        self._raycast.write(raycast.tobytes())
        self._frame.bind_to_uniform_block(shared_constants()["BINDING_FRAME"])
        self._raycast.bind_to_uniform_block(shared_constants()["BINDING_RAYCAST"])
        self._counters.bind_to_storage_buffer(storage_bindings()["RayCounterBlock"])
        self._states.bind_to_storage_buffer(storage_bindings()["RayStates"])

    def clear_counters(self) -> None:
        """Count from 0."""
        self._counters.clear()

    def counters(self) -> np.void:
        """Return a struct RayCounters of what was counted since."""
        found: np.void = np.frombuffer(self._counters.read(), dtype=storage_dtype("RayCounters"))[0]
        return found

    def release(self) -> None:
        """Free every buffer."""
        self._made.close()
