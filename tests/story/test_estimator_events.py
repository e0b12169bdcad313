"""Alignments, jumps of GNSS and ends of flights: limits from both sides on made texts and records."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import attlog
from attlog import segments, story
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, Gnss, InnovationTest, Problem, Stream
from attlog.health import HealthCase, innovations
from attlog.segments.model import Segment, Segments
from attlog.story import estimator_events, flight_events, headlines
from tests.segments.test_airborne import carried
from tests.story.made import log

SPANS = Segments([Segment("continuous", 0, 60), Segment("armed", 5, 30), Segment("armed", 40, 55)])


@pytest.mark.parametrize(
    ("size", "words", "value"),
    [
        (4.94, "The EKF and GNSS diverged", 4.9),
        (5.0, "GNSS jumped", 5.0),
        (5.1, "GNSS jumped", 5.1),
        (np.inf, "The EKF and GNSS diverged", None),
        (np.nan, "The EKF and GNSS diverged", None),
    ],
)
def test_gnss_jumped_where_its_position_left_its_velocity_by_five_metres(
    monkeypatch: pytest.MonkeyPatch, size: float, words: str, value: float | None
) -> None:
    monkeypatch.setattr(estimator_events, "gnss_disagreement_m", lambda receivers, t: size)
    found = estimator_events._gnss_jump_event(log(), 12.0, "warning", "", "ERR")
    assert (found.text, found.value, found.unit) == (f"{words} at 12.0 s.", value, "" if value is None else "m")
    assert len(found.evidence) == (1 if value is None else 2)
    assert estimator_events.is_estimator_jump(found) is (value is not None and value < 5.0)


@pytest.mark.parametrize(("count", "said"), [(1, ""), (2, ", 2 times in all")])
def test_reports_of_glitches_are_one_event_with_their_number(count: int, said: str) -> None:
    report = Problem("gnss_glitch", "warning", "GNSS glitch (ERR 11/2).", t=20.0, count=count)
    (found,) = estimator_events._gnss_jumps(log(problems=[report]), SPANS, [])
    assert found.text == f"The EKF and GNSS diverged at 20.0 s{said}."


def test_a_switch_that_a_text_told_within_a_second_and_a_half_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        estimator_events, "matching_texts", lambda log, p: [(10.0, 6, "lane (x)")] if p is estimator_events.LANE else []
    )
    problems = [Problem("lane_switch", "warning", f"At {t}.", t=t) for t in (11.4, 11.6, 33.0)]
    found = estimator_events._switch_events(log(problems=problems), SPANS, [])
    assert [(e.kind, e.t) for e in found] == [("lane_switch", 10.0), ("lane_switch", 11.6)]
    assert found[0].text == "The EKF switched lanes at 10.0 s (x)."


@pytest.mark.parametrize(
    ("deg", "said"), [(29.0, ", ended upright"), (31.0, ", ended at 31° of tilt"), (None, "")], ids=str
)
def test_a_slow_log_tells_how_the_vehicle_stood_two_to_five_seconds_after(deg: float | None, said: str) -> None:
    t = np.arange(0.0, 20.0, 0.1)
    tilt = np.where((t > 12.05) & (t < 14.95), deg or 0.0, 80.0)
    q = rotation.from_euler(np.radians(tilt), 0.0 * t, 0.0 * t)
    attitudes = {} if deg is None else {"ATT": Attitude(t, q, "ATT")}
    made = log(attitudes=attitudes, onboard=None if deg is None else "ATT")
    made.attitudes = {k: Attitude(t[(tilt < 80.0) | (t < 9.0)], q[(tilt < 80.0) | (t < 9.0)], "ATT") for k in attitudes}
    assert headlines.ending_of_slow(made, 10.0) == said


@pytest.mark.parametrize(
    ("rate", "said"), [(10.0, "IMU at 10 Hz: an impact shorter than 100 ms would not show"), (400.0, ""), (0.0, "")]
)
def test_a_slow_imu_tells_no_short_blow(monkeypatch: pytest.MonkeyPatch, rate: float, said: str) -> None:
    monkeypatch.setattr(flight_events, "shows_impacts", lambda log: rate > 50.0)
    made = log(imus=[SimpleNamespace(acc=SimpleNamespace(rate=r)) for r in ({0.5 * rate, rate} if rate else ())])
    assert flight_events.impact_limit_text(made) == said


def test_a_vehicle_without_arming_and_drive_that_never_flew_is_told_by_its_tilt() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    for deg, said in (
        (14.0, "never left the ground in 30 s."),
        (16.0, "never left the ground in 30 s, tilted up to 16° by hand."),
    ):
        q = rotation.from_euler(np.radians(np.where(t > 20.0, deg, 0.0)), 0.0 * t, 0.0 * t)
        made = log(attitudes={"ATT": Attitude(t, q, "ATT")}, onboard="ATT", seconds=30.0)
        made.vehicle = "quadrotor"
        assert headlines._grounded_phrases(made, Segments([Segment("continuous", 0, 30)]), []) == [said]


@pytest.mark.parametrize(("tilt", "said"), [(14.2, "; tilt under 15°"), (0.3, "; tilt under 1°"), (15.1, "")])
def test_a_tilt_below_fifteen_degrees_is_why_it_did_not_fly(tilt: float, said: str) -> None:
    t = np.arange(0.0, 30.0, 0.1)
    q = rotation.from_euler(np.radians(tilt) + 0.0 * t, 0.0 * t, 0.0 * t)
    made = log(attitudes={"ATT": Attitude(t, q, "ATT")}, onboard="ATT")
    assert headlines._still_reason(made, SPANS, [(5.0, 9.0)]) == said
    made.rangefinder = Stream(t, 0.0 * t[:, None], "m", "", "RFND")
    assert headlines._still_reason(made, SPANS, [(5.0, 9.0)]).startswith("; rangefinder unmoved")


# GNSS against its own velocity: a made receiver whose track is a closed form, with and without a planted jump.

M_PER_DEG = 2.0 * np.pi * 6_371_000.0 / 360.0


def circling(jump_m: float = 0.0, at: float = 18.0, lost: bool = False) -> Gnss:
    """A circle of 20 m radius once in 25 s at 5 Hz, 48 deg north; the position jumps east at ``at`` s."""
    t = np.arange(0.0, 40.0, 0.2)
    turned = 2.0 * np.pi * t / 25.0
    north, east = 20.0 * np.sin(turned), -20.0 * np.cos(turned)
    east = east + np.where(t >= at, jump_m, 0.0)
    speed = 20.0 * 2.0 * np.pi / 25.0
    velocity = np.column_stack([speed * np.cos(turned), speed * np.sin(turned), np.zeros(len(t))])
    none = np.full(len(t), np.nan)
    fix = np.where(lost & (np.abs(t - at) < 1.0), 1, 3).astype(np.int64)
    lat, lon = 48.0 + north / M_PER_DEG, 11.0 + east / (M_PER_DEG * np.cos(np.radians(48.0)))
    return Gnss(0, t, "GPS", lat, lon, none, velocity, none, none, none, fix)


@pytest.mark.parametrize("jump_m", [12.0, -60.0])
def test_a_jump_of_the_position_is_measured(jump_m: float) -> None:
    assert estimator_events.gnss_disagreement_m([circling(jump_m)], 18.5) == pytest.approx(abs(jump_m), abs=0.5)


def test_a_track_that_follows_its_velocity_is_steady() -> None:
    assert estimator_events.gnss_disagreement_m([circling()], 18.5) < 0.5 < estimator_events.MAX_STEADY_M


def test_a_jump_long_before_is_another_one() -> None:
    assert estimator_events.gnss_disagreement_m([circling(30.0, at=5.0)], 18.5) < 0.5


def test_a_lost_fix_is_no_steady_receiver_and_a_short_log_tells_nothing() -> None:
    assert estimator_events.gnss_disagreement_m([circling(lost=True)], 18.5) == np.inf
    assert np.isnan(estimator_events.gnss_disagreement_m([circling()], 2.0))
    assert np.isnan(estimator_events.gnss_disagreement_m([], 18.5))


def cut(first: float, hole: tuple[float, float] = (0.0, 0.0), jump_m: float = 0.0) -> Gnss:
    """The circle from ``first`` s on, without what was received within a hole; a jump at 18 s."""
    whole = circling(jump_m)
    kept = (whole.t >= first - 1e-9) & ~((whole.t > hole[0]) & (whole.t < hole[1]))
    for name in ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix"):
        setattr(whole, name, getattr(whole, name)[kept])
    return whole


@pytest.mark.parametrize(
    ("receiver", "known"),
    [(cut(13.4), True), (cut(13.6), False), (cut(0.0, (14.01, 15.99)), True), (cut(0.0, (14.01, 16.19)), False)],
    ids=["five seconds before", "less", "two seconds of hole", "more"],
)
def test_five_seconds_before_without_a_hole_of_more_than_two_are_needed(receiver: Gnss, known: bool) -> None:
    assert np.isfinite(estimator_events.gnss_disagreement_m([receiver], 18.5)) == known


@pytest.mark.parametrize(("at", "seen"), [(27.7, True), (28.1, False), (17.1, True), (16.9, False)])
def test_what_lies_from_ten_seconds_before_to_one_after_a_report_counts(at: float, seen: bool) -> None:
    """The jump at 18 s."""
    found = estimator_events.gnss_disagreement_m([circling(12.0)], at)
    assert (found > 10.0) is seen


def test_a_receiver_that_knows_nothing_leaves_it_to_the_next() -> None:
    blind = circling(40.0)
    blind.vel_ned[:, 0] = np.nan
    late = cut(30.0)
    assert estimator_events.gnss_disagreement_m([late, blind, circling(12.0)], 18.5) == pytest.approx(12.0, abs=0.5)


# What the EKF rejected in flight: spans, size and sources, by records whose ratios are given.


def flown(*ratios: tuple[float, float, float], aid: str = "compass") -> FlightLog:
    """A made flight from 5 to 35 s; ``ratios``: from, to (s), and the test ratio there, else 0.2, at 10 Hz."""
    log = carried(0.05)
    t = np.arange(0.0, 40.0, 0.1)
    ratio = np.full(len(t), 0.2)
    for a, b, size in ratios:
        ratio[(t >= a - 1e-9) & (t <= b + 1e-9)] = size
    log.estimator.innovation_tests = [InnovationTest(aid, t, ratio, "XKF4:0.SM")]
    return log


def test_rejections_in_flight_are_told_with_seconds_longest_and_size() -> None:
    log = flown((12.0, 15.0, 1.7), (20.0, 32.0, 2.6), (33.0, 33.4, 9.0))
    (one,) = estimator_events.aid_rejections(log, segments.build(log))
    assert one.spans == [pytest.approx((12.0, 15.0)), pytest.approx((20.0, 32.0))]
    assert (one.seconds, one.longest, one.worst) == (pytest.approx(15.0), pytest.approx(12.0), 2.6)
    assert "for 15 s of 28 (2 parts, longest 12 s), 12.0 to 32.0 s" in one.text


def test_event_and_check_tell_the_same() -> None:
    log = flown((12.0, 14.5, 1.7))
    phases = segments.build(log)
    (event,) = (e for e in story.events(log, phases) if e.kind == "aid_rejected")
    (check,) = innovations.innovation_checks(HealthCase(log, phases))
    assert event.text == check.text
    assert (event.t, event.t_end) == (check.t, check.t_end) == (pytest.approx(12.0), pytest.approx(14.5))
    assert (check.question, check.kind, check.verdict) == ("innovations", "compass", "warning")
    assert "Largest test ratio 1.7." in check.text


def test_ten_seconds_on_end_are_a_fault() -> None:
    log = flown((12.0, 22.5, 1.2), aid="velocity")
    (check,) = innovations.innovation_checks(HealthCase(log, segments.build(log)))
    assert (check.question, check.verdict) == ("innovations", "fault")


def test_the_ground_and_a_moment_are_no_rejection() -> None:
    log = flown((0.0, 4.0, 5.0), (20.0, 20.5, 5.0), (37.0, 40.0, 8.0))
    (check,) = innovations.innovation_checks(HealthCase(log, segments.build(log)))
    assert (check.verdict, check.count) == ("ok", 1)


def test_a_ratio_that_was_not_logged_is_no_ok() -> None:
    log = flown()
    log.estimator.innovation_tests[0].ratio[:] = np.nan
    (check,) = innovations.innovation_checks(HealthCase(log, segments.build(log)))
    assert check.verdict == "unknown"


def test_ratios_of_real_logs_are_roots_of_one_scale_in_every_era(corpus: Path) -> None:
    """By hand from the records: EKF4 of 3.3 (int16 in hundredths), NKF4 of 4.0, XKF4 of 4.5."""
    for name, source, worst in (
        ("copter_3.3dev_181.BIN", "EKF4.SV", 19.0),
        ("copter_two_compasses.bin", "NKF4:0.SM", 1.66),
        ("copter_heading_28deg_off.BIN", "XKF4:0.SM", 1.34),
    ):
        log = attlog.read(corpus / "logs" / "cases" / name)
        ratio = {test.source: test.ratio for test in log.estimator.innovation_tests}[source]
        assert np.nanmax(ratio) == pytest.approx(worst, rel=0.01)


def test_the_first_and_the_last_second_of_a_flight_count_for_no_rejection() -> None:
    (begin, end) = segments.build(flown()).spans("airborne")[0]
    edges = flown((begin, begin + 1.6, 5.0), (end - 1.6, end, 5.0))
    (one,) = estimator_events.aid_rejections(edges, segments.build(edges))
    assert (one.spans, one.seconds_flown) == ([], pytest.approx(end - begin - 2.0))


@pytest.mark.parametrize(("ratio", "rejected"), [(1.0, 0), (1.01, 1)])
def test_a_ratio_of_one_is_within_the_gate(ratio: float, rejected: int) -> None:
    (one,) = estimator_events.aid_rejections(*made_phases((12.0, 15.0, ratio)))
    assert len(one.spans) == rejected


@pytest.mark.parametrize(("seconds", "rejected"), [(0.9, 0), (1.1, 1)])
def test_a_rejection_lasts_a_second(seconds: float, rejected: int) -> None:
    (one,) = estimator_events.aid_rejections(*made_phases((12.0, 12.0 + seconds, 3.0)))
    assert len(one.spans) == rejected
    assert one.worst == (3.0 if rejected else 0.0)


def made_phases(*ratios: tuple[float, float, float]) -> tuple[FlightLog, segments.Segments]:
    log = flown(*ratios)
    return log, segments.build(log)
