"""Where an impact parts a run of the smoother, and what each part is given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.estimators import Aids, Estimate, Measurements
from attlog.estimators.filters import smoother

T = 100.0 + 0.01 * np.arange(2001)
ROWS = np.column_stack([T, T, T])


def parts(monkeypatch: pytest.MonkeyPatch, impact: float | None) -> tuple[list[Any], Estimate]:
    """The spans of samples and of heights that each part got; its cost is its number of samples."""
    seen: list[Any] = []

    def part(t: Any, gyr: Any, acc: Any, mag: Any, aids: Aids, params: Any) -> Estimate:
        assert (gyr[:, 0] == t).all()
        assert (acc[:, 0] == t).all()
        assert (mag[:, 0] == t).all()
        assert aids.baro is not None
        seen.append((round(t[0], 6), round(t[-1], 6), round(aids.baro.t[0], 6), round(aids.baro.t[-1], 6)))
        q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
        return Estimate(t, q, bias=np.zeros((len(t), 3)), aux={"own": t.copy()}, ns_per_update=float(len(t)))

    monkeypatch.setattr(smoother, "part", part)
    aids = Aids(baro=Measurements(T, T), impact=impact)
    return seen, smoother.run(T, ROWS, ROWS, ROWS, aids, {})


def test_a_run_is_parted_a_fifth_of_a_second_before_an_impact_with_its_own_aids(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen, run = parts(monkeypatch, 112.205)
    assert seen == [(100.0, 112.0, 100.0, 112.0), (112.01, 120.0, 112.01, 120.0)]
    assert run.t[0] == 100.0
    assert (run.aux["own"] == T).all()
    assert run.ns_per_update == pytest.approx((1201.0**2 + 800.0**2) / 2001.0)


@pytest.mark.parametrize(("impact", "count"), [(None, 1), (105.15, 1), (105.25, 2), (120.15, 2), (120.25, 1)])
def test_less_than_five_seconds_are_no_flight_and_an_impact_behind_the_end_parts_nothing(
    monkeypatch: pytest.MonkeyPatch, impact: float | None, count: int
) -> None:
    assert len(parts(monkeypatch, impact)[0]) == count
