"""The programs of the renderers, compiled once per variant, with their interfaces checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.interface import check_interface
from isosample.gl.program import compute_program, graphics_program

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.supplies import Supply

    Program = moderngl.Program | moderngl.ComputeShader


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

    def graphics(self, vertex: str, fragment: str, supply: Supply, **constants: int) -> moderngl.Program:
        """Program of two shader files, held against what its pass supplies.

        Raises
        ------
        ShaderError
            As `graphics_program` and `check_interface`.
        """
        key = (vertex, fragment, *sorted(constants.items()))
        if key not in self._graphics:
            program = graphics_program(self._ctx, vertex, fragment, constants)
            _check(program, supply)
            self._graphics[key] = program
        return self._graphics[key]

    def compute(self, entry: str, supply: Supply, **constants: int) -> moderngl.ComputeShader:
        """Program of a compute shader file; raises as `graphics`."""
        key = (entry, *sorted(constants.items()))
        if key not in self._compute:
            program = compute_program(self._ctx, entry, constants)
            _check(program, supply)
            self._compute[key] = program
        return self._compute[key]

    def has_compute(self, entry: str, **constants: int) -> bool:
        """Whether a program of a compute shader file was compiled already."""
        return (entry, *sorted(constants.items())) in self._compute

    def release(self) -> None:
        """Free every program."""
        for graphics in self._graphics.values():
            graphics.release()
        for compute in self._compute.values():
            compute.release()
        self._graphics, self._compute = {}, {}


def _check(program: Program, supply: Supply) -> None:
    """Release a program that its pass does not fit, and raise."""
    try:
        check_interface(
            program,
            uniforms=supply.uniforms,
            blocks=supply.blocks,
            attributes=supply.attributes,
            optional=supply.optional,
        )
    except BaseException:
        program.release()
        raise
