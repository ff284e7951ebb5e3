"""Start-up is quick, help is helpful, and whatever ends a command early is told in one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

import pytest

from cli.harness import ROOT, Run, content, run_beside, write_json
from isosample import cli
from isosample.cli import build_parser, info
from isosample.cli.parser import join_negative_values

HEAVY = [
    "SimpleITK",
    "scipy",
    "matplotlib",
    "trimesh",
    "moderngl",
    "glcontext",
    "rich",
    "skimage",
    "numba",
    "PIL",
    "tifffile",
]
COMMANDS = (
    "demo",
    "info",
    "filter",
    "precompute",
    "render",
    "compare",
    "verify",
    "export",
    "cache",
    "doctor",
)
ESCAPE = "\x1b"


def modules_after(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after running some code."""
    script = f"import sys\nsys.argv[1:] = []\n{code}\nprint('\\n' + ' '.join(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return {name.partition(".")[0] for name in done.stdout.splitlines()[-1].split()}


@pytest.mark.parametrize(
    "code",
    [
        "import isosample",
        "from isosample.cli import main; main(['--help'])",
        "from isosample.cli import main; main(['render', '--help'])",
        "from isosample.cli import main; assert main(['render', 'x', '-o', 'x.gif']) == 2",
    ],
)
def test_starting_loads_nothing_heavy(code: str) -> None:
    loaded = modules_after(code)
    assert "isosample" in loaded
    assert loaded & {*HEAVY, *([] if "gif" in code else ["numpy"])} == set()


def test_info_loads_no_opengl_and_no_reader_of_other_formats() -> None:
    loaded = modules_after("from isosample.cli import main; assert main(['info', 'blob.npy']) == 0")
    assert "numpy" in loaded
    others = {"SimpleITK", "moderngl", "glcontext", "matplotlib", "trimesh", "rich", "tifffile", "skimage"}
    assert loaded & others == set()


def test_help_lists_every_command_with_its_sentence(run: Run) -> None:
    assert {command.__name__.rpartition(".")[2] for command in cli.COMMANDS} == {*COMMANDS}
    outcome = run("--help")
    assert outcome.status == 0
    assert outcome.err == ""
    assert [name for name in COMMANDS if f"\n    {name}" not in outcome.out] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_a_sentence_and_an_example_that_parses(run: Run, command: str) -> None:
    outcome = run(command, "--help")
    assert outcome.status == 0
    assert ESCAPE not in outcome.out
    examples = outcome.out.partition("\nexample:\n")[2].splitlines()
    assert any(line.startswith(f"  isosample {command}") for line in examples)
    for example in examples:
        words = join_negative_values(example.split())
        assert words[0] == "isosample"
        assert build_parser().parse_args(words[1:]).run


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_explained(command: str) -> None:
    parser = build_parser()
    actions = next(action for action in parser._actions if action.dest == "command")
    assert isinstance(actions.choices, dict)
    options = actions.choices[command]._actions
    assert len(options) > 2
    assert [action.dest for action in options if not action.help] == []


def test_version_is_the_package_s(run: Run) -> None:
    import isosample

    assert run("--version").out == f"isosample {isosample.__version__}\n"


def test_the_package_runs_as_a_module() -> None:
    outcome = run_beside("info blob.npy")
    assert outcome.status == 0
    assert outcome.err == ""
    assert outcome.fields()["size (x, y, z)"] == "10 x 9 x 8"


def test_a_wrong_input_of_the_module_has_its_status_and_line() -> None:
    outcome = run_beside("info absent.npy")
    assert outcome.status == 2
    assert outcome.err.startswith("isosample: error: absent.npy")
    assert outcome.err.count("\n") == 1


def test_output_that_nobody_watches_has_no_escape_codes() -> None:
    outcome = run_beside("precompute blob.npy --cache meshes", FORCE_COLOR="1", TERM="xterm-256color")
    assert outcome.status == 0
    assert ESCAPE not in outcome.out + outcome.err
    plan = run_beside("info blob.npy --plan --tf tf.json", FORCE_COLOR="1", TERM="xterm-256color")
    assert "isovalue" in plan.out
    assert ESCAPE not in plan.out + plan.err


def on_a_terminal(arguments: str, **environment: str) -> str:
    """Return what a command writes to a terminal."""
    pty = pytest.importorskip("pty")
    try:
        ours, theirs = pty.openpty()
    except OSError as error:
        pytest.skip(f"no pseudo-terminal can be had here: {error}")
    variables = {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color", "COLUMNS": "100", **environment}
    process = subprocess.Popen(
        [sys.executable, "-m", "isosample", *arguments.split()],
        env={**os.environ, **variables},
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
    )
    os.close(theirs)
    written = b""
    try:
        while part := os.read(ours, 1 << 16):
            written += part
    except OSError:
        pass  # how Linux says that the other end is closed
    finally:
        os.close(ours)
    assert process.wait(60) == 0, written
    return written.decode()


def test_a_terminal_gets_colours_and_a_histogram_unless_no_color_is_set() -> None:
    coloured = on_a_terminal("info blob.npy --tf tf.json --plan")
    assert f"{ESCAPE}[1;36m" in coloured  # bold cyan
    assert "█" in coloured
    plain = on_a_terminal("info blob.npy --tf tf.json --plan", NO_COLOR="1")
    assert "36m" not in plain
    assert "slope end" in plain


def refuse(error: BaseException) -> object:
    def run(_: object) -> NoReturn:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt(), 130, "isosample: interrupted\n"),
        (
            MemoryError("Unable to allocate 9 TiB"),
            2,
            "isosample: error: out of memory (Unable to allocate 9 TiB)",
        ),
        (MemoryError(), 2, "isosample: error: out of memory"),
        (
            OSError(28, "No space left on device", "out.npy"),
            2,
            "isosample: error: No space left on device: out.npy.",
        ),
        (ZeroDivisionError("of\nours"), 70, "isosample: internal error: ZeroDivisionError: of ours."),
    ],
)
def test_whatever_ends_a_command_is_told_in_one_line(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: BaseException, status: int, line: str
) -> None:
    monkeypatch.setattr(info, "describe", refuse(error))
    outcome = run("info blob.npy")
    assert outcome.status == status
    assert outcome.err.startswith(line)
    assert outcome.err.count("\n") == 1


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), MemoryError(), OSError(28, "No space left on device")]
)
def test_a_picture_that_is_not_finished_is_not_there(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    from isosample.rendering import image

    def half(file: object, *_: object, **__: object) -> NoReturn:
        file.write(b"half")  # type: ignore[attr-defined]
        raise error

    before = content(folder)
    monkeypatch.setattr(image, "write_array", half)
    outcome = run("render blob.npy --tf tf.json --size 16x16 -o out.npy")
    assert outcome.status == (130 if isinstance(error, KeyboardInterrupt) else 2)
    assert outcome.err.count("\n") == 1
    assert content(folder) == before


def test_a_warning_is_one_line_and_no_error(run: Run) -> None:
    def curve(*points: object) -> dict[str, object]:
        return {"type": "piecewiseLinearFunction", "points": points}

    opacity = curve({"x": 20, "y": 0.0}, {"x": 80, "y": 0.5})
    parts = {
        "scalarOpacity": opacity,
        "rgbTransferFunction": curve({"x": 20, "color": [1, 0, 0]}, {"x": 80, "color": [0, 0, 1]}),
        "gradientOpacity": opacity,
        "componentWeight": 1.0,
    }
    write_json(Path("slicer.json"), {"volumeProperties": [{"components": [parts]}]})
    outcome = run("info blob.npy --tf slicer.json")
    assert outcome.status == 0, outcome.err
    assert outcome.err == "isosample: warning: slicer.json: gradientOpacity is not supported and left out.\n"


def test_a_reader_that_leaves_early_is_no_error() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "isosample", "info", "blob.npy"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()  # before anything is written
    with process.stderr as errors:
        assert errors.read() == b""
    assert process.wait(60) == 141


def test_a_full_disk_behind_standard_output_is_told_in_one_line() -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("there is no /dev/full here")
    with full.open("wb") as stream:
        done = subprocess.run(
            [sys.executable, "-m", "isosample", "info", "blob.npy"],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=stream,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "isosample: error: No space left on device.\n"


def test_control_characters_of_a_name_cannot_reach_the_terminal(run: Run) -> None:
    outcome = run("info", f"a{ESCAPE}[31m\n\x07.npy")
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
    assert ESCAPE not in outcome.err
    assert "\x07" not in outcome.err
