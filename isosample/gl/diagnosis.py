"""What this machine's OpenGL is, and whether the operations that rendering rests on count correctly."""

from __future__ import annotations

import ctypes.util
import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import OpenGLError, ShaderError
from isosample.gl.context import REMEDY, drawing_into, is_software, limits, shared_context, suits_compute
from isosample.gl.program import compute_program, graphics_program

if TYPE_CHECKING:
    import moderngl

SELFTEST_ROOT = Path(__file__).resolve().parent / "selftest"
INVOCATION_COUNT = 64 * 64
IMAGE_EDGE = 300  # [pixel]; triangles cover whole 64 x 64 bins, where drivers were seen to lose fragments
LAYER_COUNT = 5  # full-screen triangles on top of each other


@dataclass(frozen=True, slots=True)
class Check:
    """One operation tried on this driver."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """Result of `diagnose`.

    Attributes
    ----------
    usable : bool
        Whether a context was made and every check passed.
    summary : str
        One line: the renderer, or what failed and what to do.
    driver : dict
        As `describe`; empty without a context.
    checks : tuple of Check
        In the order tried; empty without a context.
    libraries : dict of str to (str or None)
        Name under which the system's linker finds ``EGL`` and ``GL``, or None.
    devices : tuple of str
        Device files of GPUs; none are needed for software rendering.
    """

    usable: bool
    summary: str
    driver: dict[str, Any] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    libraries: dict[str, str | None] = field(default_factory=dict)
    devices: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain values, for JSON."""
        return dataclasses.asdict(self)


def describe(ctx: moderngl.Context) -> dict[str, Any]:
    """Names, versions and limits of the driver, and the resolve stage that suits it.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.

    Returns
    -------
    driver : dict
        ``vendor``, ``renderer``, ``version``, ``glsl`` (version), ``software`` (bool), ``resolve_stage``
        ("compute" where `suits_compute`, else "fragment") and ``limits`` (dict of `Limits`).
    """
    return {
        "vendor": ctx.info["GL_VENDOR"],
        "renderer": ctx.info["GL_RENDERER"],
        "version": ctx.info["GL_VERSION"],
        "glsl": f"{ctx.version_code // 100}.{ctx.version_code % 100:02}",  # equal since OpenGL 3.3
        "software": is_software(ctx),
        "resolve_stage": "compute" if suits_compute(ctx) else "fragment",
        "limits": dataclasses.asdict(limits(ctx)),
    }


def diagnose() -> Diagnosis:
    """State of OpenGL on this machine; a missing or faulty driver is reported, not raised.

    Returns
    -------
    diagnosis : Diagnosis
        Of the shared context; one that cannot be made is the finding, not an error.
    """
    libraries, devices = _libraries(), _devices()
    try:
        ctx = shared_context()
    except OpenGLError as error:
        return Diagnosis(usable=False, summary=str(error), libraries=libraries, devices=devices)
    driver, checks = describe(ctx), self_test(ctx)
    failed = [check for check in checks if not check.passed]
    name = f"{driver['renderer']}, OpenGL {driver['version']}"
    summary = name
    if failed:
        faults = "; ".join(f"{check.name}: {check.detail}" for check in failed)
        summary = f"{name} does not work: {faults}. {REMEDY}"
    return Diagnosis(
        usable=not failed,
        summary=summary,
        driver=driver,
        checks=checks,
        libraries=libraries,
        devices=devices,
    )


def self_test(ctx: moderngl.Context) -> tuple[Check, ...]:
    """Count invocations and fragments with atomics in storage buffers, and compare with the known numbers.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.

    Returns
    -------
    checks : tuple of Check
        A compute shader; full-screen triangles into a framebuffer without attachments.
    """
    tries = (
        ("compute shader with storage buffer", _count_invocations, INVOCATION_COUNT, 1),
        ("fragment shader with storage buffer", _count_fragments, IMAGE_EDGE**2 * LAYER_COUNT, LAYER_COUNT),
    )
    checks = []
    for name, count, total, per_cell in tries:
        try:
            counts = count(ctx)
        except (ShaderError, OpenGLError) as error:
            checks.append(Check(name, passed=False, detail=" ".join(str(error).split())))
            continue
        wrong = int((counts[1:] != per_cell).sum())
        detail = f"counted {int(counts[0])} of {total}, {wrong} of {counts.size - 1} cells wrong"
        checks.append(Check(name, passed=int(counts[0]) == total and wrong == 0, detail=detail))
    return tuple(checks)


def _count_invocations(ctx: moderngl.Context) -> npt.NDArray[np.uint32]:
    program = compute_program(ctx, "count.comp", root=SELFTEST_ROOT)
    buffer = ctx.buffer(data=np.zeros(1 + INVOCATION_COUNT, np.uint32))
    try:
        buffer.bind_to_storage_buffer(0)
        program.run(INVOCATION_COUNT // 64)
        ctx.finish()
        return np.frombuffer(buffer.read(), np.uint32)
    finally:
        buffer.release()
        program.release()


def _count_fragments(ctx: moderngl.Context) -> npt.NDArray[np.uint32]:
    """Total, then count of each pixel, of full-screen triangles without attachment, as in the build pass."""
    program = graphics_program(
        ctx, "fullscreen.vert", "count.frag", {"IMAGE_WIDTH": IMAGE_EDGE}, root=SELFTEST_ROOT
    )
    buffer = ctx.buffer(data=np.zeros(1 + IMAGE_EDGE**2, np.uint32))
    framebuffer = ctx.empty_framebuffer((IMAGE_EDGE, IMAGE_EDGE))
    triangles = ctx.vertex_array(program, [])
    try:
        buffer.bind_to_storage_buffer(0)
        with drawing_into(ctx, framebuffer):
            triangles.render(vertices=3, instances=LAYER_COUNT)
        ctx.finish()
        return np.frombuffer(buffer.read(), np.uint32)
    finally:
        for part in (triangles, framebuffer, buffer, program):
            part.release()


def _libraries() -> dict[str, str | None]:
    return {name: ctypes.util.find_library(name) for name in ("EGL", "GL")}


def _devices() -> tuple[str, ...]:
    found = [*Path("/dev").glob("dri/*"), *Path("/dev").glob("nvidia[0-9]*")]
    return tuple(sorted(str(path) for path in found))
