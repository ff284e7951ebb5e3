"""The command line: `isosample COMMAND …`; one file per command, and `main`."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import traceback
import warnings
from typing import TYPE_CHECKING

from isosample.cli import cache, compare, demo, doctor, export, filter, info, precompute, render, verify
from isosample.cli.console import LogNotes
from isosample.cli.parser import CommandParser, join_negative_values, parse_arguments
from isosample.errors import IsosampleError, LostFragmentsError, OpenGLError, ShaderError, UnrepairedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

EXIT_FAILED = 1  # a verification or a strict picture failed
EXIT_INPUT = 2
EXIT_OPENGL = 3
EXIT_INTERNAL = 70  # EX_SOFTWARE of sysexits.h: a fault of this program, not of its input
EXIT_INTERRUPTED = 128 + 2  # as a shell reports SIGINT
EXIT_BROKEN_PIPE = 128 + 13  # as a shell reports SIGPIPE

COMMANDS = (demo, info, filter, precompute, render, compare, verify, export, cache, doctor)


def build_parser() -> CommandParser:
    """Return the parser of all commands."""
    from isosample import __version__

    parser = CommandParser(
        prog="isosample",
        description="Render volumes through isosurfaces at values chosen from the transfer function.",
        epilog="example:\n  isosample demo\n  isosample render head.nrrd --method auto -o head.png",
    )
    parser.add_argument("--version", action="version", version=f"isosample {__version__}")
    commands = parser.add_subparsers(title="commands", dest="command", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit status.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments after the program's name; those of the process by default.

    Returns
    -------
    status : int
        0; 1 a verification failed; 2 bad input; 3 no usable OpenGL; 70 a fault of the program; 130 interrupted;
        141 nobody reads the output any more.
    """
    arguments = join_negative_values(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal cannot show is no error
    with _warnings_as_lines(), _log_as_notes():
        try:
            return _reported(lambda: _run(arguments), debug="--debug" in arguments)
        except BrokenPipeError:
            _discard_output()
            return EXIT_BROKEN_PIPE


def _run(arguments: list[str]) -> int:
    """Parse, run the command and flush; the help and the version leave by SystemExit."""
    try:
        options = parse_arguments(build_parser(), arguments)
        status: int = options.run(options)
    except SystemExit as leaving:
        status = int(leaving.code or 0)
    sys.stdout.flush()
    return status


def _reported(run: Callable[[], int], *, debug: bool) -> int:
    """Run, and turn what goes wrong into one line on standard error and an exit status."""
    try:
        return run()
    except (OpenGLError, ShaderError, LostFragmentsError) as error:
        return _fail(f"error: {error}", EXIT_OPENGL, debug=debug)
    except UnrepairedError as error:
        return _fail(f"error: {error}", EXIT_FAILED, debug=debug)
    except IsosampleError as error:
        return _fail(f"error: {error}", EXIT_INPUT, debug=debug)
    except MemoryError as error:
        reason = str(error) or "no more can be had"
        return _fail(
            f"error: out of memory ({reason}). Use a smaller volume, fewer isovalues (--per-slope) or a "
            "smaller picture (--size).",
            EXIT_INPUT,
            debug=debug,
        )
    except KeyboardInterrupt:
        return _fail("interrupted", EXIT_INTERRUPTED, debug=debug)
    except BrokenPipeError:
        raise
    except OSError as error:
        try:
            sys.stdout.flush()
        except OSError:  # it is standard output that cannot be written, and Python would flush it once more
            _discard_output()
        place = f": {error.filename}" if error.filename else ""
        return _fail(f"error: {error.strerror or error}{place}.", EXIT_INPUT, debug=debug)
    except Exception as error:  # noqa: BLE001  # the outermost boundary: a user never sees a traceback unasked
        where = f"{type(error).__name__}: {error}"
        return _fail(
            f"internal error: {where}. Please report it with the output of --debug.",
            EXIT_INTERNAL,
            debug=debug,
        )


def _discard_output() -> None:
    """Let what is still buffered for standard output go nowhere."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, status: int, *, debug: bool) -> int:
    """Write one line on standard error (and the traceback where asked for); return `status`."""
    if debug:
        traceback.print_exc()
    line = " ".join(message.split())
    shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
    sys.stderr.write(f"isosample: {shown}\n")
    return status


@contextlib.contextmanager
def _log_as_notes() -> Iterator[None]:
    """Show what the library logs as one line each on standard error."""
    log, handler = logging.getLogger("isosample"), LogNotes()
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(level)
        log.removeHandler(handler)


@contextlib.contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """Show warnings for users (`UserWarning`) as one line each on standard error."""

    def show(message: Warning | str, *_: object, **__: object) -> None:
        sys.stderr.write(f"isosample: warning: {' '.join(str(message).split())}\n")

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield
