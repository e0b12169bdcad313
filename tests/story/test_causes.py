"""Causes of events: each rule joins with its evidence, and leaves the same events apart without it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Clipping, FlightLog, Imu, Stream, TimeLine
from attlog.segments.model import Segment, Segments
from attlog.story import causes, headline
from attlog.story.flight_events import Event
from tests.story import made


def event(
    kind: str, t: float, text: str = "", t_end: float | None = None, severity: Any = "warning", **more: Any
) -> Event:
    return Event(kind, t, severity, text or f"{kind} at {t:.1f} s.", t_end, **more)


def joined(*events: Event, **fields: Any) -> dict[str, str]:
    """Return kind of cause by kind of effect, as found in a log with these fields."""
    found = causes.link(made.log(**fields), sorted(events, key=lambda e: e.t))
    return {e.kind: e.cause.kind for e in found if e.cause is not None}


LOST = event("gnss_lost", 60.3, "No GNSS message arrived for 6 s in flight, from 60.3 s.", 66.3, about="messages")
BLIND = event("failsafe", 65.4, "Failsafe at 65.4 s.", evidence=["text at 65.4 s: Failsafe: blind land"])
INVALID = event("message", 65.3, "“invalid setpoints”.")


def test_a_failsafe_for_want_of_a_position_follows_from_the_gnss_that_is_missing() -> None:
    assert joined(LOST, INVALID, BLIND) == {"message": "gnss_lost", "failsafe": "gnss_lost"}


@pytest.mark.parametrize(
    "other",
    [
        event("failsafe", 65.4, "Radio failsafe at 65.4 s."),
        event("failsafe", 65.4, "Kill switch at 65.4 s.", about="kill switch"),
        event("failsafe", 65.4, "Failsafe at 65.4 s."),  # no word about a position
        event("failsafe", 69.0, BLIND.text, evidence=BLIND.evidence),  # GNSS is back
        event("failsafe", 60.0, BLIND.text, evidence=BLIND.evidence),  # before it was lost
        event("message", 65.4, "“low battery”."),
    ],
)
def test_another_failsafe_or_time_is_not_joined_to_lost_gnss(other: Event) -> None:
    assert joined(LOST, other) == {}


def clips(unit: int | None, *at: float) -> Clipping:
    t = np.arange(0.0, 60.0, 0.1)
    new = np.zeros(len(t), np.int64)
    new[np.searchsorted(t, at)] = 7
    return Clipping("accelerometer", unit, f"unit {unit}", t, new, True)


SHAKEN = event("clipping", 30.0, "The accelerometer clipped from 30.0 s to 50.0 s: 70 samples.", 50.0)
SWITCH = event("sensor_switch", 40.0, "IMU 1 replaced IMU 0 at 40.0 s.")
RESET = event("reset", 40.04, severity="note")
FLEW = TimeLine(np.array([0.0, 40.0]), [0, 1], "made")


def test_clipping_just_before_explains_the_switch_and_the_switch_the_jump_of_attitude() -> None:
    found = joined(SHAKEN, SWITCH, RESET, clippings=[clips(0, 38.5)], imu_that_flew=FLEW)
    assert found == {"sensor_switch": "clipping", "reset": "sensor_switch"}


@pytest.mark.parametrize(
    "clipped",
    [
        clips(0, 30.0, 37.0, 44.0),  # calm for 3 s before the switch
        clips(1, 38.5, 39.5),  # the unit that took over
        clips(None, 40.1, 40.2),  # flags of the unit that took over
    ],
)
def test_a_switch_without_clipped_samples_of_its_unit_is_not_joined(clipped: Clipping) -> None:
    found = joined(SHAKEN, SWITCH, clippings=[clipped], imu_that_flew=FLEW)
    assert found == {}


def test_vibration_explains_clipping_and_what_the_autopilot_calls_so() -> None:
    vibration = event("vibration", 28.0, t_end=52.0, value=20.0)
    words = event("message", 33.0, "“Vibration compensation ON”.")
    other = event("message", 34.0, "“Bad AHRS”.")
    found = causes.link(made.log(), [vibration, SHAKEN, words, other])
    assert [causes.root(e, found).kind for e in found] == ["vibration", "vibration", "vibration", "message"]


@pytest.mark.parametrize(("change_t", "linked"), [(35.0, True), (40.5, True), (30.2, False), (45.0, False)])
def test_a_rejected_compass_explains_its_replacement_while_it_is_rejected(change_t: float, linked: bool) -> None:
    rejected = event("aid_rejected", 30.0, "The EKF rejected its compass for 10 s of 60.", 40.0, about="compass")
    change = event("compass_switch", change_t)
    assert joined(rejected, change) == ({"compass_switch": "aid_rejected"} if linked else {})


@pytest.mark.parametrize(
    ("name", "t", "linked"),
    [
        ("AHRS_ORIENTATION", 41.0, True),
        ("EK3_SRC1_YAW", 41.0, True),
        ("RTL_ALT", 41.0, False),
        ("RNGFND1_ORIENT", 41.0, False),
        ("CAL_MAG0_ROT", 49.0, False),
    ],
)
def test_a_changed_parameter_explains_a_new_heading_only_if_it_acts_on_it(name: str, t: float, linked: bool) -> None:
    change = event("parameter_changed", 40.0, f"Changed in flight: {name} from 0 to 8 at 40.0 s.")
    lines = {name: TimeLine(np.array([0.0, 40.0]), [0.0, 8.0], name)}
    assert joined(change, event("realigned", t), lines=lines) == ({"realigned": "parameter_changed"} if linked else {})


LANDING = event("landing", 80.0, severity="info")


@pytest.mark.parametrize(
    ("reason", "modes", "linked"),
    [
        ("radio failsafe", ["LOITER", "RTL"], True),
        ("battery failsafe", ["LOITER", "RTL"], False),
        ("", ["LOITER", "RTL"], False),
        ("radio failsafe", ["LOITER", "RTL", "STABILIZE"], False),  # the pilot took over at 75 s
    ],
)
def test_a_failsafe_ends_the_flight_only_by_the_reason_of_the_mode_it_set(
    reason: str, modes: list[str], linked: bool
) -> None:
    t = np.array([0.0, 70.2, 75.0])[: len(modes)]
    lines = {"mode": TimeLine(t, modes, "MODE"), "mode_reason": TimeLine(t, ["", reason, ""][: len(modes)], "MODE")}
    found = joined(event("failsafe", 70.0, "Radio failsafe at 70.0 s."), LANDING, **lines)
    assert found == ({"landing": "failsafe"} if linked else {})


def falling(t0: float, t1: float) -> FlightLog:
    """A log whose accelerometer is weightless from ``t0`` to ``t1`` s."""
    t = np.arange(0.0, 60.0, 0.01)
    force = np.column_stack([np.zeros((len(t), 2)), np.where((t > t0) & (t < t1), 0.0, -9.8)])
    log = made.log()
    log.imus = [
        Imu(0, Stream(t, np.zeros((len(t), 3)), "rad/s", "FRD", "IMU"), Stream(t, force, "m/s^2", "FRD", "IMU"))
    ]
    return log


@pytest.mark.parametrize(("fall", "linked"), [((40.1, 41.0), True), ((0.0, 0.0), False), ((41.5, 43.0), False)])
def test_stopped_motors_explain_a_blow_only_where_it_fell_between(fall: tuple[float, float], linked: bool) -> None:
    killed = event("failsafe", 40.0, "Kill switch at 40.0 s.", about="kill switch")
    blow = event("impact", 41.0, severity="serious")
    found = causes.link(falling(*fall), [killed, blow])
    assert (found[1].cause is not None) is linked


def test_a_crash_check_that_disarms_a_tumbling_vehicle_is_not_its_cause() -> None:
    over = event("overturn", 39.5, severity="serious", t_end=39.8)
    found = causes.link(falling(40.1, 41.0), [over, event("disarmed", 40.0), event("impact", 41.0, severity="serious")])
    assert [e.cause and e.cause.kind for e in found] == [None, None, "overturn"]


@pytest.mark.parametrize(("t", "linked"), [(95.5, True), (94.0, False), (101.0, False)])
def test_a_broken_motor_explains_the_loss_of_control_within_five_seconds(t: float, linked: bool) -> None:
    fault, over = event("motor_no_thrust", t), event("overturn", 100.0, t_end=102.0, severity="serious")
    blow = event("impact", 101.0, severity="serious")
    assert joined(fault, over, blow) == {"impact": "overturn"} | ({"overturn": "motor_no_thrust"} if linked else {})


def test_the_earliest_fault_is_the_cause_and_an_oscillation_only_without_one() -> None:
    first, second = event("motor_no_thrust", 97.0), event("no_thrust_left", 98.0)
    shakes = event("oscillation", 96.0, t_end=99.0)
    over = event("overturn", 100.0, severity="serious")
    assert joined(shakes, first, second, over) == {"overturn": "motor_no_thrust"}
    assert joined(shakes, over) == {"overturn": "oscillation"}
    assert joined(event("oscillation", 50.0, t_end=60.0), over) == {}
    assert joined(event("oscillation", 50.0, t_end=100.0), over) == {}


@pytest.mark.parametrize(("t", "linked"), [(156.2, True), (160.0, False)])
def test_missing_thrust_explains_the_hard_landing_that_ends_it(t: float, linked: bool) -> None:
    thrust = event("no_thrust_left", 140.0, t_end=156.0)
    assert joined(thrust, event("hard_landing", t)) == ({"hard_landing": "no_thrust_left"} if linked else {})


def test_each_of_two_crashes_has_its_own_fault() -> None:
    crashes = [event("impact", t, severity="serious") for t in (100.0, 300.0)]
    thrust = event("no_thrust_left", 296.0, t_end=300.0)
    found = causes.link(made.log(), sorted([*crashes, thrust], key=lambda e: e.t))
    assert [e.cause and e.cause.kind for e in found if e.is_crash] == [None, "no_thrust_left"]


@pytest.mark.parametrize(("volts", "linked"), [(13.0, True), (15.5, False)])
def test_a_low_battery_explains_the_loss_of_thrust_where_its_volts_fell(volts: float, linked: bool) -> None:
    t = np.arange(0.0, 200.0, 1.0)
    battery = Stream(t, np.column_stack([np.where(t < 100.0, 16.4, volts), np.full(len(t), 30.0)]), "V, A", "", "BAT")
    low, thrust = event("battery", 110.0, "Battery failsafe at 110.0 s."), event("no_thrust_left", 150.0, t_end=156.0)
    crash = event("impact", 156.0, severity="serious")
    found = joined(event("armed", 2.0, severity="info"), low, thrust, crash, battery=battery)
    assert found == {"impact": "no_thrust_left"} | ({"no_thrust_left": "battery"} if linked else {})


@pytest.mark.parametrize(("metres", "linked"), [(44.0, True), (11.0, False), (1.0, False), (None, False)])
def test_a_jump_of_gnss_explains_its_rejection_only_where_it_is_beyond_any_gate(
    metres: float | None, linked: bool
) -> None:
    jump = event("gnss_jump", 50.0, value=metres, unit="m")
    rejected = event("aid_rejected", 51.0, "The EKF rejected its position for 9 s of 60.", 60.0, about="position")
    assert joined(jump, rejected) == ({"aid_rejected": "gnss_jump"} if linked else {})


def test_root_and_effects_follow_the_chain_to_its_ends() -> None:
    vibration = event("vibration", 28.0, t_end=52.0, value=20.0)
    log = made.log(clippings=[clips(0, 38.5)], imu_that_flew=FLEW)
    found = causes.link(log, [vibration, SHAKEN, SWITCH, RESET])
    assert causes.root(found[3], found) is found[0]
    assert [e.kind for e in causes.effects(found[0], found)] == ["clipping", "sensor_switch", "reset"]
    assert causes.effects(found[3], found) == []


def told(*events: Event, **fields: Any) -> str:
    """Return the headline of one flight from 20 to 90 s with these events."""
    log = made.log(**fields)
    linked = causes.link(log, list(events))
    return headline(log, Segments([Segment("airborne", 20.0, 90.0)]), linked, sound=False)


def test_the_headline_names_the_failsafe_once_behind_its_cause() -> None:
    said = told(LOST, BLIND)
    assert "GNSS messages missing from 60 s, hence failsafe at 65.4 s." in said
    assert said.lower().count("failsafe") == 1
    assert "hence" not in told(LOST, event("failsafe", 80.0, "EKF failsafe at 80.0 s."))


def test_the_headline_counts_the_switches_that_clipping_caused() -> None:
    switches = [event("sensor_switch", t) for t in (40.0, 44.0)]
    said = told(SHAKEN, *switches, clippings=[clips(0, 38.5, 43.0)])
    assert "Accelerometer clipped from 30 s, so the autopilot changed its IMU twice." in said
    assert "so the" not in told(SHAKEN, *switches, clippings=[clips(0, 31.0)])
