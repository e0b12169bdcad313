"""The audit names the fault that was put into a good log, and stays quiet on good ones."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from attlog import flight, health, reference, segments
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.flight.model import Attitude, FlightLog, Mag
from attlog.health import answerable, run_checks, timing
from attlog.health.check import Check, HealthCase
from attlog.metrics import drift as drift_rest
from attlog.metrics.metric import Case
from attlog.pipeline import prepare
from attlog.segments.model import Segment, Segments
from tests.conftest import SAMPLES, corpus_logs, corpus_root
from tests.metrics import flights
from tests.segments.test_rest import still_log


@cache
def good(name: str) -> FlightLog:
    return flight.read(SAMPLES / name)


def checks(log: FlightLog) -> dict[str, Check]:
    phases = segments.build(log)
    return {c.question: c for c in reversed(run_checks(HealthCase(log, phases))) if c.in_use}


def with_fault(change: Callable[[FlightLog], None], name: str = "px4_steps.ulg") -> dict[str, Check]:
    log = deepcopy(good(name))
    change(log)
    return checks(log)


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"])
def test_a_good_log_passes_every_check(name: str) -> None:
    found = checks(good(name))
    assert {c.verdict for c in found.values()} <= {"ok", "warning", "unknown"}
    assert found["gyro_against_attitude"].verdict == "ok"
    assert found["accelerometer_rest"].verdict == "ok"
    assert found["gravity_direction"].value < 0.5
    assert found["field_against_attitude"].value < 5


def turned_gyro(order: list[int], sign: list[int]) -> Callable[[FlightLog], None]:
    def change(log: FlightLog) -> None:
        log.imus[0].gyro.x = log.imus[0].gyro.x[:, order] * sign

    return change


def stuck_axis(log: FlightLog) -> None:
    log.imus[0].acc.x = log.imus[0].acc.x.copy()
    log.imus[0].acc.x[:, 1] = 0.3


def frozen_second_compass(log: FlightLog) -> None:
    frozen = deepcopy(log.mags[0].field)
    frozen.x[:] = frozen.x[0]
    log.mags.append(Mag(1, frozen))


def tenfold_field(log: FlightLog) -> None:
    log.mags[log.mag].field.x = log.mags[log.mag].field.x * 10


@pytest.mark.parametrize(
    ("change", "question", "words"),
    [
        (
            turned_gyro([1, 0, 2], [1, 1, 1]),
            "gyro_against_attitude",
            ("x is the attitude's y", "y is the attitude's x"),
        ),
        (turned_gyro([0, 1, 2], [1, -1, 1]), "gyro_against_attitude", ("reversed sign about y",)),
        (turned_gyro([0, 1, 2], [0, 0, 0]), "gyro_dead", ("all values of the gyro are zero",)),
        (stuck_axis, "accelerometer_dead", ("accelerometer axis y is constant",)),
        (frozen_second_compass, "compass_dead", ("never change",)),
        (tenfold_field, "field", ()),
    ],
)
def test_a_planted_fault_is_named(change: Callable[[FlightLog], None], question: str, words: tuple[str, ...]) -> None:
    check = with_fault(change)[question]
    assert check.verdict == "fault"
    assert all(word in check.text for word in words)


@pytest.mark.parametrize(("factor", "verdict"), [(0.5, "fault"), (1.1, "warning"), (1.0, "ok"), (np.pi / 180, "fault")])
def test_a_wrong_gyro_scale_is_seen(factor: float, verdict: str) -> None:
    def scale(log: FlightLog) -> None:
        log.imus[0].gyro.x = log.imus[0].gyro.x * factor

    check = with_fault(scale)["gyro_against_attitude"]
    # a gyro in degrees looks like a vehicle that hardly turns, which cannot pass as good
    assert check.verdict == verdict or (factor < 0.1 and check.verdict == "unknown")


@pytest.mark.parametrize(("factor", "verdict"), [(0.35, "fault"), (1.05, "warning"), (1.0, "ok"), (1 / 9.81, "fault")])
def test_a_wrong_accelerometer_scale_is_seen_and_said(factor: float, verdict: str) -> None:
    def scale(log: FlightLog) -> None:
        log.imus[0].acc.x = log.imus[0].acc.x * factor

    found = with_fault(scale)
    check = found.get("accelerometer_rest") or found["gravity_in_flight"]
    assert check.verdict == verdict
    if factor == 0.35:
        assert "Scale 0.3" in check.why_no_setting


def test_a_turned_compass_is_named_instead_of_the_declination() -> None:
    def turn(log: FlightLog) -> None:
        field = log.mags[log.mag].field
        field.x = field.x[:, [1, 0, 2]] * [-1, 1, 1]

    found = with_fault(turn)
    assert found["compass_orientation"].verdict == "fault"
    assert found["compass_orientation"].value == pytest.approx(90.0, abs=5.0)
    assert "declination" not in found


def test_lost_samples_show_as_gaps_but_not_where_the_logger_pauses_on_the_ground() -> None:
    begin, end = segments.build(good("px4_steps.ulg")).spans("armed")[0]

    def lost(first: float) -> Check:
        def lose(log: FlightLog) -> None:
            imu = log.imus[0]
            keep = ~((imu.gyro.t > first) & (imu.gyro.t < first + 3.0))
            for stream in (imu.gyro, imu.acc):
                stream.t, stream.x = stream.t[keep], stream.x[keep]

        return with_fault(lose)["gaps"]

    armed = lost(0.5 * (begin + end))
    assert armed.verdict == "warning"
    assert "3.0" in armed.text
    assert armed.t == pytest.approx(0.5 * (begin + end), abs=0.1)
    paused = lost(begin - 4.0)
    assert paused.verdict == "ok"
    assert "The logger paused once on the ground" in paused.text


def test_a_long_gap_is_a_pause_where_no_flight_goes_into_it_though_disarming_was_not_logged() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    flights = segments.build(log)
    landed = flights.spans("airborne")[-1][1]
    assert log.state.armed is not None
    log.state.armed.t, log.state.armed.value = log.state.armed.t[:1], [True]
    assert timing.is_pause(landed + 2.0, landed + 8.0, log, flights)
    assert not timing.is_pause(landed - 20.0, landed - 14.0, log, flights)
    assert not timing.is_pause(landed + 2.0, landed + 8.0, log, Segments([], unknown=("airborne",)))


def prepared(log: FlightLog, phases: Segments | None = None) -> Case:
    """The log as the metrics see it; ``phases`` instead of its own, whose reference stays."""
    own = segments.build(log)
    chosen = reference.choose(log, own)
    return Case(log, phases or own, chosen, heading_references=reference.heading_references(log, own, chosen))


def test_a_log_without_imu_names_the_setting_for_every_question(corpus: Path) -> None:
    log = flight.read(corpus / "logs" / "bin_plane_4.2.3_noimu_cut.bin")
    found = answerable(log, None)
    assert not any(a.can for a in found)
    assert all("LOG_BITMASK" in a.reason + a.setting for a in found)


def test_no_rest_names_what_logs_it() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    imu = log.imus[0]
    flown = (imu.gyro.t > 25) & (imu.gyro.t < 70)
    for stream in (imu.gyro, imu.acc):
        stream.t, stream.x = stream.t[flown], stream.x[flown]
    case = prepared(log)
    quiet = {a.question: a for a in answerable(log, case)}["noise"]
    assert not quiet.can
    assert quiet.setting.startswith("The log begins before arming already: let the vehicle stand still")
    log.state.armed = None
    quiet = {a.question: a for a in answerable(log, case)}["noise"]
    assert quiet.setting.startswith("SDLOG_MODE is 2 already"), "a setting that is made is not advised"


def test_a_rest_counts_only_when_filters_have_settled() -> None:
    """26 s of rest at the start are 6 s of usable rest: too short for a drift, as the metric says."""
    log = deepcopy(good("px4_steps.ulg"))
    phases = segments.build(log)
    first = phases.of("rest")[0]
    gyro = log.imus[0].gyro
    still = int(np.searchsorted(gyro.t, 10.0))
    for begin in range(still, int(np.searchsorted(gyro.t, 35.0)), still):  # it goes on resting where it took off
        gyro.x[begin : begin + still] = gyro.x[:still]
    for seconds, can in ((26.0, False), (30.0, True)):
        one = Segments([*phases.of("continuous"), Segment("rest.long", first.t0, first.t0 + seconds)])
        found = {a.question: a for a in answerable(log, prepared(log, one))}
        assert found["yaw_drift"].can == can
        assert found["noise"].can


# --- false alarms on simulated flights --------------------------------------------------------------------------

SIMULATED = [p for p in corpus_logs() if corpus_root() is not None and "sitl" in str(p.parent)]
INJECTED = {"px4_magfault.ulg": {"field_against_attitude"}, "copter_mag_fault.bin": {"field_against_attitude"}}
"""Compass faults that the simulator put in, seen by the audit or nearly so."""


@pytest.mark.parametrize("path", SIMULATED, ids=lambda p: p.name)
def test_only_injected_faults_are_bad_in_simulated_flights(path: Path) -> None:
    found = checks(flight.read(path))
    bad = {c.question for c in found.values() if c.verdict == "fault"}
    assert bad <= INJECTED.get(path.name, set())


@pytest.mark.slow
@pytest.mark.parametrize("path", corpus_logs(), ids=lambda p: p.name)
def test_every_log_is_audited_without_a_traceback(path: Path) -> None:
    try:
        log = flight.read(path)
    except AttlogError:
        return
    phases = segments.build(log)
    found = run_checks(HealthCase(log, phases))
    assert found
    assert all(c.value is None or isinstance(c.value, int | float) for c in found)


# What ``info`` says can be answered is what an analysis answers: one rule for both.


@pytest.mark.parametrize(("seconds", "answered"), [(22.9, False), (27.0, False), (29.0, True), (60.0, True)])
def test_a_rest_is_long_enough_for_drift_in_info_exactly_where_it_is_in_an_analysis(seconds, answered):
    """20 s to settle and 8 s to measure."""
    t = np.arange(0.0, seconds, 0.02)
    log = still_log(t)
    log.attitudes, log.onboard = {}, None
    said = {a.question: a for a in health.answerable(log, prepare(log))}["yaw_drift"]
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(0.01) * t))
    phases = [Segment("continuous", 0.0, seconds), Segment("rest.long", 0.0, seconds)]
    found = drift_rest.REST_DRIFT.ask(flights.case([row], phases), row, "rest")["drift_rest_deg_per_min"]
    assert said.can is answered
    assert (found.value is not None) is answered


@pytest.mark.parametrize(
    ("attitude", "reference", "told"), [(False, "none", "log the attitude"), (True, "none", ""), (True, "onboard", "")]
)
def test_what_would_log_an_attitude_is_told_where_nothing_is_there_to_compare_with(
    monkeypatch, attitude, reference, told
):
    """With an attitude in the log the setting would help nobody."""
    monkeypatch.setattr(FlightLog, "advice", lambda log, what, rate=None: f"log the {what}")
    t = np.arange(0.0, 40.0, 0.02)
    log = still_log(t)
    level = Attitude(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), "ATT")
    log.attitudes, log.onboard = ({"ATT": level}, "ATT") if attitude else ({}, None)
    case = prepare(log, {"reference": reference})
    assert case.reference.kind == reference
    assert health.missing_setting("accuracy", (), case) == told
