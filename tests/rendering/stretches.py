"""Rays along which the field is a given cubic: composited by the ray caster's shaders, and exactly in float64."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyval

from isosample.gl.program import compile_compute
from isosample.gl.shader_source import assemble_shader
from isosample.integral.quadrature import panel_nodes
from isosample.rendering.device_transfer import DeviceTransfer
from isosample.rendering.frame import shared_constants, uniform_dtype
from isosample.rendering.scene import ValueScale

if TYPE_CHECKING:
    from collections.abc import Sequence

    import moderngl

    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64

GROUP_SIZE = 32
PANELS, NODES = 12, 8  # between two crossings
UNIT_SCALE = ValueScale(0.0, 1.0)
CUBICS_BINDING, RESULTS_BINDING = 12, 13

# The ray runs along the x axis of the samples, one cell per world unit; the field is a cubic of the distance.
ENTRY = """
layout(local_size_x = {group}) in;
layout(std140, binding = BINDING_RAYCAST) uniform RaycastBlock {{ Raycast raycast; }};
layout(std430, binding = {cubics}) readonly buffer Cubics {{ vec4 cubics[]; }};
layout(std430, binding = {results}) writeonly buffer Results {{ vec4 results[]; }};
uniform int steps;
uniform float length_world;
struct Ray {{
    float start; vec3 index_start; vec3 index_direction; vec3 radiance; float transmittance; uint roots; uint crossings;
}};
struct Stretch {{ float start; float end; float front; float back; }};
Ray ray;
vec4 cubic;
ivec3 cell_at(vec3 index) {{ return clamp(ivec3(index), ivec3(0), raycast.samples.xyz - 2); }}
vec3 ray_at(float distance) {{ return ray.index_start + distance * ray.index_direction; }}
float field(vec3 index) {{ return cubic.x + index.x * (cubic.y + index.x * (cubic.z + index.x * cubic.w)); }}
float ray_value(float distance) {{ ++ray.roots; return field(ray_at(distance)); }}
vec2 light_at(float distance) {{ return vec2(1.0, 0.0); }}
void composite(vec3 emission, float opacity) {{
    ray.radiance += ray.transmittance * emission;
    ray.transmittance *= 1.0 - opacity;
}}
#include "pass/transfer.glsl"
#include "pass/classify.glsl"
void main() {{
    uint number = gl_GlobalInvocationID.x;
    if (number >= uint(cubics.length())) return;
    cubic = cubics[number];
    ray = Ray(0.0, vec3(0.0), vec3(1.0, 0.0, 0.0), vec3(0.0), 1.0, 0u, 0u);
    float start = 0.0;
    float front = field(ray_at(start));
    meet(front);
    for (int step = 1; step <= steps; ++step) {{
        float end = length_world * float(step) / float(steps);
        float back = field(ray_at(end));
        meet(back);
        composite_stretch(Stretch(start, end, front, back));
        start = end;
        front = back;
    }}
    results[2u * number] = vec4(ray.radiance, 1.0 - ray.transmittance);
    results[2u * number + 1u] = vec4(float(ray.roots), float(ray.crossings), 0.0, 0.0);
}}
"""
LIBRARY = ("layouts", "optics", "bands")


class Caster:
    """Programs for rays, one per set of constants.

    Parameters
    ----------
    gl : moderngl.Context
    """

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._programs: dict[tuple[tuple[str, int], ...], moderngl.ComputeShader] = {}

    def release(self) -> None:
        """Free the programs."""
        for program in self._programs.values():
            program.release()
        self._programs = {}

    def cast(
        self,
        transfer_function: TransferFunction,
        settings: RaycastSettings,
        cubics: npt.ArrayLike,
        steps: int,
        length: float = 1.0,
        table_length: float | None = None,
    ) -> tuple[F64, F64]:
        """Radiance and opacity (n, 4) of rays of the given length, and their root evaluations and crossings (n, 2).

        `cubics` (n, 4) holds the coefficients of the field, in powers of the distance.
        """
        base = length / steps if table_length is None else table_length
        transfer = DeviceTransfer(self._gl, transfer_function, UNIT_SCALE, settings, base)
        try:
            program = self._program(transfer.constants())
            for name, value in (("steps", steps), ("length_world", length)):
                program[name] = value
            return self._run(program, transfer, cubics)
        finally:
            transfer.release()

    def _program(self, constants: dict[str, int]) -> moderngl.ComputeShader:
        key = tuple(sorted(constants.items()))
        if key not in self._programs:
            values = constants | {"SHADING": 0, "RECONSTRUCTION": 1}
            declared = "".join(f'#ifndef {name}\n#error "needed"\n#endif\n' for name in values)
            included = "".join(f'#include "lib/{name}.glsl"\n' for name in LIBRARY)
            entry = ENTRY.format(group=GROUP_SIZE, cubics=CUBICS_BINDING, results=RESULTS_BINDING)
            source = assemble_shader(
                f"#version 450 core\n{declared}{included}{entry}", "stretches.comp", values
            )
            self._programs[key] = compile_compute(self._gl, source, "stretches.comp")
        return self._programs[key]

    def _run(
        self, program: moderngl.ComputeShader, transfer: DeviceTransfer, cubics: npt.ArrayLike
    ) -> tuple[F64, F64]:
        coefficients = np.ascontiguousarray(cubics, dtype=np.float32).reshape(-1, 4)
        block = np.zeros(1, dtype=uniform_dtype("Raycast"))
        block[0]["samples"] = (1 << 16, 2, 2)
        transfer.fill(block[0])
        frame, given = self._gl.buffer(block), self._gl.buffer(coefficients)
        results = self._gl.buffer(reserve=32 * len(coefficients))
        try:
            frame.bind_to_uniform_block(shared_constants()["BINDING_RAYCAST"])
            given.bind_to_storage_buffer(CUBICS_BINDING)
            results.bind_to_storage_buffer(RESULTS_BINDING)
            transfer.bind()
            program.run(-(-len(coefficients) // GROUP_SIZE))
            self._gl.finish()
            rows = np.frombuffer(results.read(), np.float32).reshape(-1, 8).astype(np.float64)
        finally:
            for part in (frame, given, results):
                part.release()
        return rows[:, :4], rows[:, 4:6]


def integrated(transfer_function: TransferFunction, cubic: Sequence[float], length: float = 1.0) -> F64:
    """Radiance and opacity (4,) of one ray: Gauss-Legendre panels between the crossings of all levels."""
    field = np.asarray(cubic, dtype=np.float32).astype(np.float64)
    surfaces = {surface.value: surface for surface in transfer_function.isosurfaces}
    values = sorted({*surfaces, *(point.value for point in transfer_function.points)})
    crossings = sorted((place, value) for value in values for place in roots(field, value, length))
    edges = [0.0, *(place for place, _ in crossings), length]
    light, through = np.zeros(3), 1.0
    for i, (start, end) in enumerate(itertools.pairwise(edges)):
        if end > start:
            radiance, opacity = _part(transfer_function, field, start, end)
            light, through = light + through * radiance, through * (1.0 - opacity)
        if i < len(crossings) and crossings[i][1] in surfaces:
            surface = surfaces[crossings[i][1]]
            light = light + through * surface.opacity * np.array(surface.color)
            through *= 1.0 - surface.opacity
    return np.array([*light, 1.0 - through])


def roots(cubic: F64, value: float, length: float) -> list[float]:
    """Places in (0, length) where the cubic takes a value and goes through it."""
    found = np.roots(np.trim_zeros((cubic - np.array([value, 0, 0, 0]))[::-1], "f"))
    places = sorted(float(root.real) for root in found if abs(root.imag) < 1e-9)
    return [place for place in places if 0.0 < place < length]


def _part(transfer_function: TransferFunction, cubic: F64, start: float, end: float) -> tuple[F64, float]:
    """Radiance and opacity between two crossings; the depth before a node by its own quadrature."""
    edges = np.linspace(start, end, PANELS + 1)
    places, weights = panel_nodes(edges, NODES)
    color, extinction = transfer_function.evaluate(polyval(places, cubic))
    depths = (weights * extinction).reshape(PANELS, NODES).sum(axis=1)
    depth_before = np.concatenate([[0.0], np.cumsum(depths)])
    inner, inner_weights = panel_nodes(np.stack([np.repeat(edges[:-1], NODES), places], axis=-1), NODES)
    _, inner_extinction = transfer_function.evaluate(polyval(inner, cubic))
    before = np.repeat(depth_before[:-1], NODES) + (inner_weights * inner_extinction).sum(axis=-1)
    light = (weights * extinction * np.exp(-before)) @ color
    return light, float(-np.expm1(-depth_before[-1]))
