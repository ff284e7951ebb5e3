"""The verdict's facts, computed in another way than the package does: by looking at every pair."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    Entry = dict[str, Any]


def recomputed_fastest(entries: Sequence[Entry], targets: Sequence[float]) -> dict[float, dict[str, float]]:
    """Shortest frame of every method at every error that it reaches."""
    found: dict[float, dict[str, float]] = {}
    for target in targets:
        reaching = [
            (one["method"], one["summary"]["frame_seconds"])
            for one in entries
            if one["summary"]["rmse"] <= target
        ]
        found[target] = {
            method: min(time for name, time in reaching if name == method) for method, _ in reaching
        }
    return found


def recomputed_break_even(
    entries: Sequence[Entry], targets: Sequence[float], most: int = 10**7
) -> tuple[float, int | None] | None:
    """Smallest error that both sides reach, and the first frame at which the data-centric one is not behind."""
    for target in sorted(targets):
        reaching = [one for one in entries if one["summary"]["rmse"] <= target]
        own = [one for one in reaching if one["method"] == "data-centric"]
        rivals = [one for one in reaching if one["method"] != "data-centric"]
        if not own or not rivals:
            continue
        quickest, rival = (
            min(side, key=lambda one: one["summary"]["frame_seconds"]) for side in (own, rivals)
        )

        def ahead(frames: int, one: Entry = quickest, other: Entry = rival) -> bool:
            own_total = one["setup_seconds"] + frames * one["summary"]["frame_seconds"]
            return bool(own_total <= other["setup_seconds"] + frames * other["summary"]["frame_seconds"])

        if ahead(1):
            return target, 1
        if not ahead(most):
            return target, None
        low, high = 1, most  # behind at the one, not at the other: totals are straight lines
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if ahead(middle) else (middle, high)
        return target, high
    return None
