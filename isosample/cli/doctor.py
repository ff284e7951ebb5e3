"""`isosample doctor`: whether this machine's OpenGL can render, and what to do if not."""

from __future__ import annotations

import platform
from typing import TYPE_CHECKING, Any

from isosample.cli.console import say_fields, say_json, say_table
from isosample.cli.parser import add_command
from isosample.errors import OpenGLError
from isosample.wording import byte_size

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands
    from isosample.gl.diagnosis import Diagnosis

EXAMPLE = """\
isosample doctor
isosample doctor --json"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "doctor",
        run,
        summary="Tell whether OpenGL is usable here, and what to do if it is not (exit status 3).",
        example=EXAMPLE,
    )
    parser.add_argument("--json", action="store_true", help="write JSON (default: tables)")


def run(args: argparse.Namespace) -> int:
    """Diagnose, report, and raise `OpenGLError` where rendering is impossible."""
    from isosample.gl.diagnosis import diagnose

    diagnosis = diagnose()
    if args.json:
        say_json({"usable": diagnosis.usable, "versions": versions(), **diagnosis.to_dict()})
    else:
        _say(diagnosis)
    if not diagnosis.usable:
        raise OpenGLError(diagnosis.summary)
    return 0


def versions() -> dict[str, str]:
    """Return the versions of what rendering rests on."""
    from importlib.metadata import version

    packages = ("isosample", "numpy", "moderngl", "glcontext")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def _say(diagnosis: Diagnosis) -> None:
    verdict = {"OpenGL": "usable" if diagnosis.usable else "not usable"}
    say_fields(verdict | _driver_fields(diagnosis.driver))
    libraries = {f"lib{name}": found or "not found" for name, found in diagnosis.libraries.items()}
    devices = {"GPU devices": ", ".join(diagnosis.devices) or "none (not needed for software rendering)"}
    say_fields(libraries | devices | versions())
    if diagnosis.checks:
        rows = [
            [check.name, "passed" if check.passed else "FAILED", check.detail] for check in diagnosis.checks
        ]
        say_table(("check", "result", "detail"), rows)


def _driver_fields(driver: dict[str, Any]) -> dict[str, str]:
    """Name the driver and the limits that matter; empty without a driver."""
    if not driver:
        return {}
    limits = driver["limits"]
    width, height = limits["framebuffer_size"]
    return {
        "renderer": driver["renderer"],
        "vendor": driver["vendor"],
        "version": driver["version"],
        "resolve stage": driver["resolve_stage"],
        "storage buffer": byte_size(limits["storage_block_bytes"]),
        "largest picture": f"{width} x {height} pixels",
    }
