"""`isosample cache`: what the caches of meshes hold, whether they are whole, and making room."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from isosample.cli import arguments, values
from isosample.cli.cache_remedies import AGAIN, remedies
from isosample.cli.console import say, say_fields, say_json, say_table, seconds
from isosample.cli.parser import add_command
from isosample.errors import InputError
from isosample.wording import byte_size, counted, thousands

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands

EXAMPLE = """\
isosample cache ls
isosample cache verify meshes_cache/head-1f3a9c07
isosample cache prune --budget 2GiB"""
ACTIONS = {
    "ls": "list the caches with their sizes, and whether they are complete",
    "verify": "decode every file, and name what is damaged (exit status 1), was evicted or is not finished",
    "prune": "remove the meshes that were used longest ago, down to --budget, and files left half-written",
}


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "cache",
        run,
        summary="List, verify or prune the caches of meshes that precompute makes.",
        example=EXAMPLE,
    )
    lines = "; ".join(f"{name}: {what}" for name, what in ACTIONS.items())
    parser.add_argument("action", choices=tuple(ACTIONS), metavar="ls|verify|prune", help=lines)
    parser.add_argument(
        "folders",
        type=Path,
        nargs="*",
        metavar="FOLDER",
        help="cache folder, or folder of such folders "
        f"(default: ${arguments.CACHE_VARIABLE}, else {arguments.CACHE_FOLDER})",
    )
    parser.late_list = "folders"
    parser.add_argument(
        "--budget",
        type=values.byte_count,
        metavar="SIZE",
        help="prune: most that all meshes may take together, such as 2GiB; what is removed is extracted again when "
        "it is needed",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="prune: tell what would be removed, remove nothing"
    )
    parser.add_argument("--json", action="store_true", help="write the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Find the cache folders and do what is asked for."""
    from isosample.surfaces.cache_folders import cache_folders

    if args.action == "prune" and args.budget is None:
        raise InputError("prune needs --budget SIZE, such as --budget 2GiB; see `isosample cache --help`")
    if args.action != "prune" and (args.budget is not None or args.dry_run):
        raise InputError(
            f"--budget and --dry-run are of prune, not of {args.action}; see `isosample cache --help`"
        )
    places = args.folders or [Path(os.environ.get(arguments.CACHE_VARIABLE) or arguments.CACHE_FOLDER)]
    folders = list(dict.fromkeys(folder for place in places for folder in cache_folders(place)))
    if args.action == "ls":
        return _list(folders, as_json=args.json)
    if args.action == "verify":
        return _verify(folders, as_json=args.json)
    return _prune(folders, args.budget, pretend=args.dry_run, as_json=args.json)


def _list(folders: list[Path], *, as_json: bool) -> int:
    """Write one row per folder."""
    from isosample.surfaces.cache_files import unfinished
    from isosample.surfaces.cache_folders import summarise

    found = [summarise(folder) for folder in folders]
    if as_json:
        rows = [
            {
                **entry._asdict(),
                "folder": str(entry.folder),
                "size_xyz": list(entry.size_xyz),
                "state": entry.state,
            }
            for entry in found
        ]
        say_json({"caches": rows, "size_bytes": sum(entry.size_bytes for entry in found)})
        return 0
    heads = ("cache", "volume", "samples", "isosurfaces", "details", "meshes", "size", "used", "state")
    table = [
        [
            str(entry.folder),
            entry.name or "?",
            "x".join(str(count) for count in entry.size_xyz),
            thousands(entry.isovalues) if entry.finished else "?",
            str(entry.details),
            thousands(entry.chunks),
            byte_size(entry.size_bytes),
            _ago(entry.used),
            entry.state,
        ]
        for entry in found
    ]
    say_table(heads, table, numeric=(3, 4, 5, 6))
    for entry in found:
        if entry.problem:
            say(f"cannot be used: {entry.problem}")
        elif not entry.finished:
            say(f"incomplete: {unfinished(entry.folder)}")
        elif entry.pieces_missing:
            say(f"incomplete: {entry.folder}: {_lack(entry.pieces_missing)}")
    say(f"{counted(len(found), 'cache')}, {byte_size(sum(entry.size_bytes for entry in found))}")
    return 0


def _verify(folders: list[Path], *, as_json: bool) -> int:
    """Write what is damaged and what is missing; return 1 where anything is damaged."""
    from isosample.cli import EXIT_FAILED
    from isosample.surfaces.cache_files import unfinished
    from isosample.surfaces.cache_folders import has_scene
    from isosample.surfaces.cache_verification import verify_folder

    start = time.perf_counter()
    verified = {folder: verify_folder(folder) for folder in folders}
    without_scene = [
        folder for folder, found in verified.items() if found.looked_through and not has_scene(folder)
    ]
    damaged = [(folder, chunk) for folder, found in verified.items() for chunk in found.damaged]
    incomplete = {folder: found for folder, found in verified.items() if found.pieces_missing}
    told = [line for folder, found in verified.items() for line in remedies(folder, found)]
    if as_json:
        rows = [
            {"cache": str(folder), "path": str(chunk.path), "reason": chunk.reason}
            for folder, chunk in damaged
        ]
        missing = [
            {
                "cache": str(folder),
                "pieces": found.pieces,
                "pieces_missing": found.pieces_missing,
                "scene_pieces_missing": found.scene_missing,
            }
            for folder, found in incomplete.items()
        ]
        say_json(
            {
                "caches": [str(folder) for folder in folders],
                "damaged": rows,
                "incomplete": missing,
                "unfinished": [str(folder) for folder in without_scene],
                "remedies": told,
            }
        )
        return EXIT_FAILED if damaged else 0
    for _, chunk in damaged:
        say(f"damaged: {chunk.path}: {chunk.reason}")
    for folder, found in incomplete.items():
        lost = f"{thousands(found.pieces_missing)} of {counted(found.pieces, 'piece')}"
        of_scene = found.scene_missing
        whose = "" if of_scene is None else f", {thousands(of_scene)} of them of its scene"
        say(f"incomplete: {folder}: {lost} are not there (evicted or removed){whose}")
    for folder in without_scene:
        say(f"incomplete: {unfinished(folder)}")
    for line in told:
        say(line)
    summary = {
        "caches": str(len(folders)),
        "damaged files": thousands(len(damaged)),
        "incomplete": thousands(len({*incomplete, *without_scene})),
        "seconds": seconds(time.perf_counter() - start),
    }
    say_fields(summary)
    return EXIT_FAILED if damaged else 0


def _prune(folders: list[Path], budget: int, *, pretend: bool, as_json: bool) -> int:
    """Remove what is too much, and write what it was."""
    from isosample.surfaces.chunk_folder import ChunkFolder, prune

    pruned = prune([ChunkFolder(folder) for folder in folders], budget, pretend=pretend)
    left = sum(entry.bytes_left for entry in pruned)
    if as_json:
        rows = [
            {
                "cache": str(folder),
                "chunks": entry.chunks,
                "size_bytes": entry.size_bytes,
                "leftovers": entry.leftovers,
                "leftover_bytes": entry.leftover_bytes,
            }
            for folder, entry in zip(folders, pruned, strict=True)
        ]
        say_json({"removed": rows, "dry_run": pretend, "budget_bytes": budget, "bytes_left": left})
        return 0
    verb = "would remove" if pretend else "removed"
    for folder, entry in zip(folders, pruned, strict=True):
        if entry.leftovers:
            files = counted(entry.leftovers, "half-written file")
            say(f"{verb} {files} ({byte_size(entry.leftover_bytes)}) of {folder}")
        if entry.chunks:
            say(f"{verb} {_meshes(entry.chunks)} ({byte_size(entry.size_bytes)}) of {folder}")
            if not pretend:
                _say_what_is_left(folder)
    total, size = sum(entry.chunks for entry in pruned), sum(entry.size_bytes for entry in pruned)
    say_fields({verb: f"{_meshes(total)}, {byte_size(size)}", "meshes left": byte_size(left)})
    return 0


def _say_what_is_left(folder: Path) -> None:
    """Tell where the scene of a folder cannot be rendered, now that meshes were removed."""
    from isosample.surfaces.cache_folders import summarise

    found = summarise(folder)
    if found.problem:
        say(f"cannot be used: {found.problem}")
    elif found.pieces_missing:
        say(f"{folder} is now incomplete: {_lack(found.pieces_missing)}")


def _lack(pieces: int) -> str:
    """Return what it means that a folder's scene lacks some pieces."""
    what = f"{counted(pieces, 'piece')} of its scene {'is' if pieces == 1 else 'are'} not there (evicted or removed)"
    return f"{what}: it cannot be rendered until {AGAIN} has extracted again what is missing"


def _meshes(number: int) -> str:
    return "1 mesh" if number == 1 else f"{thousands(number)} meshes"


def _ago(used: float) -> str:
    """Return how long ago something was used, in its largest unit."""
    if used == 0.0:
        return "never"
    amount, unit = max(0.0, time.time() - used), "s"
    for larger, step in (("min", 60), ("h", 60), ("days", 24)):
        if amount < step:
            break
        amount, unit = amount / step, larger
    return f"{amount:.0f} {unit} ago"
