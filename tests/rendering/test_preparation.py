"""What a search has extracted goes into the cache folder, and what the folder has is not extracted again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.defaults import AUTO_DISTANCE
from isosample.errors import InputError
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.surfaces import cached_extraction, field
from isosample.surfaces.brick_meshes import extract_brick
from isosample.surfaces.cache import extract_with_cache
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.settings import ExtractionSettings
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction
from rendering.scenes import ramp_tf
from rendering.test_details import blobs

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.surface_set import SurfaceSet


def refuse(*_: object, **__: object) -> None:
    raise AssertionError("a piece is extracted for the folder, though it is at hand")


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a cache folder but the scans of volumes, which hold dates of files."""
    kinds = ("volume.json", "boundary*", "chunks/*/*", "surfaces/*")
    files = [path for kind in kinds for path in folder.glob(kind)]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def assert_same(found: SurfaceSet, expected: SurfaceSet) -> None:
    assert found.statistics == expected.statistics
    assert_same_meshes(found, expected)


def assert_same_meshes(found: SurfaceSet, expected: SurfaceSet) -> None:
    assert found.settings == expected.settings
    for mesh, other in zip(found.meshes, expected.meshes, strict=True):
        assert (mesh.isovalue, mesh.brick) == (other.isovalue, other.brick)
        np.testing.assert_array_equal(mesh.positions, other.positions)
        np.testing.assert_array_equal(mesh.triangles, other.triangles)
        np.testing.assert_array_equal(mesh.residuals, other.residuals)


@pytest.mark.parametrize(
    "reconstruction", [Reconstruction.TRILINEAR, Reconstruction.CUBIC, Reconstruction.BSPLINE]
)
@pytest.mark.usefixtures("gl")
def test_what_a_search_for_a_tolerance_has_extracted_goes_into_the_folder_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reconstruction: Reconstruction
) -> None:
    volume = blobs(24)
    tf = ramp_tf(*volume.value_range, (0.0, 0.4))
    quality = Quality(tolerance=1 / 16, reconstruction=reconstruction)
    with monkeypatch.context() as watched:
        watched.setattr(cached_extraction, "Field", refuse)
        found = prepare_surfaces(volume, tf, quality, cache=tmp_path / "found")
        again = prepare_surfaces(volume, tf, quality, cache=tmp_path / "found")
    settings = found.surfaces.settings
    assert settings.residuals
    levels = found.plan.isovalues
    assert_same(
        found.surfaces,
        extract_with_cache(volume, levels, tmp_path / "expected", settings=settings),
    )
    assert contents(tmp_path / "found") == contents(tmp_path / "expected")
    assert again.surfaces.statistics.levels_reused == len(levels)
    assert_same(
        again.surfaces,
        extract_with_cache(volume, levels, tmp_path / "expected", settings=settings),
    )


@pytest.mark.parametrize("reconstruction", [Reconstruction.TRILINEAR, Reconstruction.BSPLINE])
def test_automatic_refinement_extracts_nothing_that_the_folder_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reconstruction: Reconstruction
) -> None:
    volume = blobs(24)
    tf = ramp_tf(*volume.value_range, (0.0, 0.4))
    quality = Quality(per_slope=2, refine="auto", reconstruction=reconstruction)
    first = prepare_surfaces(volume, tf, quality, cache=tmp_path)
    alone = prepare_surfaces(volume, tf, quality)
    monkeypatch.setattr(field, "extract_brick", refuse)
    again = prepare_surfaces(volume, tf, quality, cache=tmp_path)
    assert first.surfaces.settings.refine > 1  # so that more than one was tried
    assert again.surfaces.statistics.levels_reused == len(again.plan.isovalues)
    for found in (first, again):
        assert found.mesh_distance == alone.mesh_distance
        assert_same_meshes(found.surfaces, alone.surfaces)


def test_automatic_refinement_goes_on_where_it_was_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = blobs(24)
    tf = ramp_tf(*volume.value_range, (0.0, 0.4))
    quality = Quality(per_slope=2, refine="auto")
    visited: list[int] = []

    def interrupted(*arguments: Any, **options: Any) -> list[BrickMesh]:
        settings = arguments[-1]
        if settings.refine > 1 and interrupt:
            raise KeyboardInterrupt
        visited.append(settings.refine)
        return extract_brick(*arguments, **options)

    monkeypatch.setattr(field, "extract_brick", interrupted)
    interrupt = True
    with pytest.raises(KeyboardInterrupt):
        prepare_surfaces(volume, tf, quality, cache=tmp_path)
    assert visited
    interrupt, before = False, len(visited)
    found = prepare_surfaces(volume, tf, quality, cache=tmp_path)
    assert found.surfaces.settings.refine > 1
    assert 1 not in visited[before:]


def test_automatic_refinement_goes_by_the_outlines_of_curved_triangles_too() -> None:
    """Of spheres, which curved triangles meet to fourth order; chords of length h are h² / (8 r) inside of them."""
    z, y, x = np.meshgrid(*[np.arange(21.0) - 10.0] * 3, indexing="ij")
    volume = Volume(-(x**2 + y**2 + z**2))
    tf = ramp_tf(-81.0, -25.0, (0.0, 0.4))
    found = prepare_surfaces(
        volume, tf, Quality(per_slope=2, refine="auto", reconstruction=Reconstruction.CUBIC)
    )
    options = {**found.surfaces.settings.as_keywords(), "refine": 1}
    unrefined = [
        error for error in extract_surfaces(volume, found.plan.isovalues, **options).mesh_errors if error
    ]
    assert max(error.curved_rms for error in unrefined) <= AUTO_DISTANCE
    assert max(error.flat_rms for error in unrefined) > AUTO_DISTANCE
    assert found.surfaces.settings.refine > 1
    assert found.mesh_distance == max(error.flat_rms for error in found.surfaces.mesh_errors if error)
    assert found.mesh_distance <= AUTO_DISTANCE


@pytest.mark.parametrize(
    "wrong", ["isovalues", "settings", "geometry", "range", "range of the spline", "corner of the spline"]
)
def test_surfaces_of_something_else_are_not_taken(tmp_path: Path, wrong: str) -> None:
    volume = other = blobs(16)
    options: dict[str, Any] = {}
    if wrong == "geometry":
        other = replace(volume, spacing=(1.0, 1.0, 2.0))
    elif "range" in wrong or "corner" in wrong:
        samples = np.array(volume.array, dtype=np.float64)
        inner = (slice(1, -1),) * 3
        samples[inner if "range" in wrong else (-1, 0, -1)] *= 0.5
        other = replace(volume, array=samples)
    if "spline" in wrong:
        options["reconstruction"] = Reconstruction.CUBIC
    asked = [0.3, 0.6] if wrong == "isovalues" else [0.3, 0.5]
    surfaces = extract_surfaces(other, [0.3, 0.5], refine=2 if wrong == "settings" else 1, **options)
    of_volume = wrong not in ("isovalues", "settings")
    what = (
        "the extracted surfaces are of a volume" if of_volume else "the extracted surfaces have 2 isovalues"
    )
    with pytest.raises(InputError, match=what):
        extract_with_cache(
            volume, asked, tmp_path, settings=ExtractionSettings(**options), extracted=surfaces
        )
    assert not contents(tmp_path)
