"""Values and gradients of `shaders/pass/field.glsl` at places, through a small compute program."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.gl.program import compile_compute
from isosample.gl.shader_source import assemble_shader
from isosample.rendering.device_volume import DeviceVolume
from isosample.rendering.frame import shared_constants, uniform_dtype
from isosample.rendering.raycast_settings import Filtering
from isosample.rendering.scene import ValueScale
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl
    import numpy.typing as npt

    from isosample.volume.grid import Volume

    F32 = npt.NDArray[np.float32]

GROUP = 64
ENTRY = f"""#version 450 core
#ifndef RECONSTRUCTION
#error
#endif
#ifndef FILTERING
#error
#endif
layout(local_size_x = {GROUP}) in;
#include "lib/layouts.glsl"
#include "lib/ray.glsl"
layout(std140, binding = BINDING_RAYCAST) uniform RaycastBlock {{ Raycast raycast; }};
layout(std430, binding = 0) readonly buffer Places {{ vec4 places[]; }};
layout(std430, binding = 1) writeonly buffer Found {{ vec4 found[]; }};
#include "pass/field.glsl"
void main() {{
    uint n = gl_GlobalInvocationID.x;
    if (n < places.length()) found[n] = vec4(field_gradient(places[n].xyz), field(places[n].xyz));
}}
"""


def probe(
    gl: moderngl.Context,
    volume: Volume,
    places: F32,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    filtering: Filtering = Filtering.SHADER,
    *,
    scale: ValueScale | None = None,
    root: Path | None = None,
) -> tuple[F32, F32]:
    """(N,) normalised values and (N, 3) gradients per sample step at places (N, 3), index x, y, z."""
    chosen = scale or ValueScale(*volume.value_range)
    device = DeviceVolume(gl, volume, chosen, reconstruction, filtering)
    block = np.zeros(1, dtype=uniform_dtype("Raycast"))
    device.fill(block[0])
    program = compile_compute(
        gl, assemble_shader(ENTRY, "field.comp", device.constants(), root), "field.comp"
    )
    padded = np.concatenate([places, np.zeros((len(places), 1), np.float32)], axis=1)
    uniform, given, found = gl.buffer(block), gl.buffer(padded), gl.buffer(reserve=padded.nbytes)
    try:
        device.bind()
        uniform.bind_to_uniform_block(shared_constants()["BINDING_RAYCAST"])
        given.bind_to_storage_buffer(0)
        found.bind_to_storage_buffer(1)
        program.run(-(-len(places) // GROUP))
        gl.finish()
        read = np.frombuffer(found.read(), np.float32).reshape(-1, 4)
        return read[:, 3], read[:, :3]
    finally:
        for part in (device, program, uniform, given, found):
            part.release()
