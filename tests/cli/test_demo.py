"""`demo` takes built-in volumes through the whole pipeline and leaves what its summary names."""

from __future__ import annotations

import importlib.util
import json
import shlex
from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from cli.harness import Run

pytestmark = pytest.mark.usefixtures("gl")


def test_the_demo_leaves_pictures_statistics_and_meshes_that_render_again(run: Run, folder: Path) -> None:
    import PIL.Image

    outcome = run("demo -o shown --size 24x16")
    assert outcome.status == 0, outcome.err
    assert outcome.err == ""
    stats = json.loads((folder / "shown" / "stats.json").read_text(encoding="utf-8"))
    assert len(stats) >= 2
    pictures = {f"{name}{part}.png" for name in stats for part in ("", "_cut")}
    plots = {f"{name}_transfer_function.png" for name in stats}
    has_plots = importlib.util.find_spec("matplotlib") is not None
    left = {path.name for path in (folder / "shown").iterdir()}
    expected = pictures | {f"{name}_meshes" for name in stats} | {"stats.json"}
    assert left == expected | (plots if has_plots else set())
    for name in pictures:
        assert f"  shown/{name}\n" in outcome.out
        with PIL.Image.open(folder / "shown" / name) as picture:
            assert picture.size == (24, 16)
            assert np.ptp(np.asarray(picture)[..., :3], axis=(0, 1)).min() > 50  # every channel varies
    for entry in stats.values():
        assert entry["lost_fragments"] == 0
        assert entry["fragments"] > 24 * 16
    again = outcome.out.splitlines()[-1].partition("isosample ")[2]
    assert run(*shlex.split(again), "--size", "24x16").status == 0
    assert (folder / "again.png").is_file()
