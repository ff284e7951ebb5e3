"""The plan of a scene: its isovalues, and the linear transfer function in every band between them."""

from __future__ import annotations

import copy
import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.transfer.sample_shares import SampleShares

if TYPE_CHECKING:
    from collections.abc import Mapping

F64 = npt.NDArray[np.float64]

CONSTANT_SLOPES = "constant_slopes"  # key of `skipped`: visible slopes that were given no isovalues inside


class Reason(enum.Enum):
    """Why a value is in the plan; where several apply, the first in this order is given."""

    IMPULSE = "isosurface"
    SHEET = "sheet"
    PEAK = "peak"
    STEP = "step"
    SLOPE_END = "slope end"
    BETWEEN = "between"


class PlanRow(NamedTuple):
    """One isovalue of a plan, for printing."""

    level_index: int
    value: float
    reason: str
    extinction_below: float
    extinction_above: float
    opacity: float
    sheet_area: float
    sheet_width: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IsovaluePlan:
    """The isovalues of a scene and the linear transfer function inside every band between them.

    Attributes
    ----------
    isovalues : (K,) float64
        Strictly ascending, in data units.
    reasons : tuple of K Reason
        Why each value is there.
    value_range : (low, high)
        Smallest and largest sample of the volume, in data units.
    band_values : (K + 1, 2) float64
        Lower and upper end of every band; band `b` lies between isovalue `b − 1` and isovalue `b`, the
        outer ones end at the value range.
    band_extinction : (K + 1, 2) float64
        One-sided limits of the extinction at the two ends of the band [1/world]; linear in between.
    band_color : (K + 1, 2, 3) float64
        The same for the colour (linear RGB, straight).
    impulse_opacity : (K,) float64
        Opacity of one crossing of an isosurface of the transfer function; 0 where the level is none.
    impulse_color : (K, 3) float64
        Its colour (linear RGB, straight); 0 where the level is none.
    sheet_area : (K,) float64
        Integral over the value of a narrow peak's extinction [data units/world]; 0 where the level is no sheet.
        One crossing has the opacity 1 − exp(−sheet_area / |df/dt|). A level that is a sheet and an isosurface
        composites the sheet first (front), then the isosurface, from whichever side a ray comes.
    sheet_color : (K, 3) float64
        The sheet's colour (linear RGB, straight); 0 where the level is none.
    sheet_width : (K,) float64
        Width of the peak that the sheet stands for, in typical voxels; 0 where the level is none.
    skipped : dict of str to int
        What was left out and how much.
    lit : bool
        True where slopes of constant extinction and colour were given isovalues too, for pictures with light.
    shares : SampleShares or None
        By which the values inside slopes of constant extinction and colour were spaced.
    report : dict
        How the plan was found, JSON-ready; empty for a plan that was not searched for.

    Raises
    ------
    InputError
        If shapes do not belong together, isovalues do not ascend, or a sheet's area is negative or not finite.
    """

    isovalues: F64
    reasons: tuple[Reason, ...]
    value_range: tuple[float, float]
    band_values: F64
    band_extinction: F64
    band_color: F64
    impulse_opacity: F64
    impulse_color: F64
    sheet_area: F64
    sheet_color: F64
    sheet_width: F64
    skipped: dict[str, int]
    lit: bool = False
    shares: SampleShares | None = None
    report: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.isovalues)
        shapes = {
            "isovalues": (count,),
            "band_values": (count + 1, 2),
            "band_extinction": (count + 1, 2),
            "band_color": (count + 1, 2, 3),
            "impulse_opacity": (count,),
            "impulse_color": (count, 3),
            "sheet_area": (count,),
            "sheet_color": (count, 3),
            "sheet_width": (count,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InputError(f"{name} has shape {getattr(self, name).shape}; expected {shape}.")
        if len(self.reasons) != count:
            raise InputError(f"reasons has {len(self.reasons)} entries; expected {count}.")
        if not (np.diff(self.isovalues) > 0).all():
            raise InputError(f"isovalues {self.isovalues.tolist()} must be strictly ascending.")
        if not (np.isfinite(self.sheet_area) & (self.sheet_area >= 0)).all():
            raise InputError(f"sheet_area {self.sheet_area.tolist()} must be finite and >= 0.")

    @property
    def band_visible(self) -> npt.NDArray[np.bool_]:
        """(K + 1,) bool, True for bands with extinction."""
        visible: npt.NDArray[np.bool_] = np.any(self.band_extinction > 0, axis=1)
        return visible

    @property
    def lacks_light(self) -> bool:
        """True where a picture with light needs isovalues that the plan has left out; see `plan_isovalues`."""
        return not self.lit and self.skipped.get(CONSTANT_SLOPES, 0) > 0

    def describe(self) -> list[PlanRow]:
        """Return one row per isovalue, for printing."""
        below, above = self.band_extinction[:-1, 1], self.band_extinction[1:, 0]
        reasons = [reason.value for reason in self.reasons]
        numbers = np.stack(
            [below, above, self.impulse_opacity, self.sheet_area, self.sheet_width], axis=1
        ).tolist()
        values = self.isovalues.tolist()
        return [PlanRow(k, values[k], reasons[k], *row) for k, row in enumerate(numbers)]

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-ready lists; `from_dict` gives back an equal plan."""
        return {
            "isovalues": self.isovalues.tolist(),
            "reasons": [reason.value for reason in self.reasons],
            "value_range": list(self.value_range),
            "band_values": self.band_values.tolist(),
            "band_extinction": self.band_extinction.tolist(),
            "band_color": self.band_color.tolist(),
            "impulse_opacity": self.impulse_opacity.tolist(),
            "impulse_color": self.impulse_color.tolist(),
            "sheet_area": self.sheet_area.tolist(),
            "sheet_color": self.sheet_color.tolist(),
            "sheet_width": self.sheet_width.tolist(),
            "skipped": dict(self.skipped),
            "lit": self.lit,
            **({"shares": self.shares.to_dict()} if self.shares is not None else {}),
            "report": copy.deepcopy(self.report),
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> IsovaluePlan:
        """Plan from the content of `to_dict`.

        Raises
        ------
        InputError
            If a key is missing, a reason is unknown or a list has the wrong shape.
        """
        try:
            low, high = document["value_range"]
            isovalues = np.asarray(document["isovalues"], dtype=np.float64)
            return cls(
                isovalues=isovalues,
                reasons=tuple(map(_reason, document["reasons"])),
                value_range=(float(low), float(high)),
                band_values=np.asarray(document["band_values"], dtype=np.float64),
                band_extinction=np.asarray(document["band_extinction"], dtype=np.float64),
                band_color=np.asarray(document["band_color"], dtype=np.float64),
                impulse_opacity=np.asarray(document["impulse_opacity"], dtype=np.float64),
                impulse_color=np.asarray(document["impulse_color"], dtype=np.float64).reshape(-1, 3),
                sheet_area=np.asarray(document["sheet_area"], dtype=np.float64),
                sheet_color=np.asarray(document["sheet_color"], dtype=np.float64).reshape(-1, 3),
                sheet_width=np.asarray(document["sheet_width"], dtype=np.float64),
                skipped={str(key): int(count) for key, count in document["skipped"].items()},
                lit=bool(document.get("lit", False)),  # plans of older caches do not say
                shares=SampleShares.from_dict(document["shares"]) if "shares" in document else None,
                report=copy.deepcopy(dict(document.get("report", {}))),
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError(f"an isovalue plan lacks or misuses {error}; make it anew.") from error


def _reason(name: str) -> Reason:
    """Return the reason of a name, or raise `InputError`: a later version may know more of them."""
    if name not in {reason.value for reason in Reason}:
        raise InputError(
            f"an isovalue plan has the reason {name!r}; expected one of {[reason.value for reason in Reason]}. Make "
            "it anew."
        )
    return Reason(name)
