import numpy as np
import pytest

from attlog import rotation
from attlog.metrics import settling
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.motions import motion, sampled


def answers(factor_after):
    """A row that turns ``factor_after(t since the movement)`` times as far as the reference in 10 turns of yaw."""
    t, q = motion("yaw", 36.0)
    yaw = np.unwrap(rotation.to_euler(q)[:, 2])
    starts = np.arange(3.0, 33.0, 3.0)
    since = t - starts[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)]
    before = np.interp(starts, t, yaw)[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)]
    est = before + (yaw - before) * np.where(t >= starts[0], factor_after(since), 1.0)
    ref, row = sampled(t, q, 50.0), sampled(t, rotation.from_euler(0.02, -0.03, est), 200.0)
    made = flights.row(row.t, row.q)
    end = float(ref.t[-1])
    case = flights.case([made], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q))
    return settling.compute(case, made, "all")


def test_a_row_that_follows_exactly_settles_at_once_without_overshoot():
    found = answers(lambda since: 1.0 + 0 * since)
    assert found["overshoot_pct"].value == pytest.approx(0.0, abs=0.3)
    assert found["settling_s"].value == pytest.approx(0.0, abs=0.05)
    assert found["settling_s"].n >= 8


def test_overshoot_that_decays_is_told_in_percent_and_in_time():
    """20 % too far until 0.9 s after the command, then exact: the error ends there."""
    found = answers(lambda since: np.where(since < 0.9, 1.2, 1.0))
    assert 10.0 < found["overshoot_pct"].value < 25.0
    assert 0.6 < found["settling_s"].value < 1.0
    assert found["settling_s"].ci95[0] >= 0.0
