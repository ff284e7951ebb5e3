"""The verdict of a comparison in three sentences, made from its numbers alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from isosample.defaults import DATA_CENTRIC, PEAK_FINDING, POST_CLASSIFIED, PRE_INTEGRATED

if TYPE_CHECKING:
    from collections.abc import Sequence

    Entry = dict[str, Any]  # of results.json

TARGETS = (0.005, 0.002, 0.001)  # RMSE at which methods are held against each other
NOUNS = {
    DATA_CENTRIC: "the data-centric method",
    POST_CLASSIFIED: "post-classification",
    PRE_INTEGRATED: "pre-integration",
    PEAK_FINDING: "peak finding",
}
LEVEL = 1.05  # times that differ by less are called level: medians of a few frames tell no more


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """The methods at one error.

    Attributes
    ----------
    target : float
        RMSE that a picture may have.
    fastest : dict of str to str
        By method: the entry with the shortest frame of those that reach the target; methods that do not are
        absent. From fast to slow.
    seconds : dict of str to float
        Its frame, by method, in the same order.
    """

    target: float
    fastest: dict[str, str]
    seconds: dict[str, float]

    @property
    def winner(self) -> str | None:
        """The fastest method; None where none reaches the target."""
        return next(iter(self.seconds), None)

    @property
    def lead(self) -> float | None:
        """How many times as long the second one takes; None without a second."""
        times = list(self.seconds.values())
        return times[1] / times[0] if len(times) > 1 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class BreakEven:
    """When the data-centric method's precomputation has paid.

    Attributes
    ----------
    target : float
        RMSE of both.
    entry, rival : str
        Data-centric, and the fastest ray caster, at that target.
    frames : int or None
        Least number of frames that both take equally long for, setup included, or the data-centric one less;
        None: never.
    last : int or None
        Largest such number, where the data-centric frames are slower and only its setup is shorter; None: there is no
        end, or no such number at all.
    """

    target: float
    entry: str
    rival: str
    frames: int | None
    last: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the numbers say.

    Attributes
    ----------
    races : tuple of Race
        One per target.
    break_even : BreakEven or None
        At the smallest target that both sides reach; None where there is none.
    sentences : (str, str, str)
        Which method is fastest at which error; where methods lose; the break-even.
    """

    races: tuple[Race, ...]
    break_even: BreakEven | None
    sentences: tuple[str, str, str]

    def to_dict(self) -> dict[str, Any]:
        """All of it, JSON-ready."""
        found = self.break_even
        return {
            "sentences": list(self.sentences),
            "races": [
                {"target": race.target, "fastest": race.fastest, "seconds": race.seconds}
                for race in self.races
            ],
            "break_even": None
            if found is None
            else {
                "target": found.target,
                "entry": found.entry,
                "rival": found.rival,
                "frames": found.frames,
                "last": found.last,
            },
        }


def judge(entries: Sequence[Entry], targets: Sequence[float] = TARGETS) -> Verdict:
    """Return the verdict of a comparison.

    Parameters
    ----------
    entries : sequence of dict
        Of results.json: ``name``, ``method``, ``setup_seconds``, and ``rmse``, ``frame_seconds`` in ``summary``.
    targets : sequence of float
        RMSE, any order.

    Returns
    -------
    verdict : Verdict
        Nothing is interpolated: at a target counts the fastest entry that was measured and errs no more.
    """
    races = tuple(_race(entries, target) for target in sorted(targets, reverse=True))
    break_even = _break_even(entries, races)
    sentences = (_fastest(races), _losses(entries, races), _paid(entries, races, break_even))
    return Verdict(races=races, break_even=break_even, sentences=sentences)


def frames_to_break_even(setup: float, frame: float, rival_setup: float, rival_frame: float) -> int | None:
    """Least n >= 1 with ``setup + n frame <= rival_setup + n rival_frame``; None where there is none.

    Parameters
    ----------
    setup, frame, rival_setup, rival_frame : float
        Seconds before the first frame and of every frame, of either side.
    """
    more, gain = setup - rival_setup, rival_frame - frame
    if more <= gain:
        return 1
    return math.ceil(more / gain) if gain > 0.0 else None


def last_frame_ahead(setup: float, frame: float, rival_setup: float, rival_frame: float) -> int | None:
    """Largest n >= 1 with ``setup + n frame <= rival_setup + n rival_frame``; None where there is none or no end.

    Parameters
    ----------
    setup, frame, rival_setup, rival_frame : float
        As of `frames_to_break_even`.
    """
    more, gain = setup - rival_setup, rival_frame - frame
    return math.floor(more / gain) if more <= gain < 0.0 else None


def _race(entries: Sequence[Entry], target: float) -> Race:
    best: dict[str, Entry] = {}
    for entry in entries:
        if entry["summary"]["rmse"] <= target:
            held = best.get(entry["method"])
            if held is None or _seconds(entry) < _seconds(held):
                best[entry["method"]] = entry
    ranked = sorted(best.items(), key=lambda pair: _seconds(pair[1]))
    return Race(
        target=target,
        fastest={method: entry["name"] for method, entry in ranked},
        seconds={method: _seconds(entry) for method, entry in ranked},
    )


def _break_even(entries: Sequence[Entry], races: Sequence[Race]) -> BreakEven | None:
    by_name = {entry["name"]: entry for entry in entries}
    for race in reversed(races):
        rival = next((method for method in race.fastest if method != DATA_CENTRIC), None)
        if DATA_CENTRIC in race.fastest and rival is not None:
            own, other = by_name[race.fastest[DATA_CENTRIC]], by_name[race.fastest[rival]]
            costs = (own["setup_seconds"], _seconds(own), other["setup_seconds"], _seconds(other))
            return BreakEven(
                target=race.target,
                entry=own["name"],
                rival=other["name"],
                frames=frames_to_break_even(*costs),
                last=last_frame_ahead(*costs),
            )
    return None


# -- sentences ------------------------------------------------------------------------------------


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
        least = min(entry["summary"]["rmse"] for entry in entries if entry["method"] == method)
        parts.append(f"RMSE {least:.2g} at best")
    return f"{NOUNS[method]} ({'; '.join(parts)})" if parts else ""


def _paid(entries: Sequence[Entry], races: Sequence[Race], found: BreakEven | None) -> str:
    methods = {entry["method"] for entry in entries}
    if DATA_CENTRIC not in methods or len(methods) < 2:
        return "There is no break-even: it takes the data-centric method and a ray caster to have one."
    if found is None:
        return f"There is no break-even: at no RMSE down to {races[-1].target:g} do both sides arrive."
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


def listed(parts: Sequence[str]) -> str:
    """Words with commas and an ``and``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def milliseconds(duration: float) -> str:
    """A frame's time with two digits or whole milliseconds."""
    return f"{1e3 * duration:.2g} ms" if duration < 0.01 else f"{1e3 * duration:.0f} ms"


def seconds(duration: float) -> str:
    """A duration of setup."""
    return f"{duration:.2g} s" if duration < 10 else f"{duration:.0f} s"


def _seconds(entry: Entry) -> float:
    return float(entry["summary"]["frame_seconds"])
