"""The best reference is taken, wrong ones are refused, and every step is told."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import attlog
from attlog import segments, story
from attlog.core import rotation
from attlog.core.errors import AttlogError, UsageError
from attlog.estimators.interface import Estimate
from attlog.flight.model import Attitude, FlightLog, Gnss, Mag, Stream, TimeLine
from attlog.reference import (
    Reference,
    ReferenceOptions,
    choose,
    heading_references,
    observed_declination_deg,
    onboard_rows,
    replayed,
)
from attlog.segments.model import Segment
from tests.conftest import corpus_logs, corpus_root
from tests.reference.flights import SECONDS, flight, sampled
from tests.segments.flights import imu_log


def chosen(log, **options) -> Reference:
    """The reference of a log."""
    return choose(log, segments.build(log), ReferenceOptions(**options))


def step(reference: Reference, name: str):
    """One step by name."""
    return next(s for s in reference.alignment.steps if s.name == name)


def test_truth_comes_before_the_onboard_attitude_and_that_before_nothing():
    assert chosen(flight(truth_hz=50.0)).kind == "truth"
    assert chosen(flight()).kind == "onboard"
    log = flight()
    log.attitudes, log.onboard = {}, None
    nothing = chosen(log)
    assert nothing.kind == "none"
    assert "neither truth nor an onboard attitude" in nothing.alignment.steps[0].text


def test_the_user_decides():
    log = flight(truth_hz=50.0)
    log.attitudes["AHR2"] = sampled(5.0, source="AHR2")
    assert chosen(log, reference="onboard").source == "ATT"
    named = chosen(log, reference="onboard:AHR2")
    assert (named.kind, named.source, named.name) == ("onboard", "AHR2", "AHR2")
    assert chosen(log, reference="none").kind == "none"


def test_a_true_heading_from_outside_changes_no_onboard_attitude_that_is_asked_for():
    log = flight()
    plain = chosen(log, reference="onboard")
    t = np.arange(0.0, SECONDS, 0.2)
    log.true_heading = Stream(t, np.full((len(t), 1), 2.0), "rad", "NED", "dual-antenna yaw")
    beside = chosen(log, reference="onboard")
    np.testing.assert_array_equal(beside.q, plain.q)
    assert (beside.kind, beside.heading.by) == ("onboard", plain.heading.by)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reference": "truth"}, "holds no truth"),
        ({"reference": "onboard:XKQ.7"}, "onboard:ATT"),
        ({"reference": "best"}, "use auto, truth"),
        ({"reference": "truth:ATT"}, "use auto, truth"),
        ({"clock": "wall"}, "use sample or publication"),
        ({"declination": "north"}, "use auto, model, param or degrees"),
        ({"input_delay": "late"}, "use auto, off or milliseconds"),
    ],
)
def test_what_the_log_does_not_hold_is_a_usage_error_that_helps(options, words):
    with pytest.raises(UsageError, match=words):
        chosen(flight(), **options)


def test_times_of_measurement_are_used_unless_the_user_wants_those_of_publication():
    log = flight()
    log.attitudes["ATT"].t_sample = log.attitudes["ATT"].t - 0.007
    reference = chosen(log)
    np.testing.assert_allclose(reference.t, log.attitudes["ATT"].t_sample)
    assert step(reference, "clock").value == pytest.approx(7.0)
    np.testing.assert_allclose(chosen(log, clock="publication").t, log.attitudes["ATT"].t)


def test_an_attitude_that_gravity_contradicts_is_refused_unless_asked_for():
    """A board on its back with the rotation not set: agreement with such an attitude means nothing."""
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_euler(np.radians(30.0), 0, 0))
    refused = chosen(log)
    assert refused.kind == "none"
    assert "disagrees with gravity at rest by 30 deg" in refused.faults.reference
    assert refused.faults.refused == {"onboard": refused.faults.reference}
    kept = chosen(log, reference="onboard")
    assert kept.kind == "onboard"
    assert kept.faults.reference == refused.faults.reference


def test_a_truth_that_gravity_contradicts_gives_way_to_the_onboard_attitude():
    log = flight(truth_hz=50.0)
    log.truth.q = rotation.multiply(log.truth.q, rotation.from_euler(np.radians(30.0), 0, 0))
    reference = chosen(log)
    assert reference.source == "ATT"
    assert "truth refused: SIM disagrees with gravity" in reference.alignment.steps[0].text
    assert list(reference.faults.refused) == ["truth"]
    assert list(heading_references(log, segments.build(log), reference)) == ["onboard"]


def test_a_truth_that_never_moves_while_the_gyro_turns_is_refused():
    log = flight(truth_hz=50.0)
    log.truth.q[:] = [1.0, 0.0, 0.0, 0.0]
    assert "never changes while the gyro turns" in chosen(log).faults.refused["truth"]
    assert chosen(log, reference="truth").kind == "truth"


def test_the_first_seconds_after_a_restart_are_not_scored():
    log = flight()
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        keep = (stream.t < 20.0) | (stream.t > 21.0)
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    reference = chosen(log)
    assert reference.scoring.unscored == [(pytest.approx(21.0, abs=0.02), pytest.approx(36.0, abs=0.02))]
    assert "1 restarts" in step(reference, "scoring_start").text
    assert np.unique(reference.gap_segment).tolist() == [0, 1]


def test_comparisons_end_at_an_impact():
    log = flight()
    found = segments.build(log)
    found.segments.append(Segment("impact", 50.0, SECONDS, "8 g with a tumble"))
    reference = choose(log, found, ReferenceOptions())
    assert reference.scoring.end == 50.0
    assert step(reference, "scoring_end").value == 50.0


def test_pieces_end_at_resets_and_gaps_and_runs_at_gaps_only():
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.resets = np.array([600])
    keep = (attitude.t < 40) | (attitude.t > 43)
    attitude.t, attitude.q = attitude.t[keep], attitude.q[keep]
    reference = chosen(log)
    assert np.unique(reference.gap_segment).tolist() == [0, 1]
    assert np.unique(reference.segment).tolist() == [0, 1, 2]
    assert reference.t[np.argmax(reference.segment == 1)] == pytest.approx(30.0)
    assert step(reference, "resets").value == 1.0


def test_samples_that_are_no_attitude_do_not_enter_the_reference():
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.q[100] = np.nan
    attitude.q[101] = 0.0
    attitude.t[102] = attitude.t[99]
    reference = chosen(log)
    assert len(reference.t) == len(attitude.t) - 3
    assert np.isfinite(reference.q).all()
    np.testing.assert_allclose(np.linalg.norm(reference.q, axis=1), 1.0)


def test_the_reference_of_a_log_without_imu_is_still_compared():
    log = flight(truth_hz=50.0)
    log.imus, log.imu = [], None
    reference = chosen(log)
    assert reference.kind == "truth"
    assert reference.scoring.start == pytest.approx(15.0)


def test_an_instance_that_flew_is_the_reference_and_not_the_first():
    """The trap: instance 0 analysed though instance 1 flew."""
    log = flight()
    log.attitudes = {
        "estimator_attitude.0": sampled(20.0, source="0"),
        "estimator_attitude.1": sampled(20.0, source="1"),
    }
    log.onboard = "estimator_attitude.1"
    assert chosen(log).source == "1"


def test_an_attitude_that_covers_only_a_rest_is_not_called_frozen():
    log = flight()
    attitude = log.attitudes["ATT"]
    log.attitudes["ATT"] = Attitude(attitude.t[:5], np.tile(attitude.q[0], (5, 1)), "ATT")
    log.imus[0].gyro.x[log.imus[0].gyro.t <= attitude.t[4]] = 0.0
    assert chosen(log).kind == "onboard"


# Logs of any shape get segments, a reference and rows without an exception or a warning.

count = st.integers(0, 40)
steps = st.sampled_from([0.0, 0.0025, 0.02, 0.1, 0.4, 3.0, 900.0])
values = st.sampled_from([0.0, 1.0, -9.81, 40.0, np.nan, 1e-9])


@st.composite
def times(draw: st.DrawFn, least: int = 0) -> np.ndarray:
    """Ascending times with repeats, gaps and jumps."""
    n = max(draw(count), least)
    return draw(st.floats(-5, 5)) + np.cumsum([draw(steps) for _ in range(n)] or [0.0])[:n]


def filled(draw: st.DrawFn, n: int, k: int) -> np.ndarray:
    """Values of any kind."""
    return np.array([draw(values) for _ in range(n * k)]).reshape(n, k)


@st.composite
def attitudes(draw: st.DrawFn, source: str) -> Attitude:
    """An attitude that may be anything."""
    t = draw(times())
    resets = np.unique([draw(st.integers(0, 50)) for _ in range(draw(st.integers(0, 3)))]).astype(np.int64)
    return Attitude(t, filled(draw, len(t), 4), source, resets=resets, has_trim=draw(st.booleans()))


@st.composite
def flags(draw: st.DrawFn, source: str) -> TimeLine | None:
    """A flag, or none."""
    t = draw(times())[:4]
    return None if draw(st.booleans()) else TimeLine(t, [draw(st.booleans()) for _ in t], source)


@st.composite
def logs(draw: st.DrawFn) -> FlightLog:
    """A log in which every part may be missing, short, constant, or no number."""
    t = draw(times())
    log = imu_log(t, filled(draw, len(t), 3), filled(draw, len(t), 3))
    if draw(st.booleans()):
        log.attitudes, log.onboard = {"ATT": draw(attitudes("ATT")), "AHR2": draw(attitudes("AHR2"))}, "ATT"
    log.truth = draw(attitudes("SIM")) if draw(st.booleans()) else None
    log.state.armed, log.state.landed = draw(flags("vehicle_status")), draw(flags("EV"))
    tm = draw(times(1))
    log.mags, log.mag = [Mag(0, Stream(tm, filled(draw, len(tm), 3), "T", "FRD", "MAG"))], 0
    n = len(tm)
    one = np.ones(n)
    log.gnss = [
        Gnss(
            0, tm, "GPS", filled(draw, n, 1)[:, 0], one, one, filled(draw, n, 3), one, one, one, np.full(n, 3), yaw=one
        )
    ]
    log.power.throttle = Stream(tm, filled(draw, n, 1), "1", "", "CTUN")
    log.baro = [Stream(tm, filled(draw, n, 1), "m", "", "BARO")]
    if draw(st.booleans()):
        log.imus, log.imu = [], None
    return log


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(log=logs(), e=st.data())
def test_nothing_in_a_log_breaks_the_comparison(log, e):
    found = segments.build(log)
    assert all(s.t1 >= s.t0 and s.kind in segments.KINDS and s.why for s in found.segments)
    happened = story.events(log, found)
    assert all(e.text and e.evidence and np.isfinite(e.t) for e in happened)
    reference = choose(log, found)
    assert len(reference.t) == len(reference.q) == len(reference.segment) == len(reference.gap_segment)
    rows = onboard_rows(log, found, reference)
    t = e.draw(times(1))
    rows.append(replayed(log, found, reference, Estimate(t, filled(e.draw, len(t), 4)), name="made", uses_mag=False))
    for row in rows:
        assert row.coverage_pct is None or 0 <= row.coverage_pct <= 100
        assert row.errors is None or np.isfinite(row.errors.heading).all()
    for heading_reference in heading_references(log, found, reference).values():
        assert np.isfinite(heading_reference.heading_deg).all()


# Simulated-firmware flights: onboard against truth is what the makers of the flights measured.

ROOT = corpus_root()
MAG_FAULTS = ("px4_magfault.ulg", "copter_mag_fault.bin")


def scored_rows() -> list[dict[str, str]]:
    """Lines of the manifest for the attitude that flew."""
    if ROOT is None:
        return []
    with (ROOT / "sitl" / "MANIFEST.csv").open(encoding="utf-8") as table:
        return [r for r in csv.DictReader(table) if r["source"] == "onboard"]


ROWS = scored_rows()


def flown(row: dict[str, str], **options) -> tuple[FlightLog, segments.Segments, Reference]:
    """A flight of the manifest with its reference."""
    assert ROOT is not None
    log = attlog.read(ROOT / "sitl" / row["file"])
    found = segments.build(log)
    return log, found, choose(log, found, ReferenceOptions(**options))


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=lambda r: r["file"])
def test_onboard_errors_are_those_of_the_manifest(row):
    """Clock of the manifest (publication, packet stamps), from 15 s after the first IMU sample, to 0.1 deg."""
    log, found, reference = flown(row, clock="publication")
    onboard = next(r for r in onboard_rows(log, found, reference) if r.name == "onboard")
    assert onboard.errors is not None
    scored = onboard.errors.scored
    for measured, column in ((onboard.errors.tilt, "rms_tilt"), (onboard.errors.heading, "rms_heading")):
        assert np.sqrt(np.mean(measured[scored] ** 2)) == pytest.approx(float(row[column]), abs=0.1)
    assert onboard.status == "ok"
    assert onboard.coverage_pct == pytest.approx(100.0, abs=1.0)
    assert reference.scoring.end == np.inf


@pytest.mark.slow
@pytest.mark.parametrize("row", [r for r in ROWS if Path(r["file"]).name not in MAG_FAULTS], ids=lambda r: r["file"])
def test_the_declination_seen_by_truth_is_the_simulators(row):
    log, found, reference = flown(row)
    true = float(row["declination_true"])
    assert observed_declination_deg(log, reference) == pytest.approx(true, abs=0.5)
    assert reference.alignment.declination_deg == pytest.approx(true, abs=2.2)
    heading = heading_references(log, found, reference)["mag"].heading_deg - reference.alignment.declination_deg + true
    heading_reference = heading_references(log, found, reference)["mag"]
    truth = heading_references(log, found, reference)["truth"]
    at = np.interp(heading_reference.t, truth.t, np.unwrap(np.radians(truth.heading_deg)))
    off = np.degrees(np.angle(np.exp(1j * (np.radians(heading) - at))))
    assert abs(np.median(off[heading_reference.t > reference.scoring.start])) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=lambda r: r["file"])
def test_the_rates_confirm_the_input_delay_where_the_flight_turns(row):
    """ArduPilot's low-pass formula holds to 0.6 ms; tlog truth has estimated stamps, good to a few ms."""
    _, _, reference = flown(row)
    step = next(s for s in reference.alignment.steps if s.name == "input_delay")
    assert "disagrees" not in step.text
    assert isinstance(step.value, float)
    if "the rates show" in step.text:
        seen = float(step.text.split("the rates show ")[1].split()[0])
        assert seen == pytest.approx(step.value, abs=1.5 if row["file"].endswith(".tlog") else 0.6)


@pytest.mark.slow
def test_the_logged_trim_is_what_sets_the_imus_attitude_apart_from_the_vehicles():
    """In this flight ATT and XKQ differ by the trim of 0.96 deg, and by nothing once it is taken out."""
    row = next((r for r in ROWS if r["file"].endswith("copter_vibration.bin")), None)
    if row is None:
        pytest.skip("ATTLOG_CORPUS does not name a folder with logs")

    def difference(trim: bool) -> float:
        log, found, reference = flown(row, reference="onboard", trim=trim)
        kernel = next(r for r in onboard_rows(log, found, reference) if r.name.startswith("onboard:XKQ"))
        assert kernel.errors is not None
        return float(np.median(kernel.errors.tilt[kernel.errors.scored]))

    assert difference(trim=False) == pytest.approx(0.96, abs=0.03)
    assert difference(trim=True) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("path", corpus_logs(), ids=lambda p: p.name)
def test_every_log_gets_a_reference_or_a_reason(path):
    try:
        log = attlog.read(path)
    except AttlogError:
        return
    found = segments.build(log)
    reference = choose(log, found)
    assert reference.kind != "none" or reference.alignment.steps[0].text
    assert len(reference.t) == len(reference.q) == len(reference.gap_segment) == len(reference.segment)
    assert np.isfinite(reference.q).all()
    assert np.all(np.diff(reference.t) > 0)
    for row in onboard_rows(log, found, reference):
        assert row.errors is None or np.isfinite(row.errors.total).all()
    for heading_reference in heading_references(log, found, reference).values():
        assert np.isfinite(heading_reference.heading_deg).all()
