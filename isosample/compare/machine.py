"""What a comparison ran on: versions, processor, driver and date."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

PACKAGES = ("numpy", "scipy", "numba", "moderngl", "glcontext", "scikit-image", "flip-evaluator")


def describe_machine() -> dict[str, Any]:
    """Names and versions of what figures depend on.

    Returns
    -------
    machine : dict
        ``date`` (UTC, ISO 8601), ``isosample``, ``python``, ``platform``, ``processor``, ``cores``, ``packages``
        (versions by name), ``driver`` (as `gl.diagnosis.describe`); JSON-ready.

    Raises
    ------
    OpenGLError
        If there is no usable OpenGL.
    """
    import isosample
    from isosample.gl.context import shared_context
    from isosample.gl.diagnosis import describe

    return {
        "date": datetime.now(tz=UTC).isoformat(timespec="seconds"),
        "isosample": isosample.__version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": processor(),
        "cores": os.cpu_count(),
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
        "driver": describe(shared_context()),
    }


def processor() -> str:
    """Model name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
