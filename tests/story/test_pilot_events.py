"""The pilot's sticks and radio: conventions of both firmwares, losses, and full stick that flips a vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog import flight, story
from attlog.core import rotation
from attlog.flight.ardupilot import vehicle
from attlog.flight.ardupilot.imu import DataflashBuilder
from attlog.flight.mavlink import RADIO_RECEIVER
from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.flight.px4 import sensors
from attlog.flight.px4.imu import TopicBuilder
from attlog.health.findings import event_signs
from attlog.segments.model import Segments
from attlog.story.flight_events import Event
from tests.conftest import SAMPLES
from tests.flight import fake
from tests.story.falling import flight_log, segments

START = 10_000_000


# --- reading ---


@pytest.mark.parametrize("name", ["copter_steps_stabilize.bin", "px4_steps.ulg"])
def test_a_stick_to_the_right_or_back_is_followed_by_roll_right_or_nose_up(name: str) -> None:
    """Sign by what the simulated vehicle did."""
    log = flight.read(SAMPLES / name)
    sticks, attitude = log.pilot.sticks, log.onboard_attitude
    assert sticks is not None
    assert attitude is not None
    euler = rotation.to_euler(attitude.q)
    moved = 0
    for axis in (0, 1):
        angle = np.interp(sticks.t, attitude.t, euler[:, axis])
        if np.std(sticks.x[:, axis]) > 0.05:
            moved += 1
            assert np.corrcoef(sticks.x[:, axis], angle)[0, 1] > 0.4
    assert moved or name.endswith(".ulg")


def test_pulses_become_shares_of_the_calibrated_travel() -> None:
    pulse = np.array([[1000, 1500, 2000, 1400], [1800, 1500, 1100, 1600], [0, 1500, 1500, 1500]], np.uint16)
    columns = {"TimeUS": fake.micros(3, 10.0)} | {f"C{k + 1}": pulse[:, k] for k in range(4)}
    builder = DataflashBuilder(fake.messages("dataflash", {("RCIN", 0): columns}), t0_us=START)
    builder.values = {
        "RCMAP_ROLL": 3.0,
        "RCMAP_THROTTLE": 1.0,
        "RC3_MIN": 1100.0,
        "RC3_MAX": 2000.0,
        "RC2_REVERSED": 1.0,
    }
    builder.values |= {"RC4_REV": -1.0}
    stream = vehicle.stick_stream(builder)
    assert stream is not None
    np.testing.assert_allclose(stream.x[:2], [[1.0, 0.0, 0.25], [-1.0, 0.0, -0.25]])


def test_px4s_forward_stick_is_nose_down_in_both_eras() -> None:
    for names, turn in ((("roll", "pitch", "yaw"), 1.0), (("y", "x", "r"), 1.0)):
        x = {name: np.array([v, v], np.float32) for name, v in zip(names, (0.5, 0.25, -0.125), strict=True)}
        columns = {"timestamp": fake.micros(2, 5.0)} | x
        made = fake.messages("ulog", {("manual_control_setpoint", 0): columns})
        stream = sensors.stick_stream(TopicBuilder(made, t0_us=START))
        assert stream is not None
        np.testing.assert_allclose(stream.x[0], [0.5 * turn, -0.25, -0.125])


def ardupilot_signal(table: str, columns: dict[str, Any], **values: float) -> list[bool]:
    columns = {"TimeUS": fake.micros(4, 10.0)} | columns
    builder = DataflashBuilder(fake.messages("dataflash", {(table, 0): columns}), t0_us=START)
    builder.values = values
    line = vehicle.radio_signal(builder)
    return [] if line is None else [bool(line.at(0.1 * k + 0.01)) for k in range(4)]


def test_the_radio_is_lost_by_its_flag_or_a_throttle_below_the_failsafe() -> None:
    good, lost = [True, True, False, True], {"C1": np.full(4, 1500), "C3": np.array([1100, 990, 950, 1100])}
    assert ardupilot_signal("RCI2", {"Flags": np.array([1, 1, 2, 1], np.uint8)}) == good
    assert ardupilot_signal("RCIN", lost, FS_THR_ENABLE=1.0, FS_THR_VALUE=975.0) == good
    assert ardupilot_signal("RCIN", lost, THR_FAILSAFE=1.0, THR_FS_VALUE=975.0) == good
    assert ardupilot_signal("RCIN", lost, FS_THR_ENABLE=0.0, FS_THR_VALUE=975.0) == []


def test_px4_loses_the_radio_where_receiver_or_autopilot_reports_it() -> None:
    receiver = {"timestamp": fake.micros(4, 10.0), "rc_lost": np.array([0, 1, 0, 0], np.uint8)}
    flags = {"timestamp": fake.micros(4, 10.0), "manual_control_signal_lost": np.array([0, 0, 1, 0], np.uint8)}
    made = fake.messages("ulog", {("input_rc", 0): receiver, ("failsafe_flags", 0): flags})
    line = sensors.radio_signal(TopicBuilder(made, t0_us=START))
    assert line is not None
    assert [bool(line.at(0.1 * k + 0.01)) for k in range(4)] == [True, False, False, True]
    assert line.value == [True, False, True]  # one loss, though two topics report parts of it


def test_telemetrys_bit_is_that_of_the_receiver() -> None:
    assert RADIO_RECEIVER == 1 << 16  # MAV_SYS_STATUS_SENSOR_RC_RECEIVER of common.xml


# --- events ---


def turning(rate_dps: tuple[float, float], begin: float, end: float) -> tuple[FlightLog, Segments]:
    """A quadrotor that turns at constant roll and pitch rates from begin to end s, where it is over."""
    t = np.arange(0.0, 15.0, 0.01)
    on = (t >= begin) & (t < end)
    rate = np.column_stack([on * rate_dps[0], on * rate_dps[1], 0.0 * t])
    angle = np.cumsum(rate[:, :2], axis=0) * 0.01
    return flight_log(t, rate, np.clip(angle, -170.0, 170.0), np.full((len(t), 4), 0.5), 5), segments(end, True)


def held(log: FlightLog, axis: int, value: float, begin: float, end: float, mode: str) -> None:
    t = np.arange(0.0, 15.0, 0.1)
    x = np.zeros((len(t), 3))
    x[(t >= begin) & (t <= end), axis] = value
    log.pilot.sticks = Stream(t, x, "1", "", "RCIN")
    log.state.mode = TimeLine(np.zeros(1), [mode], "MODE")


def told(log: FlightLog, made: Segments) -> tuple[list[Event], list[Event]]:
    events = story.events(log, made)
    return [e for e in events if e.kind == "full_stick"], [e for e in events if e.is_crash]


@pytest.mark.parametrize(
    ("axis", "value", "rates", "words"),
    [
        (0, 1.0, (300.0, 0.0), "right"),
        (0, -0.95, (-300.0, 0.0), "left"),
        (1, 1.0, (20.0, 200.0), "back"),
        (1, -1.0, (0.0, -200.0), "forward"),
    ],
)
def test_full_stick_in_acro_explains_the_flip_it_commands(
    axis: int, value: float, rates: tuple[float, float], words: str
) -> None:
    log, made = turning(rates, 10.0, 10.6)
    held(log, axis, value, 9.9, 10.5, "ACRO")
    (stick,), (crash,) = told(log, made)
    assert stick.text.startswith(f"Full {words} stick in ACRO from 9.9 s: ")
    assert stick.severity == "note"
    assert stick.value == pytest.approx(abs(0.6 * rates[axis]), abs=3.0)
    assert crash.cause is not None
    assert crash.cause.kind == "full_stick"


@pytest.mark.parametrize(
    ("value", "begin", "mode", "rates"),
    [
        (1.0, 9.9, "STABILIZE", (300.0, 0.0)),
        (-1.0, 9.9, "ACRO", (300.0, 0.0)),
        (0.6, 9.9, "ACRO", (300.0, 0.0)),
        (1.0, 2.0, "ACRO", (300.0, 0.0)),
        (1.0, 9.9, "ACRO", (100.0, 300.0)),
        (1.0, 9.9, "ACRO", (40.0, 0.0)),
    ],
    ids=["angle mode", "against it", "half", "long before", "other axis", "not followed"],
)
def test_stick_that_did_not_command_the_flip_is_no_cause(
    value: float, begin: float, mode: str, rates: tuple[float, float]
) -> None:
    log, made = turning(rates, 10.0, 10.6)
    held(log, 0, value, begin, begin + 0.5, mode)
    stick, (crash,) = told(log, made)
    assert stick == []
    assert crash.cause is None or crash.cause.kind != "full_stick"


def lost_radio(*spans: tuple[float, float], source: str = "RCI2.Flags") -> list[Event]:
    log, made = turning((0.0, 0.0), 10.0, 14.0)
    made.crash_events = []
    times = [0.0, *(t for span in spans for t in span)]
    log.pilot.signal = TimeLine(np.array(times), [k % 2 == 0 for k in range(len(times))], source)
    log.texts = [(6.4, 4, "Radio Failsafe - RTL")]
    log.seconds = 15.0
    return story.events(log, made)


def test_a_lost_radio_is_the_cause_of_its_failsafe() -> None:
    events = lost_radio((5.0, 8.0))
    (lost,) = [e for e in events if e.kind == "radio_lost"]
    assert (lost.t, lost.t_end, lost.severity) == (5.0, 8.0, "warning")
    (failsafe,) = [e for e in events if e.kind == "failsafe"]
    assert failsafe.cause is not None
    assert (failsafe.cause.kind, failsafe.cause.evidence) == ("radio_lost", "no signal for 1.4 s")


@pytest.mark.parametrize(
    ("source", "joystick"),
    [
        ("failsafe_flags.manual_control_signal_lost", True),
        ("input_rc.rc_lost and failsafe_flags.manual_control_signal_lost", False),
    ],
)
def test_a_log_without_a_receiver_may_have_lost_its_joystick(source: str, joystick: bool) -> None:
    (lost,) = [e for e in lost_radio((5.0, 8.0), source=source) if e.kind == "radio_lost"]
    assert ("joystick" in lost.text) is joystick
    (sign,) = [s for s in event_signs([lost], [], turning((0.0, 0.0), 10.0, 14.0)[0]) if s.kind == "failsafe"]
    assert ("joystick" in sign.action) is joystick


@pytest.mark.parametrize("spans", [(), ((5.0, 5.3),), ((0.0, 15.0),)], ids=["received", "short", "never received"])
def test_a_radio_that_was_received_or_never_was_is_not_lost(spans: tuple[tuple[float, float], ...]) -> None:
    assert [e for e in lost_radio(*spans) if e.kind == "radio_lost"] == []
