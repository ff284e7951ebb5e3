"""isosample: volume rendering that samples where the data changes.

A volume and a transfer function give isovalues, the isovalues give meshes, and a GPU A-buffer integrates the
volume-rendering integral over the meshes' crossings with every pixel's ray.

>>> import isosample
>>> volume = isosample.open_volume("head.nrrd")
>>> image = isosample.render(volume, camera=isosample.Camera.orbit(volume.box, azimuth=30))
>>> image.save("head.png")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from isosample.errors import IsosampleError as IsosampleError
    from isosample.integral.segment_rule import SegmentRule as SegmentRule
    from isosample.rendering.camera import Camera as Camera
    from isosample.rendering.camera import Projection as Projection
    from isosample.rendering.camera import UpAxis as UpAxis
    from isosample.rendering.film import Film as Film
    from isosample.rendering.framing import visible_box as visible_box
    from isosample.rendering.image import Image as Image
    from isosample.rendering.method_choice import choose_method as choose_method
    from isosample.rendering.pipeline import Renderer as Renderer
    from isosample.rendering.pipeline import render as render
    from isosample.rendering.pipeline import render_surfaces as render_surfaces
    from isosample.rendering.raycast_settings import Classification as Classification
    from isosample.rendering.raycast_settings import Crossings as Crossings
    from isosample.rendering.raycast_settings import Filtering as Filtering
    from isosample.rendering.raycast_settings import Integration as Integration
    from isosample.rendering.raycast_settings import PeakMode as PeakMode
    from isosample.rendering.raycast_settings import PeakWeight as PeakWeight
    from isosample.rendering.raycast_settings import Quadrature as Quadrature
    from isosample.rendering.raycast_settings import RaycastSettings as RaycastSettings
    from isosample.rendering.raycast_settings import Sampling as Sampling
    from isosample.rendering.raycast_settings import TableDtype as TableDtype
    from isosample.rendering.raycast_settings import TransferLookup as TransferLookup
    from isosample.rendering.raycaster import RayCaster as RayCaster
    from isosample.rendering.raycaster import raycast as raycast
    from isosample.rendering.reference_image import render_reference as render_reference
    from isosample.rendering.settings import BuildStage as BuildStage
    from isosample.rendering.settings import ClipPlane as ClipPlane
    from isosample.rendering.settings import Material as Material
    from isosample.rendering.settings import RenderSettings as RenderSettings
    from isosample.rendering.step_search import step_for_tolerance as step_for_tolerance
    from isosample.rendering.turntable import turntable as turntable
    from isosample.surfaces.detail_sets import extract_details as extract_details
    from isosample.surfaces.extract import extract_meshes
    from isosample.surfaces.extract import extract_surfaces as extract_surfaces
    from isosample.transfer.control_points import ControlPoint as ControlPoint
    from isosample.transfer.control_points import Isosurface as Isosurface
    from isosample.transfer.isovalues import plan_isovalues as plan_isovalues
    from isosample.transfer.transfer_function import TransferFunction as TransferFunction
    from isosample.volume.grid import Volume as Volume
    from isosample.volume.readers import open_volume as open_volume
    from isosample.volume.reconstruction import Reconstruction as Reconstruction

if TYPE_CHECKING:
    extract = extract_meshes

__version__ = "0.1.0"

_HOMES = {
    "BuildStage": "rendering.settings",
    "Camera": "rendering.camera",
    "Classification": "rendering.raycast_settings",
    "ClipPlane": "rendering.settings",
    "ControlPoint": "transfer.control_points",
    "Crossings": "rendering.raycast_settings",
    "Film": "rendering.film",
    "Filtering": "rendering.raycast_settings",
    "Image": "rendering.image",
    "Integration": "rendering.raycast_settings",
    "IsosampleError": "errors",
    "Isosurface": "transfer.control_points",
    "Material": "rendering.settings",
    "PeakMode": "rendering.raycast_settings",
    "PeakWeight": "rendering.raycast_settings",
    "Projection": "rendering.camera",
    "Quadrature": "rendering.raycast_settings",
    "RayCaster": "rendering.raycaster",
    "RaycastSettings": "rendering.raycast_settings",
    "Reconstruction": "volume.reconstruction",
    "RenderSettings": "rendering.settings",
    "Renderer": "rendering.pipeline",
    "Sampling": "rendering.raycast_settings",
    "SegmentRule": "integral.segment_rule",
    "TransferFunction": "transfer.transfer_function",
    "TableDtype": "rendering.raycast_settings",
    "TransferLookup": "rendering.raycast_settings",
    "UpAxis": "rendering.camera",
    "Volume": "volume.grid",
    "choose_method": "rendering.method_choice",
    "extract": "surfaces.extract:extract_meshes",
    "extract_details": "surfaces.detail_sets",
    "extract_surfaces": "surfaces.extract",
    "open_volume": "volume.readers",
    "plan_isovalues": "transfer.isovalues",
    "raycast": "rendering.raycaster",
    "render": "rendering.pipeline",
    "render_reference": "rendering.reference_image",
    "render_surfaces": "rendering.pipeline",
    "step_for_tolerance": "rendering.step_search",
    "turntable": "rendering.turntable",
    "visible_box": "rendering.framing",
}

__all__ = [
    "__version__", *sorted(_HOMES),
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use, so that `import isosample` stays fast."""
    if name not in _HOMES:
        raise AttributeError(f"module 'isosample' has no attribute {name!r}")
    module, _, attribute = _HOMES[name].partition(":")
    found = getattr(importlib.import_module(f"isosample.{module}"), attribute or name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
