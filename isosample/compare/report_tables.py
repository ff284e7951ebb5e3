"""Tables and facts of a report, as text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from isosample.compare.report_columns import ABSENT, COSTS, ERRORS, TIMES, milliseconds, whole_number
from isosample.wording import byte_size, counted, percentage

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Document = dict[str, Any]
    Cell = Callable[[Document], str]

WHOLES = {"brick_visits_of": ("brick_visits",), "chunks_of": ("chunks_outside_view", "chunks_clipped")}


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under headings.

    Attributes
    ----------
    name, caption : str
    columns : tuple of (heading, what it means)
    rows : tuple of (method, setting, cells)
    """

    name: str
    caption: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, str, tuple[str, ...]], ...]


def tables(document: Document) -> list[Table]:
    """The tables of a report, from the content of results.json."""
    entries = document["entries"]
    return [
        _races(document),
        _table(
            "Time", "Setup is paid once, frames again and again; medians over the frames.", TIMES, entries
        ),
        _table("Error", "Against the float64 reference, over all cameras.", ERRORS, entries),
        _table("Cost", "Of one frame, over all cameras.", COSTS, entries),
        _skipped(entries),
    ]


def facts(document: Document) -> list[tuple[str, list[tuple[str, str]]]]:
    """Groups of names and values: volume, settings, machine."""
    settings, machine = document["settings"], document["machine"]
    return [
        ("Volume", _volume_facts(document["scene"])),
        ("Settings, the same for all methods", _setting_facts(settings, document["reference"])),
        ("Machine", _machine_facts(machine, document["reference"])),
    ]


def _races(document: Document) -> Table:
    """The fastest setting of every method at every error."""
    races = document["verdict"]["races"]
    labels = {entry["name"]: entry["label"] for entry in document["entries"]}
    rows = []
    for method in document["settings"]["methods"]:
        cells = tuple(
            f"{milliseconds(race['seconds'][method])} · {labels[race['fastest'][method]]}"
            if method in race["seconds"]
            else ABSENT
            for race in races
        )
        rows.append((method, "", cells))
    columns = tuple((f"RMSE ≤ {race['target']:g}", "fastest setting that errs no more") for race in races)
    caption = f"Time of a frame [ms] and the setting that reaches the error. {_framing(document)}"
    return Table("Equal error", caption, columns, tuple(rows))


def _framing(document: Document) -> str:
    """What an error over whole pictures says of the pixels that show anything."""
    shares = document["reference"]["shown_share"]
    share = sum(shares) / len(shares)
    if not 0.0 < share < 1.0:
        return "The RMSE is over whole pictures."
    return (
        f"The RMSE is over whole pictures, and {percentage(share)} of their pixels show anything: it depends on the "
        f"framing. Over those pixels alone it would be {share**-0.5:.2g} times as large, but for what methods draw "
        "elsewhere."
    )


def _table(
    name: str, caption: str, columns: Sequence[tuple[str, str, Cell]], entries: Sequence[Document]
) -> Table:
    rows = tuple(
        (entry["method"], entry["label"], tuple(cell(entry) for _, _, cell in columns)) for entry in entries
    )
    return Table(name, caption, tuple((heading, meaning) for heading, meaning, _ in columns), rows)


def _skipped(entries: Sequence[Document]) -> Table:
    """What was not needed, by reason, of all cameras together; and what is not shown."""
    found = [_sums_of(entry) for entry in entries]
    reasons = list(dict.fromkeys(reason for sums in found for reason in sums))
    kept = [reason for reason in reasons if reason not in WHOLES and any(sums.get(reason) for sums in found)]
    rows = tuple(
        (entry["method"], entry["label"], tuple(_share_of_whole(sums, reason) for reason in kept))
        for entry, sums in zip(entries, found, strict=True)
    )
    columns = tuple((reason.replace("_", " "), "count") for reason in kept)
    caption = "What was left out because the picture does not need it, or because the method cannot show it."
    return Table("Skipped", caption, columns, rows)


def _sums_of(entry: Document) -> dict[str, float]:
    """Counts of what was skipped, over all cameras, and of what no camera shows."""
    sums: dict[str, float] = {}
    for view in entry["views"]:
        for reason, count in view["cost"]["skipped"].items():
            sums[reason] = sums.get(reason, 0) + count
    return sums | {f"{reason} not shown": count for reason, count in entry["summary"]["not_shown"].items()}


def _share_of_whole(sums: dict[str, float], reason: str) -> str:
    """A count, with what it is a part of where that is known."""
    whole = next((name for name, parts in WHOLES.items() if reason in parts and name in sums), None)
    of = "" if whole is None or reason not in sums else f" of {whole_number(sums[whole])}"
    return whole_number(sums.get(reason)) + of


def _volume_facts(scene: Document) -> list[tuple[str, str]]:
    volume, transfer_function = scene["volume"], scene["transfer_function"]
    sources = {"read from": scene["source"], "TF from": scene["transfer_function_source"]}
    low, high = volume["value_range"]
    return [
        ("name", volume["name"]),
        ("samples", " × ".join(map(str, volume["samples"]))),
        ("spacing", " × ".join(f"{step:.4g}" for step in volume["spacing"])),
        ("type", f"{volume['dtype']}, {byte_size(volume['bytes'])}"),
        ("values", f"{low:g} to {high:g}"),
        (
            "transfer function",
            f"{counted(len(transfer_function['points']), 'point')}, "
            f"{counted(len(transfer_function.get('isosurfaces', [])), 'isosurface')}",
        ),
        *((name, words) for name, words in sources.items() if words),
    ]


def _setting_facts(settings: Document, reference: Document) -> list[tuple[str, str]]:
    width, height = settings["size"]
    cameras = [
        f"{camera['projection']}, eye {_vector(camera['eye'])}, target {_vector(camera['target'])}"
        for camera in settings["cameras"]
    ]
    planes = "; ".join(_vector(plane) for plane in settings["clip_planes"]) or "none"
    sampling = settings["sampling"] + (", adaptive" if settings["adaptive"] else "")
    return [
        ("picture", f"{width} × {height} pixels"),
        *(
            (f"camera {number}", f"{words}; {percentage(share)} of the pixels show anything")
            for number, (words, share) in enumerate(
                zip(cameras, reference["shown_share"], strict=True), start=1
            )
        ),
        (
            "timed frames",
            f"{settings['repeat']} per setting and camera, in turn, after one that is not timed",
        ),
        ("background", _vector(settings["background"])),
        ("light", _light(settings["material"])),
        ("clip planes", planes),
        ("reconstruction", settings["reconstruction"]),
        ("least transmittance", f"{settings['min_transmittance']:.2g}"),
        (
            "ray casters",
            f"{sampling} sampling, {settings['quadrature']} quadrature, {settings['integration']} tables",
        ),
        ("peak finding", f"weights: {settings['peak_weight']}; crossings: {settings['crossings']}"),
        ("data-centric", _meshes(settings)),
        ("wood grain", _grain(settings)),
    ]


def _grain(settings: Document) -> str:
    """In which frequencies of each camera's picture wood grain is looked for."""
    bands = [
        "none, the picture shows too little"
        if band is None
        else f"{band[0]:.3g} to {band[1]:.3g} cycles per pixel"
        for band in settings["grain_bands"]
    ]
    least, greatest = settings["grain_tilts"]
    return f"{'; '.join(bands)}: steps of one voxel at tilts of {least:g}° to {greatest:g}°"


def _light(material: Sequence[float] | None) -> str:
    """How every method and the reference are lit."""
    if material is None:
        return "none: colours as they are"
    ambient, diffuse, specular, shininess = material
    return (
        f"at the eye, Blinn–Phong: ambient {ambient:g}, diffuse {diffuse:g}, specular {specular:g}, shininess "
        f"{shininess:g}; the reference is lit everywhere, ray casters at their samples, data-centric by the "
        "gradients at crossings"
    )


def _meshes(settings: Document) -> str:
    """How the data-centric method draws."""
    details, segments = settings["details"], f"{settings['segment']} segments"
    if not details:
        return f"{segments}, meshes as extracted"
    return f"{segments}, {details} coarser details, at most {settings['screen_error']:g} pixel off"


def _machine_facts(machine: Document, reference: Document) -> list[tuple[str, str]]:
    driver = machine["driver"]
    return [
        ("date", machine["date"]),
        ("processor", f"{machine['processor']}, {machine['cores']} cores"),
        ("driver", f"{driver['renderer']}, OpenGL {driver['version']}"),
        ("isosample", machine["isosample"]),
        ("Python", f"{machine['python']} on {machine['platform']}"),
        ("packages", ", ".join(f"{name} {version}" for name, version in machine["packages"].items())),
        ("reference", f"{reference['renderer']}, {sum(reference['seconds']):.3g} s"),
    ]


def _vector(numbers: Sequence[float]) -> str:
    return "(" + ", ".join(f"{number:.4g}" for number in numbers) + ")"
