import numpy as np
import pytest

from attlog import rotation
from attlog.flight.model import Attitude
from attlog.metrics import controller
from attlog.segments.model import Segment
from tests.metrics import flights


def flight(time_constant, dead_s, seconds=120.0, hz=100.0):
    """A set-point that jumps at random, followed by a first-order vehicle after a dead time."""
    t = np.arange(0.0, seconds, 1.0 / hz)
    rng = np.random.default_rng(0)
    wanted = np.repeat(np.radians(rng.uniform(-20, 20, (int(seconds), 2))), int(hz), axis=0)
    shift = round(dead_s * hz)
    late = np.concatenate([np.repeat(wanted[:1], shift, axis=0), wanted[: len(t) - shift]])
    flown = np.column_stack([flights.first_order(x, 1.0 / hz, time_constant) for x in late.T])
    q_set, q = (rotation.from_euler(x[:, 0], x[:, 1], 0.3) for x in (wanted, flown))
    row = flights.row(t, q, "onboard")
    row.kind = "onboard"
    case = flights.case([row], [Segment("continuous", 0, seconds), Segment("airborne", 2, seconds - 1)])
    case.log.attitudes, case.log.onboard = {"ATT": Attitude(t, q, "ATT")}, "ATT"
    case.log.setpoints = Attitude(t, q_set, "ATT.Des")
    return case, row


def test_delay_and_rise_of_a_known_vehicle_are_found():
    answers = controller.compute(*flight(0.08, 0.05), "all")
    assert answers["setpoint_delay_ms"].value == pytest.approx(50 + 1000 * 0.08 * np.log(2), abs=12)
    assert answers["setpoint_rise_ms"].value == pytest.approx(1000 * 0.08 * np.log(9), rel=0.5)
    assert answers["setpoint_peak_pct"].value == pytest.approx(100.0, abs=12.0)
    assert answers["setpoint_delay_ms"].ci95[0] < answers["setpoint_delay_ms"].value
    assert answers["tracking_rms_deg"].value > 1.0


def test_a_vehicle_that_follows_at_once_has_no_delay():
    answers = controller.compute(*flight(1e-4, 0.0), "all")
    assert answers["setpoint_delay_ms"].value == pytest.approx(0.0, abs=20.0)  # 5 % regularisation smooths
    assert answers["tracking_rms_deg"].value < 0.01


def test_without_a_set_point_there_is_a_code():
    case, row = flight(0.08, 0.05)
    case.log.setpoints = None
    assert {a.code for a in controller.compute(case, row, "all").values()} == {"no_setpoint"}


def test_only_the_onboard_row_has_a_controller():
    case, row = flight(0.08, 0.05)
    row.name = "mahony"
    assert controller.compute(case, row, "all") == {}
