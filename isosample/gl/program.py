"""Programs compiled from shader files, with the driver's messages at the places of those files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeVar

from isosample.errors import ShaderError
from isosample.gl.shader_source import (
    DECLARE,
    ShaderSource,
    assemble_shader,
    declared_constants,
    read_shader,
    shader_root,
)
from isosample.tally import PROGRAMS, tally

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import moderngl

    from isosample.gl.shader_source import Constant

Compiled = TypeVar("Compiled")

# moderngl writes `vertex_shader`, NVIDIA's linker `Vertex info`, before the messages of a stage.
_STAGE_HEADER = re.compile(r"^(vertex|fragment|compute)[_ ](?:shader|info)\s*$", re.IGNORECASE)


def graphics_program(
    ctx: moderngl.Context,
    vertex: str,
    fragment: str,
    constants: Mapping[str, Constant] | None = None,
    root: Path | None = None,
) -> moderngl.Program:
    """Program of a vertex and a fragment shader.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    vertex, fragment : str
        Entry files, relative to the root.
    constants : mapping of str to bool, int or float, optional
        Values of the compile-time constants that the two files declare between them: each stage gets its own.
    root : Path, optional
        Folder of the shaders; the package's own by default.

    Returns
    -------
    program : moderngl.Program
        To be released by the caller.

    Raises
    ------
    ShaderError
        If a file does not assemble or compile, or the two do not link; places are given as ``file:line``.
    """
    sources = _stage_sources({"vertex": vertex, "fragment": fragment}, constants, root)
    return _compiled(
        lambda: ctx.program(vertex_shader=sources["vertex"].text, fragment_shader=sources["fragment"].text),
        f"{vertex} with {fragment}",
        sources,
    )


def compute_program(
    ctx: moderngl.Context,
    compute: str,
    constants: Mapping[str, Constant] | None = None,
    root: Path | None = None,
) -> moderngl.ComputeShader:
    """Program of a compute shader; parameters and errors as `graphics_program`.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    compute : str
        Entry file, relative to the root.
    constants, root
        As in `graphics_program`.

    Returns
    -------
    program : moderngl.ComputeShader
        To be released by the caller.

    Raises
    ------
    ShaderError
        If the file does not assemble, compile or link; places are given as ``file:line``.
    """
    sources = _stage_sources({"compute": compute}, constants, root)
    return compile_compute(ctx, sources["compute"], compute)


def compile_compute(ctx: moderngl.Context, source: ShaderSource, name: str) -> moderngl.ComputeShader:
    """Compute program of an assembled source.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    source : ShaderSource
        What `load_shader` or `assemble_shader` gives.
    name : str
        What stands for the program in messages.

    Returns
    -------
    program : moderngl.ComputeShader
        To be released by the caller.

    Raises
    ------
    ShaderError
        If it does not compile or link.
    """
    return _compiled(lambda: ctx.compute_shader(source.text), name, {"compute": source})


def map_stage_log(log: str, sources: Mapping[str, ShaderSource]) -> str:
    """Driver log of several stages with the places rewritten by the map of the stage they belong to.

    Parameters
    ----------
    log : str
        Messages; a line such as ``fragment_shader`` or ``Fragment info`` begins a stage.
    sources : mapping of str to ShaderSource
        By stage: "vertex", "fragment" or "compute". With one stage no heading is needed.

    Returns
    -------
    mapped : str
        The same lines with ``file:line`` places.
    """
    current = next(iter(sources.values())) if len(sources) == 1 else None
    mapped: list[str] = []
    for line in log.split("\n"):
        header = _STAGE_HEADER.match(line)
        if header is not None:
            current = sources.get(header[1].lower(), current)
        mapped.append(line if current is None else current.map_log(line))
    return "\n".join(mapped)


def _stage_sources(
    entries: Mapping[str, str], constants: Mapping[str, Constant] | None, root: Path | None
) -> dict[str, ShaderSource]:
    """Assembled source of each stage; a constant goes to the stages that declare it, and to one at least."""
    folder = shader_root() if root is None else root
    values = {} if constants is None else constants
    texts = {stage: read_shader(path, folder) for stage, path in entries.items()}
    declared = {stage: declared_constants(text).keys() for stage, text in texts.items()}
    unknown = sorted(set(values).difference(*declared.values()))
    if unknown:
        raise ShaderError(
            f"constants {', '.join(unknown)} are not declared in {' or '.join(entries.values())}. {DECLARE}"
        )
    return {
        stage: assemble_shader(
            texts[stage], path, {key: values[key] for key in values if key in declared[stage]}, folder
        )
        for stage, path in entries.items()
    }


def _compiled(build: Callable[[], Compiled], name: str, sources: Mapping[str, ShaderSource]) -> Compiled:
    import moderngl

    tally(PROGRAMS)
    try:
        return build()
    except moderngl.Error as error:
        log = map_stage_log(str(error), sources).strip()
        raise ShaderError(f"{name} does not compile:\n{log}") from error
