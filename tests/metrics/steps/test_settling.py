import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.steps import settling
from attlog.metrics.steps.curves import Curve
from attlog.metrics.steps.events import StepEvent
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


def curve(error_deg):
    """A movement of 20 deg within 0.2 s, its error (n,) at 100 Hz from 0.3 s before the onset on."""
    t = 5.0 + np.arange(-30, 200) / 100.0
    moved = 20.0 * np.clip((t - 5.0) / 0.2, 0.0, 1.0)
    return Curve(StepEvent(0, 5.0, 5.1, 5.18, 20.0, 4.7, 6.99), t, moved, np.asarray(error_deg(t - 5.0)))


@pytest.mark.parametrize("until", [0.25, 0.6, 1.5])
def test_settled_is_the_first_time_from_which_on_the_error_stays_small(until):
    """At 100 Hz an error that is seen at 0.6 s for the last time is over at 0.61 s."""
    overshoot, settled, unsettled = settling.of_events(
        [curve(lambda s: np.where((s > 0) & (s < until + 0.005), 4.0, 0.0))]
    )
    assert settled == pytest.approx([until + 0.01])
    assert overshoot == pytest.approx([100.0 * 4.0 / 20.0])
    assert unsettled == 0


def test_what_is_wrong_at_the_end_has_not_settled():
    assert settling.of_events([curve(lambda s: np.where(s > 0, 4.0, 0.0))])[2] == 1


def test_the_reference_of_a_movement_begins_at_its_onset_and_ends_at_its_size():
    t, q = motion("yaw", 36.0)
    ref = sampled(t, q, 50.0)
    made = flights.row(ref.t, ref.q)
    end = float(ref.t[-1])
    case = flights.case([made], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q))
    found = settling.curves(case, made, "all")
    assert len(found) >= 8
    for one in found:
        assert np.interp(0.0, one.seconds, one.reference) == pytest.approx(0.0, abs=1e-6)
        assert one.reference.max() == pytest.approx(abs(one.event.delta_deg), rel=0.05)
