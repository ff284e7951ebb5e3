"""The programs of the renderers, compiled once per variant, with their interfaces checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.interface import Block, check_interface
from isosample.gl.program import compute_program, graphics_program
from isosample.rendering.frame import shared_constants, uniform_dtype

if TYPE_CHECKING:
    import moderngl

    Program = moderngl.Program | moderngl.ComputeShader

MESH_ATTRIBUTES = {
    "position": "vec3",
    "gradient": "vec3",
    "residual": "float",
    "start": "vec3",
    "face": "int",
    "values": "vec4",
}
MESH_UNIFORMS = {"side": "float", "level": "uint"}
TEXTURES = {
    "volume": "sampler3D",
    "macrocells": "usampler3D",
    "transfer": "sampler2D",
    "length_table": "sampler2D",
    "length_tables": "sampler3D",
    "peak_table": "usampler2D",
    "integrals": "sampler2D",
    "spans": "sampler2D",
}
UNIFORM_BLOCKS = {"FrameBlock": ("FRAME", "Frame"), "RaycastBlock": ("RAYCAST", "Raycast")}


class Programs:
    """Compiles on first use and keeps what it compiled.

    Parameters
    ----------
    ctx : moderngl.Context
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._graphics: dict[tuple[object, ...], moderngl.Program] = {}
        self._compute: dict[tuple[object, ...], moderngl.ComputeShader] = {}

    def graphics(self, vertex: str, fragment: str, **constants: int) -> moderngl.Program:
        """Program of two shader files; raises ShaderError as `graphics_program` and `check_interface` do."""
        key = (vertex, fragment, *sorted(constants.items()))
        if key not in self._graphics:
            program = graphics_program(self._ctx, vertex, fragment, constants)
            _check(program, constants)
            self._graphics[key] = program
        return self._graphics[key]

    def compute(self, entry: str, **constants: int) -> moderngl.ComputeShader:
        """Program of a compute shader file; raises as `graphics`."""
        key = (entry, *sorted(constants.items()))
        if key not in self._compute:
            program = compute_program(self._ctx, entry, constants)
            _check(program, constants)
            self._compute[key] = program
        return self._compute[key]

    def release(self) -> None:
        """Free every program."""
        for graphics in self._graphics.values():
            graphics.release()
        for compute in self._compute.values():
            compute.release()
        self._graphics, self._compute = {}, {}


def storage_bindings() -> dict[str, int]:
    """Binding of every storage block by its name in the shaders."""
    names = {"Heads": "HEADS", "CounterBlock": "COUNTERS", "Bands": "BANDS"}
    names |= {"Levels": "LEVELS", "Boundary": "BOUNDARY"}
    names |= {"RayCounterBlock": "RAY_COUNTERS", "RayStates": "RAY_STATES"}
    return {block: shared_constants()[f"BINDING_{name}"] for block, name in names.items()}


def _check(program: Program, constants: dict[str, int]) -> None:
    blocks = {name: Block(binding) for name, binding in storage_bindings().items()}
    for name, (binding, struct) in UNIFORM_BLOCKS.items():
        blocks[name] = Block(shared_constants()[f"BINDING_{binding}"], uniform_dtype(struct).itemsize)
    uniforms = MESH_UNIFORMS | TEXTURES | {"run": "uint", "image": "image2D", "nodes": "uimage2D"}
    if constants.get("FILTERING") == 0:
        uniforms["volume"] = "sampler2DArray"
    check_interface(
        program,
        uniforms=uniforms,
        blocks=blocks,
        attributes=MESH_ATTRIBUTES,
        optional=[*uniforms, *blocks, *MESH_ATTRIBUTES],  # every pass uses some of them
    )
