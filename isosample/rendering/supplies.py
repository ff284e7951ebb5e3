"""What every pass gives to its programs, by the names in the shaders: `Programs` holds each program against it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

from isosample.gl.interface import Block
from isosample.rendering.frame import shared_constants, uniform_dtype

if TYPE_CHECKING:
    from collections.abc import Mapping

STORAGE_BLOCKS = {
    "Heads": "HEADS",
    "CounterBlock": "COUNTERS",
    "Boundary": "BOUNDARY",
    "RayCounterBlock": "RAY_COUNTERS",
    "RayStates": "RAY_STATES",
    "Vertices": "VERTICES",
    "Indices": "INDICES",
    "Residuals": "RESIDUALS",
    "Packets": "PACKETS",
    "Shares": "SHARES",
    "SlotStore": "SLOT_STORE",
    "NodeStore": "NODE_STORE",
}
UNIFORM_BLOCKS = {"FrameBlock": ("FRAME", "Frame"), "RaycastBlock": ("RAYCAST", "Raycast")}
NODES = {"nodes": "uimageBuffer"}
TABLE = {"scene_table": "image2D"}  # bands and levels
SLOTS = {"slots": "uimageBuffer", "slot_normals": "uimageBuffer"}
PROJECTED = {"places": "image2D", "corners": "image2D", "positions": "image2D"}
INTERLEAVED = {"thread_count": "uint", "groups_each": "uint"}
SHARED_OUT = {"first_share": "uint", "share_count": "uint"} | INTERLEAVED
IMAGE = {"image": "image2D"}  # of compute shaders; a fragment shader draws into it


@dataclass(frozen=True, slots=True, kw_only=True)
class Supply:
    """What one pass gives.

    Attributes
    ----------
    blocks : mapping of str to Block
    uniforms, attributes : mapping of str to str
        GLSL types by name.
    optional : frozenset of str
        Of all these the names that some of its programs do not use; every program uses the others.
    """

    blocks: Mapping[str, Block]
    uniforms: Mapping[str, str] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    optional: frozenset[str] = frozenset()


@cache
def storage_bindings() -> dict[str, int]:
    """Binding of every storage block by its name in the shaders."""
    return {block: shared_constants()[f"BINDING_{name}"] for block, name in STORAGE_BLOCKS.items()}


def blocks(*names: str) -> dict[str, Block]:
    """The blocks of these names."""
    found = {}
    for name in names:
        if name in STORAGE_BLOCKS:
            found[name] = Block(storage_bindings()[name])
            continue
        binding, struct = UNIFORM_BLOCKS[name]
        found[name] = Block(shared_constants()[f"BINDING_{binding}"], uniform_dtype(struct).itemsize)
    return found


@cache
def mesh_supply() -> Supply:
    """Of the build pass, and those that count: isosurfaces."""
    lists = ("Heads", "CounterBlock", "NodeStore")
    return Supply(
        blocks=blocks("FrameBlock", *lists),
        uniforms={"side": "float", "level": "uint"} | NODES,
        attributes={"position": "vec3", "gradient": "vec3", "residual": "float"},
        optional=frozenset({*lists, *NODES, "level", "gradient", "residual"}),
    )


@cache
def mask_supply() -> Supply:
    """Of the same passes: the border of the valid cells."""
    lists = ("Heads", "CounterBlock", "NodeStore")
    return Supply(
        blocks=blocks("FrameBlock", *lists),
        uniforms={"side": "float"} | NODES,
        attributes={"start": "vec3", "face": "int", "values": "vec4"},
        optional=frozenset({*lists, *NODES, "values"}),
    )


@cache
def project_supply() -> Supply:
    """Of the build pass by compute shaders: vertices."""
    return Supply(
        blocks=blocks("FrameBlock", "Vertices", "Shares"),
        uniforms={"window_vertex": "uint"} | SHARED_OUT | PROJECTED,
        optional=frozenset({"positions"}),
    )


@cache
def raster_supply() -> Supply:
    """Of the build pass by compute shaders: triangles."""
    return Supply(
        blocks=blocks(
            "FrameBlock", "Heads", "CounterBlock", "Indices", "Residuals", "Shares", "SlotStore", "NodeStore"
        ),
        uniforms={"slot_count": "uint", "window_index": "uint"} | SHARED_OUT | PROJECTED | NODES | SLOTS,
        optional=frozenset(
            {"positions", "Residuals", "SlotStore", "NodeStore", "slot_count", *NODES, *SLOTS}
        ),
    )


@cache
def resolve_supply(*, compute: bool) -> Supply:
    """Of the resolve pass."""
    scene = ("CounterBlock", "Boundary")
    return Supply(
        blocks=blocks("FrameBlock", "Heads", *scene),
        uniforms=NODES | TABLE | (IMAGE if compute else {}),
        optional=frozenset({*scene, *NODES, *TABLE}),
    )


@cache
def group_supply() -> Supply:
    """Of the pass that groups packets of pixels."""
    return Supply(blocks=blocks("FrameBlock", "Heads", "CounterBlock", "Packets"))


@cache
def slot_supply() -> Supply:
    """Of the resolve pass, lists in slots."""
    return Supply(
        blocks=blocks("FrameBlock", "Heads", "CounterBlock", "Packets", "Boundary"),
        uniforms={"first_packet": "uint", "packet_number": "uint"} | INTERLEAVED | SLOTS | TABLE | IMAGE,
        optional=frozenset({"Boundary", *SLOTS, *TABLE}),
    )


@cache
def spill_supply() -> Supply:
    """Of the pass that makes lists of what is in slots."""
    return Supply(
        blocks=blocks("FrameBlock", "Heads", "CounterBlock", "Packets", "NodeStore"),
        uniforms=SLOTS | NODES,
        optional=frozenset({"nodes", "slot_normals"}),
    )


@cache
def listed_supply() -> Supply:
    """Of the resolve pass, lists that were in slots and are no chains."""
    return Supply(
        blocks=blocks("FrameBlock", "Heads", "CounterBlock", "Packets", "Boundary"),
        uniforms=NODES | TABLE | IMAGE | INTERLEAVED,
        optional=frozenset(TABLE),
    )


@cache
def merge_supply() -> Supply:
    """Of the pass that sorts long lists."""
    return Supply(blocks=blocks("FrameBlock", "Heads"), uniforms={"run": "uint"} | NODES)


def ray_supply(samplers: Mapping[str, str], *, compute: bool) -> Supply:
    """Of the ray caster, with these textures."""
    return Supply(
        blocks=blocks("FrameBlock", "RaycastBlock", "RayCounterBlock", "RayStates"),
        uniforms=dict(samplers) | (IMAGE if compute else {}),
        optional=frozenset({"transfer", "peak_table"}),  # not with every table and mode
    )


@cache
def ray_block_supply() -> Supply:
    """Of the pass over blocks of rays."""
    return Supply(blocks=blocks("FrameBlock", "RaycastBlock"), uniforms={"macrocells": "usampler3D"})
