"""Speed controllers: matched to motors by made flights, stops with and without confirmation, loads by closed form."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.drive import Esc, MotorOutputs, esc_telemetry
from attlog.flight.model import FlightLog
from attlog.health.check import HealthCase
from attlog.health.drive import esc_checks
from attlog.segments.model import Segments
from attlog.story.motor_faults import DriveFault, study_motors
from attlog.story.motor_speeds import match_motors, motor_loads
from tests.story.falling import Fall

ORDER = (2, 1, 0, 3)
"""The motor of each controller."""


def controllers(outputs: MotorOutputs, delay: float = 0.2, order: tuple[int, ...] = ORDER) -> list[Esc]:
    """Controllers of motors that turn at 2,000 rpm and 4,000 more at full output; the current goes with its cube."""
    t, found = np.arange(0.0, outputs.t[-1], 0.1), []
    for k, motor in enumerate(order):
        rpm = np.rint(2000.0 + 4000.0 * np.interp(t - delay, outputs.t, outputs.x[:, motor]))
        made = esc_telemetry(t, np.column_stack([rpm, (rpm / 2000.0) ** 3, 300.0 + 0.0 * t]), f"ESC[{k}]")
        assert made is not None
        found.append(made)
    return found


def flight(made: Fall) -> tuple[FlightLog, Segments, MotorOutputs]:
    log, spans = made.flown()
    assert log.power.outputs is not None
    log.power.escs = controllers(log.power.outputs)
    return log, spans, log.power.outputs


def stopped(esc: Esc, t0: float, t1: float, current: bool = False) -> None:
    """Let a controller report 0 rpm between two times, and no current either."""
    standing = (esc.t >= t0) & (esc.t < t1)
    esc.rpm[standing] = 0.0
    if current:
        esc.current[standing] = 0.0


def faults(flown: tuple[FlightLog, Segments, MotorOutputs]) -> list[DriveFault]:
    return study_motors(flown[0], flown[1]).all_faults


def test_controllers_are_matched_to_the_motors_whose_outputs_they_follow() -> None:
    log, _, outputs = flight(Fall(lost=0.0, wanted_deg=20.0, seconds=20.0))
    rng = np.random.default_rng(2)
    outputs.x = 0.5 + 0.1 * np.cumsum(rng.normal(0.0, 0.3, outputs.x.shape), axis=0)
    log.power.escs = controllers(outputs)
    assert match_motors(log.power.escs, outputs, [(1.0, 20.0)]) == list(ORDER)


def test_motors_that_move_alike_match_none_unless_the_log_names_them() -> None:
    _, _, outputs = flight(Fall(lost=0.0, seconds=20.0))
    rng = np.random.default_rng(2)
    outputs.x = np.repeat(0.5 + 0.1 * rng.normal(size=(len(outputs.t), 1)), 4, axis=1)
    escs = controllers(outputs)
    assert match_motors(escs, outputs, [(1.0, 20.0)]) == [None] * 4
    named = [Esc(e.name, e.t, e.rpm, e.current, e.temperature, ORDER[k] + 1) for k, e in enumerate(escs)]
    assert match_motors(named, outputs, [(1.0, 20.0)]) == list(ORDER)


@pytest.mark.parametrize(("current", "word"), [(0.0, "it stood still"), (40.0, "blocked"), (None, "propeller, lost")])
def test_a_motor_without_thrust_stands_is_blocked_or_lost_its_propeller(current: float | None, word: str) -> None:
    flown = flight(Fall(1))
    if current is not None:
        esc = flown[0].power.escs[1]
        stopped(esc, 10.0, 20.0)
        esc.current[esc.t >= 10.0] = current
    (found,) = faults(flown)
    assert (found.kind, found.motor) == ("motor_no_thrust", 2)
    assert word in found.cause.lower()
    assert any("ESC[1]" in line for line in found.evidence)


@pytest.mark.parametrize(("current", "motor"), [(False, None), (True, 3)])
def test_a_speed_of_zero_counts_where_the_current_confirms_it(current: bool, motor: int | None) -> None:
    log, spans, outputs = flight(Fall(lost=0.0, wanted_deg=20.0, seconds=20.0))
    rng = np.random.default_rng(2)
    outputs.x = np.clip(0.5 + 0.1 * np.cumsum(rng.normal(0.0, 0.1, outputs.x.shape), axis=0), 0.2, 0.8)
    log.power.escs = controllers(outputs)
    stopped(log.power.escs[0], 12.0, 13.0, current)
    found = [fault for fault in faults((log, spans, outputs)) if fault.kind == "motor_no_thrust"]
    assert [fault.motor for fault in found] == ([] if motor is None else [motor])
    assert all(fault.t == pytest.approx(12.0, abs=0.11) and "no current" in fault.evidence[0] for fault in found)


def hovering(*stops: tuple[float, float]) -> list[float]:
    """Begins of the stops that are found where the first controller reports no speed and current in ``stops``."""
    log, spans, outputs = flight(Fall(lost=0.0, wanted_deg=20.0, seconds=20.0))
    rng = np.random.default_rng(2)
    outputs.x = np.clip(0.5 + 0.1 * np.cumsum(rng.normal(0.0, 0.1, outputs.x.shape), axis=0), 0.2, 0.8)
    log.power.escs = controllers(outputs)
    for k, (t0, t1) in enumerate(stops):
        stopped(log.power.escs[0], t0, t1, current=k == len(stops) - 1)
    return [fault.t for fault in faults((log, spans, outputs)) if fault.kind == "motor_no_thrust"]


def test_a_quad_that_flies_on_for_seconds_has_a_motor_and_no_telemetry_of_it() -> None:
    assert hovering((8.0, 10.0)) == [pytest.approx(8.0, abs=0.11)]
    assert hovering((8.0, 15.0)) == []


def test_a_dropout_of_telemetry_does_not_hide_the_stop_after_it() -> None:
    assert hovering((6.0, 7.0), (12.0, 13.0)) == [pytest.approx(12.0, abs=0.11)]


@pytest.mark.parametrize(
    ("factor", "hotter", "verdict"), [(1.3, 15.0, "ok"), (1.6, 0.0, "warning"), (1.0, 25.0, "warning")]
)
def test_a_controller_unlike_the_others_is_a_note(factor: float, hotter: float, verdict: str) -> None:
    log, spans, _ = flight(Fall(lost=0.0, wanted_deg=20.0, seconds=20.0))
    log.power.escs[2].current[:] *= factor
    log.power.escs[3].temperature[:] += hotter
    loads = motor_loads(log.power.escs, [(1.0, 19.0)])
    assert loads == pytest.approx([1.0, 1.0, factor, 1.0], rel=1e-6)
    (found,) = esc_checks(HealthCase(log, spans))
    assert found.verdict == verdict
    assert log.power.escs[0].temperature[0] == pytest.approx(26.85)


def test_a_controller_that_measures_no_current_is_valued_by_its_temperature() -> None:
    log, spans, _ = flight(Fall(lost=0.0, wanted_deg=20.0, seconds=20.0))
    for esc in log.power.escs:
        esc.current[:] = np.nan
    log.power.escs[3].temperature[:] += 15.0
    (found,) = esc_checks(HealthCase(log, spans))
    assert (found.verdict, found.value, found.unit) == ("ok", 15.0, "K")


def test_without_three_controllers_or_measurements_there_is_no_question() -> None:
    log, spans, _ = flight(Fall(lost=0.0))
    log.power.escs = log.power.escs[:2]
    assert esc_checks(HealthCase(log, spans)) == []


@pytest.mark.parametrize(("value", "count"), [(-0.19, 0), (np.nan, 0), (0.5, 1)])
def test_a_controller_without_known_motor_may_stand_because_an_output_is_off(value: float, count: int) -> None:
    log, spans, outputs = flight(Fall(lost=0.0, seconds=20.0))
    stopped(log.power.escs[0], 12.0, 13.0, current=True)
    outputs.x[(outputs.t > 11.9) & (outputs.t < 13.5), 2] = value + 0.01 * np.arange(15)
    found = [fault for fault in faults((log, spans, outputs)) if fault.kind == "motor_no_thrust"]
    assert [fault.motor for fault in found] == [None] * count
