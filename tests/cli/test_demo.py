"""`demo` takes built-in volumes through the whole pipeline and leaves what its summary names."""

from __future__ import annotations

import importlib.util
import json
import shlex
from typing import TYPE_CHECKING

import numpy as np
import pytest

from cli.harness import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from cli.harness import Run

pytestmark = pytest.mark.usefixtures("gl")


def readme_commands() -> list[list[str]]:
    """What README.md says can be done with the folder that `make demo` leaves."""
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    words = [shlex.split(line, comments=True) for line in lines if line.startswith("isosample ")]
    found = [line[1:] for line in words if any(word.split("/")[0] == "demo" for word in line[1:])]
    assert len(found) == 3
    return found


def test_the_demo_leaves_pictures_statistics_and_meshes_that_render_again(run: Run, folder: Path) -> None:
    import PIL.Image

    outcome = run("demo -o demo --size 24x16")
    assert outcome.status == 0, outcome.err
    assert outcome.err == ""
    stats = json.loads((folder / "demo" / "stats.json").read_text(encoding="utf-8"))
    assert len(stats) >= 2
    pictures = {f"{name}{part}.png" for name in stats for part in ("", "_cut")}
    plots = {f"{name}_transfer_function.png" for name in stats}
    has_plots = importlib.util.find_spec("matplotlib") is not None
    left = {path.name for path in (folder / "demo").iterdir()}
    expected = pictures | {f"{name}_meshes" for name in stats} | {"stats.json"}
    assert left == expected | (plots if has_plots else set())
    for name in pictures:
        assert f"  demo/{name}\n" in outcome.out
        with PIL.Image.open(folder / "demo" / name) as picture:
            assert picture.size == (24, 16)
            assert np.ptp(np.asarray(picture)[..., :3], axis=(0, 1)).min() > 50  # every channel varies
    for entry in stats.values():
        assert entry["lost_fragments"] == 0
        assert entry["fragments"] > 24 * 16
    for words in readme_commands():
        followed = run(*words, *(["--size", "24x16"] if "render" in words else []))
        assert followed.status == 0, followed.err
    assert (folder / "nucleon.png").is_file()
    assert (folder / "hydrogen.gif").is_file()
    again = outcome.out.splitlines()[-1].partition("isosample ")[2]
    assert run(*shlex.split(again), "--size", "24x16").status == 0
    assert (folder / "again.png").is_file()
