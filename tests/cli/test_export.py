"""`export` writes one isosurface in world units, the same from a volume and from its cache."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cli.harness import Run, blob
from isosample.cli import console

if TYPE_CHECKING:
    from pathlib import Path


def vertices_of(path: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    import trimesh

    mesh: Any = trimesh.load(path, force="mesh")
    return np.asarray(mesh.vertices, dtype=np.float64)


@pytest.mark.parametrize("suffix", ["ply", "glb", "stl", "obj", "vtp"])
@pytest.mark.usefixtures("cache")
def test_a_volume_and_its_cache_give_the_same_file(run: Run, folder: Path, suffix: str) -> None:
    from_volume = run(f"export blob.npy --isovalue 50 -o volume.{suffix}")
    from_cache = run(f"export meshes --isovalue 50 -o cache.{suffix}")
    assert (from_volume.status, from_cache.status) == (0, 0)
    assert (from_volume.err, from_cache.err) == ("", "")
    data = (folder / f"volume.{suffix}").read_bytes()
    assert (folder / f"cache.{suffix}").read_bytes() == data
    fields = from_volume.fields()
    assert fields["mesh"].startswith(f"volume.{suffix} (")
    assert fields["isovalue"] == "50"
    assert int(fields["triangles"].replace(" ", "")) > 100


@pytest.mark.parametrize("suffix", ["ply", "glb", "stl", "obj"])
def test_vertices_lie_in_the_box_in_world_units(run: Run, suffix: str) -> None:
    assert run(f"export blob.npy --isovalue 50 --spacing 0.5,1,3 -o out.{suffix}").status == 0
    vertices = vertices_of(f"out.{suffix}")
    # Along each axis the samples through the blob's middle fall through 50 at an index between two samples.
    for axis, (count, spacing) in enumerate([(10, 0.5), (9, 1.0), (8, 3.0)]):
        centre = (count - 1) / 2 * spacing
        low, high = vertices[:, axis].min(), vertices[:, axis].max()
        # 100 exp(-2 u^2) = 50 at u = sqrt(ln(2) / 2) of half the box; linear interpolation moves it by less
        # than a cell.
        reach = np.sqrt(np.log(2) / 2) * centre
        assert low == pytest.approx(centre - reach, abs=spacing)
        assert high == pytest.approx(centre + reach, abs=spacing)


def test_json_tells_what_the_table_tells(run: Run, folder: Path) -> None:
    told = json.loads(run("export blob.npy --isovalue 50 -o out.vtp --json").out)
    fields = run("export blob.npy --isovalue 50 -o out.vtp").fields()
    assert told["mesh"] == "out.vtp"
    assert told["bytes"] == (folder / "out.vtp").stat().st_size
    assert told["isovalue"] == 50
    for name in ("vertices", "triangles", "open_edges"):
        assert str(told[name]) == fields[name.replace("_", " ")].replace(" ", "")
    assert told["open_edges"] == 0  # the blob lies inside the volume
    assert "simplification" not in told


def test_a_simplified_mesh_tells_its_distance(run: Run) -> None:
    pytest.importorskip("pymeshlab")
    whole = json.loads(run("export blob.npy --isovalue 50 -o whole.ply --json").out)
    told = json.loads(run("export blob.npy --isovalue 50 --simplify 0.5 -o half.ply --json").out)
    done = told["simplification"]
    assert done["triangles_before"] == whole["triangles"]
    assert told["triangles"] == pytest.approx(0.5 * whole["triangles"], abs=2)
    assert (0 < done["rms_voxels"] < done["hausdorff_voxels"] < 1) is True
    assert told["open_edges"] == 0
    fields = run("export blob.npy --isovalue 50 --max-deviation 0.2 -o near.ply").fields()
    assert float(fields["Hausdorff distance"].split()[0]) <= 0.2
    assert int(fields["triangles"].replace(" ", "")) < whole["triangles"]


@pytest.mark.parametrize("options", ["--simplify 0.5", "--max-deviation 0.2"])
def test_simplification_tells_its_progress(run: Run, monkeypatch: pytest.MonkeyPatch, options: str) -> None:
    pytest.importorskip("pymeshlab")
    monkeypatch.setattr(console, "MOMENT", 0.0)
    outcome = run(f"export blob.npy --isovalue 50 {options} -o near.ply")
    assert outcome.status == 0
    assert "isosample: simplify: 100 % after " in outcome.err
    assert "simplify:" not in outcome.out


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--simplify 1", "must be below 1"),
        ("--simplify 0", "must be above 0"),
        ("--max-deviation -1", "must be above 0"),
        ("--simplify 0.5 --max-deviation 1", "not allowed with"),
    ],
)
def test_impossible_simplifications_are_refused(run: Run, folder: Path, options: str, told: str) -> None:
    outcome = run(f"export blob.npy --isovalue 50 {options} -o out.ply")
    assert outcome.status == 2
    assert told in outcome.err
    assert not (folder / "out.ply").exists()


def test_a_missing_pymeshlab_is_told_before_anything_is_written(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    outcome = run("export blob.npy --isovalue 50 --simplify 0.5 -o out.ply")
    assert outcome.status == 2
    assert 'pip install "isosample[simplify]"' in outcome.err
    assert not (folder / "out.ply").exists()


def test_a_negative_isovalue_needs_no_equals_sign(run: Run) -> None:
    np.save("low.npy", blob() - 100)
    assert run("export low.npy --isovalue -50 -o low.ply").status == 0
    assert run("export blob.npy --isovalue 50 -o high.ply").status == 0
    np.testing.assert_allclose(vertices_of("low.ply"), vertices_of("high.ply"), atol=1e-4)


def test_nan_masked_leaves_a_hole(run: Run) -> None:
    samples = blob()
    samples[:, :, 5:] = np.nan
    np.save("half.npy", samples)
    assert run("export half.npy --isovalue 50 --nan masked -o half.ply").status == 0
    assert vertices_of("half.ply")[:, 0].max() <= 4  # cells end at the last finite sample
