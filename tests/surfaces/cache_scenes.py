"""Scenes and their cache folders: written, compared bit for bit, and damaged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mesh_checks import closed_noise

from isosample.surfaces.cache import content_hash, write_cache
from isosample.surfaces.extract import SurfaceSet, extract_surfaces
from isosample.surfaces.settings import ExtractionSettings
from isosample.transfer.isovalues import IsovaluePlan, plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from pathlib import Path

SMALL_BRICKS = ExtractionSettings(brick_cells=4)
CURVED: dict[str, Any] = {"reconstruction": Reconstruction.CUBIC, "refine": 2, "residuals": True}


def scene_volume(seed: int = 0) -> Volume:
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, -1.0]])
    samples = closed_noise(seed, size=9).astype(">f4")
    return Volume(samples, spacing=(0.1, 1 / 3, 0.7), origin=(0.1, -2.0, 1e3), direction=turn, name="noise")


def scene_transfer(volume: Volume) -> tuple[TransferFunction, IsovaluePlan]:
    colors = ((0.1, 0.2, 1 / 3), (1.0, 0.5, 0.0), (0.3, 0.3, 0.3))
    points = zip((-0.5, 0.1, 0.7), colors, (0.0, 2.0 / 3.0, 0.0), strict=True)
    transfer = TransferFunction([ControlPoint(value=v, color=c, extinction=e) for v, c, e in points])
    return transfer, plan_isovalues(transfer, volume.value_range, per_slope=1)


def written_scene(folder: Path, volume: Volume, **settings: Any) -> SurfaceSet:
    transfer, plan = scene_transfer(volume)
    surfaces = extract_surfaces(volume, plan.isovalues, brick_cells=4, **settings)
    write_cache(
        folder,
        surfaces,
        content_hash=content_hash(volume),
        transfer_function=transfer,
        plan=plan,
        name=volume.name,
    )
    return surfaces


def assert_same_bits(first: SurfaceSet, second: SurfaceSet) -> None:
    assert first.geometry == second.geometry
    assert first.value_range == second.value_range
    assert first.settings == second.settings
    assert first.statistics.triangles == second.statistics.triangles
    assert first.statistics.vertices == second.statistics.vertices
    assert first.isovalues.tobytes() == second.isovalues.tobytes()
    assert len(first.meshes) == len(second.meshes) > 0
    for a, b in zip(first.meshes, second.meshes, strict=True):
        assert (a.isovalue, a.brick, a.start) == (b.isovalue, b.brick, b.start)
        assert a.error == b.error
        for field in ("positions", "gradients", "edge_keys", "triangles", "residuals"):
            left, right = getattr(a, field), getattr(b, field)
            assert left.dtype == right.dtype
            assert left.shape == right.shape
            assert left.tobytes() == right.tobytes()
    assert first.mesh_errors == second.mesh_errors
    kernels = [surfaces.boundary.kernel for surfaces in (first, second)]
    left, right = (None if kernel is None else kernel.tobytes() for kernel in kernels)
    assert left == right
    for face, other in zip(first.boundary.faces, second.boundary.faces, strict=True):
        assert face.dtype == other.dtype
        assert face.tobytes() == other.tobytes()


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def damaged(path: Path, damage: str) -> None:
    content = path.read_bytes()
    if damage == "flipped":
        middle = len(content) // 2
        path.write_bytes(content[:middle] + bytes([content[middle] ^ 4]) + content[middle + 1 :])
    else:
        path.write_bytes(content[: len(content) * 2 // 3 * (damage == "truncated")])
