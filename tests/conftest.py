"""Shared fixtures: numpy errors raise, hypothesis is derandomised, real volumes and OpenGL are found once."""

from __future__ import annotations

from pathlib import Path

import hypothesis
import numpy as np
import pytest

hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, max_examples=60)
hypothesis.settings.load_profile("ci")

REAL_VOLUMES = Path(__file__).resolve().parents[2] / "shared" / "volumes"


@pytest.fixture(autouse=True)
def _numpy_errors_raise():
    """Turn silent divisions by zero, overflows and invalid operations into test failures."""
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield


@pytest.fixture(scope="session")
def real_volumes() -> Path:
    """Folder of real scans; tests that need it are skipped where it is absent."""
    if not (REAL_VOLUMES / "README.md").is_file():
        pytest.skip("the folder of real scans (../shared/volumes) is not there")
    return REAL_VOLUMES
