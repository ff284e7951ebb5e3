"""The harness passes every bit in and out, and a wrong function is told from a right one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import ShaderError
from shaders.harness import call

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

LIBRARY = """
float identity(float x) { return x; }
int negated(int x) { return -x; }
uint inverted(uint x) { return ~x; }
bool below(float x, float limit) { return x < limit; }
vec2 swapped(vec2 p) { return p.yx; }
vec3 scaled(vec3 p, float s) { return s * p; }
vec4 over(vec4 front, vec4 back) { return front + (1.0 - front.a) * back; }
vec4 over_wrong(vec4 front, vec4 back) { return front + (1.0 - front.r) * back; }
ivec3 shifted(ivec3 p, int by) { return p + by; }
bvec2 above(vec2 p) { return greaterThan(p, vec2(0.0)); }
int split(float x, out float fraction, inout uint counter) {
    fraction = fract(x); counter += 1u; return int(floor(x));
}
void order(inout float a, inout float b) { if (a > b) { float c = a; a = b; b = c; } }
float last(float x[4]) { return x[3]; }
float total(float x[COUNT]) { float s = 0.0; for (int i = 0; i < COUNT; ++i) s += x[i]; return s; }
vec2 second(vec2 p[3]) { return p[1]; }
float answer() { return 42.0; }
"""
CONSTANTS = {"COUNT": 3}
ONE = np.ones(1, np.float32)
WHOLE = np.arange(130, dtype=np.float32)  # three work groups, the last one partly used


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shaders")
    (folder / "small.glsl").write_text(LIBRARY)
    return folder


def _over(front: np.ndarray, back: np.ndarray) -> np.ndarray:
    front, back = front.astype(np.float64), back.astype(np.float64)
    composited: np.ndarray = front + (1.0 - front[:, 3:]) * back
    return composited


def test_scalars_of_each_type_pass_unchanged_in_bits(gl: moderngl.Context, root: Path) -> None:
    floats = np.array([0.0, -0.0, 1.0, -1.5, 3.4e38, 1.2e-38, np.inf], np.float32)
    found = call(gl, "small.glsl", "float identity(float x)", floats, constants=CONSTANTS, root=root)
    assert found.view(np.uint32).tolist() == floats.view(np.uint32).tolist()
    ints = np.array([0, 5, -7, 2**31 - 1], np.int32)
    negated = call(gl, "small.glsl", "int negated(int x)", ints, constants=CONSTANTS, root=root)
    assert negated.tolist() == (-ints).tolist()
    assert negated.dtype == np.int32
    uints = np.array([0, 1, 2**32 - 1], np.uint32)
    inverted = call(gl, "small.glsl", "uint inverted(uint x)", uints, constants=CONSTANTS, root=root)
    assert inverted.tolist() == (~uints).tolist()


def test_calls_beyond_one_work_group_are_all_made(gl: moderngl.Context, root: Path) -> None:
    below = call(
        gl, "small.glsl", "bool below(float x, float limit)", WHOLE, 64.5, constants=CONSTANTS, root=root
    )
    assert below.dtype == np.bool_
    assert below.tolist() == (WHOLE < 64.5).tolist()


def test_vectors_keep_their_components_in_order(gl: moderngl.Context, root: Path) -> None:
    pairs = WHOLE.reshape(-1, 2)
    swapped = call(gl, "small.glsl", "vec2 swapped(vec2 p)", pairs, constants=CONSTANTS, root=root)
    assert swapped.tolist() == pairs[:, ::-1].tolist()
    triples = WHOLE[:129].reshape(-1, 3)
    factors = np.arange(43, dtype=np.float32)
    scaled = call(
        gl, "small.glsl", "vec3 scaled(vec3 p, float s)", triples, factors, constants=CONSTANTS, root=root
    )
    assert scaled.tolist() == (triples * factors[:, None]).tolist()  # whole numbers below 2**24: exact
    indices = np.arange(6, dtype=np.int32).reshape(2, 3)
    shifted = call(
        gl, "small.glsl", "ivec3 shifted(ivec3 p, int by)", indices, -2, constants=CONSTANTS, root=root
    )
    assert shifted.tolist() == (indices - 2).tolist()
    signs = np.array([[1.0, -1.0], [-1.0, 1.0]], np.float32)
    above = call(gl, "small.glsl", "bvec2 above(vec2 p)", signs, constants=CONSTANTS, root=root)
    assert above.tolist() == (signs > 0).tolist()


def test_out_and_inout_parameters_follow_the_returned_value(gl: moderngl.Context, root: Path) -> None:
    x = np.array([1.25, -0.5, 7.0], np.float32)
    signature = "int split(float x, out float fraction, inout uint counter)"
    counter = np.array([4, 5, 6], np.uint32)
    whole, fraction, counted = call(gl, "small.glsl", signature, x, counter, constants=CONSTANTS, root=root)
    assert whole.tolist() == [1, -1, 7]
    assert fraction.tolist() == [0.25, 0.5, 0.0]
    assert counted.tolist() == [5, 6, 7]


def test_void_function_gives_its_inout_parameters(gl: moderngl.Context, root: Path) -> None:
    a, b = np.array([3, 1], np.float32), np.array([2, 2], np.float32)
    signature = "void order(inout float a, inout float b)"
    low, high = call(gl, "small.glsl", signature, a, b, constants=CONSTANTS, root=root)
    assert (low.tolist(), high.tolist()) == ([2, 1], [3, 2])


def test_array_parameters_take_one_row_per_call(gl: moderngl.Context, root: Path) -> None:
    rows = WHOLE[:12].reshape(3, 4)
    last = call(gl, "small.glsl", "float last(float x[4])", rows, constants=CONSTANTS, root=root)
    assert last.tolist() == [3, 7, 11]
    total = call(
        gl, "small.glsl", "float total(float x[COUNT])", rows.reshape(4, 3), constants=CONSTANTS, root=root
    )
    assert total.tolist() == [3, 12, 21, 30]
    second = call(
        gl, "small.glsl", "vec2 second(vec2 p[3])", rows.reshape(2, 3, 2), constants=CONSTANTS, root=root
    )
    assert second.tolist() == [[2, 3], [8, 9]]


def test_function_without_arguments_is_called_once(gl: moderngl.Context, root: Path) -> None:
    assert call(gl, "small.glsl", "float answer()", constants=CONSTANTS, root=root).tolist() == [42]


def test_prelude_supplies_what_the_file_expects(gl: moderngl.Context, tmp_path: Path) -> None:
    (tmp_path / "march.glsl").write_text("float twice(float x) { return 2.0 * field(x); }\n")
    prelude = "float field(float x) { return x + 1.0; }"
    found = call(gl, "march.glsl", "float twice(float x)", ONE, prelude=prelude, root=tmp_path)
    assert found.tolist() == [4.0]


def _assert_composites(gl: moderngl.Context, root: Path, function: str) -> None:
    random = np.random.default_rng(7)
    front, back = random.random((2, 1000, 4), dtype=np.float32)
    found = call(
        gl,
        "small.glsl",
        f"vec4 {function}(vec4 front, vec4 back)",
        front,
        back,
        constants=CONSTANTS,
        root=root,
    )
    # Three roundings (1 - a, the product, the sum): gamma(3) (|front| + |back|), with u = 2**-24.
    unit = 2.0**-24
    bound = 3 * unit / (1 - 3 * unit) * (np.abs(front) + np.abs(back))
    assert (np.abs(found - _over(front, back)) <= bound).all()


def test_function_agrees_with_its_float64_twin(gl: moderngl.Context, root: Path) -> None:
    _assert_composites(gl, root, "over")


def test_wrong_function_is_told_from_its_float64_twin(gl: moderngl.Context, root: Path) -> None:
    with pytest.raises(AssertionError):
        _assert_composites(gl, root, "over_wrong")


@given(value=st.floats(width=32, allow_nan=False, allow_subnormal=False))
def test_property_tests_can_call(gl: moderngl.Context, root: Path, value: float) -> None:
    found = call(gl, "small.glsl", "float identity(float x)", [value], constants=CONSTANTS, root=root)
    assert found.tolist() == [value]


@pytest.mark.parametrize(
    ("signature", "arrays", "message"),
    [
        ("float identity(float x)", (np.zeros(2),), "expected float32, not float64"),
        ("float identity(float x)", (), "0 arrays for the 1 parameters"),
        ("float identity(float x)", (np.zeros((2, 2), np.float32),), "expected shape"),
        ("vec2 swapped(vec2 p)", (np.zeros((2, 3), np.float32),), "expected shape"),
        ("float identity(float x)", (np.zeros(0, np.float32),), "0 calls"),
        (
            "bool below(float x, float limit)",
            (np.zeros(2, np.float32), np.zeros(3, np.float32)),
            r"different lengths: \[2, 3\]",
        ),
        ("identity(float x)", (np.zeros(2, np.float32),), "cannot read the signature"),
        ("float identity(mat4 x)", (np.zeros(2, np.float32),), "type mat4"),
        ("float total(float x[NONE])", (np.zeros((2, 3), np.float32),), "array length NONE"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(
    gl: moderngl.Context, root: Path, signature: str, arrays: tuple[np.ndarray, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        call(gl, "small.glsl", signature, *arrays, constants=CONSTANTS, root=root)


def test_compile_error_names_the_library_line(gl: moderngl.Context, tmp_path: Path) -> None:
    (tmp_path / "bad.glsl").write_text("float f(float x) {\n    return missing;\n}\n")
    with pytest.raises(ShaderError, match=r"bad\.glsl:2\b"):
        call(gl, "bad.glsl", "float f(float x)", ONE, root=tmp_path)
