"""Memory layouts and constants read from GLSL text: the definition is there, numpy dtypes are derived."""

from __future__ import annotations

import ast
import enum
import operator
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import ShaderError
from isosample.gl.shader_source import strip_comments

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_STRUCT = re.compile(r"\bstruct\s+(\w+)\s*\{([^{}]*)\}\s*;")
_CONSTANT = re.compile(r"\bconst\s+(int|uint|float)\s+(\w+)\s*=\s*([^;]+);")
_MEMBER = re.compile(r"(\w+)\s+(\w+)\s*(?:\[\s*(\w+)\s*\])?")
_SUFFIXED = re.compile(
    r"(?<![\w.])(?:(0[xX][0-9a-fA-F]+|\d+)[uU]|((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)[fF])\b"
)
_SCALARS = {"float": "<f4", "int": "<i4", "uint": "<u4"}
_VECTOR_PREFIXES = {"vec": "<f4", "ivec": "<i4", "uvec": "<u4"}
_ARRAY_TYPES = ("vec4", "ivec4", "uvec4", "mat4")  # their stride is their size, in both packings
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.LShift: operator.lshift,
    ast.BitOr: operator.or_,
}


class Packing(enum.Enum):
    """Rules by which GLSL lays a struct out in memory (OpenGL 4.5 core, section 7.6.2.2)."""

    STD140 = "std140"  # uniform blocks: a struct is aligned to, and its size rounded up to, 16 bytes
    STD430 = "std430"  # storage blocks: a struct is aligned to its most aligned member


def constants(text: str) -> dict[str, int | float]:
    """Values of the ``const int``, ``const uint`` and ``const float`` of a GLSL text, outside functions.

    Parameters
    ----------
    text : str
        GLSL text; a value is a literal, or ``+ - * << |`` of literals and constants defined above it.

    Returns
    -------
    values : dict of str to int or float
        In the order of the text.

    Raises
    ------
    ShaderError
        If a value is not of that form, does not fit its type, or a name is defined twice.
    """
    values: dict[str, int | float] = {}
    for kind, name, expression in _CONSTANT.findall(_outside_braces(strip_comments(text))):
        if name in values:
            raise ShaderError(f"const {name} is defined twice; keep one definition")
        values[name] = _typed(kind, name, _evaluate(expression, values, name))
    return values


def struct_dtypes(text: str, packing: Packing) -> dict[str, np.dtype[np.void]]:
    """Structured dtypes of all structs of a GLSL text.

    Parameters
    ----------
    text : str
        GLSL text. Members are ``float int uint vecN ivecN uvecN mat4`` and arrays of ``vec4``, ``ivec4``,
        ``uvec4`` or ``mat4``, whose length is a number or a constant of the text; a ``vec3`` is followed by a
        scalar.
    packing : Packing
        STD140 for a uniform block, STD430 for a storage block.

    Returns
    -------
    dtypes : dict of str to dtype
        With explicit offsets, little endian; the item size is the stride in an array of that struct. Matrices
        are ``(4, 4)`` float32 as OpenGL reads them: assign `column_major` of a matrix.

    Raises
    ------
    ShaderError
        If a member is none of these (names struct and member).
    """
    lengths = constants(text)
    found = _STRUCT.findall(strip_comments(text))
    names = [name for name, _ in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ShaderError(f"struct {', '.join(twice)} is defined twice; keep one definition")
    return {name: _struct_dtype(name, body, packing, lengths) for name, body in found}


def column_major(matrix: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Matrices in the order in which OpenGL stores a ``mat4``: the only place where they are transposed.

    Parameters
    ----------
    matrix : (..., 4, 4) array_like of float
        Row by row, so that ``matrix @ column_vector`` transforms.

    Returns
    -------
    stored : (..., 4, 4) float32
        Contiguous; column by column.

    Raises
    ------
    ShaderError
        If the last two axes are not 4 by 4.
    """
    array = np.asarray(matrix, dtype=np.float32)
    if array.shape[-2:] != (4, 4):
        raise ShaderError(f"a mat4 needs an array of shape (..., 4, 4), not {array.shape}")
    return np.ascontiguousarray(np.swapaxes(array, -1, -2))


def _outside_braces(code: str) -> str:
    """Code with everything between braces blanked."""
    while (inner := re.sub(r"\{[^{}]*\}", " ", code)) != code:
        code = inner
    return code


def _evaluate(expression: str, names: Mapping[str, int | float], owner: str) -> int | float:
    plain = _SUFFIXED.sub(lambda match: match[1] or match[2], expression.strip())
    try:
        value: int | float = _value(ast.parse(plain, mode="eval").body, names)
    except (SyntaxError, KeyError, TypeError) as error:
        raise ShaderError(
            f"const {owner} = {expression.strip()}: cannot be read; use numbers and the constants above it, "
            "joined by + - * << |"
        ) from error
    return value


def _value(node: ast.expr, names: Mapping[str, int | float]) -> Any:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return node.value
    if isinstance(node, ast.Name):
        return names[node.id]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_value(node.operand, names)
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_value(node.left, names), _value(node.right, names))
    raise TypeError(ast.dump(node))


def _typed(kind: str, name: str, value: float) -> int | float:
    if kind == "float":
        return float(value)
    low, high = (0, 2**32 - 1) if kind == "uint" else (-(2**31), 2**31 - 1)
    if not isinstance(value, int) or not low <= value <= high:
        raise ShaderError(f"const {kind} {name} = {value}: expected a whole number in [{low}, {high}]")
    return value


def _struct_dtype(
    name: str, body: str, packing: Packing, lengths: Mapping[str, int | float]
) -> np.dtype[np.void]:
    fields: dict[str, tuple[Any, int]] = {}
    offset, alignment, after_vec3 = 0, 4, ""
    for declaration in (part.strip() for part in body.split(";") if part.strip()):
        match = _MEMBER.fullmatch(declaration)
        if match is None:
            raise ShaderError(f"struct {name}: cannot read {declaration!r}; write one 'type name' per member")
        glsl_type, member, length = match.groups()
        where = f"struct {name}, member {member}"
        if member in fields:
            raise ShaderError(f"{where}: declared twice; give each member its own name")
        format_, align = _member_format(glsl_type, length, lengths, where)
        if after_vec3 and (glsl_type not in _SCALARS or length is not None):
            raise ShaderError(f"{where}: follows the vec3 {after_vec3}; put a scalar there")
        after_vec3 = member if glsl_type in ("vec3", "ivec3", "uvec3") else ""
        offset = _round_up(offset, align)
        fields[member] = (format_, offset)
        offset += np.dtype(format_).itemsize
        alignment = max(alignment, align)
    if not fields or after_vec3:
        raise ShaderError(
            f"struct {name}: {'has no member' if not fields else 'ends in a vec3'}; add a scalar"
        )
    size = _round_up(offset, 16 if packing is Packing.STD140 else alignment)
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": size})


def _member_format(
    glsl_type: str, length: str | None, lengths: Mapping[str, int | float], where: str
) -> tuple[Any, int]:
    """Numpy format and alignment in bytes of a member."""
    scalar, shape, align = _base_format(glsl_type, where)
    if length is None:
        return ((scalar, shape) if shape else scalar), align
    if glsl_type not in _ARRAY_TYPES:
        raise ShaderError(f"{where}: arrays of {glsl_type} are not supported; use {', '.join(_ARRAY_TYPES)}")
    count = int(length) if length.isdigit() else lengths.get(length)
    if not isinstance(count, int) or count < 1:
        raise ShaderError(
            f"{where}: array length {length} must be a positive number or a constant of the text"
        )
    return (scalar, (count, *shape)), align


def _base_format(glsl_type: str, where: str) -> tuple[str, tuple[int, ...], int]:
    if glsl_type in _SCALARS:
        return _SCALARS[glsl_type], (), 4
    if glsl_type == "mat4":
        return "<f4", (4, 4), 16
    prefix, width = glsl_type[:-1], glsl_type[-1]
    if prefix in _VECTOR_PREFIXES and width in "234":
        return _VECTOR_PREFIXES[prefix], (int(width),), 8 if width == "2" else 16
    raise ShaderError(
        f"{where}: type {glsl_type} is not supported; use float, int, uint, vecN, ivecN, uvecN, mat4 or "
        "arrays of vec4"
    )


def _round_up(offset: int, align: int) -> int:
    return -(-offset // align) * align
