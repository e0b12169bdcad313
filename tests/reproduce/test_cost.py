"""What an update costs: in turn over the same samples, told apart where it differs by much."""

from __future__ import annotations

import numpy as np

from attlog.reproduce import cost


def test_a_filter_with_twelve_states_costs_more_than_integration_alone() -> None:
    spent = cost.nanoseconds(("gyro", "ekf12"), rounds=3, repeats=3)
    assert [len(x) for x in spent.values()] == [3, 3]
    assert min(spent["ekf12"]) > 3.0 * max(spent["gyro"]) > 0.0


def test_filters_without_a_field_and_with_a_rare_one_can_be_timed() -> None:
    never, rare = (cost.nanoseconds(("complementary",), every, rounds=1, updates=400) for every in (None, 8))
    assert np.isfinite([*never["complementary"], *rare["complementary"]]).all()
