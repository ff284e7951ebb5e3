"""Assembly of GLSL source: includes, compile-time constants, and driver logs mapped back to files."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import ShaderError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    Constant = bool | int | float | np.bool_ | np.integer | np.floating

DECLARE = "Declare each by '#ifndef NAME' and '#error' on the next line."

_COMMENT = re.compile(r"//[^\n]*|/\*.*?(?:\*/|\Z)", re.DOTALL)
_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"\s*$')
_ANY_INCLUDE = re.compile(r"#\s*include\b")
_DECLARATION = re.compile(r"^\s*#\s*ifndef\s+(\w+)\s*\n\s*#\s*error\b", re.MULTILINE)
_VERSION = re.compile(r"^\s*#\s*version\b")
# Mesa `0:10(22): error`, NVIDIA `0(10) : error`, AMD and glslang `ERROR: 0:10: …`.
_LOG_PLACE = re.compile(r"^((?:ERROR|WARNING): )?0(?::(\d+)(\(\d+\))|\((\d+)\)|:(\d+)(?=:))")


@dataclass(frozen=True, slots=True)
class ShaderSource:
    """Assembled GLSL text and where each of its lines comes from.

    Attributes
    ----------
    text : str
        What the driver compiles; starts with the ``#version`` line.
    line_map : tuple of (str, int)
        ``line_map[i]`` is the file (path from the shader root) and 1-based line of assembled line ``i + 1``.
    """

    text: str
    line_map: tuple[tuple[str, int], ...]

    def map_log(self, log: str) -> str:
        """Driver log with every place of the assembled text rewritten to ``file:line``.

        Parameters
        ----------
        log : str
            Compiler messages in the form of Mesa, NVIDIA or AMD; other lines stay as they are.

        Returns
        -------
        mapped : str
            The same lines; ``0:10(22): error`` becomes ``lib/x.glsl:2(22): error``.
        """
        return "\n".join(_LOG_PLACE.sub(self._place, line) for line in log.split("\n"))

    def _place(self, match: re.Match[str]) -> str:
        number = int(match[2] or match[4] or match[5])
        if not 1 <= number <= len(self.line_map):
            return match[0]
        file, line = self.line_map[number - 1]
        return f"{match[1] or ''}{file}:{line}{match[3] or ''}"


def shader_root() -> Path:
    """Folder of the GLSL files: inside an installed wheel, or ``shaders/`` of a checkout.

    Returns
    -------
    root : Path
        An existing folder.

    Raises
    ------
    ShaderError
        If neither place exists (a damaged installation).
    """
    package = Path(__file__).resolve().parents[1]
    candidates = (package / "shaders", package.parent / "shaders")
    for folder in candidates:
        if folder.is_dir():
            return folder
    places = " and ".join(str(folder) for folder in candidates)
    raise ShaderError(f"no folder of shaders: looked at {places}. Reinstall isosample.")


def load_shader(
    path: str, constants: Mapping[str, Constant] | None = None, root: Path | None = None
) -> ShaderSource:
    """Assembled source of an entry file: includes resolved, constants defined.

    Parameters
    ----------
    path : str
        Entry file, relative to the root, such as ``"resolve.frag"``. Its first line of code is ``#version``.
    constants : mapping of str to bool, int or float, optional
        A value for each constant that the entry file declares by ``#ifndef NAME`` followed by ``#error``.
        Booleans are written as 0 or 1, so that ``#if`` reads them.
    root : Path, optional
        Folder that paths are relative to; `shader_root` by default.

    Returns
    -------
    source : ShaderSource
        Text and line map.

    Raises
    ------
    ShaderError
        If a file is missing or outside the root, includes form a cycle or are malformed, the ``#version``
        line is missing, or the constants are not exactly those that the entry file declares.
    """
    folder = shader_root() if root is None else root
    return assemble_shader(read_shader(path, folder), path, constants, folder)


def read_shader(path: str, root: Path, chain: tuple[str, ...] = ()) -> str:
    """Text of a shader file.

    Parameters
    ----------
    path : str
        Relative to the root.
    root : Path
        Folder of the shaders.
    chain : tuple of str, optional
        Files that led here by including each other, outermost first; named in the message.

    Returns
    -------
    text : str
        The file's text.

    Raises
    ------
    ShaderError
        If the file is missing or outside the root.
    """
    origin = f" (included by {' > '.join(chain)})" if chain else ""
    file = (root / path).resolve()
    if not file.is_relative_to(root.resolve()):
        raise ShaderError(f"{path}{origin} lies outside the shader folder {root}; use a path inside it")
    if not file.is_file():
        raise ShaderError(f"no shader {path} in {root}{origin}; paths are relative to that folder")
    return file.read_text(encoding="utf-8")


def assemble_shader(
    text: str, name: str, constants: Mapping[str, Constant] | None = None, root: Path | None = None
) -> ShaderSource:
    """Assembled source of an entry text that need not lie in a file; otherwise as `load_shader`.

    Parameters
    ----------
    text : str
        Entry text.
    name : str
        What stands for the entry in messages and in the line map.
    constants, root
        As in `load_shader`.

    Returns
    -------
    source : ShaderSource
        Text and line map.

    Raises
    ------
    ShaderError
        As `load_shader`.
    """
    folder = shader_root() if root is None else root
    values = {} if constants is None else constants
    declared = declared_constants(text)
    _check_constants(name, declared, values)
    lines, places = _resolve(text, name, folder, (name,), {name})
    version = next((i for i, line in enumerate(lines) if line.strip()), None)
    if version is None or not _VERSION.match(lines[version]):
        raise ShaderError(f"{name}: the first line that is not blank or comment must be #version 450 core")
    defines = [f"#define {key} {glsl_literal(value)}" for key, value in values.items()]
    # Starting at #version keeps line numbers right where the binding strips leading white space.
    merged = [lines[version], *defines, *lines[version + 1 :]]
    origin = [places[version], *((name, declared[key]) for key in values), *places[version + 1 :]]
    return ShaderSource("\n".join(merged) + "\n", tuple(origin))


def declared_constants(text: str) -> dict[str, int]:
    """Constants that an entry text declares, and the line of each declaration.

    Parameters
    ----------
    text : str
        GLSL text with declarations of the form ``#ifndef NAME`` followed by a line ``#error``.

    Returns
    -------
    lines : dict of str to int
        1-based line of each ``#ifndef``.
    """
    code = strip_comments(text)
    found = _DECLARATION.finditer(code)
    return {match[1]: code.count("\n", 0, match.start(1)) + 1 for match in found}


def strip_comments(text: str) -> str:
    """GLSL text with each comment replaced by blanks; line and column numbers are kept."""
    return _COMMENT.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def glsl_literal(value: Constant) -> str:
    """Text that GLSL reads as the given number.

    Parameters
    ----------
    value : bool, int or float
        A boolean gives 0 or 1; an integer must fit 32 bits (above 2**31 - 1 it becomes unsigned); a float
        must stay finite in float32.

    Returns
    -------
    literal : str
        In parentheses where negative.

    Raises
    ------
    ShaderError
        If the number cannot be written.
    """
    if isinstance(value, (bool, np.bool_)):
        return str(int(value))
    if isinstance(value, (int, np.integer)):
        return _integer_literal(int(value))
    number = float(value)
    if not math.isfinite(number) or abs(number) > float(np.finfo(np.float32).max):
        raise ShaderError(f"constant {number} is not a finite float32; give a finite number")
    return f"({number!r})" if number < 0 else repr(number)


def _integer_literal(number: int) -> str:
    if -(2**31) < number < 2**31:
        return f"({number})" if number < 0 else str(number)
    if 2**31 <= number < 2**32:
        return f"{number}u"
    raise ShaderError(f"constant {number} does not fit 32 bits; give a number in (-2**31, 2**32)")


def _check_constants(name: str, declared: Iterable[str], given: Iterable[str]) -> None:
    missing, undeclared = sorted(set(declared) - set(given)), sorted(set(given) - set(declared))
    if missing:
        raise ShaderError(f"{name}: no value for the declared constants {', '.join(missing)}; supply them")
    if undeclared:
        raise ShaderError(
            f"{name}: constants {', '.join(undeclared)} are not declared; it declares "
            f"{', '.join(sorted(declared)) or 'none'}. {DECLARE}"
        )


def _resolve(
    text: str, name: str, root: Path, chain: tuple[str, ...], seen: set[str]
) -> tuple[list[str], list[tuple[str, int]]]:
    """Comment-free lines of a text with each include replaced by its file's lines, once per file."""
    lines: list[str] = []
    places: list[tuple[str, int]] = []
    for number, line in enumerate(strip_comments(text).split("\n"), start=1):
        match = _INCLUDE.match(line)
        if match is None:
            if _ANY_INCLUDE.search(line):
                raise ShaderError(
                    f'{name}:{number}: write #include "path" alone on its line, not {line.strip()!r}'
                )
            lines.append(line)
            places.append((name, number))
            continue
        path = match[1]
        if path in chain:
            raise ShaderError(f"{name}:{number}: includes form a cycle: {' > '.join((*chain, path))}")
        if path not in seen:
            seen.add(path)
            inner = _resolve(read_shader(path, root, chain), path, root, (*chain, path), seen)
            lines += inner[0]
            places += inner[1]
    return lines, places
