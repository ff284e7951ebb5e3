"""A program is held against what its own pass supplies: neither has what the other lacks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import ShaderError
from isosample.gl.interface import active_interface
from isosample.rendering.programs import Programs
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.supplies import (
    Supply,
    blocks,
    mask_supply,
    merge_supply,
    mesh_supply,
    ray_block_supply,
    resolve_supply,
)
from isosample.volume.grid import Volume
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import moderngl

    from isosample.rendering.programs import Program

    Compile = Callable[[Programs, Supply], Program]

RESOLVE = {"SEGMENT_RULE": 2, "SHADING": 0, "SMOOTH_FACES": 0, "EXTINCTION": 1, "LEVEL_LIGHT": 1}
PASSES: dict[str, tuple[Compile, Callable[[], Supply]]] = {
    "measure": (
        lambda programs, supply: programs.graphics(
            "build.vert", "measure.frag", supply, CURVED=0, RESIDUAL=0
        ),
        mesh_supply,
    ),
    "count": (
        lambda programs, supply: programs.graphics("build.vert", "count.frag", supply, CURVED=0, RESIDUAL=0),
        mesh_supply,
    ),
    "count, border": (
        lambda programs, supply: programs.graphics("build_mask.vert", "count.frag", supply),
        mask_supply,
    ),
    "build, border": (
        lambda programs, supply: programs.graphics(
            "build_mask.vert", "build_mask.frag", supply, SUBPIXEL_BITS=8, BEYOND_BLOCK=0
        ),
        mask_supply,
    ),
    "resolve": (
        lambda programs, supply: programs.graphics(
            "screen.vert", "resolve_chain.frag", supply, RUN=16, RUNS=1, FACE_BAND=-1, **RESOLVE
        ),
        lambda: resolve_supply(compute=False),
    ),
    "merge": (
        lambda programs, supply: programs.compute("merge_lists.comp", supply, SORT_CAPACITY=1),
        merge_supply,
    ),
    "ray blocks": (
        lambda programs, supply: programs.graphics("screen.vert", "raycast_blocks.frag", supply),
        ray_block_supply,
    ),
}


@pytest.fixture
def programs(gl: moderngl.Context) -> Iterator[Programs]:
    """Anew for every test: nothing is compiled yet."""
    made = Programs(gl)
    yield made
    made.release()


@pytest.mark.parametrize("name", PASSES)
def test_a_program_that_uses_what_its_pass_does_not_supply_is_refused(programs: Programs, name: str) -> None:
    compiled, supply = PASSES[name]
    whole = supply()
    used = active_interface(compiled(programs, whole))
    assert used
    for missing in used:
        lacking = replace(
            whole,
            uniforms={key: kind for key, kind in whole.uniforms.items() if key != missing},
            attributes={key: kind for key, kind in whole.attributes.items() if key != missing},
            blocks={key: block for key, block in whole.blocks.items() if key != missing},
        )
        other = Programs(programs._ctx)
        with pytest.raises(ShaderError, match=rf"{missing}: the program has .*, the pass supplies nothing"):
            compiled(other, lacking)
        other.release()


def test_a_pass_that_supplies_what_no_program_uses_is_refused(programs: Programs) -> None:
    compiled, supply = PASSES["merge"]
    more = replace(supply(), blocks=blocks("FrameBlock", "Heads", "Packets"))
    with pytest.raises(
        ShaderError, match="Packets: the program has no such active member, the pass supplies"
    ):
        compiled(programs, more)


@pytest.mark.parametrize("part", ["volume", "transfer", "macrocells"])
def test_a_ray_caster_whose_part_brings_no_texture_is_refused(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    volume = Volume(np.linspace(0.0, 1.0, 27, dtype=np.float32).reshape(3, 3, 3))
    with RayCaster(volume, ramp_tf(0.0, 1.0, (0.0, 0.1))) as caster:
        monkeypatch.setattr(type(getattr(caster, f"_{part}")), "samplers", lambda _: {})
        with pytest.raises(
            ShaderError, match=rf"{part}: the program has uniform .*, the pass supplies nothing"
        ):
            caster.render(size=(8, 8))


def test_a_refused_program_is_released(gl: moderngl.Context) -> None:
    programs = Programs(gl)
    with pytest.raises(ShaderError):
        programs.compute("merge_lists.comp", ray_block_supply(), SORT_CAPACITY=1)
    programs.release()  # a program that was dropped would be found after the test
