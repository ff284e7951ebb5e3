"""Renders real scans with the transfer functions of this folder: python examples/gallery.py VOLUMES [OUT].

VOLUMES is a folder with the classic test volumes named below; those that are not there are left out.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import isosample
from isosample import Camera, Material, Projection, RenderSettings

TRANSFER_FUNCTIONS = Path(__file__).parent / "tf"


@dataclass(frozen=True)
class Scene:
    """A volume file, the view of it, and how to read it."""

    name: str  # of the transfer function and of the picture
    file: str
    view: dict[str, Any] = field(default_factory=dict)
    reading: dict[str, Any] = field(default_factory=dict)


SCENES = [
    Scene("nucleon", "nucleon.nhdr", {"azimuth": 20, "elevation": 20, "zoom": 1.4}),
    Scene("engine", "engine.tif", {"azimuth": 150, "elevation": -60, "zoom": 1.35}),
    Scene("head_ct", "head_ct.nii.gz", {"azimuth": 35, "elevation": 8, "zoom": 1.5}),
    Scene("carp", "carp.nii.gz", {"azimuth": 65, "elevation": 25, "zoom": 1.3}),
    Scene(
        "aneurism",
        "aneurism.raw.gz",
        {"azimuth": 30, "elevation": 20, "zoom": 1.5},
        {"shape": (256, 256, 256), "dtype": "uint8"},
    ),
    Scene("vessels_mra", "vessels_mra.nii.gz", {"elevation": 90, "zoom": 1.6}),
    Scene("hydrogenatom", "hydrogenatom.dat", {"azimuth": 30, "elevation": 20, "zoom": 1.5}),
]
SETTINGS = RenderSettings(material=Material(), background=(0.01, 0.01, 0.015, 1.0))


def render_scene(scene: Scene, volumes: Path, size: tuple[int, int] = (800, 800)) -> isosample.Image:
    """The picture of one scene."""
    volume = isosample.open_volume(volumes / scene.file, **scene.reading)
    tf = isosample.TransferFunction.load(TRANSFER_FUNCTIONS / f"{scene.name}.json")
    camera = Camera.orbit(volume.box, projection=Projection.PERSPECTIVE, **scene.view)
    return isosample.render(volume, tf, camera=camera, size=size, settings=SETTINGS)


def main(volumes: Path, out: Path) -> None:
    """Render every scene whose volume is there."""
    out.mkdir(parents=True, exist_ok=True)
    for scene in SCENES:
        if not (volumes / scene.file).exists():
            print(f"{scene.file}: not in {volumes}, left out")
            continue
        image = render_scene(scene, volumes)
        image.save(out / f"{scene.name}.png")
        stats = image.stats
        print(
            f"{scene.name}: {len(stats['isovalues'])} isovalues, {stats['triangles']['drawn']:,} triangles, "
            f"{stats['fragments']:,} fragments, {sum(stats['seconds'].values()):.1f} s"
        )


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else Path("gallery"))
