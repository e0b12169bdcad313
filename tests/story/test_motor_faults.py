"""Motors that fail in closed loop are named; sound ones in hard manoeuvres are not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from attlog import story
from attlog.flight.drive import HEXA_X, Geometry, MotorOutputs, MotorReport, frame_of
from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.health.check import HealthCase
from attlog.health.drive import fault_check, motor_checks
from attlog.segments.airborne import InAir
from attlog.segments.model import Segments
from attlog.story.motor_faults import QUESTIONS, DriveFault, study_motors, tipping_rate
from tests.story.falling import Fall, level_log, segments

PLACES = ("front right", "rear left", "front left", "rear right")


def faults(flown: tuple[FlightLog, Segments]) -> list[DriveFault]:
    return study_motors(*flown).all_faults


@pytest.mark.parametrize("motor", range(4))
def test_a_motor_that_stops_is_named_with_place_and_time(motor: int) -> None:
    (found,) = faults(Fall(motor).flown())
    assert (found.kind, found.motor, found.position) == ("motor_no_thrust", motor + 1, PLACES[motor])
    assert 10.0 <= found.t < 10.5
    assert "full speed" not in found.cause


def test_the_event_leads_the_headline_and_carries_the_part() -> None:
    log, spans = Fall(1).flown()
    found = story.events(log, spans)
    (event,) = [e for e in found if e.kind == "motor_no_thrust"]
    assert (event.part, event.motor, event.position, event.severity) == ("motor", 2, "rear left", "serious")
    assert "Motor 2 (rear left) gave no thrust from 10." in story.headline(log, spans, found)


@pytest.mark.parametrize("made", [Fall(lost=0.0), Fall(lost=0.0, wanted_deg=40.0), Fall(lost=0.3)], ids=str)
def test_sound_and_weak_motors_that_hold_the_vehicle_are_no_fault(made: Fall) -> None:
    assert faults(made.flown()) == []
    checks = {c.question: c.verdict for c in motor_checks(HealthCase(*made.flown()))}
    assert checks == dict.fromkeys(("motor_thrust", "motor_outputs", "thrust_reserve", "yaw_response"), "ok")


def test_a_frame_of_the_other_order_names_no_motor() -> None:
    log, spans = Fall(1).flown()
    outputs = log.power.outputs
    assert outputs is not None
    assert outputs.geometry is not None
    outputs.geometry = replace(outputs.geometry, bearing=outputs.geometry.bearing + 180.0)
    assert not any(fault.kind == "motor_no_thrust" for fault in faults((log, spans)))


def test_an_opposite_motor_that_runs_away_turns_the_vehicle_the_other_way() -> None:
    log, spans = Fall(1).flown()
    log.imus[0].gyro.x[:, 2] *= -1.0
    (found,) = faults((log, spans))
    assert found.cause.endswith("Or motor 1 ran at full speed uncommanded.")


def test_the_firmwares_report_is_quoted_beside_the_motor() -> None:
    log, spans = Fall(1).flown()
    assert log.power.outputs is not None
    log.power.outputs.reports = [MotorReport(10.4, 2, "Potential Thrust Loss (2)")]
    (found,) = faults((log, spans))
    assert "report at 10.4 s: Potential Thrust Loss (2)" in found.evidence


@pytest.mark.parametrize(
    ("change", "why"), [("hz", "Hz"), ("frame", "position"), ("scale", "limits"), ("none", "RCOU")]
)
def test_without_its_inputs_the_question_is_unknown_with_the_reason(change: str, why: str) -> None:
    log, spans = Fall(hz=4.0 if change == "hz" else 10.0).flown()
    assert log.power.outputs is not None
    if change == "frame":
        log.power.outputs.geometry = None
    if change == "scale":
        log.power.outputs.scaled = False
    if change == "none":
        log.power.outputs = None
    found = {c.question: c for c in motor_checks(HealthCase(log, spans))}["motor_thrust"]
    assert found.verdict == "unknown"
    assert why in found.text


def test_a_fall_from_lift_off_may_be_the_order_of_the_motors() -> None:
    (found,) = faults(Fall(1, at=2.0).flown())
    assert found.text.startswith("Motor 2 (rear left) did not lift its side from ")
    assert found.cause.endswith("do not match the frame type.")


@pytest.mark.parametrize(("height", "words"), [(0.5, "did not lift its side"), (np.nan, "gave no"), (8.0, "gave no")])
def test_near_the_ground_a_leg_may_have_caught(height: float, words: str) -> None:
    log, spans = Fall(1).flown()
    grid = SimpleNamespace(index=lambda t: 0)
    spans.air = cast(InAir, SimpleNamespace(grid=grid, levels=[SimpleNamespace(above=np.full(1, height))]))
    (found,) = faults((log, spans))
    assert found.text.startswith(f"Motor 2 (rear left) {words}")
    assert ("touched the ground" in found.cause) is (height < 1.0)


@pytest.mark.parametrize(("command", "count"), [("yaw", 0), ("roll", 1)])
def test_a_yaw_command_of_a_hexa_drives_three_motors_and_accuses_none(command: str, count: int) -> None:
    log, spans = Fall(lost=0.0).flown()
    outputs, frame = log.power.outputs, frame_of(HEXA_X, "made")
    assert outputs is not None
    asked = frame.spin if command == "yaw" else 2.0 * frame.lever @ frame.lever[1]
    during = (outputs.t > 5.0) & (outputs.t < 5.8)
    outputs.x = np.where(during[:, None], np.clip(0.5 + 0.5 * asked, 0.0, 1.0), 0.5)
    outputs.names, outputs.geometry = [f"C{k + 1}" for k in range(6)], frame
    gyro = log.imus[0].gyro
    gyro.x[:] = 0.0
    tipped = np.radians(np.interp(gyro.t, [5.0, 5.8, 6.0], [0.0, -200.0, 0.0]))
    gyro.x[:, :2] = tipped[:, None] * frame.lever[1]
    assert len([f for f in faults((log, spans)) if f.motor == 2]) == count


def test_without_an_attitude_only_the_outputs_are_judged() -> None:
    log, spans = Fall(1).flown()
    log.attitudes, log.onboard = {}, None
    unknown = {c.question: c.text for c in motor_checks(HealthCase(log, spans)) if c.verdict == "unknown"}
    assert unknown == dict.fromkeys(("motor_thrust", "thrust_reserve", "yaw_response"), "No attitude is logged.")


def test_outputs_that_are_slow_or_on_the_ground_alone_are_unknown() -> None:
    log, spans = Fall(lost=0.0, hz=2.0).flown()
    assert "2.0 Hz" in study_motors(log, spans).missing["motor_outputs"]
    log, spans = Fall(lost=0.0, hz=1.2).flown()
    assert set(study_motors(log, spans).missing) == set(QUESTIONS)
    log.power.throttle = None
    log, spans = Fall(lost=0.0).flown()
    outputs = log.power.outputs
    assert outputs is not None
    outputs.t, outputs.x = outputs.t[:10], outputs.x[:10]
    assert "in flight" in study_motors(log, spans).missing["motor_outputs"]


# --- an output off or frozen ---


@pytest.mark.parametrize("level", [-1.2, np.nan, 0.5])
def test_an_output_that_never_drives_or_moves_is_no_motor(level: float) -> None:
    log, spans = Fall(lost=0.0, wanted_deg=20.0).flown()
    assert log.power.outputs is not None
    log.power.outputs.x[:, 2] = level
    assert faults((log, spans)) == []


@pytest.mark.parametrize(("value", "kind"), [(-0.19, "motor_off"), (np.nan, "motor_off"), (0.47, "motor_frozen")])
def test_an_output_off_or_frozen_in_flight_is_named(value: float, kind: str) -> None:
    log, spans = Fall(lost=0.0, wanted_deg=20.0).flown()
    outputs = log.power.outputs
    assert outputs is not None
    outputs.x[(outputs.t > 6.0) & (outputs.t < 7.5), 2] = value
    (found,) = faults((log, spans))
    assert (found.kind, found.motor) == (kind, 3)
    assert found.t == pytest.approx(6.1, abs=0.11)


@pytest.mark.parametrize(("stir", "step", "count"), [(0.02, 0.0, 1), (0.002, 0.0, 0), (0.02, 0.04, 0)])
def test_a_value_repeated_in_quiet_hover_is_frozen_where_chance_does_not_repeat_it(
    stir: float, step: float, count: int
) -> None:
    log, spans = Fall(lost=0.0, seconds=60.0).flown()
    outputs = log.power.outputs
    assert outputs is not None
    outputs.x = 0.5 + stir * np.random.default_rng(3).uniform(-1.0, 1.0, outputs.x.shape)
    if step:  # a coarse output keeps its value often
        outputs.x[:, 2] = step * np.round(outputs.x[:, 2] / step)
    outputs.x[(outputs.t > 20.0) & (outputs.t < 22.0), 2] = 0.503
    found = faults((log, spans))
    assert len(found) == count
    assert all((fault.kind, fault.motor) == ("motor_frozen", 3) for fault in found)


def test_a_motor_that_the_autopilot_stopped_quotes_its_report() -> None:
    log, spans = Fall(lost=0.0, wanted_deg=20.0).flown()
    outputs = log.power.outputs
    assert outputs is not None
    outputs.x[(outputs.t > 6.0) & (outputs.t < 7.5), 2] = np.nan
    outputs.reports = [MotorReport(6.0, 3, "control_allocator_status.handled_motor_failure_mask 4")]
    (found,) = faults((log, spans))
    assert found.evidence[-1].endswith("handled_motor_failure_mask 4")
    assert found.cause.endswith("stopped a failed motor.")


def test_all_outputs_off_at_once_is_disarming() -> None:
    log, spans = Fall(lost=0.0).flown()
    assert log.power.outputs is not None
    log.power.outputs.x[log.power.outputs.t > 9.0] = -0.19
    assert faults((log, spans)) == []


def stopped(force: float = 0.0, at: float = 9.0, level: float = -0.19) -> tuple[FlightLog, Segments]:
    """All motors stop at ``at`` s; it is weightless (or feels ``force``) and overturns at 10.5 s."""
    log, _ = Fall(lost=0.0).flown()
    outputs = log.power.outputs
    assert outputs is not None
    off = (outputs.t > at) & (outputs.t < 10.5)
    outputs.x[off] = level
    acc = log.imus[0].acc
    acc.x[:, 2] = np.where((acc.t > at) & (acc.t < 10.5), -force, -9.8)
    log.state.armed = TimeLine(np.array([0.0]), [True], "made")
    return log, segments(10.5, crashed=True)


def test_all_motors_off_while_armed_and_falling_are_named_with_the_landing_that_was_detected() -> None:
    log, spans = stopped()
    (found,) = faults((log, spans))
    assert (found.kind, found.motor, found.text) == ("motors_off", None, "All motors were off from 9.1 s in the air.")
    log.state.landed = TimeLine(np.array([0.0, 8.7]), [False, True], "made")
    (found,) = faults((log, spans))
    assert found.text.endswith("the autopilot had detected a landing at 8.7 s.")
    assert fault_check("motor_outputs", [found]).action == "Compare minimum and hover throttle before the next flight."
    log.parameters.lines["MPC_THR_MIN"] = TimeLine(np.array([0.0]), [0.12], "made")
    (found,) = faults((log, spans))
    assert fault_check("motor_outputs", [found]).action == "Set MPC_THR_MIN (0.12) well below hover thrust."
    crash = next(e for e in story.events(log, spans) if e.kind == "overturn")
    assert crash.cause is not None
    assert crash.cause.kind == "motors_off"


def test_motors_at_rest_are_no_fault_without_a_fall_or_by_the_pilot() -> None:
    assert faults(stopped(force=9.8)) == []
    assert faults(stopped(at=4.0)) == []  # it was lost 6.5 s later
    assert faults(stopped(level=0.0)) == []  # ArduPilot's floor turns the motors
    log, spans = stopped()
    log.texts = [(8.9, 4, "Kill-switch engaged")]
    assert faults((log, spans)) == []
    log, spans = stopped()
    log.state.armed = TimeLine(np.array([0.0, 9.0]), [True, False], "made")
    assert faults((log, spans)) == []


# --- thrust and yaw ---


def sinking(
    *, levels: tuple[float, ...] = (1.02, 0.9, 0.9, 0.95), climb_end: float = -1.5
) -> tuple[FlightLog, Segments]:
    """A flight at full throttle from 20 to 24 s, which sinks at 1.5 m/s and ends at ``climb_end``."""
    log = level_log(30.0, np.zeros(4))
    outputs = log.power.outputs
    assert outputs is not None
    outputs.x[:] = 0.7 + np.random.default_rng(2).normal(0.0, 0.01, outputs.x.shape)
    full = (outputs.t >= 20.0) & (outputs.t <= 24.0)
    outputs.x[full] = np.clip(outputs.x[full] - 0.7 + np.array(levels), 0.0, 1.0)
    t = np.arange(0.0, 30.0, 0.1)
    climb = np.where((t > 18.0) & (t < 26.0), np.interp(t, [18.0, 20.0, 24.0], [-1.5, -1.5, climb_end]), 0.0)
    log.baro = [Stream(t, 30.0 + np.cumsum(climb)[:, None] * 0.1, "m", "", "BARO")]
    return log, segments(29.0)


def test_full_throttle_that_sinks_is_told_with_the_drop() -> None:
    (found,) = faults(sinking())
    assert (found.kind, found.motor) == ("no_thrust_left", None)
    assert found.t == pytest.approx(20.0, abs=0.11)
    assert found.value == pytest.approx(6.0, abs=0.4)
    assert "heavy" in found.cause


def test_a_motor_alone_at_its_limit_is_named() -> None:
    (found,) = faults(sinking(levels=(0.7, 1.02, 0.7, 0.65)))
    assert (found.motor, found.position) == (2, "rear left")


@pytest.mark.parametrize(
    "made", [{"climb_end": 1.5}, {"levels": (0.9, 0.9, 0.9, 0.9)}, {"levels": (1.0, 0.6, 0.6, 0.6)}], ids=str
)
def test_a_fall_that_is_arrested_or_has_reserve_is_no_fault(made: dict) -> None:  # type: ignore[type-arg]
    assert faults(sinking(**made)) == []


@pytest.mark.parametrize(("turned", "count"), [(-30.0, 1), (30.0, 0), (-10.0, 0)])
def test_yaw_against_the_motors_is_a_fault(turned: float, count: int) -> None:
    log, spans = Fall(lost=0.0).flown()
    outputs = log.power.outputs
    assert outputs is not None
    assert isinstance(outputs.geometry, Geometry)
    late = outputs.t > 5.0
    outputs.x[late] = np.where(outputs.geometry.spin > 0, 0.75, 0.25)  # counter-clockwise propellers turn it right
    log.imus[0].gyro.x[:, 2] = np.radians(turned)
    assert len([f for f in faults((log, spans)) if f.kind == "yaw_backwards"]) == count


def test_nothing_after_the_first_blow_counts() -> None:
    log, _ = Fall(1).flown()
    assert faults((log, segments(12.0, blow=9.9))) == []


def test_five_records_at_the_top_are_the_ceiling() -> None:
    t, x = np.arange(100) * 0.1, np.full((100, 4), 0.5)
    x[:5, 2] = 0.92
    assert MotorOutputs(t, x, "RCOU", []).ceiling == pytest.approx(0.92)
    x[4, 2] = 0.93
    assert MotorOutputs(t, x, "RCOU", []).ceiling == 1.0


@pytest.mark.parametrize(("hover", "count"), [(0.2, 0), (0.5, 1)])
def test_why_a_vehicle_with_thrust_to_spare_sinks_is_unknown(hover: float, count: int) -> None:
    log, spans = sinking()
    t = np.arange(0.0, 30.0, 0.1)
    log.power.throttle = Stream(t, np.where((t >= 20.0) & (t <= 24.0), 1.0, hover)[:, None], "1", "", "CTUN.ThO")
    assert len(faults((log, spans))) == count
    assert ("hover takes 20 %" in study_motors(log, spans).missing.get("thrust_reserve", "")) is (count == 0)


@pytest.mark.parametrize(("seconds", "rise", "named"), [(0.35, 0.0, True), (0.25, 0.0, False), (0.35, 300.0, False)])
def test_a_rate_that_fell_before_the_full_command_must_stay_unanswered(
    seconds: float, rise: float, named: bool
) -> None:
    t = np.arange(0.0, seconds, 0.01)
    assert (tipping_rate(t, -190.0 + rise * t, np.linspace(0.0, -190.0, 30)) is not None) is named
    assert tipping_rate(t, -190.0 + rise * t, np.full(30, -190.0)) is None  # a roll that was flown
