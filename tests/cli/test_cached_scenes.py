"""The surfaces that commands take from a cache folder: each list is read once, and damage is told as damage."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.harness import TF, Run, write_json
from isosample.cli.cached_scenes import scene_from_cache
from isosample.surfaces import cached_surfaces, surface_files
from isosample.surfaces.cache import load_cache, open_cache
from isosample.surfaces.surface_set import SurfaceSet


def watch_lists(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return where the keys of the lists that are read from now on are noted."""
    read: list[str] = []

    def noted(folder: Path, key: str, isovalue: float, digest: str | None = None) -> object:
        read.append(key)
        return surface_files.read_rows(folder, key, isovalue, digest)

    monkeypatch.setattr(cached_surfaces, "read_rows", noted)
    return read


@pytest.mark.parametrize("given", [False, True], ids=["own", "given"])
def test_every_list_of_a_scene_is_read_once(
    cache: Path, monkeypatch: pytest.MonkeyPatch, given: bool
) -> None:
    expected = load_cache(cache)
    read = watch_lists(monkeypatch)
    found = scene_from_cache(cache, None).surfaces
    assert isinstance(found, SurfaceSet)
    assert len(found.meshes) == len(expected.surfaces.meshes) > 0
    assert len(read) == len(set(read)) == len(expected.surfaces.isovalues)
    if given:
        read.clear()
        again = scene_from_cache(cache, expected.transfer_function).surfaces
        assert isinstance(again, SurfaceSet)
        assert len(again.meshes) == len(expected.surfaces.meshes)
        assert len(read) == 2 * len(set(read))  # of the scene, and of what the given function needs


def test_a_damaged_list_is_not_told_as_an_absent_isosurface(run: Run, cache: Path) -> None:
    """Of an isosurface that the scene needed before its transfer function was another."""
    before, lists = open_cache(cache).surfaces.isovalues.tolist(), set(cache.glob("surfaces/*.npz"))
    write_json(
        Path("other.json"), {"points": [{**point, "value": point["value"] + 1} for point in TF["points"]]}
    )
    assert run("precompute blob.npy --tf other.json --cache meshes").status == 0
    isovalue = next(value for value in before if value not in open_cache(cache).surfaces.isovalues)
    assert run(f"export meshes --isovalue {isovalue!r} -o whole.ply").status == 0
    outcome = run("export meshes --isovalue 77.125 -o absent.ply")
    assert outcome.status == 2
    assert "has no isosurface 77.125; the nearest of its" in outcome.err
    for path in lists:
        path.write_bytes(path.read_bytes()[:-40])
    outcome = run(f"export meshes --isovalue {isovalue!r} -o damaged.ply")
    assert outcome.status == 2
    assert "is damaged" in outcome.err
    assert "has no isosurface" not in outcome.err
