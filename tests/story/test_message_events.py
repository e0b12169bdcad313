"""Words of the autopilot as events: one for each cause, counted, and serious where the vehicle was in use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import story
from attlog.core import rotation
from attlog.flight.ardupilot.vehicle import is_simulated
from attlog.flight.model import Attitude, FlightLog, Gnss, InnovationTest, Problem
from attlog.segments.impacts import CrashEvent
from attlog.segments.model import Segment, Segments
from attlog.story import Event, estimator_events, failsafe_events, message_events
from attlog.story.flight_events import Text
from tests.story.made import log


def spans(*air: tuple[float, float], armed: tuple[float, float] | None = (10.0, 90.0)) -> Segments:
    found = [Segment("continuous", 0.0, 100.0), *(Segment("airborne", a, b) for a, b in air)]
    return Segments(found if armed is None else [*found, Segment("armed", *armed)])


def events_of(texts: Sequence[Text], segments: Segments, **more: Any) -> list[Event]:
    return message_events.message_events(log(texts=list(texts), seconds=100.0, **more), [], segments)


def said(text: str, *times: float, level: int = 6) -> list[Text]:
    return [(t, level, text) for t in times]


def test_an_attempt_to_arm_that_the_autopilot_refused_is_the_headline_of_a_vehicle_that_stayed_disarmed() -> None:
    texts = [*said("Arm: Gyros not calibrated", 8.0, 11.0, 52.0), *said("PreArm: Gyros not calibrated", 61.0)]
    refused, unasked = sorted(events_of(texts, spans(armed=None)), key=lambda e: e.t)
    assert (refused.kind, refused.severity, refused.t, refused.quote) == (
        *("arming_refused", "warning"),
        *(8.0, "Gyros not calibrated"),
    )
    assert "3 times" in refused.text
    assert (unasked.kind, unasked.severity) == ("message", "note")
    made = log(texts=texts, seconds=100.0)
    text = story.headline(made, spans(armed=None), [refused, unasked], sound=False)
    assert "not armed in 100 s. Arming was refused at 8.0 s: “Gyros not calibrated” (3 times)." in text


def test_a_refusal_before_a_flight_is_a_note() -> None:
    (early,) = events_of(said("Arm: Throttle too high", 8.0), spans((20.0, 80.0)))
    assert (early.kind, early.severity) == ("arming_refused", "note")


def test_errors_of_one_driver_are_one_event_with_the_number_of_each_text() -> None:
    texts = [
        *said("[roboclaw] Error reading encoders", *np.arange(12.0, 62.0), level=3),
        *said("[roboclaw] ACK timeout", *np.arange(40.0, 70.0), level=3),
    ]
    (device,) = events_of(texts, spans(), vehicle="rover")
    assert (device.kind, device.severity, device.value) == ("device_error", "warning", 80.0)
    assert "“Error reading encoders” 50 times, “ACK timeout” 30 times from 40.0 s" in device.text
    assert [e.kind for e in events_of(texts[:5], spans(), vehicle="rover")] == ["message"]
    fails = said("[commander] Preflight Fail: no heading", *np.arange(1.0, 31.0), level=2)
    assert [e.kind for e in events_of(fails, spans())] == ["message"]


def test_a_measured_value_in_a_text_makes_no_new_cause_but_a_sensor_does() -> None:
    volts = [
        x for k in range(5) for x in said(f"[commander] Preflight Fail: Avionics Power low: 4.{70 + k} Volt", 20.0 + k)
    ]
    clips = [*said("Accel 0 clipping, not safe to fly!", 30.0), *said("Accel 1 clipping, not safe to fly!", 31.0)]
    low, first, second = events_of([*volts, *clips], spans((15.0, 80.0)))
    assert ("(5 times)" in low.text, low.severity) == (True, "note")
    assert [first.severity, second.severity] == ["warning", "warning"]


def test_a_fault_in_flight_is_a_warning_though_px4_words_it_as_a_check_before_flight() -> None:
    text = "Preflight Fail: Compass 1 fault"
    assert [e.severity for e in events_of(said(text, 40.0, level=4), spans((15.0, 80.0)))] == ["warning"]
    assert [e.severity for e in events_of(said(text, 5.0, level=4), spans((15.0, 80.0)))] == ["note"]


@pytest.mark.parametrize("text", ["Preflight Fail: Kill switch engaged", "Arming denied: kill switch engaged"])
def test_a_reason_for_not_arming_is_no_kill_switch(text: str) -> None:
    events, quoted = failsafe_events.failsafe_events(log(texts=said(text, 30.0)), spans())
    assert not events
    assert not quoted


def test_stopped_motors_belong_to_the_kill_switch() -> None:
    texts = [*said("Kill switch engaged", 40.0), *said("Preflight Fail: Flight termination active", 40.1)]
    (event,), quoted = failsafe_events.failsafe_events(log(texts=texts), spans((15.0, 80.0)))
    assert (event.about, len(event.evidence), len(quoted)) == ("kill switch", 2, 2)
    assert failsafe_events.failsafe_events(log(texts=texts[1:]), spans((15.0, 80.0))) == ([], [])


def test_a_failsafe_is_named_by_its_action_and_quotes_its_reason() -> None:
    texts = [
        *said("invalid setpoints", 40.0, level=4),
        *said("Failsafe activated", 40.01),
        *said("Failsafe: blind land", 40.01),
    ]
    (event,), _ = failsafe_events.failsafe_events(log(texts=texts), spans((15.0, 80.0)))
    assert (event.text, event.quote) == ("Failsafe “blind land” at 40.0 s.", "invalid setpoints")


@pytest.mark.parametrize(
    ("reports", "names"),
    [
        (["Radio Failsafe - RTL", "GCS Failsafe"], ["Radio failsafe at 40.0 s.", "Ground station failsafe at 60.0 s."]),
        (["Radio Failsafe - RTL", "Radio Failsafe - RTL"], ["Radio failsafe at 40.0 s."]),
        (["Radio Failsafe - RTL", "Failsafe activated"], ["Radio failsafe at 40.0 s."]),
        (["Kill switch engaged", "Radio Failsafe - RTL"], ["Kill switch at 40.0 s."]),
        (["Radio Failsafe - RTL", "Kill switch engaged"], ["Kill switch at 60.0 s.", "Radio failsafe at 40.0 s."]),
    ],
)
def test_a_failsafe_hides_its_repetitions_and_no_other_failsafe(reports: list[str], names: list[str]) -> None:
    texts = [x for k, text in enumerate(reports) for x in said(text, 40.0 + 20.0 * k, level=4)]
    found, _ = failsafe_events.failsafe_events(log(texts=texts), spans((15.0, 80.0)))
    assert [event.text for event in found] == names


def test_a_battery_failsafe_by_its_code_stands_beside_a_radio_failsafe_of_the_same_minute() -> None:
    made = log(texts=said("Radio Failsafe - RTL", 40.0, level=4))
    made.problems = [
        Problem("err_6_1", "warning", "Battery failsafe", t=60.0),
        Problem("err_5_1", "warning", "", t=41.0),
    ]
    found, _ = failsafe_events.failsafe_events(made, spans((15.0, 80.0)))
    assert [event.kind for event in found] == ["failsafe", "battery"]


def test_warnings_of_a_battery_within_a_minute_are_one_event_that_quotes_its_own_time() -> None:
    texts = [
        *said("Low battery level! Return advised", 40.0, level=4),
        *said("Dangerous battery level!, please land!", 42.0, level=3),
    ]
    (event,), quoted = failsafe_events.failsafe_events(log(texts=texts), spans((15.0, 80.0)))
    assert (event.kind, event.t, event.t_end, event.severity) == ("battery", 40.0, 42.0, "warning")
    assert event.quote == "Low battery level! Return advised"
    assert "42.0" in event.evidence[-1]
    assert len(quoted) == 2


def test_spoofing_is_quoted_and_is_no_jump() -> None:
    texts = said("GPS spoofing detected! (state: 2)", 30.0)
    (event,) = estimator_events._gnss_jumps(log(texts=texts), spans(), [])
    assert (event.kind, event.severity, event.quote) == ("gnss_interference", "warning", texts[0][2])


@pytest.mark.parametrize(
    ("texts", "weights"),
    [
        # Two cores align once each, then one of them again.
        ([(20.0, 0), (33.0, 1)], ["info"]),
        ([(20.0, 0), (33.0, 1), (60.0, 0)], ["info", "warning"]),
        ([(20.0, 0), (25.0, 0)], ["info", "warning"]),
    ],
)
def test_an_alignment_told_by_two_cores_is_one(texts: list[tuple[float, int]], weights: list[str]) -> None:
    told = [x for t, core in texts for x in said(f"EKF3 IMU{core} in-flight yaw alignment complete", t)]
    found = estimator_events._realign_events(log(texts=told), spans(), [])
    assert [e.severity for e in found] == weights


def test_a_pause_of_the_records_is_no_time_of_rejection() -> None:
    t = np.concatenate([np.arange(20.0, 30.0, 0.2), np.arange(70.0, 72.0, 0.2)])
    test = InnovationTest("compass", t, np.where(t > 27.9, 1.5, 0.2), "XKF4:0.SM")
    (found,) = estimator_events.aid_rejections(log(innovation_tests=[test]), spans((15.0, 80.0)))
    assert found.seconds == pytest.approx(1.8 + 1.8)


def receiver(*, missing: tuple[float, float] | None = None, unfixed: tuple[float, float] | None = None) -> Gnss:
    t = np.arange(0.0, 100.0, 0.2)
    t = t if missing is None else t[(t < missing[0]) | (t > missing[1])]
    fix = np.full(len(t), 3)
    if unfixed is not None:
        fix[(t > unfixed[0]) & (t < unfixed[1])] = 1
    none = np.full(len(t), np.nan)
    return Gnss(0, t, "GPS", none, none, none, np.full((len(t), 3), np.nan), none, none, none, fix)


def with_attitude(gnss: Gnss, pause: tuple[float, float] = (0.0, 0.0), form: str = "ulog") -> FlightLog:
    t = np.arange(0.0, 100.0, 0.1)
    attitude: Any = SimpleNamespace(t=t[(t <= pause[0]) | (t >= pause[1])])
    return log(gnss=[gnss], attitudes={"A": attitude}, onboard="A", format=form)


def test_gnss_is_lost_by_records_without_a_fix_and_its_messages_may_be_missing() -> None:
    flight = spans((15.0, 80.0))
    (lost,) = estimator_events._gnss_lost(with_attitude(receiver(unfixed=(40.0, 50.0))), flight)
    assert "no fix for 10 s" in lost.text
    (missing,) = estimator_events._gnss_lost(with_attitude(receiver(missing=(40.0, 50.0))), flight)
    assert "No GNSS message arrived for 10 s" in missing.text
    paused = with_attitude(receiver(missing=(40.0, 50.0)), pause=(42.0, 49.0))
    assert not estimator_events._gnss_lost(paused, flight)
    assert not estimator_events._gnss_lost(with_attitude(receiver(missing=(40.0, 50.0)), form="tlog"), flight)


def test_many_outages_are_one_event_with_their_sum() -> None:
    gnss = receiver()
    for k in range(5):
        gnss.fix[(gnss.t > 20.0 + 10.0 * k) & (gnss.t < 24.0 + 10.0 * k)] = 1
    (lost,) = estimator_events._gnss_lost(with_attitude(gnss), spans((15.0, 80.0)))
    assert (lost.t, lost.value) == (pytest.approx(20.0, abs=0.3), pytest.approx(20.0, abs=2.0))
    assert "in 5 outages" in lost.text


@pytest.mark.parametrize(
    ("speed_m_s", "scatter_m_s", "said_"),
    [
        (0.4, 0.01, "moved 4.1 m at up to 0.42 m/s from 20 to 30 s of 100 s."),
        (0.0, 0.01, "stood still for 100 s."),
        (0.0, 0.1, "stood still for 100 s."),  # a receiver that scatters
        (3.0, 0.1, "moved at up to 3.2 m/s in 100 s."),
    ],
)
def test_a_rover_that_moves_slowly_does_not_stand(speed_m_s: float, scatter_m_s: float, said_: str) -> None:
    gnss = receiver()
    gnss.vel_ned[:] = 0.0
    gnss.vel_ned[:, 0] = scatter_m_s * (1.0 + np.sin(gnss.t))
    gnss.vel_ned[:, 0] += speed_m_s * ((gnss.t > 19.6) & (gnss.t < 29.4))
    text = story.headline(log(gnss=[gnss], vehicle="rover", seconds=100.0), spans(), [], sound=False)
    assert text.endswith(said_)


def test_texts_that_differ_by_a_measured_value_are_one_event() -> None:
    texts = [(float(t), 4, f"[timesync] RTT too high: {10 + t} ms") for t in range(21)]
    sensors = [(50.0, 4, "IMU 1 is bad"), (51.0, 4, "IMU 2 is bad")]
    groups = message_events._by_cause([*texts, *sensors])
    assert [len(group) for group in groups] == [21, 1, 1]


@pytest.mark.parametrize(("turn_deg", "said_"), [(-61.5, ", turned by 60°."), (12.0, "of 100 s.")])
def test_a_rover_turns_on_the_spot_but_not_by_drift(turn_deg: float, said_: str) -> None:
    """It turns within 5 s before it moves; standing, its heading drifts by 0.3 deg/s."""
    gnss = receiver()
    gnss.vel_ned[:] = 0.0
    gnss.vel_ned[:, 0] = 0.4 * ((gnss.t > 19.6) & (gnss.t < 29.4))
    t = np.arange(0.0, 100.0, 0.05)
    heading = np.radians(turn_deg * np.clip((t - 10.0) / 5.0, 0.0, 1.0) + 0.3 * t + 170.0)
    turned = Attitude(t, rotation.from_euler(0.0 * t, 0.0 * t, heading), "vehicle_attitude")
    made = log(gnss=[gnss], vehicle="rover", seconds=100.0, attitudes={"A": turned}, onboard="A")
    assert story.headline(made, spans(), [], sound=False).endswith(said_)


def test_a_broken_part_stays_in_the_headline_where_flights_do_not() -> None:
    made, crash = log(), Event("impact", 77.9, "serious", "Hit.")
    motor = Event(
        "motor_no_thrust", 77.0, "serious", "Motor 1 (front right) gave no thrust from 77.0 s: driven at 99 %."
    )
    first = CrashEvent("impact", 77.9, 78.0, 5.2, "g", "seen", rate=25.0)
    second = CrashEvent("impact", 80.6, 80.7, 6.4, "g", "seen", rate=25.0)
    text = story.headline(made, spans((15.0, 78.0)), [motor, crash], sound=False)
    assert "Motor 1 (front right) gave no thrust" in text
    crashed = replace(spans((15.0, 40.0), (50.0, 78.0)), crash_events=[first, second])
    text = story.headline(made, crashed, [motor, crash], sound=False)
    assert "Motor 1 (front right) gave no thrust from 77.0 s." in text
    late = replace(motor, t=79.0, t_end=80.0)
    text = story.headline(made, crashed, [crash, late], sound=False)
    assert text.index("Hit") < text.index("Motor 1")


@pytest.mark.parametrize(
    ("records", "text", "names", "simulated"),
    [
        (True, "ChibiOS: d4fce84e", [], True),
        (False, "RC Protocol: SITL", [], True),
        (False, "", ["SIM_DRIFT_TIME"], True),
        (False, "PX4: bc032eee NuttX: 2c1505d6", ["SIM_HITL"], False),
        (False, "PX4v3 0031001E 31334712 34353535", ["SIM_HITL"], False),
        (False, "ArduCopter V4.6.0", ["INS_USE"], False),
    ],
)
def test_a_board_wins_over_a_parameter_of_the_simulator(
    records: bool, text: str, names: list[str], simulated: bool
) -> None:
    assert is_simulated(records, [(0.0, 6, text)], names) is simulated
