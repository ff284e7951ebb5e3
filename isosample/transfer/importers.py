"""Transfer functions of 3D Slicer (volume property) and ParaView (colour map) from their JSON documents."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from isosample.errors import InputError
from isosample.transfer.control_points import Isosurface, finite_number
from isosample.transfer.foreign_curves import (
    Node,
    curve_color_srgb,
    linear_from_srgb,
    transfer_function_from_curves,
)
from isosample.transfer.json_format import located, positive_number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.transfer.transfer_function import TransferFunction

DENSE_STEP = 0.06  # colours this close need no colour space: the ways between them hardly differ


def is_slicer(document: object) -> bool:
    """Tell whether a JSON document is a volume property of 3D Slicer."""
    return isinstance(document, dict) and "volumeProperties" in document


def is_paraview(document: object) -> bool:
    """Tell whether a JSON document is a list of colour maps (or one) of ParaView."""
    entries = document if isinstance(document, list) else [document]
    return bool(entries) and all(isinstance(entry, dict) and "RGBPoints" in entry for entry in entries)


def from_slicer(
    document: object, *, source: str = "volume property", isosurfaces: bool = False
) -> TransferFunction:
    """Transfer function from a volume property of 3D Slicer (``.vp.json``, schema 1.0.0).

    Parameters
    ----------
    document : dict
        Content of the file: one volume property, whose first component is taken.
    source : str
        File name for messages.
    isosurfaces : bool
        Take ``isoSurfaceValues`` too, with the colour and the opacity that the curves have there. Slicer
        shows either them or the volume, so the default leaves them out.

    Returns
    -------
    transfer_function : TransferFunction
        Within `foreign_curves.TOLERANCE` of the file's curves; sRGB made linear, opacity per
        ``scalarOpacityUnitDistance`` (1 where absent) made extinction.

    Raises
    ------
    InputError
        If the document is not of this form; the message names the entry and its value.

    Warns
    -----
    UserWarning
        If opacities of 1 are lowered, or a gradient opacity is left out.
    """
    with located(f"{source}: "):
        properties = _entries(_field(document, "volumeProperties"), "volumeProperties")
        if len(properties) != 1:
            raise InputError(f"volumeProperties has {len(properties)} entries; expected one.")
        with located("volumeProperties[0]."):
            components = _entries(_field(properties[0], "components"), "components")
            if not components:
                raise InputError("components is empty; expected one component.")
            values = _entries(properties[0].get("isoSurfaceValues", []), "isoSurfaceValues")
            with located("components[0]."):
                opacity = _slicer_nodes(components[0], "scalarOpacity", "y")
                color = _slicer_nodes(components[0], "rgbTransferFunction", "color")
                distance = components[0].get("scalarOpacityUnitDistance", 1.0)
                distance = positive_number(distance, "scalarOpacityUnitDistance")
                _warn_of_gradient_opacity(components[0], source)
        surfaces = [finite_number(value, f"isoSurfaceValues[{i}]") for i, value in enumerate(values)]
        return transfer_function_from_curves(
            opacity,
            color,
            distance,
            source=source,
            isosurfaces=_isosurfaces(surfaces if isosurfaces else [], opacity, color),
        )


def from_paraview(
    document: object,
    *,
    source: str = "colour map",
    unit_distance: float = 1.0,
    opacity: Sequence[tuple[float, float]] | None = None,
) -> TransferFunction:
    """Transfer function from a colour map exported by ParaView.

    Parameters
    ----------
    document : list of one dict, or dict
        ``RGBPoints`` [v, r, g, b, …], ``Points`` [v, opacity, midpoint, sharpness, …], ``ColorSpace``.
    source : str
        File name for messages.
    unit_distance : float
        The length that has the given opacities [world], > 0; the file does not tell it.
    opacity : sequence of (value, opacity)
        In place of ``Points``.

    Returns
    -------
    transfer_function : TransferFunction
        Within `foreign_curves.TOLERANCE` of the file's curves, sRGB made linear.

    Raises
    ------
    InputError
        If the document is not of this form, has no opacities, or mixes few colours in a colour space other
        than RGB.

    Warns
    -----
    UserWarning
        If opacities of 1 are lowered.
    """
    with located(f"{source}: "):
        entries: list[Any] = document if isinstance(document, list) else [document]
        if len(entries) != 1:
            raise InputError(f"the file has {len(entries)} colour maps; keep the one to use.")
        distance = positive_number(unit_distance, "unit_distance")
        colors = [Node(row[0], row[1:]) for row in _rows(entries[0], "RGBPoints", 4)]
        _check_color_space(entries[0].get("ColorSpace", "RGB"), colors)
        if opacity is not None:
            opacities = [Node(value, [alpha]) for value, alpha in opacity]
        elif entries[0].get("Points") is None:
            raise InputError(
                "Points (the opacities) is missing. Export the map with its opacities, or give opacity=[...]."
            )
        else:
            opacities = [Node(row[0], row[1:2], *row[2:]) for row in _rows(entries[0], "Points", 4)]
        return transfer_function_from_curves(opacities, colors, distance, source=source)


def _slicer_nodes(component: Any, key: str, channel: str) -> list[Node]:
    """Nodes of one curve of a component, ascending; equal values keep the file's order."""
    with located(f"{key}."):
        points = _entries(_field(_field(component, key), "points"), "points")
        nodes = []
        for i, point in enumerate(points):
            with located(f"points[{i}]."):
                content = _field(point, channel)
                channels = content if isinstance(content, list) else [content]
                shape = point.get("midpoint", 0.5), point.get("sharpness", 0.0)
                nodes.append(Node(_field(point, "x"), channels, *shape))
    return sorted(nodes, key=lambda node: node.value)


def _isosurfaces(values: list[float], opacity: list[Node], color: list[Node]) -> list[Isosurface]:
    """Isosurfaces with the colour and the opacity of the curves; those of opacity 0 are invisible."""
    surfaces = []
    for value in values:
        alpha, srgb = curve_color_srgb(value, opacity, color)
        if alpha > 0:
            red, green, blue = linear_from_srgb(srgb).tolist()
            surfaces.append(Isosurface(value, (red, green, blue), alpha))
    return surfaces


def _warn_of_gradient_opacity(component: dict[str, Any], source: str) -> None:
    """Warn where a gradient opacity has an effect in Slicer, which this package does not show."""
    if component.get("disableGradientOpacity", False) or "gradientOpacity" not in component:
        return
    nodes = _slicer_nodes(component, "gradientOpacity", "y")
    if any(node.channels != (1.0,) for node in nodes):
        warnings.warn(f"{source}: gradientOpacity is not supported and left out.", stacklevel=4)


def _check_color_space(space: object, colors: list[Node]) -> None:
    """Raise where the way from colour to colour matters and does not lead through RGB."""
    if space == "RGB":
        return
    ascending = sorted(colors, key=lambda node: node.value)
    for low, high in pairwise(ascending):
        if max(abs(a - b) for a, b in zip(low.channels, high.channels, strict=True)) > DENSE_STEP:
            raise InputError(
                f"ColorSpace {space!r} is not supported for colours as far apart as "
                f"{list(low.channels)} and {list(high.channels)}. Choose RGB in ParaView, or add colours."
            )


def _rows(entry: dict[str, Any], key: str, width: int) -> list[list[Any]]:
    """Rows of a flat list; raises unless its length is a multiple of `width`."""
    flat = _entries(_field(entry, key), key)
    if not flat or len(flat) % width:
        raise InputError(f"{key} has {len(flat)} numbers; expected a multiple of {width}, at least {width}.")
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def _field(document: object, key: str) -> Any:
    """Content under `key` of a JSON object."""
    if not isinstance(document, dict):
        raise InputError(f"{document!r:.80} is no object; expected one with {key!r}.")
    if key not in document:
        raise InputError(f"{key} is missing.")
    return document[key]


def _entries(document: object, what: str) -> list[Any]:
    """Return the JSON list `document`."""
    if not isinstance(document, list):
        raise InputError(f"{what} is {document!r:.80}; expected a list.")
    return document
