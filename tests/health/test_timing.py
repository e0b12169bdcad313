"""Which gaps of the inertial data are the logger's own pauses."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import segments
from attlog.core.timestamps import gap_indices
from attlog.flight.model import Firmware, FlightLog, Gnss, Problem, Stream, TimeLine
from attlog.health import timing
from attlog.health.check import Check, HealthCase
from attlog.health.timing import frozen_gyro_reason, timing_checks
from attlog.health.timing import is_pause as pauses
from attlog.segments import Segments
from attlog.segments.model import Segment
from tests.health.test_health import good
from tests.reference.flights import Array, flight
from tests.reference.test_gyro_checks import with_compass


@pytest.mark.parametrize(("armed_s", "is_pause"), [(0.0, True), (1.3, True), (1.6, False), (4.0, False)])
def test_a_gap_of_seconds_is_a_pause_unless_more_than_a_second_and_a_tenth_of_it_was_armed(
    armed_s: float, is_pause: bool
) -> None:
    line = TimeLine(np.array([0.0, 5.0, 10.0 + armed_s]), [False, True, False], "arming")
    log: Any = SimpleNamespace(state=SimpleNamespace(armed=line))
    assert pauses(10.0, 14.0, log, Segments()) is is_pause
    assert not pauses(10.0, 11.9, log, Segments()), "shorter gaps are lost records"


@pytest.mark.parametrize(("log_disarmed", "is_pause"), [(0.0, True), (1.0, False), (None, False)])
def test_without_arming_a_logger_that_stops_while_disarmed_paused(log_disarmed: float | None, is_pause: bool) -> None:
    """Motor tests arm without a record."""
    log: Any = SimpleNamespace(state=SimpleNamespace(armed=None), param=lambda _: log_disarmed)
    assert pauses(10.0, 12.0, log, Segments()) is is_pause


def test_a_logger_that_keeps_every_tenth_sample_is_not_called_uneven_too() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    assert "jitter" in [c.question for c in timing_checks(HealthCase(log, Segments()))]
    source = log.imus[0].gyro.source
    log.problems.append(Problem("imu_decimated", "note", "One sample per 100 ms.", source=source))
    assert "jitter" not in [c.question for c in timing_checks(HealthCase(log, Segments()))]


@pytest.mark.parametrize(("kind", "hz", "verdict"), [("telemetry", 4.0, "unknown"), ("telemetry", 50.0, "warning")])
def test_lost_packets_of_slow_telemetry_are_no_gaps_of_the_imu(kind: str, hz: float, verdict: str) -> None:
    t = np.delete(
        np.arange(0.0, 100.0, 1.0 / hz), [k for n in range(10, 90, 20) for k in range(int(n * hz), int((n + 2) * hz))]
    )
    log: Any = SimpleNamespace(
        state=SimpleNamespace(armed=None),
        param=lambda _: None,
        settings=SimpleNamespace(kind=kind),
        onboard_attitude=None,
    )
    check = timing.gap_check(t, gap_indices(t) - 1, log, Segments())
    assert check.verdict == verdict
    assert verdict == "unknown" or check.cause == timing.LINK_CAUSE


# A sensor that stops in motion is said; one that rests, or is coarse, or simulated without noise, is not.


def stop(x: Array, t: Array, begin: float, end: float) -> None:
    """The value of ``begin`` until ``end``."""
    inside = (t >= begin) & (t < end)
    x[inside] = x[np.argmax(inside)]


def found(log: FlightLog) -> dict[str, Check]:
    return {c.question: c for c in timing.frozen_checks(HealthCase(log, segments.build(log)))}


def moving() -> FlightLog:
    """Still for 20 s, then turning."""
    log = with_compass(flight())
    log.seconds = 60.0
    return log


def test_a_sound_log_has_nothing_frozen() -> None:
    assert {c.verdict for c in found(moving()).values()} == {"ok"}


@pytest.mark.parametrize("attitude", [True, False])
def test_a_gyro_that_stops_in_motion_is_said_and_nothing_is_judged(attitude: bool) -> None:
    log = moving()
    if not attitude:
        log.attitudes, log.onboard = {}, None
    stop(log.imus[0].gyro.x, log.imus[0].gyro.t, 40.0, 50.0)
    check = found(log)["frozen_gyro"]
    assert (check.verdict, check.t) == ("fault", pytest.approx(40.0))
    assert check.value == pytest.approx(100 * 10 / 60, abs=0.2)
    assert "is frozen for 17 %" in frozen_gyro_reason(log)


def test_a_gyro_that_is_coarse_and_at_rest_is_not_frozen() -> None:
    """Steps of 10 mrad/s hide the noise: 20 s of the same value, and a vehicle that stands."""
    log = moving()
    log.imus[0].gyro.x = np.round(log.imus[0].gyro.x, 2)
    assert timing.frozen_spans(log.imus[0].gyro, 1.0)
    assert found(log)["frozen_gyro"].verdict == "ok"


def test_an_accelerometer_and_a_compass_that_stop_are_told_together() -> None:
    log = moving()
    stop(log.imus[0].acc.x, log.imus[0].acc.t, 30.0, 33.0)
    assert log.mag is not None
    field = log.mags[log.mag].field
    stop(field.x, field.t, 30.0, 50.0)
    check = found(log)["frozen_sensors"]
    assert (check.verdict, check.count) == ("fault", 2)
    assert check.value == pytest.approx(20.0, abs=0.1)
    assert "accelerometer" in check.text
    assert "compass" in check.text
    assert frozen_gyro_reason(log) == ""


@pytest.mark.parametrize(("climbs", "verdict"), [((0.0, 20.0), "ok"), ((30.0, 60.0), "warning")])
def test_a_barometer_stands_still_where_the_vehicle_rises_in_flight_and_not_where_gnss_finds_its_height(
    climbs: tuple[float, float], verdict: str
) -> None:
    log = moving()
    t = np.arange(0.0, 60.0, 0.1)
    log.baro = [Stream(t, np.full((len(t), 1), 3.0), "m", "", "BARO:0")]
    height, one = np.interp(t, climbs, [0.0, 40.0]), np.ones(len(t))
    log.gnss = [Gnss(0, t, "GPS", one, one, height, np.zeros((len(t), 3)), one, one, one, np.full(len(t), 3))]
    phases = segments.build(log)
    phases.segments = [s for s in phases.segments if s.kind != "airborne"]
    phases.segments.append(segments.Segment("airborne", 25.0, 60.0))
    (check,) = (c for c in timing.frozen_checks(HealthCase(log, phases)) if c.question == "frozen_sensors")
    assert check.verdict == verdict


# Processor: main loops, load and memory in flight alone.

FLIGHTS = Segments([Segment("airborne", 20.0, 80.0)])


def judged(log: FlightLog) -> Check:
    (check,) = timing.processor_checks(HealthCase(log, FLIGHTS))
    return check


def loaded(**streams: Array) -> FlightLog:
    """A log with records of the processor at one per second."""
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("PX4"), "quadrotor")
    for name, x in streams.items():
        setattr(log.processor, name, Stream(np.arange(len(x), dtype=float), x.reshape(len(x), -1), "1", "", name))
    return log


@pytest.mark.parametrize(("share", "verdict"), [(0.14, "ok"), (0.16, "warning")])
def test_long_main_loops_count_in_flight_alone(share: float, verdict: str) -> None:
    loops = np.column_stack([np.full(100, 400.0 * share), np.full(100, 400.0), np.full(100, 0.004)])
    loops[:20], loops[81:] = (400.0, 400.0, 6.0), (400.0, 400.0, 6.0)
    check = judged(loaded(loops=loops))
    assert (check.verdict, check.value) == (verdict, pytest.approx(100.0 * share))
    assert "4.0 ms" in check.text
    assert bool(check.action) is (verdict == "warning")


@pytest.mark.parametrize(
    ("seconds", "level", "limit", "verdict"),
    [(3, 0.96, None, "warning"), (2, 0.96, None, "ok"), (60, 0.94, None, "ok"), (3, 0.85, 80.0, "warning")],
)
def test_an_overload_lasts_for_two_seconds_above_the_firmwares_limit(
    seconds: int, level: float, limit: float | None, verdict: str
) -> None:
    load = np.full(100, 0.4)
    load[40 : 40 + seconds] = level
    log = loaded(load=load)
    if limit is not None:
        log.parameters.lines["COM_CPU_MAX"] = TimeLine(np.zeros(1), [limit], "parameters")
    assert judged(log).verdict == verdict


def test_full_memory_is_noted_and_records_on_the_ground_answer_nothing() -> None:
    assert judged(loaded(memory=np.full(100, 0.96))).verdict == "ok"
    assert judged(loaded(memory=np.full(100, 0.995))).verdict == "warning"
    assert judged(loaded(load=np.full(15, 0.99))).verdict == "unknown"
    assert timing.processor_checks(HealthCase(loaded(), FLIGHTS)) == []


def test_main_loops_are_counted_per_record_and_shares_are_below_one() -> None:
    log = good("copter_yaw_turns.bin")
    loops = log.processor.loops
    assert loops is not None
    np.testing.assert_allclose(loops.x[1:, 1] / np.diff(loops.t), log.param("SCHED_LOOP_RATE"), rtol=0.01)
    assert ((loops.x[:, 2] > 0.01) & (loops.x[:, 2] < 0.02)).all()
    assert log.processor.load is None, "the simulator logs 0"
    load = good("px4_steps.ulg").processor.load
    assert load is not None
    assert 0.05 < np.median(load.x) < 0.5
