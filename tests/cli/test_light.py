"""Pictures with light have isovalues where the transfer function is constant; what was made without says so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import isosample
from cli.harness import blob, write_json
from isosample.transfer.sample_shares import SampleShares

if TYPE_CHECKING:
    from cli.harness import Run

pytestmark = pytest.mark.usefixtures("gl", "plateau")

SIZE = "--size 24x16"
NOTE = "was made for pictures without light"


@pytest.fixture
def plateau() -> None:
    """plateau.json: as a suggested transfer function, constant from half the range to its end."""
    ends = ((20, 0.0), (50, 0.4), (100, 0.4))
    points = [{"value": value, "color": [1, 0.5, 0.2], "extinction": there} for value, there in ends]
    write_json(Path("plateau.json"), {"points": points})


def isovalues_of(stats: str) -> list[float]:
    found: list[float] = json.loads(Path(stats).read_text(encoding="utf-8"))["isovalues"]
    return found


@pytest.mark.usefixtures("run")
def test_the_library_plans_for_light_where_a_material_is_given() -> None:
    volume, tf = isosample.Volume(blob()), isosample.TransferFunction.load("plateau.json")
    camera: dict[str, Any] = {"camera": isosample.Camera.orbit(volume.box), "size": (24, 16)}
    settings = isosample.RenderSettings(material=isosample.Material())
    lit = isosample.render(volume, tf, settings=settings, **camera)
    plan = isosample.plan_isovalues(tf, volume.value_range, lit=True, shares=SampleShares.of(volume))
    assert lit.stats["isovalues"] == plan.isovalues.tolist()
    assert len(isosample.render(volume, tf, **camera).stats["isovalues"]) == len(plan.isovalues) - 5
    assert isosample.choose_method(volume, tf, settings=settings).load.isovalues == len(plan.isovalues)


def test_a_cache_for_light_gives_the_picture_of_the_volume(run: Run) -> None:
    assert run(f"render blob.npy --tf plateau.json --shading {SIZE} -o direct.npy").status == 0
    assert run("precompute blob.npy --tf plateau.json --shading --cache meshes").status == 0
    for options in ("", "--tf plateau.json", "--per-slope 5"):
        outcome = run(f"render meshes {options} --shading {SIZE} -o cached.npy")
        assert outcome.status == 0
        assert outcome.err == ""
        np.testing.assert_array_equal(np.load("cached.npy"), np.load("direct.npy"))


@pytest.mark.parametrize("options", ["", "--tf plateau.json"])
def test_a_cache_that_was_made_without_light_says_so_and_names_the_cure(run: Run, options: str) -> None:
    assert run("precompute blob.npy --tf plateau.json --cache meshes").status == 0
    outcome = run(f"render meshes {options} --shading --stats stats.json {SIZE} -o out.png")
    assert outcome.status == 0
    assert NOTE in outcome.err
    assert "precompute --shading" in outcome.err
    assert run(f"render meshes {options} {SIZE} -o out.png").err == ""
    assert run("precompute blob.npy --tf plateau.json --shading --cache meshes").status == 0
    cured = run(f"render meshes {options} --shading --stats lit.json {SIZE} -o out.png")
    assert cured.err == ""
    assert len(isovalues_of("lit.json")) == len(isovalues_of("stats.json")) + 5


def test_a_cache_without_constant_slopes_needs_no_light_of_its_own(run: Run) -> None:
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    assert run(f"render meshes --shading {SIZE} -o out.png").err == ""


def test_the_plan_for_light_is_shown(run: Run) -> None:
    unlit, lit = (run(f"info blob.npy --tf plateau.json --plan {option}").out for option in ("", "--shading"))
    assert "constant slopes 1" in unlit
    assert "constant slopes" not in lit
    assert len(lit.splitlines()) == len(unlit.splitlines()) + 5
    outcome = run("info blob.npy --shading")
    assert outcome.status == 2
    assert "add --plan" in outcome.err


def test_a_tolerance_is_told_as_one_without_light_and_lights_plateaus_all_the_same(run: Run) -> None:
    options = f"--tf plateau.json --tolerance 1/16 {SIZE}"
    assert run(f"render blob.npy {options} --stats unlit.json -o out.png").err == ""
    outcome = run(f"render blob.npy {options} --shading --stats lit.json --plan -o out.png")
    assert outcome.status == 0
    assert "unlit" in outcome.fields()["tolerance"]
    assert "without light; of the same views, lit, all but 0.1 % err less than" in outcome.err
    assert "constant slopes" not in outcome.out
    inside = [value for value in isovalues_of("lit.json") if value > 50]
    assert len(inside) >= 5
    assert not [value for value in isovalues_of("unlit.json") if value > 50]
