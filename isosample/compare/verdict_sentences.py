"""What a verdict says, in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.defaults import DATA_CENTRIC, PEAK_FINDING, POST_CLASSIFIED, PRE_INTEGRATED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.compare.verdict import BreakEven, Race

    Entry = dict[str, Any]  # of results.json

NOUNS = {
    DATA_CENTRIC: "the data-centric method",
    POST_CLASSIFIED: "post-classification",
    PRE_INTEGRATED: "pre-integration",
    PEAK_FINDING: "peak finding",
}
LEVEL = 1.05  # times that differ by less are called level: medians of a few frames tell no more


def sentences_of(
    entries: Sequence[Entry], races: Sequence[Race], break_even: BreakEven | None
) -> tuple[str, ...]:
    """Which method is fastest at which error, where methods lose, and the break-even.

    Parameters
    ----------
    entries : sequence of dict
        As `judge`.
    races : sequence of Race
        From the largest error to the smallest.
    break_even : BreakEven or None

    Returns
    -------
    sentences : tuple of str
        Three.
    """
    return (_fastest(races), _losses(entries, races), _paid(entries, races, break_even))


def _fastest(races: Sequence[Race]) -> str:
    won = [race for race in races if race.winner is not None]
    if not won:
        return f"No method reaches an RMSE of {races[0].target:g}."
    parts = [
        f"by {NOUNS[str(race.winner)]} at {'' if number else 'an RMSE of '}{race.target:g} ({_time_and_lead(race)})"
        for number, race in enumerate(won)
    ]
    unreached = [f"{race.target:g}" for race in races if race.winner is None]
    rest = f"; none reaches {listed(unreached)}" if unreached else ""
    return f"The fastest frames are drawn {listed(parts)}{rest}."


def _time_and_lead(race: Race) -> str:
    """The winner's time, and how far the second is behind."""
    names, times = list(race.seconds), list(race.seconds.values())
    if race.lead is None:
        return f"{milliseconds(times[0])}, alone"
    ahead = (
        f"level with {NOUNS[names[1]]}"
        if race.lead < LEVEL
        else f"{race.lead:.1f}× ahead of {NOUNS[names[1]]}"
    )
    return f"{milliseconds(times[0])}, {ahead}"


def _losses(entries: Sequence[Entry], races: Sequence[Race]) -> str:
    methods = list(dict.fromkeys(entry["method"] for entry in entries))
    parts = [part for method in methods if (part := _loss(method, entries, races))]
    if not parts:
        return "No method loses to another at these errors."
    return f"Where methods lose: {', '.join(parts)}."


def _loss(method: str, entries: Sequence[Entry], races: Sequence[Race]) -> str:
    """Where one method is slower than the fastest, or does not get to; empty where nowhere."""
    behind = [
        (race.seconds[method] / race.seconds[str(race.winner)], race.target)
        for race in races
        if method in race.seconds
    ]
    slower = [(f"{times:.1f}×", f"{target:g}") for times, target in behind if times >= LEVEL]
    parts = []
    if slower:
        factors, places = zip(*slower, strict=True)
        parts.append(f"{listed(factors)} slower than the fastest at {listed(places)}")
    if any(method not in race.seconds for race in races):
        parts.append(f"RMSE {least_rmse(entries, method):.2g} at best")
    return f"{NOUNS[method]} ({'; '.join(parts)})" if parts else ""


def _paid(entries: Sequence[Entry], races: Sequence[Race], found: BreakEven | None) -> str:
    methods = {entry["method"] for entry in entries}
    if DATA_CENTRIC not in methods or len(methods) < 2:
        return "There is no break-even: it takes the data-centric method and a ray caster to have one."
    if found is None:
        late = _out_of_reach(entries, races[0].target)
        return f"There is no break-even: it takes both sides at one RMSE, and {late}."
    by_name = {entry["name"]: entry for entry in entries}
    own, rival = by_name[found.entry], by_name[found.rival]
    setups = f"{seconds(own['setup_seconds'])} of setup against {seconds(rival['setup_seconds'])}"
    sides = f"at RMSE {found.target:g} ({own['label']}) against {NOUNS[rival['method']]} ({rival['label']})"
    if found.frames is None:
        return f"The data-centric precomputation never pays {sides}: {setups}, and its frames are no faster."
    if found.last is not None:
        ahead = f"The data-centric method is ahead up to frame {found.last}"
        return f"{ahead} {sides}: {setups}, and its frames are slower."
    if found.frames == 1:
        return f"The data-centric method is ahead from the first frame on {sides}: {setups}."
    return f"The data-centric precomputation has paid after {found.frames} frames {sides}: {setups}."


def _out_of_reach(entries: Sequence[Entry], target: float) -> str:
    """Which side has no setting at the largest error, and so none at the smaller ones."""
    own = [entry for entry in entries if entry["method"] == DATA_CENTRIC]
    rivals = [entry for entry in entries if entry["method"] != DATA_CENTRIC]
    bests = [
        (noun, min(entry["summary"]["rmse"] for entry in side))
        for noun, side in ((NOUNS[DATA_CENTRIC], own), ("the best ray caster", rivals))
    ]
    late = [f"{noun} ({least:.2g} at best)" for noun, least in bests if least > target]
    return f"{listed(late)} never {'gets' if len(late) == 1 else 'get'} to {target:g}"


def least_rmse(entries: Sequence[Entry], method: str) -> float:
    """The smallest error of a method."""
    return min(float(entry["summary"]["rmse"]) for entry in entries if entry["method"] == method)


def listed(parts: Sequence[str]) -> str:
    """Words with commas and an ``and``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def milliseconds(duration: float) -> str:
    """A frame's time with two digits or whole milliseconds."""
    return f"{1e3 * duration:.2g} ms" if duration < 0.01 else f"{1e3 * duration:.0f} ms"


def seconds(duration: float) -> str:
    """A duration of setup."""
    return f"{duration:.2g} s" if duration < 10 else f"{duration:.0f} s"
