"""The verdict of a comparison, made from its numbers alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from isosample.compare.verdict_sentences import sentences_of
from isosample.defaults import DATA_CENTRIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    Entry = dict[str, Any]  # of results.json

TARGETS = (0.005, 0.002, 0.001)  # RMSE at which methods are held against each other


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
    sentences : tuple of str
        Which method is fastest at which error; where methods lose; the break-even; where a method does not
        show everything, and where few pixels make its RMSE.
    """

    races: tuple[Race, ...]
    break_even: BreakEven | None
    sentences: tuple[str, ...]

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
        Of results.json: ``name``, ``method``, ``label``, ``setup_seconds``, and ``rmse``, ``frame_seconds``,
        ``worst_pixels_share``, ``not_shown`` in ``summary``.
    targets : sequence of float
        RMSE, any order.

    Returns
    -------
    verdict : Verdict
        Nothing is interpolated: at a target counts the fastest entry that was measured and errs no more.
    """
    races = tuple(_race(entries, target) for target in sorted(targets, reverse=True))
    break_even = _break_even(entries, races)
    return Verdict(races=races, break_even=break_even, sentences=sentences_of(entries, races, break_even))


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


def _seconds(entry: Entry) -> float:
    return float(entry["summary"]["frame_seconds"])
