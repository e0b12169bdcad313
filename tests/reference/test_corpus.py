"""Simulated-firmware flights: onboard against truth is what the makers of the flights measured."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import segments
from attlog.base.errors import AttlogError
from attlog.flight.model import FlightLog
from attlog.reference import Reference, ReferenceOptions, choose, heading_references, measured_deg, onboard_rows
from tests.conftest import corpus_logs, corpus_root

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
    for measured, column in ((onboard.errors.inclination, "rms_tilt"), (onboard.errors.heading, "rms_heading")):
        assert np.sqrt(np.mean(measured[scored] ** 2)) == pytest.approx(float(row[column]), abs=0.1)
    assert onboard.status == "ok"
    assert onboard.coverage_pct == pytest.approx(100.0, abs=1.0)
    assert reference.end == np.inf


@pytest.mark.slow
@pytest.mark.parametrize("row", [r for r in ROWS if Path(r["file"]).name not in MAG_FAULTS], ids=lambda r: r["file"])
def test_the_declination_seen_by_truth_is_the_simulators(row):
    log, found, reference = flown(row)
    true = float(row["declination_true"])
    assert measured_deg(log, reference) == pytest.approx(true, abs=0.5)
    assert reference.declination_deg == pytest.approx(true, abs=2.2)
    heading = heading_references(log, found, reference)["mag"].heading_deg - reference.declination_deg + true
    heading_reference = heading_references(log, found, reference)["mag"]
    truth = heading_references(log, found, reference)["truth"]
    at = np.interp(heading_reference.t, truth.t, np.unwrap(np.radians(truth.heading_deg)))
    off = np.degrees(np.angle(np.exp(1j * (np.radians(heading) - at))))
    assert abs(np.median(off[heading_reference.t > reference.scoring_start])) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=lambda r: r["file"])
def test_the_rates_confirm_the_input_delay_where_the_flight_turns(row):
    """ArduPilot's low-pass formula holds to 0.6 ms; tlog truth has estimated stamps, good to a few ms."""
    _, _, reference = flown(row)
    step = next(s for s in reference.steps if s.name == "input_delay")
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
        return float(np.median(kernel.errors.inclination[kernel.errors.scored]))

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
    assert reference.kind != "none" or reference.steps[0].text
    assert len(reference.t) == len(reference.q) == len(reference.gap_segment) == len(reference.segment)
    assert np.isfinite(reference.q).all()
    assert np.all(np.diff(reference.t) > 0)
    for row in onboard_rows(log, found, reference):
        assert row.errors is None or np.isfinite(row.errors.total).all()
    for heading_reference in heading_references(log, found, reference).values():
        assert np.isfinite(heading_reference.heading_deg).all()
