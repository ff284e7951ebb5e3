"""Transfer functions as JSON files: reading with errors that name the entry, and atomic writing."""

from __future__ import annotations

import json
import math
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from isosample.errors import InputError
from isosample.files import replacing
from isosample.transfer.control_points import ControlPoint, Isosurface, finite_number
from isosample.transfer.transfer_function import TransferFunction
from isosample.wording import about_unknown_keys

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

TOP_KEYS = {"points", "isosurfaces", "unit_distance"}
POINT_KEYS = {"value", "color", "extinction", "opacity"}
ISOSURFACE_KEYS = {"value", "color", "opacity"}


def parse_transfer_function(document: object, source: str) -> TransferFunction:
    """Transfer function from the content of a JSON file.

    Parameters
    ----------
    document : dict
        ``{"points": [{"value", "color", "extinction"} …],
        "isosurfaces": [{"value", "color", "opacity"} …]}``, colours in linear RGB.
        A point may give ``opacity`` in [0, 1) with a top-level ``unit_distance`` [world] in place of
        ``extinction``: extinction = −ln(1 − opacity) / unit_distance.
    source : str
        File name for messages.

    Raises
    ------
    InputError
        If a key is unknown or missing, a number is wrong, or values do not ascend; the message names the
        source, the entry and its value.
    """
    with located(f"{source}: "):
        top = _object(document, "the file", TOP_KEYS, required=set())
        unit_distance = top.get("unit_distance")
        if unit_distance is not None:
            unit_distance = positive_number(unit_distance, "unit_distance")
        points = []
        for i, entry in enumerate(_list(top, "points")):
            fields = _object(entry, f"points[{i}]", POINT_KEYS, required={"value", "color"})
            with located(f"points[{i}]."):
                points.append(_point(fields, unit_distance))
        isosurfaces = []
        for i, entry in enumerate(_list(top, "isosurfaces")):
            fields = _object(entry, f"isosurfaces[{i}]", ISOSURFACE_KEYS, required=ISOSURFACE_KEYS)
            with located(f"isosurfaces[{i}]."):
                isosurfaces.append(Isosurface(fields["value"], fields["color"], fields["opacity"]))
        return TransferFunction(points, isosurfaces)


def transfer_function_to_dict(transfer_function: TransferFunction) -> dict[str, Any]:
    """Return the content of a JSON file, with extinctions (never opacities) at the points."""
    return {
        "points": [
            {"value": point.value, "color": list(point.color), "extinction": point.extinction}
            for point in transfer_function.points
        ],
        "isosurfaces": [
            {"value": surface.value, "color": list(surface.color), "opacity": surface.opacity}
            for surface in transfer_function.isosurfaces
        ],
    }


def load_transfer_function(path: str | Path) -> TransferFunction:
    """Transfer function from a JSON file of this package, 3D Slicer (.vp.json) or ParaView, told apart by content."""
    from isosample.transfer import importers

    source = Path(path).name
    if source.lower().endswith(".vp"):
        raise InputError(
            f"{source} is a volume property of 3D Slicer in its older form, as plain text; only its JSON form is read. "
            "Save it from 3D Slicer as .vp.json."
        )
    document = read_json(path)
    if importers.is_slicer(document):
        return importers.from_slicer(document, source=source)
    if importers.is_paraview(document):
        return importers.from_paraview(document, source=source)
    return parse_transfer_function(document, source)


def save_transfer_function(transfer_function: TransferFunction, path: str | Path) -> None:
    """Write the JSON file, whole or not at all; an existing file is replaced."""
    text = json.dumps(transfer_function_to_dict(transfer_function), indent=2, allow_nan=False) + "\n"
    with replacing(Path(path)) as file:
        file.write(text.encode())


def read_json(path: str | Path) -> object:
    """Content of a JSON file; NaN, Infinity and repeated keys are refused.

    Raises
    ------
    InputError
        If the file cannot be read or is no JSON (names line and column).
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}. Check the path.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text (byte {error.start}); expected a JSON file.") from error
    with located(f"{path.name}: "):
        try:
            document: object = json.loads(
                text, parse_constant=_refuse_constant, object_pairs_hook=_unique_keys
            )
        except json.JSONDecodeError as error:
            raise InputError(
                f"line {error.lineno}, column {error.colno}: {error.msg}; expected a JSON file."
            ) from error
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"a number cannot be read ({error}).") from error
        except RecursionError as error:
            raise InputError("brackets are nested too deeply for a transfer function.") from error
    return document


@contextmanager
def located(prefix: str) -> Iterator[None]:
    """Put `prefix` (a file, an entry) before the message of an `InputError` raised inside."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{prefix}{error}") from error.__cause__


def extinction_from_opacity(opacity: float, unit_distance: float) -> float:
    """Extinction [1/world] of a medium with `opacity` in [0, 1) over `unit_distance` [world]."""
    return -math.log1p(-opacity) / unit_distance


def positive_number(number: object, what: str) -> float:
    """Return a finite float > 0, or raise an `InputError` that starts with `what`."""
    result = finite_number(number, what)
    if result <= 0:
        raise InputError(f"{what} {result:g} must be > 0.")
    return result


def _point(fields: Mapping[str, Any], unit_distance: float | None) -> ControlPoint:
    """Control point from one entry, with extinction given or made from opacity."""
    if ("opacity" in fields) == ("extinction" in fields):
        found = "both" if "opacity" in fields else "neither"
        raise InputError(f"extinction or opacity: exactly one is needed, {found} given.")
    if "extinction" in fields:
        return ControlPoint(fields["value"], fields["color"], fields["extinction"])
    opacity = finite_number(fields["opacity"], "opacity")
    if unit_distance is None:
        raise InputError(
            f"opacity {opacity:g} needs a top-level unit_distance (the length that has this opacity)."
        )
    if opacity == 1:
        raise InputError(
            "opacity 1 over a distance means infinite extinction. Give less than 1, or use isosurfaces."
        )
    if not 0 <= opacity < 1:
        raise InputError(f"opacity {opacity:g} must be >= 0 and < 1.")
    return ControlPoint(fields["value"], fields["color"], extinction_from_opacity(opacity, unit_distance))


def _object(document: object, what: str, allowed: set[str], *, required: set[str]) -> Mapping[str, Any]:
    """Return the JSON object `document` after checking its keys."""
    if not isinstance(document, dict):
        raise InputError(f"{what} is {document!r:.80}; expected an object with {sorted(allowed)}.")
    unknown = sorted(str(key) for key in document.keys() - allowed)
    if unknown:
        raise InputError(f"{what} {about_unknown_keys(unknown, allowed)}")
    missing = sorted(required - document.keys())
    if missing:
        raise InputError(f"{what} lacks {missing}.")
    return document


def _list(top: Mapping[str, Any], key: str) -> list[object]:
    """Return the list under `key`, empty where the key is absent."""
    entries = top.get(key, [])
    if not isinstance(entries, (list, tuple)):
        raise InputError(f"{key} is {entries!r:.80}; expected a list of objects.")
    return list(entries)


def _refuse_constant(literal: str) -> NoReturn:
    raise InputError(f"{literal} is no JSON number; values must be finite.")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a dict, refusing repeated keys (the standard reader keeps the last one without a word)."""
    result = dict(pairs)
    if len(result) < len(pairs):
        keys = [key for key, _ in pairs]
        repeated = sorted({key for key in keys if keys.count(key) > 1})
        raise InputError(f"keys {repeated} are repeated in one object; keep one of each.")
    return result
