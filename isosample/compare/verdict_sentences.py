"""What a verdict says, in sentences."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from isosample.defaults import DATA_CENTRIC, PEAK_FINDING, POST_CLASSIFIED, PRE_INTEGRATED
from isosample.wording import counted, percentage

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
FEW_PIXELS = (
    0.5  # share of the squared error: from here on 0.1 % of the pixels have as much as all the others
)
LEVEL = 1.05  # times that differ by less are called level: medians of a few frames tell no more


def sentences_of(
    entries: Sequence[Entry], races: Sequence[Race], break_even: BreakEven | None
) -> tuple[str, ...]:
    """Which method is fastest at which error, where methods lose, and the break-even; then what the errors hide.

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
        Three; one more where methods do not show everything, and one where few pixels make a method's RMSE.
    """
    always = (_fastest(races), _losses(entries, races), _paid(entries, races, break_even))
    return always + tuple(told for told in (_not_shown(entries), _few_pixels(entries, races)) if told)


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
        (noun, min(map(_rmse, side)))
        for noun, side in ((NOUNS[DATA_CENTRIC], own), ("the best ray caster", rivals))
    ]
    late = [f"{noun} ({least:.2g} at best)" for noun, least in bests if least > target]
    return f"{listed(late)} never {'gets' if len(late) == 1 else 'get'} to {target:g}"


def _not_shown(entries: Sequence[Entry]) -> str:
    """Which methods leave out isosurfaces; empty where none does."""
    hidden = {entry["method"]: entry["summary"]["not_shown"].get("isosurfaces", 0) for entry in entries}
    told = [
        f"{NOUNS[method]} does not show {counted(count, 'isosurface')} of the transfer function, "
        "which its samples do not meet: that is part of its error"
        for method, count in hidden.items()
        if count
    ]
    return _sentence("; ".join(told))


def _few_pixels(entries: Sequence[Entry], races: Sequence[Race]) -> str:
    """Whose RMSE says little about most pixels, of the settings that the other sentences are about."""
    told = []
    for method in dict.fromkeys(entry["method"] for entry in entries):
        own = [entry for entry in entries if entry["method"] == method]
        closest = min(own, key=_rmse)
        named = {race.fastest.get(method) for race in races} | {closest["name"]}
        made = [
            entry
            for entry in own
            if entry["name"] in named and entry["summary"]["worst_pixels_share"] >= FEW_PIXELS
        ]
        if made:
            one = min(made, key=_rmse)
            share = one["summary"]["worst_pixels_share"]
            told.append(
                f"{NOUNS[method]} ({one['label']}: 0.1 % of the pixels have {percentage(share)} of the squared error; "
                f"RMSE {_rmse(one):.2g}, without them {_rmse(one) * math.sqrt(1.0 - share):.2g})"
            )
    return f"A few pixels, such as those on outlines, make the RMSE of {listed(told)}." if told else ""


def _sentence(words: str) -> str:
    """With a capital and a full stop; nothing stays nothing."""
    return f"{words[0].upper()}{words[1:]}." if words else ""


def least_rmse(entries: Sequence[Entry], method: str) -> float:
    """The smallest error of a method."""
    return min(_rmse(entry) for entry in entries if entry["method"] == method)


def _rmse(entry: Entry) -> float:
    return float(entry["summary"]["rmse"])


def listed(parts: Sequence[str]) -> str:
    """Words with commas and an ``and``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def milliseconds(duration: float) -> str:
    """A frame's time with two digits or whole milliseconds."""
    return f"{1e3 * duration:.2g} ms" if duration < 0.01 else f"{1e3 * duration:.0f} ms"


def seconds(duration: float) -> str:
    """A duration of setup."""
    return f"{duration:.2g} s" if duration < 10 else f"{duration:.0f} s"
