"""A truth that the user brought: taken before all others, wrong by its own sigma, with or without a north."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.flight.model import Stream
from attlog.flight.truth import TruthFit
from attlog.reference import (
    Reference,
    ReferenceOptions,
    choose,
    heading_references,
    meaning,
    onboard_rows,
    own_sigma_deg,
    sigma_deg,
)
from attlog.reference.physics import accusing
from attlog.reference.smoothed import with_true_heading

from .flights import compared, estimate, flight, sampled

FIT = TruthFit(
    "mocap.tum", 12.5, 4e-4, 0.0, 1.5, (180.0, 0.0, 0.0), (180.0, 0.0, 90.0), 0.99, 0.4, 5000, 50.0, 0.3, 0.4, "file"
)


def log_with(north: str = "file", turned_deg: float = 0.0, tilt_deg: float = 0.0, name: str = "mocap.tum"):
    """A log with a brought truth whose earth is turned by a heading and whose body is tilted about its x axis."""
    log = flight()
    truth = sampled(50.0, source=name)
    q = rotation.multiply(truth.q, rotation.from_rotvec(np.radians([tilt_deg, 0.0, 0.0])))
    q = rotation.turn_about_down(q, np.radians(turned_deg))
    log.truth = replace(truth, q=q, fit=replace(FIT, north=north, name=name))
    return log


def reference_of(log, **options) -> Reference:
    """The reference of a log."""
    return choose(log, segments.build(log), ReferenceOptions(**{"declination": 0.0} | options))


def test_it_is_taken_whatever_speaks_against_it_and_that_is_told():
    tilted = log_with(tilt_deg=25.0)
    reference = reference_of(tilted)
    assert (reference.kind, reference.source) == ("truth", "mocap.tum")
    assert "gravity" in reference.doubt
    tilted.truth = replace(tilted.truth, fit=None)  # the log's own truth is refused for the same
    assert reference_of(tilted).kind == "onboard"


def test_every_step_of_its_alignment_is_told_with_its_number():
    steps = {s.name: s for s in reference_of(log_with()).steps}
    assert (steps["truth_clock"].value, steps["truth_clock"].unit) == (12.5, "s")
    assert "0.4 ms" in steps["truth_clock"].text
    assert not steps["truth_drift"].applied
    assert steps["truth_body"].value == pytest.approx(180.0)
    assert steps["truth_world"].value == pytest.approx(180.0)  # half a turn about the line between north and east
    assert steps["truth_residual"].value == 0.4
    assert steps["own_sigma"].value == 0.3


def test_its_own_sigma_is_part_of_what_is_said():
    reference = reference_of(log_with())
    assert own_sigma_deg(reference, "inclination") == pytest.approx(0.3)
    assert own_sigma_deg(reference, "heading") == pytest.approx(0.4)
    assert sigma_deg(reference, "total") == pytest.approx(0.5)
    assert "0.3 deg in tilt, 0.4 deg in heading" in meaning(reference)


def test_without_a_north_rows_are_turned_to_it_and_their_changes_compared():
    row, reference, _ = compared(log_with("nobody", turned_deg=70.0), estimate(heading_deg=5.0))
    assert reference.heading_by == "relative"
    assert row.heading_offset_deg == pytest.approx(-65.0, abs=0.1)
    assert np.abs(row.errors.heading).max() < 0.1
    assert own_sigma_deg(reference, "heading") == pytest.approx(0.4)
    assert "only changes of heading" in meaning(reference)


def test_with_its_own_north_a_wrong_heading_stays_wrong():
    row, reference, _ = compared(log_with("file"), estimate(heading_deg=5.0))
    assert reference.heading_by == "own"
    assert row.heading_offset_deg is None
    assert np.median(row.errors.heading) == pytest.approx(5.0, abs=0.1)


def test_without_a_north_it_is_no_heading_for_the_compass_and_accuses_no_heading():
    log = log_with("nobody", turned_deg=70.0)
    found = segments.build(log)
    reference = choose(log, found, ReferenceOptions(declination=0.0))
    assert "truth" not in heading_references(log, found, reference_of(flight()))
    assert log.truth_with_north is None
    assert not any(step.name == "declination_seen" for step in reference.steps)
    judged = accusing.compared(log, found, reference)
    assert judged is not None
    assert set(judged.sizes) == {"tilt"}


def test_a_small_difference_is_no_error_of_the_onboard_attitude_where_the_truth_is_unsure():
    sure, unsure = log_with(tilt_deg=4.0), log_with(tilt_deg=4.0)
    unsure.truth = replace(unsure.truth, fit=replace(unsure.truth.fit, sigma_tilt_deg=2.0))
    found = segments.build(sure)
    assert accusing.compared(sure, found, reference_of(sure)).sigmas["tilt"].max() == pytest.approx(0.3)
    assert accusing.compared(unsure, found, reference_of(unsure)).errors == []


def test_a_message_of_the_log_that_is_the_truth_is_no_row():
    log = log_with(name="vehicle_mocap_odometry")
    log.attitudes["vehicle_mocap_odometry"] = sampled(50.0, source="vehicle_mocap_odometry")
    found = segments.build(log)
    names = [row.name for row in onboard_rows(log, found, choose(log, found))]
    assert names == ["onboard"]


def test_a_heading_alone_goes_with_the_tilt_of_the_smoother():
    """The smoother's own heading is 20 deg off and wanders; a receiver with two antennas knows it to 0.5 deg."""
    log = flight()
    t = np.arange(0.0, 60.0, 0.01)
    own = rotation.turn_about_down(estimate(t).q, np.radians(20.0 + 3.0 * np.sin(0.2 * t)))
    smoother = smoother_of(log, t, own)
    at = np.arange(1.0, 59.0, 0.2)
    true = rotation.to_euler(estimate(at).q)[:, 2] + np.radians(np.random.default_rng(1).normal(0.0, 0.5, len(at)))
    found = with_true_heading(smoother, Stream(at, rotation.wrap(true)[:, None], "rad", "NED", "dual-antenna yaw"))
    inside = (found.t > 2.0) & (found.t < 58.0)
    apart = rotation.error(found.q, estimate(found.t).q)[inside]
    assert np.degrees(np.abs(rotation.heading_angle(apart))).max() < 1.0
    assert np.degrees(rotation.inclination_angle(apart)).max() < 1e-3
    assert own_sigma_deg(found, "heading") == pytest.approx(0.5, abs=0.1)
    assert "dual-antenna yaw" in next(s.text for s in found.steps if s.name == "heading_by")
    assert "that you brought" in meaning(found)


def smoother_of(log, t, q) -> Reference:
    """A smoother's attitude that is sure of its tilt and knows nothing of north."""
    found = reference_of(log)
    zero = np.zeros(len(t), np.int64)
    sigma = np.full(len(t), 0.1)
    return replace(
        found,
        kind="smoother",
        t=t,
        q=q,
        gap_segment=zero,
        segment=zero,
        sigma_tilt_deg=sigma,
        sigma_heading_deg=90 * sigma,
    )
