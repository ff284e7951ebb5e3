"""The check of a program's interface against what a pass supplies, both ways, before the first draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from isosample.errors import ShaderError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    import moderngl

# OpenGL enumerants (gl.xml) of the types that passes supply.
_TYPE_NAMES = {
    0x1406: "float", 0x8B50: "vec2", 0x8B51: "vec3", 0x8B52: "vec4",
    0x1404: "int", 0x8B53: "ivec2", 0x8B54: "ivec3", 0x8B55: "ivec4",
    0x1405: "uint", 0x8DC6: "uvec2", 0x8DC7: "uvec3", 0x8DC8: "uvec4",
    0x8B56: "bool", 0x8B5A: "mat2", 0x8B5B: "mat3", 0x8B5C: "mat4",
    0x8B5D: "sampler1D", 0x8B5E: "sampler2D", 0x8B5F: "sampler3D", 0x8DC1: "sampler2DArray",
    0x8DC9: "isampler1D", 0x8DCA: "isampler2D", 0x8DCB: "isampler3D",
    0x8DD1: "usampler1D", 0x8DD2: "usampler2D", 0x8DD3: "usampler3D",
    0x8DC2: "samplerBuffer", 0x8DD0: "isamplerBuffer", 0x8DD8: "usamplerBuffer",
    0x904D: "image2D", 0x904E: "image3D", 0x9058: "iimage2D", 0x9059: "iimage3D",
    0x9063: "uimage2D", 0x9064: "uimage3D",
    0x9051: "imageBuffer", 0x905C: "iimageBuffer", 0x9067: "uimageBuffer",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Block:
    """What a pass binds to a uniform block (its size is given) or to a storage block (no size)."""

    binding: int
    size_bytes: int | None = None  # of a uniform block: the item size of its std140 dtype

    def __str__(self) -> str:
        """Words for messages."""
        if self.size_bytes is None:
            return f"storage block at binding {self.binding}"
        return f"uniform block of {self.size_bytes} bytes at binding {self.binding}"


def check_interface(
    program: moderngl.Program | moderngl.ComputeShader,
    *,
    uniforms: Mapping[str, str] | None = None,
    blocks: Mapping[str, Block] | None = None,
    attributes: Mapping[str, str] | None = None,
    optional: Collection[str] = (),
) -> None:
    """Compare a program's active interface with what will be supplied, in both directions.

    Parameters
    ----------
    program : moderngl.Program or moderngl.ComputeShader
        Linked program; members that the driver removed as unused do not count as active.
    uniforms, attributes : mapping of str to str, optional
        GLSL type by name, for example ``{"volume": "sampler3D"}``; of an array the type of its elements.
    blocks : mapping of str to Block, optional
        Binding, and for a uniform block its size, by block name.
    optional : collection of str, optional
        Names that are supplied although a variant of the program may not use them.

    Raises
    ------
    ShaderError
        If the two differ: each line names the member, what the program has and what the pass supplies.
    """
    supplied: dict[str, str] = {name: f"uniform {kind}" for name, kind in (uniforms or {}).items()}
    supplied |= {name: f"attribute {kind}" for name, kind in (attributes or {}).items()}
    supplied |= {name: str(block) for name, block in (blocks or {}).items()}
    active = active_interface(program)
    differences = [
        f"  {name}: the program has {active.get(name, 'no such active member')}, "
        f"the pass supplies {supplied.get(name, 'nothing')}"
        for name in sorted(active.keys() | supplied.keys())
        if active.get(name) != supplied.get(name) and not (name in optional and name not in active)
    ]
    if differences:
        raise ShaderError(
            "a program's interface differs from what its pass supplies:\n" + "\n".join(differences)
        )


def active_interface(program: moderngl.Program | moderngl.ComputeShader) -> dict[str, str]:
    """Active uniforms, attributes and blocks of a program, in words.

    Parameters
    ----------
    program : moderngl.Program or moderngl.ComputeShader
        Linked program.

    Returns
    -------
    members : dict of str to str
        For example ``{"volume": "uniform sampler3D", "Nodes": "storage block at binding 1"}``; the names that
        GLSL itself defines (``gl_…``) are left out.
    """
    return {name: _words(program[name]) for name in program if not name.startswith("gl_")}


def _words(member: Any) -> str:
    kind = type(member).__name__
    if kind == "StorageBlock":
        return str(Block(member.binding))
    if kind == "UniformBlock":
        return str(Block(member.binding, member.size))
    return f"{kind.lower()} {_TYPE_NAMES.get(member.gl_type, hex(member.gl_type))}"
