"""The scenes of the ray caster's benchmark, and their reference pictures, kept between runs."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import isosample
from benchmarks import accuracy_scenes
from isosample.rendering.camera import Camera, Projection
from isosample.transfer.control_points import Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.readers import open_volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    F32 = npt.NDArray[np.float32]

TENTS = "T1 two narrow tents"
REFERENCES = Path(tempfile.gettempdir()) / "isosample-bench"
IMPULSES = 128
IMPULSE_OPACITY = 0.05


@dataclass(frozen=True, eq=False)
class RaycastScene:
    """A volume, a transfer function and a camera."""

    name: str
    volume: Volume
    transfer_function: TransferFunction
    camera: Camera
    reconstruction: Reconstruction = Reconstruction.TRILINEAR

    def reference(self, size: int) -> F32:
        """The float64 reference picture (size, size, 4), from the folder of earlier runs if it is there."""
        file = REFERENCES / f"{self._key(size)}.npy"
        if not file.is_file():
            REFERENCES.mkdir(exist_ok=True)
            image = isosample.render_reference(
                self.volume,
                self.transfer_function,
                camera=self.camera,
                size=(size, size),
                reconstruction=self.reconstruction,
                tolerance=1e-7,
            )
            part = file.with_suffix(".part.npy")
            np.save(part, image.rgba)
            part.replace(file)
        shown: F32 = np.load(file)
        return shown

    def looked_at(self, name: str, camera: Camera) -> RaycastScene:
        """The scene by another camera."""
        return replace(self, name=f"{self.name}, {name}", camera=camera)

    def reconstructed(self, reconstruction: Reconstruction) -> RaycastScene:
        """The scene with another field between the samples."""
        return replace(self, reconstruction=reconstruction)

    def _key(self, size: int) -> str:
        """Of all that the reference picture depends on."""
        digest = hashlib.sha256(np.ascontiguousarray(self.volume.array).tobytes())
        for part in (
            self.volume.geometry.to_dict(),
            self.transfer_function.to_dict(),
            self.camera.to_dict(),
            self.reconstruction.value,
            size,
        ):
            digest.update(repr(part).encode())
        return digest.hexdigest()[:24]


def nucleon_tents() -> RaycastScene:
    """Nucleon-like field on 128³ with two narrow tents."""
    scene = accuracy_scenes.nucleon(128)
    tents = scene.transfer_function(TENTS, "translucent")
    return RaycastScene(scene.name, scene.volume, tents, scene.camera)


def scan(name: str, file: str, tents: tuple[tuple[float, float, float], ...]) -> RaycastScene | None:
    """A scan with tents (foot, peak, extinction of a box of 40), in its own axes; None if it is not there."""
    path = accuracy_scenes.SCANS / file
    if not path.is_file():
        print(f"skipped: {name}, as there is no {file} in the folder of scans (ISOSAMPLE_VOLUMES)")
        return None
    options = {"shape": (256, 256, 256), "dtype": "uint8"} if ".raw" in file else {}
    opened = open_volume(path, **options)  # type: ignore[arg-type]
    volume = Volume(np.ascontiguousarray(opened.array), spacing=opened.spacing, name=name)
    scale = accuracy_scenes.EXTINCTION_RADIUS / volume.box.radius
    colors = (accuracy_scenes.BLUE, accuracy_scenes.GOLD)
    points = [
        isosample.ControlPoint(value, color, height * scale)
        for (foot, peak, extinction), color in zip(tents, colors, strict=True)
        for value, height in ((foot, 0.0), (peak, extinction), (2 * peak - foot, 0.0))
    ]
    camera = Camera.orbit(volume.box, azimuth=31, elevation=23, zoom=1.5)
    return RaycastScene(name, volume, TransferFunction(points), camera)


SCAN_TENTS = {
    "engine": ("engine.tif", ((85.0, 95.0, 0.3), (175.0, 185.0, 0.6))),
    "vessels (MRA)": ("vessels_mra.nii.gz", ((90.0, 100.0, 0.3), (160.0, 170.0, 0.6))),
    "aneurism": ("aneurism.raw.gz", ((30.0, 40.0, 0.3), (110.0, 120.0, 0.6))),
    "hydrogen atom": ("hydrogenatom.dat", ((20.0, 28.0, 0.3), (70.0, 78.0, 0.6))),
    "carp": ("carp.nii.gz", ((60.0, 70.0, 0.3), (125.0, 135.0, 0.6))),
    "embryo (noisy)": ("embryo.nrrd", ((60.0, 66.0, 0.3), (110.0, 116.0, 0.6))),
}


def scans(*names: str) -> Iterator[RaycastScene]:
    """The named scans that are there; all without a name."""
    for name in names or SCAN_TENTS:
        found = scan(name, *SCAN_TENTS[name])
        if found is not None:
            yield found


def impulses(count: int = IMPULSES) -> RaycastScene:
    """A nucleon-like field with many isosurfaces and nothing between them."""
    return replace(
        nucleon_tents(), name="nucleon-like 128³", transfer_function=_isosurfaces(count, 0.02, 0.94)
    )


def ramp_impulses(count: int = IMPULSES) -> RaycastScene:
    """Many isosurfaces of a ramp along an axis of 65³ samples: two between neighbouring samples."""
    ramp = np.broadcast_to(np.linspace(0.0, 1.0, 65, dtype=np.float32)[:, None, None], (65, 65, 65))
    volume = Volume(np.ascontiguousarray(ramp), name="ramp")
    camera = Camera.orbit(volume.box, azimuth=31, elevation=23, zoom=1.5)
    return RaycastScene("ramp 65³", volume, _isosurfaces(count, 0.0, 1.0), camera)


def _isosurfaces(count: int, low: float, high: float) -> TransferFunction:
    """Isosurfaces in the middle of equal parts of a range, from blue to red."""
    shares = ((np.arange(count) + 0.5) / count).tolist()
    surfaces = [
        Isosurface(low + (high - low) * share, (share, 0.5, 1.0 - share), IMPULSE_OPACITY) for share in shares
    ]
    return TransferFunction([], isosurfaces=surfaces)


def close_up(scene: RaycastScene) -> Camera:
    """Perspective camera half-way between the middle and the front of the box: most of a ray is far away."""
    return _perspective(scene, 0.55, 60.0)


def far_view(scene: RaycastScene) -> Camera:
    """Perspective camera that sees the whole box."""
    return Camera.orbit(
        scene.volume.box, azimuth=31, elevation=23, zoom=1.3, projection=Projection.PERSPECTIVE
    )


def _perspective(scene: RaycastScene, distance: float, fov: float) -> Camera:
    """Look at the middle from `distance` radii."""
    orbit = far_view(scene)
    box = scene.volume.box
    away = np.subtract(orbit.eye, box.centre)
    eye = box.centre + distance * box.radius * away / np.linalg.norm(away)
    return Camera(
        projection=Projection.PERSPECTIVE,
        eye=tuple(eye.tolist()),
        target=orbit.target,
        up=orbit.up,
        fov_y_degrees=fov,
    )
