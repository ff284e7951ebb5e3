"""`isosample render --turntable N`: a turn about the volume as a film, by any method."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from isosample.cli.cameras import orbit
from isosample.cli.console import progress_bars, say, say_fields, seconds
from isosample.cli.outputs import check_suffix, write_json
from isosample.cli.summary import FLAWS, check_strict, say_flaws
from isosample.defaults import DEFAULT_FRAME_RATE, FILM_SUFFIXES, IMAGE_SUFFIXES
from isosample.errors import InputError
from isosample.wording import counted

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from isosample.cli.console import Progress
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.turntable import FrameLog
    from isosample.volume.geometry import Box

    Draw = Callable[[Camera, Progress], Image]


@dataclass(frozen=True, slots=True)
class EmptyFrames:
    """The frames of a film that show nothing.

    Attributes
    ----------
    cameras : list of Camera
        Of all frames.
    size : (width, height)
    settings : RenderSettings
    numbers : list of int
        Of the empty ones.
    """

    cameras: list[Camera]
    size: tuple[int, int]
    settings: RenderSettings
    numbers: list[int] = field(default_factory=list)

    def say_why(self, box: Box) -> None:
        """Tell why the first of them is empty."""
        from isosample.rendering.emptiness import why_empty

        if self.numbers:
            first = self.numbers[0]
            why = why_empty(box, self.cameras[first], self.size, self.settings)
            say(f"{len(self.numbers)} of {counted(len(self.cameras), 'frame')}, from frame {first} on: {why}")


def check_turntable(args: argparse.Namespace) -> None:
    """Raise `InputError` for options that a film, or a single picture, cannot have."""
    from isosample.rendering.film import check_film
    from isosample.rendering.turntable import turntable_degrees

    if args.turntable is None:
        if args.frame_rate is not None:
            raise InputError(
                f"--frame-rate {args.frame_rate:g} belongs to a film; add --turntable N, or leave it out."
            )
        return
    turntable_degrees(args.turntable)
    if args.error_map is not None:
        raise InputError(
            f"--error-map {args.error_map} belongs to one picture, and --turntable makes {args.turntable}; leave out "
            "one of them."
        )
    check_suffix(args.output, FILM_SUFFIXES, "a film")
    if args.frame_rate is not None and args.output.suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(
            f"--frame-rate {args.frame_rate:g} belongs to .mp4 and .gif, and {args.output} becomes numbered pictures; "
            "leave it out."
        )
    check_film(args.output, args.size, args.turntable, frame_rate_of(args))


def frame_rate_of(args: argparse.Namespace) -> float:
    """Frames per second of the film."""
    return DEFAULT_FRAME_RATE if args.frame_rate is None else float(args.frame_rate)


def outputs_of(args: argparse.Namespace) -> dict[str, Path | None]:
    """Files of the picture or the film, by what to call them in messages."""
    if args.turntable is None:
        return {"--output": args.output}
    from isosample.rendering.film import film_paths

    paths = film_paths(args.output, args.turntable)
    if len(paths) == 1:
        return {"--output": paths[0]}
    return {f"--output, frame {number}:": path for number, path in enumerate(paths)}


def cameras_of(args: argparse.Namespace, camera: Camera | None, box: Box) -> list[Camera]:
    """Cameras of the turn: about the box, or about the target of the file's camera."""
    from isosample.rendering.turntable import turntable, turntable_degrees

    if camera is not None:
        return turntable(camera, args.turntable)
    first = args.azimuth or 0.0
    return [orbit(args, box, azimuth=first + degrees) for degrees in turntable_degrees(args.turntable)]


def run_turntable(
    args: argparse.Namespace,
    cameras: list[Camera],
    draw: Draw,
    log: FrameLog,
    *,
    more: Mapping[str, Any],
    fields: Mapping[str, str],
    settings: RenderSettings,
    refined: bool = False,
) -> EmptyFrames:
    """Draw the frames, write the film, and sum up.

    Parameters
    ----------
    args : Namespace
        Of `isosample render`, checked by `check_turntable`.
    cameras : list of Camera
        One per frame.
    draw : callable
        Picture of a camera.
    log : FrameLog
        Begun with the command.
    more : mapping
        For the statistics.
    fields : mapping of str to str
        For the summary.
    settings : RenderSettings
        Of all frames.
    refined : bool
        As for `say_flaws`.

    Returns
    -------
    empty : EmptyFrames
    """
    from isosample.rendering.emptiness import is_empty
    from isosample.rendering.film import Film

    empty = EmptyFrames(cameras, args.size, settings)
    images: list[dict[str, Any]] = []
    writing = 0.0
    with (
        progress_bars() as progress,
        Film(args.output, args.size, len(cameras), frame_rate=frame_rate_of(args)) as film,
    ):
        for camera in cameras:
            progress("film", len(images), len(cameras))
            with log.frame():
                image = draw(camera, progress)
            if args.strict:
                check_strict(image.stats)
            if is_empty(image, settings):
                empty.numbers.append(len(images))
            begun = time.perf_counter()
            film.add(image)
            writing += time.perf_counter() - begun
            images.append(image.stats)
        progress("film", len(images), len(cameras))
    flaws = {name: sum(stats[name] for stats in images) for name in FLAWS if name in images[0]}
    if args.stats:
        film_stats = log.to_dict() | {"files": [str(path) for path in film.paths], **_by_frame(images)}
        film_stats["seconds"]["writing"] = writing
        film_stats["cameras"] = [camera.to_dict() for camera in cameras]
        write_json(args.stats, images[0] | flaws | {"turntable": film_stats} | dict(more))
    _summarise(args, film.paths, log, fields, images[0]["method"])
    say_flaws(flaws, args.size[0] * args.size[1] * len(images), refined=refined)
    stale = _numbered_besides(film.paths)
    if stale:
        say(f"{len(stale)} files of another film remain: {stale[0]} to {stale[-1].name}")
    return empty


def _numbered_besides(paths: list[Path]) -> list[Path]:
    """Files that are numbered like those of a film, and are none of them."""
    if len(paths) == 1:
        return []
    stem = paths[0].stem.rpartition("-")[0]
    named = re.compile(rf"{re.escape(stem)}-\d+{re.escape(paths[0].suffix)}")
    beside = {path for path in paths[0].parent.iterdir() if named.fullmatch(path.name)}
    return sorted(beside - set(paths))


def _by_frame(images: list[dict[str, Any]]) -> dict[str, Any]:
    """What changes from frame to frame."""
    names = ("fragments", "max_depth_complexity", "samples_per_ray")
    return {f"{name}_by_frame": [stats[name] for stats in images] for name in names if name in images[0]}


def _summarise(
    args: argparse.Namespace,
    paths: list[Path],
    log: FrameLog,
    fields: Mapping[str, str],
    method: str,
) -> None:
    """Write where the film is, what was made once, and what a frame cost."""
    width, height = args.size
    where = f"{paths[0]}" if len(paths) == 1 else f"{paths[0]} to {paths[-1].name}"
    pace = f", {frame_rate_of(args):g} per second" if len(paths) == 1 else ""
    say_fields(
        {
            "film": f"{where} ({len(log.seconds)} frames of {width} x {height} pixels{pace}), {method}",
            **fields,
            "made once": _told(log.made_once),
            "made again": _told(log.made_again),
            "seconds per frame": f"first {seconds(log.seconds[0])}, then {seconds(log.median_frame)} (median); "
            f"{seconds(log.per_frame)} on average, with the {seconds(log.preparation)} before the first",
            "seconds": seconds(log.elapsed),
        }
    )


def _told(made: Mapping[str, int]) -> str:
    """Counts in words."""
    return ", ".join(f"{kind.replace('_', ' ')} {number}" for kind, number in made.items()) or "nothing"
