"""What restores a cache folder: the command of its scene, and what is known of meshes that others made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.wording import counted, thousands

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.cache_verification import FolderVerified

NAMED = 6  # isovalues that a remedy names
AGAIN = "`isosample precompute` with the same volume, transfer function, options and --cache"


def remedies(folder: Path, found: FolderVerified) -> list[str]:
    """Return what to run for what is damaged or missing in a folder: one line for the scene, and for the rest."""
    if not found.looked_through:
        return [f"the other files of {folder} were not read: volume.json comes first"]
    lines = []
    if found.scene_needs:
        lines.append(
            f"remedy for the scene of {folder}{_scene(found)}: {AGAIN} makes anew what is damaged or missing, and only "
            "that"
        )
    if found.others_need:
        lines.append(
            f"remedy for {_others(folder, found)}, of {_isosurfaces(found.others_need)}: the folder does not know "
            "what they were made for; the `isosample precompute` or `isosample render --cache` that did, run again "
            "with its own --tf and options, makes them anew"
        )
    if found.unlisted:
        lines.append(
            f"{counted(found.unlisted, 'damaged file')} of {folder} cannot be told to be of any scene: whichever "
            "`isosample precompute` needs one makes it anew"
        )
    return lines


def _others(folder: Path, found: FolderVerified) -> str:
    """Return what meshes are that the folder's scene is not known to need."""
    if found.scene_missing is None:
        return f"meshes of {folder}, which has no scene that tells whether it needs them"
    return (
        f"meshes that the scene of {folder} does not need (of other transfer functions or options, or of coarser tries "
        "of --refine auto)"
    )


def _scene(found: FolderVerified) -> str:
    """Return what tells the folder's scene from others, where that can still be read."""
    levels = found.scene_isovalues
    if not levels:
        return ""
    span = f" from {levels[0]:.6g} to {levels[-1]:.6g}" if len(levels) > 1 else f" {levels[0]:.6g}"
    return f" ({counted(len(levels), 'isosurface')}{span}{f' of {found.volume}' if found.volume else ''})"


def _isosurfaces(isovalues: tuple[float, ...]) -> str:
    """Return isovalues as people read them, the first few of many."""
    named = ", ".join(repr(value) for value in isovalues[:NAMED])
    more = f" and {thousands(len(isovalues) - NAMED)} more" if len(isovalues) > NAMED else ""
    return f"{'isosurface' if len(isovalues) == 1 else 'isosurfaces'} {named}{more}"
