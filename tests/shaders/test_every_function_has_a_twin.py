"""Every function of `shaders/lib` has a numpy twin of its name, a test, and a header that names the twin's file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import pytest

from isosample.gl.shader_source import shader_root

ROOT = Path(__file__).resolve().parents[2]
FUNCTION = re.compile(r"^\w+ (\w+)\([^;{]*\)\s*\{", re.MULTILINE)  # what begins a line and has a body
TWIN = re.compile(r"^// Twin: (\S+)$", re.MULTILINE)
FILES = {
    path.name: path.read_text(encoding="utf-8")
    for path in sorted((shader_root() / "lib").glob("*.glsl"))
    if path.name != "layouts.glsl"  # structs and constants
}


class Function(NamedTuple):
    """A function of a shader file."""

    file: str
    name: str


FUNCTIONS = [Function(file, name) for file, text in FILES.items() for name in FUNCTION.findall(text)]


def header_of(text: str) -> str:
    """The comment that a file begins with."""
    lines = text.splitlines()
    end = next(number for number, line in enumerate(lines) if not line.startswith("//"))
    return "\n".join(lines[:end])


def body_count(text: str) -> int:
    """Number of blocks that stand in no other and follow a closing parenthesis."""
    count, depth = 0, 0
    for brace in re.findall(r"\)\s*\{|[{}]", re.sub(r"//.*", "", text)):
        count += depth == 0 and brace.startswith(")")
        depth += -1 if brace == "}" else 1
    return count


def test_layouts_have_no_function() -> None:
    layouts = (shader_root() / "lib" / "layouts.glsl").read_text(encoding="utf-8")
    assert body_count(layouts) == 0


@pytest.mark.parametrize("file", FILES)
def test_every_function_of_a_file_is_found(file: str) -> None:
    found = [function for function in FUNCTIONS if function.file == file]
    assert len(found) == body_count(FILES[file]) > 0


@pytest.mark.parametrize("file", FILES)
def test_the_header_names_the_twin_s_file(file: str) -> None:
    named = TWIN.findall(header_of(FILES[file]))
    assert len(named) == 1, f"{file} should begin with a comment that has one line '// Twin: PATH'"
    assert (ROOT / named[0]).is_file(), f"{named[0]}, which {file} names, is not there"


@pytest.mark.parametrize(("file", "name"), FUNCTIONS)
def test_a_function_of_the_same_name_is_its_twin(file: str, name: str) -> None:
    twin = (ROOT / TWIN.findall(FILES[file])[0]).read_text(encoding="utf-8")
    assert re.search(rf"^def {name}\(", twin, re.MULTILINE), f"{name} of {file} has no twin"


@pytest.mark.parametrize(("file", "name"), FUNCTIONS)
def test_a_test_names_the_function(file: str, name: str) -> None:
    tests = [path for path in Path(__file__).parent.glob("test_*.py") if path.name != Path(__file__).name]
    named = [path.name for path in tests if re.search(rf"\b{name}\b", path.read_text(encoding="utf-8"))]
    assert named, f"no test of tests/shaders names {name} of {file}"
