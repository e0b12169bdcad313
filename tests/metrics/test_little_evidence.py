"""Intervals where there is hardly any evidence: none, never a crash."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.statistics import intervals as interval


@pytest.mark.parametrize("n", range(1, 12))
@pytest.mark.parametrize("probability", [0.5, 0.95])
def test_fewer_values_than_groups_give_an_interval_of_them_or_none(n: int, probability: float) -> None:
    values = np.random.default_rng(n).exponential(size=n)
    groups = interval.equal_groups(n, 8)
    assert sum(g.stop - g.start for g in groups) == n
    assert all(g.stop > g.start for g in groups)
    found = interval.of_quantile(values, probability, groups)
    assert (found is None) is (n < 2)
    assert found is None or values.min() <= found[0] <= found[1] <= values.max()


def test_empty_groups_are_no_evidence() -> None:
    values = np.arange(100.0)
    whole = interval.equal_groups(100, 5)
    assert interval.of_quantile(values, 0.5, [*whole, slice(100, 100)]) == interval.of_quantile(values, 0.5, whole)
    assert interval.of_quantile(values, 0.5, [slice(0, 100), slice(100, 100)]) is None
