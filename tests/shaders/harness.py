"""Call one GLSL function of `shaders/lib` for arrays of arguments, to hold it against float64."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.gl.program import compile_compute
from isosample.gl.shader_source import assemble_shader

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import moderngl

    from isosample.gl.shader_source import Constant, ShaderSource

    Words = npt.NDArray[np.uint32]
    Values = npt.NDArray[Any]

GROUP_SIZE = 64
MAX_CALLS = 65535 * GROUP_SIZE  # the least work group count that OpenGL 4.5 guarantees
_SIGNATURE = re.compile(r"\s*(\w+)\s+(\w+)\s*\(([^()]*)\)\s*;?\s*")
_PARAMETER = re.compile(r"(?:const\s+)?(?:(in|out|inout)\s+)?(\w+)\s+(\w+)(?:\s*\[\s*(\w+)\s*\])?")
_SCALARS: dict[str, type[np.generic]] = {
    "float": np.float32,
    "int": np.int32,
    "uint": np.uint32,
    "bool": np.bool_,
}
_COMPONENTS = {"vec": "float", "ivec": "int", "uvec": "uint", "bvec": "bool"}
_READ = {"float": "uintBitsToFloat({})", "int": "int({})", "uint": "{}", "bool": "({} != 0u)"}
_WRITE = {"float": "floatBitsToUint({})", "int": "uint({})", "uint": "{}", "bool": "uint({})"}


@dataclass(frozen=True, slots=True)
class Slot:
    """A parameter or the returned value: its GLSL type and the array shape of one call's worth of it."""

    name: str
    glsl_type: str
    mode: str  # "in", "out" or "inout"
    length: int = 0  # of an array parameter; 0: no array

    @property
    def scalar(self) -> str:
        """GLSL type of one component."""
        return self.glsl_type if self.glsl_type in _SCALARS else _COMPONENTS[self.glsl_type[:-1]]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one call's value; () for a scalar."""
        width = () if self.glsl_type in _SCALARS else (int(self.glsl_type[-1]),)
        return (self.length, *width) if self.length else width

    @property
    def word_count(self) -> int:
        """Scalars of one call."""
        return int(np.prod(self.shape, dtype=int))

    def places(self) -> list[str]:
        """GLSL expressions of the single scalars, in the order of the numpy array."""
        elements = [f"{self.name}[{i}]" for i in range(self.length)] if self.length else [self.name]
        if self.glsl_type in _SCALARS:
            return elements
        return [f"{element}[{i}]" for element in elements for i in range(int(self.glsl_type[-1]))]


def call(
    ctx: moderngl.Context,
    include: str,
    signature: str,
    *arrays: npt.ArrayLike,
    constants: Mapping[str, Constant] | None = None,
    prelude: str = "",
    root: Path | None = None,
) -> Any:
    """Result of a GLSL function, called once per row of its arguments.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    include : str
        File that defines the function, for example ``"lib/compositing.glsl"``.
    signature : str
        As in the file: ``"vec4 over(vec4 front, vec4 back)"``. Types: ``float int uint bool``, their vectors,
        arrays of these; ``out`` and ``inout`` parameters. An array length may be a name of `constants`.
    *arrays : array_like
        One per ``in`` and ``inout`` parameter: shape (n, …) with the parameter's own shape behind n, or that
        shape alone for a value that all calls share. Arrays have the parameter's own dtype (float32, int32,
        uint32, bool): a float64 array is refused, since its rounding would count as the shader's error.
        Python numbers are converted.
    constants : mapping, optional
        Compile-time constants, defined before the file is included.
    prelude : str, optional
        GLSL put before the include, for functions that the file expects from its entry.
    root : Path, optional
        Folder of the shaders; the package's own by default.

    Returns
    -------
    result : ndarray or tuple of ndarray
        Returned value, then the ``out`` and ``inout`` parameters, each (n, …) in its dtype; a single one is
        not wrapped in a tuple. n = 1 if every argument is shared.

    Raises
    ------
    ValueError
        If the signature cannot be read or the arrays do not fit it.
    ShaderError
        If the file does not compile.
    """
    values = {} if constants is None else constants
    name, slots = parse_signature(signature, values)
    given = [slot for slot in slots if slot.mode in ("in", "inout") and slot.name != "returned"]
    results = [slot for slot in slots if slot.mode in ("out", "inout")]
    words = _argument_words(given, arrays)
    count = max(words.shape[0], 1)
    text = _entry_text(include, name, slots, count, values, prelude)
    stride = sum(slot.word_count for slot in results)
    raw = _run(ctx, assemble_shader(text, "call.comp", values, root), words, (count, stride))
    return _unpacked(raw, results)


def parse_signature(signature: str, constants: Mapping[str, Constant]) -> tuple[str, list[Slot]]:
    """Name of the function, and its returned value (slot ``returned``, unless void) and parameters."""
    match = _SIGNATURE.fullmatch(signature)
    if match is None:
        raise ValueError(f"cannot read the signature {signature!r}; expected 'type name(type name, …)'")
    returned, name, parameters = match.groups()
    slots = [] if returned == "void" else [Slot("returned", returned, "out")]
    for text in (part.strip() for part in parameters.split(",") if part.strip() not in ("", "void")):
        parameter = _PARAMETER.fullmatch(text)
        if parameter is None:
            raise ValueError(f"cannot read the parameter {text!r} of {signature!r}")
        mode, glsl_type, parameter_name, length = parameter.groups()
        slots.append(Slot(f"arg_{parameter_name}", glsl_type, mode or "in", _length(length, constants)))
    for slot in slots:
        prefix, width = slot.glsl_type[:-1], slot.glsl_type[-1]
        if slot.glsl_type not in _SCALARS and (prefix not in _COMPONENTS or width not in "234"):
            raise ValueError(f"type {slot.glsl_type} in {signature!r} is not supported")
    return name, slots


def _length(text: str | None, constants: Mapping[str, Constant]) -> int:
    if text is None:
        return 0
    length = int(text) if text.isdigit() else int(constants.get(text, 0))
    if length < 1:
        raise ValueError(f"array length {text} must be a positive number or a name of the constants")
    return length


def _argument_words(slots: Sequence[Slot], arrays: Sequence[npt.ArrayLike]) -> Words:
    """(n, words per call) uint32, the bits of all arguments side by side."""
    if len(slots) != len(arrays):
        raise ValueError(f"{len(arrays)} arrays for the {len(slots)} parameters that are read")
    typed = [_typed(slot, array) for slot, array in zip(slots, arrays, strict=True)]
    counts = {
        value.shape[0] for slot, value in zip(slots, typed, strict=True) if value.ndim > len(slot.shape)
    }
    if len(counts) > 1:
        raise ValueError(f"arrays of different lengths: {sorted(counts)}")
    count = counts.pop() if counts else 1
    if not 1 <= count <= MAX_CALLS:
        raise ValueError(f"{count} calls; expected 1 to {MAX_CALLS}")
    columns = [
        np.broadcast_to(value, (count, *slot.shape)).reshape(count, slot.word_count)
        for slot, value in zip(slots, typed, strict=True)
    ]
    return np.concatenate([np.zeros((count, 0), np.uint32), *columns], axis=1)


def _typed(slot: Slot, array: npt.ArrayLike) -> Words:
    """Bits of an argument, in its own shape."""
    dtype = np.dtype(_SCALARS[slot.scalar])
    value = np.asarray(array)
    if isinstance(array, (np.ndarray, np.generic)) and value.dtype != dtype:
        raise ValueError(f"{slot.name} is {slot.glsl_type}: expected {dtype}, not {value.dtype}")
    value = value.astype(dtype)
    if value.shape[value.ndim - len(slot.shape) :] != slot.shape or value.ndim > len(slot.shape) + 1:
        raise ValueError(f"{slot.name}: expected shape (n, *{slot.shape}) or {slot.shape}, not {value.shape}")
    return value.astype(np.uint32) if dtype == np.bool_ else value.copy(order="C").view(np.uint32)


def _entry_text(
    include: str,
    name: str,
    slots: Sequence[Slot],
    count: int,
    constants: Mapping[str, Constant],
    prelude: str,
) -> str:
    """Compute shader that makes call number gl_GlobalInvocationID.x."""
    declared = "".join(f'#ifndef {key}\n#error "given by the test"\n#endif\n' for key in constants)
    parameters = [slot for slot in slots if slot.name != "returned"]
    variables = "".join(
        f"    {slot.glsl_type} {slot.name}{f'[{slot.length}]' if slot.length else ''};\n" for slot in slots
    )
    reads = [(slot, place) for slot in parameters if slot.mode != "out" for place in slot.places()]
    writes = [(slot, place) for slot in slots if slot.mode != "in" for place in slot.places()]
    load = "".join(
        f"    {place} = {_READ[slot.scalar].format(f'given[{len(reads)}u * call + {i}u]')};\n"
        for i, (slot, place) in enumerate(reads)
    )
    store = "".join(
        f"    results[{len(writes)}u * call + {i}u] = {_WRITE[slot.scalar].format(place)};\n"
        for i, (slot, place) in enumerate(writes)
    )
    target = "returned = " if len(parameters) < len(slots) else ""
    arguments = ", ".join(slot.name for slot in parameters)
    return (
        f"#version 450 core\n{declared}layout(local_size_x = {GROUP_SIZE}) in;\n"
        "layout(std430, binding = 0) readonly buffer Given { uint given[]; };\n"
        "layout(std430, binding = 1) writeonly buffer Results { uint results[]; };\n"
        f'{prelude}\n#include "{include}"\n'
        f"void main() {{\n    uint call = gl_GlobalInvocationID.x;\n    if (call >= {count}u) return;\n"
        f"{variables}{load}    {target}{name}({arguments});\n{store}}}\n"
    )


def _run(ctx: moderngl.Context, source: ShaderSource, words: Words, shape: tuple[int, int]) -> Words:
    program = compile_compute(ctx, source, "call.comp")
    given = ctx.buffer(data=np.ascontiguousarray(words)) if words.size else ctx.buffer(reserve=4)
    results = ctx.buffer(reserve=4 * shape[0] * shape[1])
    try:
        given.bind_to_storage_buffer(0)
        results.bind_to_storage_buffer(1)
        program.run(-(-shape[0] // GROUP_SIZE))
        ctx.finish()
        return np.frombuffer(results.read(), np.uint32).reshape(shape)
    finally:
        for part in (given, results, program):
            part.release()


def _unpacked(raw: Words, results: Sequence[Slot]) -> Values | tuple[Values, ...]:
    ends = np.cumsum([slot.word_count for slot in results])
    parts: list[Values] = []
    for slot, columns in zip(results, np.split(raw, ends[:-1], axis=1), strict=True):
        words = np.ascontiguousarray(columns).reshape(raw.shape[0], *slot.shape)
        dtype = np.dtype(_SCALARS[slot.scalar])
        parts.append(words != 0 if dtype == np.bool_ else words.view(dtype))
    return parts[0] if len(parts) == 1 else tuple(parts)
