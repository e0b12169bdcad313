"""The smoother is the reference where it is sure of itself, and it judges the onboard attitude too.

The estimates are the true attitude of made flights with known errors, and sigmas as they please.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators.interface import Estimate
from attlog.flight.model import FlightLog
from attlog.health.findings import contradiction, findings
from attlog.pipeline import replay
from attlog.reference import (
    Reference,
    ReferenceOptions,
    caveat,
    choose,
    expected_reference,
    heading_references,
    onboard_rows,
    scoring,
    sigma_deg,
    smoother,
)
from attlog.segments.model import Segment, Segments
from tests.reference.flights import RATE, SECONDS, ardupilot, attitude_at, contradicted, estimate, flight, sampled


def made(tilt: float = 0.1, heading: float = 0.2, off: Estimate | None = None, **quality: float | str) -> Estimate:
    """What a smoother would return: the true attitude (or ``off``) with sigmas in deg and what it says of itself."""
    found = off or estimate()
    found.aux = {n: np.full(len(found.t), np.radians(s)) for n, s in (("sigma_tilt", tilt), ("sigma_heading", heading))}
    found.quality = {"aided_by": "gnss baro mag", **quality}
    return found


def chosen(log: FlightLog, found: Estimate | Callable[[], Estimate], option: str = "auto") -> Reference:
    smooth = found if callable(found) else lambda: found
    return choose(log, segments.build(log), ReferenceOptions(reference=option), smooth=smooth)


def never() -> Estimate:
    raise AssertionError("the smoother is not wanted here")


def test_the_smoother_comes_after_truth_and_before_the_onboard_attitude() -> None:
    reference = chosen(flight(), made())
    assert reference.kind == "smoother"
    assert "aided by GNSS, barometer and magnetometer" in reference.alignment.steps[0].text
    assert next(s for s in reference.alignment.steps if s.name == "own_sigma").value == pytest.approx(0.1)
    onboard = onboard_rows(flight(), segments.build(flight()), reference)[0]
    assert not onboard.is_reference
    assert onboard.errors is not None
    assert onboard.errors.total.max() < 0.01


@pytest.mark.parametrize("option", ["truth", "onboard", "none", "auto"])
def test_it_is_run_only_where_it_is_wanted(option: str) -> None:
    assert chosen(flight(truth_hz=50.0), never, option).kind == ("truth" if option == "auto" else option)


@pytest.mark.parametrize(
    ("found", "why"),
    [
        (made(tilt=1.4), "own tilt sigma 1.4 deg"),
        (made(openings=6.0), "gave way 6 times"),
        (made(soft_gated_pct=41.0), "41 % of the GNSS velocities"),
        (made(worst_ratio=3.2), "3.2 times what it expects"),
        (estimate(), "does not say how wrong it may be"),
        (made(off=estimate(tilt_deg=np.where(np.arange(0, SECONDS, 1 / RATE) > 50, np.nan, 0))), "lost its way"),
    ],
)
def test_one_that_is_not_sure_of_itself_gives_way_to_the_onboard_attitude_and_says_why(found: Estimate, why: str):
    log = flight()
    reference = chosen(log, found)
    assert reference.kind == "onboard"
    assert why in reference.faults.refused["smoother"]
    assert f"smoother refused: {reference.faults.refused['smoother']}" in reference.alignment.steps[0].text
    assert reference.faults.reference == ""
    assert "onboard" in heading_references(log, segments.build(log), reference)


def test_one_that_cannot_run_says_so_and_is_an_error_only_where_it_was_asked_for() -> None:
    def broken() -> Estimate:
        raise UsageError("no accelerometer")

    assert chosen(flight(), broken).faults.refused == {"smoother": "no accelerometer"}
    with pytest.raises(UsageError, match=r"reference smoother: .*no accelerometer"):
        chosen(flight(), broken, "smoother")


def test_one_that_was_asked_for_is_taken_however_unsure_and_the_text_says_it() -> None:
    reference = chosen(flight(), made(tilt=1.4, heading=5.0, openings=9.0), "smoother")
    assert (reference.kind, reference.heading.by) == ("smoother", "own")
    told = next(s for s in reference.alignment.steps if s.name == "own_sigma").text
    assert "tilt 1.40 deg, heading 5.00 deg" in told
    assert "own checks fail: a sensor contradicted it" in told


def test_without_smoother_and_onboard_attitude_nothing_is_left_and_both_are_told() -> None:
    log = flight()
    log.attitudes, log.onboard = {}, None
    reference = chosen(log, made(tilt=4.0))
    assert reference.kind == "none"
    assert (
        "neither truth nor an onboard attitude; smoother refused: own tilt sigma 4.0"
        in reference.alignment.steps[0].text
    )
    assert chosen(log, made()).kind == "smoother"


def test_one_that_is_not_quite_sure_stands_in_for_an_onboard_attitude_that_is_wrong() -> None:
    """At rest and after: gravity refuses it, and a smoother with a sigma of 2 deg is better than nothing."""
    log = flight()
    lean = rotation.from_rotvec(np.radians([28.0, 0.0, 0.0]))
    log.attitudes["ATT"].q = rotation.multiply(lean, log.attitudes["ATT"].q)
    reference = chosen(log, made(tilt=2.2))
    assert (reference.kind, list(reference.faults.refused)) == ("smoother", ["onboard"])
    assert "onboard refused: ATT disagrees with gravity at rest by 28 deg" in reference.alignment.steps[0].text
    told = findings(log, [], contradiction(reference))
    assert [(f.kind, f.severity) for f in told] == [("attitude", "serious")]


def test_an_unsure_smoother_refuses_no_onboard_attitude_of_which_gravity_says_nothing() -> None:
    """They differ by 28 deg while it moves: the one that is not sure of itself stands back."""
    log = flight()
    attitude = log.attitudes["ATT"]
    lean = rotation.from_rotvec(np.radians([28.0, 0.0, 0.0]))
    wrong = attitude.t > 0.5 * SECONDS
    attitude.q = np.where(wrong[:, None], rotation.multiply(lean, attitude.q), attitude.q)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 21.0, SECONDS))  # or the jump would be its own alignment
    reference = choose(log, phases, smooth=lambda: made(tilt=2.2))
    assert reference.kind == "onboard"
    assert "own tilt sigma 2.2 deg" in reference.faults.refused["smoother"]


def standing(seconds: float = SECONDS) -> FlightLog:
    """A log of a vehicle that stands still all the time."""
    log = flight(seconds)
    imu = log.imus[0]
    imu.gyro.x = np.zeros_like(imu.gyro.x)
    imu.acc.x = np.tile([0.0, 0.0, -9.80665], (len(imu.acc.x), 1))
    level = log.attitudes["ATT"]
    level.q = np.tile([1.0, 0.0, 0.0, 0.0], (len(level.q), 1))
    return log


def leaning(deg: float, begin: float = 0.0, end: float = np.inf) -> Estimate:
    """A smoothed attitude that leans by so much between two times, and is level else."""
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    lean = np.where((t >= begin) & (t <= end), np.radians(deg), 0.0)
    return Estimate(t, rotation.from_rotvec(np.outer(lean, [1.0, 0.0, 0.0])))


def test_a_smoother_that_gravity_contradicts_where_the_vehicle_stands_still_gives_way_to_the_onboard_attitude() -> None:
    """Sure of itself (0.6 deg) and 8 deg off, before an accelerometer that says so."""
    reference = chosen(standing(), made(tilt=0.6, off=leaning(8.0)))
    assert reference.kind == "onboard"
    assert "it is 8.0 deg off gravity (sigma 0.6), ATT 0.0 deg" in reference.faults.refused["smoother"]
    assert chosen(standing(), made(tilt=0.6, off=leaning(8.0)), "smoother").kind == "smoother"


@pytest.mark.parametrize(("deg", "sigma", "kept"), [(1.5, 0.2, True), (2.4, 0.2, False), (8.0, 2.8, True)])
def test_twice_the_onboard_residual_and_two_degrees_refuse_a_smoother_and_little_does_not(
    deg: float, sigma: float, kept: bool
) -> None:
    log = standing()
    lean = rotation.from_rotvec(np.radians([5.0 if deg > 5.0 else 0.4, 0.0, 0.0]))
    log.attitudes["ATT"].q = rotation.multiply(lean, log.attitudes["ATT"].q)
    reference = chosen(log, made(tilt=sigma, off=leaning(deg)))
    assert ("off gravity" not in reference.faults.refused.get("smoother", "")) is kept


def test_where_gravity_contradicts_a_smoother_for_a_while_nothing_is_scored() -> None:
    reference = chosen(standing(), made(off=leaning(8.0, 40.0, 50.0)))
    assert reference.kind == "smoother"
    counted = reference.t[scoring.scored_mask(reference, reference.t)]
    assert not np.any((counted > 42.0) & (counted < 48.0))
    assert np.any((counted > 20.0) & (counted < 38.0))
    step = next(s for s in reference.alignment.steps if s.name == "gravity_at_standstill")
    assert step.value == pytest.approx(10.0, abs=3.0)  # windows that hold a part of it are off too


def test_a_smoother_that_stood_behind_takes_the_place_of_an_onboard_attitude_that_filters_refuse() -> None:
    log = flight()
    phases = segments.build(log)
    first = choose(log, phases, smooth=lambda: made(tilt=2.2))
    assert first.kind == "onboard"
    again = choose(log, phases, refused={"onboard": "three filters agree against it"}, second=first.second)
    assert (again.kind, again.heading.by) == ("smoother", "own")
    assert again.faults.refused == {"onboard": "three filters agree against it"}


def test_an_unsure_heading_is_that_of_the_onboard_attitude_and_tilt_stays_its_own() -> None:
    """The smoother's heading is 20 deg off and wanders; the onboard tilt is 2 deg off."""
    log = flight()
    t = np.arange(0.0, SECONDS, 1 / RATE)
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(rotation.from_rotvec(np.radians([2.0, 0.0, 0.0])), attitude.q)
    reference = chosen(log, made(heading=4.0, off=estimate(t, heading_deg=20.0 + 3.0 * np.sin(0.1 * t))))
    assert (reference.kind, reference.heading.by) == ("smoother", "onboard")
    assert "own heading sigma is 4.0 deg" in reference.heading.why
    truth = attitude_at(reference.t)
    e = rotation.earth_error(reference.q, truth)
    assert np.degrees(rotation.tilt_angle(e)).max() < 1e-4
    assert np.abs(np.degrees(rotation.heading_angle(e))).max() < 0.5
    onboard = onboard_rows(log, segments.build(log), reference)[0]
    assert onboard.heading_shared
    assert onboard.errors is not None
    assert np.median(onboard.errors.tilt) == pytest.approx(2.0, abs=0.01)


def test_a_shared_heading_is_cut_where_the_onboard_attitude_jumps() -> None:
    log = flight()
    attitude = log.attitudes["ATT"]
    k = np.searchsorted(attitude.t, 40.0)
    attitude.q[k:] = rotation.turn_about_down(attitude.q[k:], np.radians(30.0))
    reference = chosen(log, made(heading=4.0))
    at = np.flatnonzero(np.diff(reference.segment))
    assert len(at) == 1
    assert reference.t[at[0] + 1] == reference.t[np.searchsorted(reference.t, attitude.t[k])]  # not a sample late
    heading = np.degrees(rotation.heading_angle(rotation.earth_error(reference.q, attitude_at(reference.t))))
    assert np.median(heading[reference.t < 39]) == pytest.approx(0.0, abs=0.1)
    assert np.median(heading[reference.t > 41]) == pytest.approx(30.0, abs=0.1)


def test_an_onboard_attitude_that_is_tilted_itself_lends_no_heading() -> None:
    log = flight()
    attitude = log.attitudes["ATT"]
    lean = rotation.from_rotvec(np.radians(28.0) * np.array([1.0, 0.0, 0.0]))
    attitude.q = np.where((attitude.t > 25)[:, None], rotation.multiply(lean, attitude.q), attitude.q)
    reference = chosen(log, made(heading=4.0))
    assert (reference.kind, reference.heading.by) == ("smoother", "none")
    onboard = onboard_rows(log, segments.build(log), reference)[0]
    assert onboard.errors is not None
    assert np.median(onboard.errors.tilt[onboard.errors.t > 26]) == pytest.approx(28.0, abs=0.1)


def test_the_trim_of_the_vehicle_is_no_error_of_the_attitude_that_has_it_taken_out() -> None:
    """The smoother is the IMU's attitude, the onboard one the vehicle's, 3 deg apart: compared are vehicles."""
    log = ardupilot(flight(), AHRS_TRIM_X=np.radians(3.0), AHRS_TRIM_Y=0.0)
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_rotvec(np.radians([-3.0, 0.0, 0.0])))
    attitude.has_trim = True
    reference = chosen(log, made())
    assert reference.alignment.trim is not None
    onboard = onboard_rows(log, segments.build(log), reference)[0]
    assert onboard.errors is not None
    assert onboard.errors.total.max() < 0.01


class Runs(list[dict[str, Any]]):
    """What the smoother was run with, piece by piece; the runs (from 1) that shall fail their own checks."""

    failing: frozenset[int] = frozenset()


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Runs:
    """A smoother that returns the true attitude."""
    seen = Runs()

    def run(name: str, t: np.ndarray, gyr: np.ndarray, acc: np.ndarray, mag: object, **more: Any) -> Estimate:
        seen.append({"t": t, "gyr": gyr, "acc": acc, "aids": more["aids"]})
        return made(off=estimate(t), openings=99.0 if len(seen) in seen.failing else 0.0)

    monkeypatch.setattr(replay.estimators, "estimate", run)
    return seen


def test_the_smoother_is_told_the_lag_of_the_gyro_and_gets_all_of_a_flight_without_incident(runs) -> None:
    log = flight(gyro_late=0.005)
    log.imus[0].gyro.delay = 0.005
    whole = replay.smoother(log, segments.build(log), ReferenceOptions())
    np.testing.assert_array_equal(whole.t, log.imus[0].gyro.t)
    assert runs[0]["aids"].lag[0] == 0.005
    assert len(runs[0]["t"]) == len(runs[0]["gyr"]) == len(runs[0]["acc"]) == len(log.imus[0].gyro.t)


@pytest.mark.parametrize(
    ("happened", "spans"),
    [
        ([Segment("impact", 42.0, 43.0)], [(0.0, 41.7)]),
        ([Segment("loss_of_control", 30.0, 32.0)], [(0.0, 29.0), (32.0, 59.99)]),
        ([Segment("loss_of_control", 12.0, 32.0)], [(32.0, 59.99)]),  # 11 s are too short
        ([Segment("loss_of_control", 50.0, 51.0), Segment("impact", 51.0, 52.0)], [(0.0, 49.0)]),
    ],
)
def test_what_happens_in_a_tumble_or_after_an_impact_is_not_given_to_it(happened, spans, runs) -> None:
    log = flight()
    found = replay.smoother(log, Segments([*segments.build(log).segments, *happened]), ReferenceOptions())
    given = [(one["t"][0], one["t"][-1]) for one in runs]
    assert np.allclose(given, spans, atol=0.02)
    assert np.array_equal(np.flatnonzero(np.diff(found.segment)) + 1, np.cumsum([len(r["t"]) for r in runs])[:-1])


def test_a_gap_parts_the_log_and_a_piece_that_fails_its_own_checks_is_left_out(runs) -> None:
    """Three pieces of 59, 59 and 61 s: without the second two thirds are left, without two a third."""
    t = np.concatenate([np.arange(0, 59, 0.01), np.arange(60, 119, 0.01), np.arange(120, 181, 0.01)])
    log = flight(180.0)
    imu = log.imus[0]
    keep = np.isin(np.round(imu.gyro.t, 2), np.round(t, 2))
    for stream in (imu.gyro, imu.acc):
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    runs.failing = frozenset({2, 4, 5, 7, 8, 9})
    found = replay.smoother(log, Segments(), ReferenceOptions())
    lengths = [len(r["t"]) for r in runs]
    assert lengths == pytest.approx([5900, 5900, 6000], abs=1)
    assert not np.any((found.t > 59.5) & (found.t < 119.5))
    with pytest.raises(UsageError, match="gave way 99 times"):
        replay.smoother(log, Segments(), ReferenceOptions())
    assert len(replay.smoother(log, Segments(), ReferenceOptions(reference="smoother")).t) == sum(lengths)


def test_too_short_and_too_long_logs_are_not_smoothed(runs) -> None:
    log = flight()
    short = Segments([Segment("impact", 12.0, 13.0)])
    with pytest.raises(UsageError, match="needs 20 s without a gap"):
        replay.smoother(log, short, ReferenceOptions())
    assert "onboard attitude (ATT) (no smoother: it needs 20 s" in expected_reference(log, short, choose(log, short))
    imu = log.imus[0]
    for stream in (imu.gyro, imu.acc):
        stream.t = stream.t * 40.0
    with pytest.raises(UsageError, match="40 min would cost minutes; up to 30 min"):
        replay.smoother(log, Segments(), ReferenceOptions())
    assert not runs


def test_a_smoother_that_nothing_tells_north_is_sure_of_no_heading() -> None:
    reference = chosen(flight(), made(heading=0.2, aided_by="rest"))
    assert (reference.heading.by, sigma_deg(reference, "tilt")) == ("onboard", pytest.approx(0.1))


def test_sigma_is_that_of_what_is_scored() -> None:
    found = made(heading=0.3)
    found.aux["sigma_tilt"][found.t < 15.0] = 1.0
    reference = chosen(flight(), found)
    assert sigma_deg(reference, "tilt") == pytest.approx(0.1)
    assert sigma_deg(reference, "total") == pytest.approx(np.hypot(0.1, 0.3))
    assert sigma_deg(chosen(flight(), never, "onboard"), "tilt") == 0.0


def test_a_fast_smoother_is_thinned_and_keeps_its_sigmas_beside_its_attitudes() -> None:
    t = np.arange(0.0, 30.0, 1e-3)
    found = made(off=estimate(t))
    found.aux["sigma_tilt"] = np.radians(0.01 * t)
    thin, q, segment, tilt, _ = smoother.thin(found)
    assert 199.9 <= 1.0 / np.median(np.diff(thin)) <= 200.1
    assert len(thin) == len(q) == len(segment) == len(tilt)
    np.testing.assert_allclose(tilt, 0.01 * thin)


def test_filters_that_agree_against_a_smoother_refuse_it_for_the_onboard_attitude() -> None:
    from tests.reference.test_reference_checks import TURN, T, rows, tilted
    from tests.reference.test_reference_checks import flight as flown

    log = flown(TURN)
    phases = Segments([Segment("continuous", 0.0, 60.0)])
    wrong = made(off=Estimate(T, tilted(TURN, 25.0)))
    reference = choose(log, phases, smooth=lambda: wrong)
    assert reference.kind == "smoother"
    found = contradicted(log, log.imus[0], reference, rows(TURN, TURN, tilted(TURN, 2.0)))
    assert found is not None
    assert "the smoother is wrong by 25 deg" in found[0]
    assert choose(log, phases, refused={"smoother": found[0]}).kind == "onboard"


def test_what_an_analysis_would_compare_with_is_foreseen_without_running_it() -> None:
    log = flight()
    phases = segments.build(log)
    told = expected_reference(log, phases, choose(log, phases))
    assert told.startswith("the smoother, aided by gravity alone")
    assert "else the onboard attitude (ATT)" in told
    truth = flight(truth_hz=50.0)
    assert expected_reference(truth, phases, choose(truth, phases)) == "the logged truth."
    assert sampled(20.0).source in told


@pytest.mark.parametrize("scale", [0.0, 1.0 / 9.80665, 3.0])
def test_no_smoother_is_made_of_an_accelerometer_that_shows_no_gravity(scale: float) -> None:
    log = flight()
    assert smoother.reason_not_smoothed(log, segments.build(log)) == ""
    log.imus[0].acc.x = scale * log.imus[0].acc.x
    assert "no gravity" in smoother.reason_not_smoothed(log, segments.build(log))


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (made(heading_from="both"), ""),
        (made(heading_from="compass"), "the heading rests on the compass alone"),
        (made(heading_from="motion"), "the heading is from motion, without the compass"),
        (made(tilt=2.0), "the smoother was refused: own tilt sigma 2.0 deg"),
    ],
)
def test_a_ranking_says_in_a_clause_what_it_rests_on(found: Estimate, words: str) -> None:
    assert caveat(chosen(flight(), found)) == words


def test_a_smoother_that_was_asked_for_although_its_checks_fail_is_in_doubt() -> None:
    failed = made(worst_ratio=4.0)
    assert caveat(chosen(flight(), failed, "smoother")).startswith(
        "the smoother is in doubt: a sensor's errors are 4.0"
    )
    assert (
        caveat(chosen(flight(), made(tilt=2.0), "smoother"))
        == "the smoother is in doubt: its tilt sigma is above 1 deg"
    )


def segment_of(seconds: float, heading_from: str, heading: float = 0.2) -> Estimate:
    """A smoothed segment that long, at 10 Hz, and what its heading rests on."""
    t = np.arange(0.0, seconds, 0.1)
    off = Estimate(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
    return made(heading=heading, off=off, heading_from=heading_from, heading_why="neither is sure of it")


def test_a_short_segment_without_a_heading_does_not_cost_the_others_theirs() -> None:
    flown, ground = segment_of(60.0, "both"), segment_of(25.0, "none", 180.0)
    found = smoother.join_segments([ground, flown])
    assert len(found.t) == len(flown.t)
    assert np.degrees(found.aux["sigma_heading"]).max() == pytest.approx(0.2)


def test_one_segment_by_the_compass_alone_leaves_nobody_to_be_accused_of_heading() -> None:
    found = smoother.join_segments([segment_of(60.0, "both"), segment_of(25.0, "compass")])
    assert found.quality["heading_from"] == "compass"
