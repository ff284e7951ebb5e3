"""What is told of the errors of many pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import SHOWN_QUANTILE

if TYPE_CHECKING:
    import numpy.typing as npt


def shown_error(errors: npt.NDArray[np.floating[Any]]) -> float:
    """Error of one of the pixels that no more than a thousandth of them exceed; 0 without pixels."""
    return float(np.quantile(errors, SHOWN_QUANTILE, method="higher")) if errors.size else 0.0
