"""Values are spaced half by value and half by samples, and a histogram survives its file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.isovalues import IsovaluePlan, plan_isovalues
from isosample.transfer.sample_shares import SampleShares
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume


def test_between_two_values_lie_as_much_of_the_range_and_of_the_samples_together() -> None:
    # All samples of the range from 2 to 6 lie between 2 and 3: the mean of both shares is (1/4 + 1) / 2 = 5/8 at 3.
    shares = SampleShares(low=0.0, high=8.0, counts=(9, 9, 4, 0, 0, 0, 7, 7))
    np.testing.assert_allclose(shares.spaced(2.0, 6.0, 1), [2.0 + 0.5 / 0.625], rtol=1e-14)
    np.testing.assert_allclose(shares.spaced(2.0, 6.0, 3), [2.4, 2.8, 4.0], rtol=1e-14)
    assert shares.spaced(2.0, 6.0, 0) == []


def test_without_samples_values_are_evenly_spaced() -> None:
    shares = SampleShares(low=0.0, high=8.0, counts=(9, 9, 0, 0, 0, 0, 7, 7))
    np.testing.assert_allclose(shares.spaced(2.0, 6.0, 3), [3, 4, 5])
    np.testing.assert_allclose(shares.spaced(20.0, 24.0, 3), [21, 22, 23])  # where only a spline reaches


def test_a_plan_for_light_keeps_the_shares_that_it_was_made_with() -> None:
    volume = Volume(np.array([0.0] * 40 + [6.0] * 20 + [8.0, 10.0, 10.0, 10.0]).reshape(4, 4, 4))
    shares = SampleShares.of(volume)
    assert sum(shares.counts) == 64
    red = (1.0, 0.0, 0.0)
    tf = TransferFunction([ControlPoint(value, red, there) for value, there in ((2, 0), (5, 1), (10, 1))])
    plan = plan_isovalues(tf, volume.value_range, per_slope=3, lit=True, shares=shares)
    read = IsovaluePlan.from_dict(json.loads(json.dumps(plan.to_dict())))
    assert read.shares == shares
    again = plan_isovalues(tf, volume.value_range, per_slope=3, lit=True, shares=read.shares)
    assert again.isovalues.tolist() == plan.isovalues.tolist()
    even = plan_isovalues(tf, volume.value_range, per_slope=3, lit=True)
    np.testing.assert_array_equal(plan.isovalues[:4], even.isovalues[:4])  # the ramp is spaced evenly
    assert plan.isovalues[5] < even.isovalues[5]  # the plateau's are where the samples are


def test_a_histogram_without_bins_is_refused() -> None:
    with pytest.raises(InputError, match="no histogram"):
        SampleShares(low=0.0, high=1.0, counts=())
    with pytest.raises(InputError, match="no histogram"):
        SampleShares(low=1.0, high=1.0, counts=(1,))
