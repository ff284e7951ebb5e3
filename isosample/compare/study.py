"""A convergence study: errors over a refined parameter, the order seen, the order expected, and the verdict.

Source: T. Etiene et al., "Verifying volume rendering using discretization error analysis", IEEE TVCG 20(1), 2014:
refine one parameter at a time and compare the observed order of the error with the theory's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """One parameter refined, everything else kept.

    Attributes
    ----------
    name : str
        Unique and short; the plot's file name.
    question : str
        One sentence: what is refined and what is compared with what.
    parameter : str
        Axis label of the refined parameter.
    refinement : (N,) float64
        Ascending: the error is expected to fall like a power of it.
    errors : (N,) float64
    measure : str
        What an error is: axis label.
    expected : (low, high) or None
        Orders that the theory allows, already with the margin that few refinements need; None for a study whose
        errors must stay below `bounds` instead.
    bounds : (N,) float64 or None
        Largest error allowed at each refinement.
    reason : str
        Why this order or these bounds.
    """

    name: str
    question: str
    parameter: str
    refinement: F64
    errors: F64
    measure: str
    reason: str
    expected: tuple[float, float] | None = None
    bounds: F64 | None = None

    def __post_init__(self) -> None:
        if (self.expected is None) == (self.bounds is None):
            raise InputError(f"study {self.name} needs either an expected order or bounds.")
        if self.refinement.shape != self.errors.shape or len(self.errors) < 2:
            raise InputError(f"study {self.name} needs two errors or more, one per refinement.")
        if not (np.isfinite(self.errors).all() and np.all(np.diff(self.refinement) > 0)):
            raise InputError(f"study {self.name} has errors {self.errors} over {self.refinement}.")

    @property
    def order(self) -> float | None:
        """Observed order: the negative slope of log error over log refinement, least squares."""
        if np.any(self.errors <= 0):
            return None
        return -float(np.polyfit(np.log(self.refinement), np.log(self.errors), 1)[0])

    @property
    def passed(self) -> bool:
        """Whether the order is an expected one, or every error below its bound."""
        if self.bounds is not None:
            return bool(np.all(self.errors <= self.bounds))
        assert self.expected is not None
        return self.order is not None and self.expected[0] <= self.order <= self.expected[1]

    @property
    def expectation(self) -> str:
        """The expectation in words."""
        if self.expected is None:
            return "below its bound"
        return f"{self.expected[0]:g} to {self.expected[1]:g}"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "name": self.name,
            "question": self.question,
            "parameter": self.parameter,
            "refinement": self.refinement.tolist(),
            "errors": self.errors.tolist(),
            "measure": self.measure,
            "order": self.order,
            "expected": self.expectation,
            "bounds": None if self.bounds is None else self.bounds.tolist(),
            "reason": self.reason,
            "passed": self.passed,
        }
