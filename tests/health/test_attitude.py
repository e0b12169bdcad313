"""The onboard attitude is judged by the smoother: in degrees, and in the smoother's own sigmas."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.estimators.evidence import HeadingOffset
from attlog.flight.model import Clipping, FlightLog, InnovationTest, Problem
from attlog.health import Check, attitude, sources
from attlog.health import attitude as against_smoother
from attlog.health import heading as gnss_heading
from attlog.health.attitude import wrong_angle
from attlog.health.check import HealthCase
from attlog.health.findings import findings
from attlog.health.registry import CHECKS, run_checks
from attlog.reference import Reference, choose, onboard_check
from attlog.reference.heading_sources import find_wrong_heading
from attlog.segments.model import Segment, Segments
from attlog.story import WrongAngle
from tests.health.test_health import good
from tests.reference.flights import flight
from tests.reference.test_smoother import made
from tests.segments.flights import flight as flights_flight

NAME = "onboard_against_smoother"


def off(log: FlightLog, vector_deg: tuple[float, float, float], t0: float, t1: float) -> FlightLog:
    """The log with its onboard attitude turned by this rotation vector in earth axes between two times."""
    attitude = log.attitudes["ATT"]
    wrong = ((attitude.t >= t0) & (attitude.t < t1))[:, None]
    attitude.q = np.where(
        wrong, rotation.multiply(rotation.from_rotvec(np.radians(vector_deg)), attitude.q), attitude.q
    )
    return log


def judged(log: FlightLog, **sigma: float) -> tuple[Check, Reference]:
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))  # or a jump at 30 s would be its own alignment
    reference = choose(log, phases, smooth=lambda: made(**sigma))
    return next(c for c in run_checks(HealthCase(log, phases, reference)) if c.question == NAME), reference


def test_an_attitude_that_agrees_is_good_and_told_in_sigmas() -> None:
    check, _ = judged(off(flight(), (0.3, 0.0, 0.0), 0.0, 60.0))
    assert check.verdict == "ok"
    assert "tilt 0.3 deg (3.0 sigma), heading 0.0 deg (0.0 sigma)" in check.text


@pytest.mark.parametrize(
    ("vector", "span", "sigma", "verdict"),
    [
        ((5.0, 0.0, 0.0), (30.0, 50.0), 0.1, "warning"),  # a look, but not the wrong attitude
        ((18.0, 0.0, 0.0), (30.0, 33.0), 0.1, "ok"),  # 3 s are no "for long"
        ((2.5, 0.0, 0.0), (30.0, 50.0), 0.9, "ok"),  # within three sigmas of the smoother
        ((3.5, 0.0, 0.0), (30.0, 50.0), 0.9, "ok"),  # beyond them, within three of both
        ((0.0, 0.0, 20.0), (30.0, 50.0), 0.1, "warning"),
        ((0.0, 0.0, 60.0), (30.0, 50.0), 0.1, "fault"),
    ],
)
def test_how_far_and_how_long_decide(vector, span, sigma: float, verdict: str) -> None:
    check, _ = judged(off(flight(), vector, *span), tilt=sigma, heading=sigma)
    assert check.verdict == verdict
    assert ("wrong" in check.text) == (verdict == "fault")


def test_where_it_is_wrong_comes_before_where_it_is_only_off_for_longer() -> None:
    log = off(off(flight(), (5.0, 0.0, 0.0), 25.0, 45.0), (18.0, 0.0, 0.0), 46.0, 54.0)
    check, _ = judged(log)
    assert check.verdict == "fault"
    assert "tilt 18.0 deg off (sigma 0.1) from 46 s to 54 s." in check.text


def test_a_heading_of_which_the_smoother_is_not_sure_judges_nobody() -> None:
    check, reference = judged(off(flight(), (0.0, 0.0, 60.0), 30.0, 50.0), heading=5.0)
    assert reference.heading.by == "onboard"
    assert check.verdict == "ok"
    assert "heading" not in check.text


def test_it_stands_in_the_list_of_what_is_wrong_and_takes_the_place_of_what_follows_from_it() -> None:
    """The onboard attitude is tilted at rest too: gravity disagrees with it, and that is the same thing."""
    log = off(flight(), (18.0, 0.0, 0.0), 0.0, 60.0)
    phases = segments.build(log)
    reference = choose(log, phases, smooth=made)
    checks = run_checks(HealthCase(log, phases, reference))
    assert {c.question for c in checks if c.verdict == "fault"} >= {NAME, "gravity_direction"}
    told = findings(log, checks)
    first = next(f for f in told if f.kind == "attitude")
    assert first.severity == "serious"
    assert first.cause
    assert any("Measured gravity" in line for line in first.evidence)
    assert all(f.kind != "mounting" for f in told)


def test_a_sensor_that_is_mounted_otherwise_than_set_is_no_wrong_attitude() -> None:
    """A turn in body axes, the same all the time, also where the vehicle swings by 15 deg."""
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_rotvec(np.radians([25.0, 0.0, 0.0])))
    check, _ = judged(log)
    assert check.verdict == "warning"
    assert check.text.startswith(
        "The sensor is mounted otherwise than set, or the onboard attitude is wrong throughout"
    )
    assert judged(off(flight(), (25.0, 0.0, 0.0), 30.0, 60.0))[0].verdict == "fault"


def test_truth_judges_the_attitude_that_flew_without_sigmas() -> None:
    log = off(flight(), (0.0, 0.0, 60.0), 30.0, 50.0)
    log.truth = flight().attitudes["ATT"]
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    checks = run_checks(HealthCase(log, phases, choose(log, phases)))
    check = next(c for c in checks if c.question == "onboard_against_truth")
    assert (check.verdict, check.value) == ("fault", 60.0)
    assert check.text == "The onboard attitude was wrong: heading 60.0 deg off from 30 s to 50 s."
    assert "attitude" in {f.kind for f in findings(log, checks)}
    log.attitudes["ATT"] = flight().attitudes["ATT"]
    check = next(
        c for c in run_checks(HealthCase(log, phases, choose(log, phases))) if c.question == "onboard_against_truth"
    )
    assert (check.verdict, check.text) == ("ok", "ATT differs from the truth by tilt 0.0 deg, heading 0.0 deg.")


def test_a_smoother_whose_sensors_failed_a_check_accuses_nobody() -> None:
    log = off(flight(), (18.0, 0.0, 0.0), 30.0, 50.0)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    reference = choose(log, phases, smooth=lambda: made(tilt=0.3))
    spikes = Check("gyro_spikes", "fault", "The gyro jumps.")
    (check,) = against_smoother.smoother_checks(HealthCase(log, phases, reference, found=[spikes]))
    assert check.verdict == "unknown"
    assert "Who is wrong is open: `gyro spikes` failed." in check.text
    constant = Check("gyro_bias", "warning", "The gyro reads 1.2 deg/s.")
    (check,) = against_smoother.smoother_checks(HealthCase(log, phases, reference, found=[constant]))
    assert check.verdict == "fault"  # a smoother finds a constant bias


@pytest.mark.parametrize(("what", "angles"), [("both", {"heading"}), ("compass", set())])
def test_a_heading_that_rests_on_the_compass_alone_accuses_nobody(what: str, angles: set[str]) -> None:
    log = off(flight(), (0.0, 0.0, 60.0), 30.0, 50.0)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    found = onboard_check.compare_onboard(log, phases, choose(log, phases, smooth=lambda: made(heading_from=what)))
    assert found is not None
    assert {error.angle for error in found.errors} == angles


def test_a_smoother_without_gnss_accuses_of_a_small_tilt_only_where_gravity_does() -> None:
    for aids, count in (("gnss mag", 1), ("mag", 0)):
        log = off(flight(), (5.0, 0.0, 0.0), 30.0, 50.0)
        phases = segments.build(log)
        phases.segments.append(Segment("airborne", 22.0, 60.0))
        found = onboard_check.compare_onboard(
            log, phases, choose(log, phases, smooth=lambda aids=aids: made(aided_by=aids))
        )
        assert found is not None
        assert len(found.errors) == count


def test_a_smoother_that_gravity_refutes_elsewhere_accuses_of_no_tilt_in_flight() -> None:
    log = off(flight(), (18.0, 0.0, 0.0), 30.0, 50.0)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    reference = choose(log, phases, smooth=lambda: made(tilt=0.3))
    for refuted, count in (([], 1), ([(5.0, 15.0)], 0)):
        reference.scoring.refuted = refuted
        found = onboard_check.compare_onboard(log, phases, reference)
        assert found is not None
        assert len(found.errors) == count


# Which angle of the onboard attitude the checks prove wrong.

GNSS = Check("heading_by_gnss", "fault", "", 26.5, "deg", t=11.0, t_end=102.0)
SMOOTHER = Check("onboard_against_smoother", "fault", "", 7.2, "deg", t=30.0, t_end=40.0, about="tilt")


def test_gnss_acceleration_which_assumes_least_is_taken_before_the_smoother():
    assert wrong_angle([SMOOTHER, GNSS]) == WrongAngle("heading", 26.5, 11.0, 102.0)
    assert wrong_angle([SMOOTHER]) == WrongAngle("tilt", 7.2, 30.0, 40.0)
    turned = Check("compass_orientation", "fault", "", in_use=True)
    assert wrong_angle([GNSS, turned]).why == "wrong compass orientation"
    assert wrong_angle([GNSS, replace(turned, in_use=False)]).why == ""
    assert wrong_angle([replace(GNSS, kind="attitude")]).why == "the estimator diverged from its compass"


# What is said of a crash follows what happened: the first thing first, and what is compared.

LOSS = Segment("loss_of_control", 41.7, 42.0, "tilt of 159 deg, and 0.3 s later it was disarmed")


def said(*found: Segment) -> str:
    (check,) = attitude.crash_checks(HealthCase(flights_flight(), Segments(list(found))))
    return " ".join([check.text, *check.evidence])


def test_a_wreck_that_rolls_over_after_its_impact_lost_no_control_there() -> None:
    blow = Segment("impact", 40.3, 60.0, "16.4 g with a tumble, and 1.7 s later it was disarmed")
    assert said(LOSS, blow) == f"An impact at 40.3 s: {blow.why}. Nothing is compared after 40.3 s."


def test_an_impact_after_a_loss_is_the_end_of_what_is_compared() -> None:
    blow = Segment("impact", 42.0, 60.0, LOSS.why)
    assert said(LOSS, blow) == f"Control was lost at 41.7 s: {LOSS.why}. Nothing is compared after 42.0 s."


def test_a_loss_that_is_flown_on_ends_nothing() -> None:
    again = Segment("loss_of_control", 90.0, 91.0, "tilt of 99 deg, and at once it was disarmed")
    text = f"Control was lost 2 times, first at 41.7 s: {LOSS.why}. It flew again: what follows is compared too."
    assert said(LOSS, again) == text


def test_a_flight_without_a_crash_is_good_only_where_samples_could_show_one() -> None:
    flown = Segments([Segment("airborne", 35.0, 75.0)])
    (fast,), (slow,) = (
        attitude.crash_checks(HealthCase(flights_flight(200.0), flown)),
        attitude.crash_checks(HealthCase(flights_flight(25.0), flown)),
    )
    assert (fast.verdict, slow.verdict) == ("ok", "unknown")
    assert "IMU at 25 Hz" in slow.text


# A wrong onboard heading is found by GNSS acceleration, with its time; it stands with the compass that caused it.


def turned(off_deg: float, t0: float = -np.inf) -> FlightLog:
    """A simulated flight of real firmware whose onboard heading is off by this from ``t0`` s on."""
    log = deepcopy(good("px4_steps.ulg"))
    attitude = log.onboard_attitude
    assert attitude is not None
    attitude.q = rotation.turn_about_down(attitude.q, np.where(attitude.t >= t0, np.radians(off_deg), 0.0))
    return log


def checked(log: FlightLog) -> Check:
    (check,) = gnss_heading.gnss_heading_checks(HealthCase(log, segments.build(log)))
    return check


@pytest.mark.parametrize(("off", "verdict"), [(5.0, "ok"), (12.0, "warning"), (-28.0, "fault"), (150.0, "fault")])
def test_a_heading_that_is_off_is_named_with_degrees_sigma_and_time(off: float, verdict: str) -> None:
    check = checked(turned(off))
    assert check.verdict == verdict
    assert check.value == pytest.approx(abs(off), abs=2.0)
    assert " deg (±" in check.text or " deg wrong (±" in check.text
    assert (" from " in check.text) == (verdict != "ok")


def test_a_heading_that_is_wrong_for_a_part_is_named_with_that_time() -> None:
    log = turned(0.0)
    (begin, end) = max(segments.build(log).spans("airborne"), key=lambda span: span[1] - span[0])
    since = 0.5 * (begin + end)
    check = checked(turned(60.0, since))
    assert check.verdict == "fault"
    assert check.t is not None
    assert check.t > begin + 5.0
    assert check.t_end == pytest.approx(end, abs=5.0)


@pytest.mark.parametrize("seconds", [0.0, 8.0], ids=["jump", "ramp"])
def test_an_estimator_that_leaves_its_compass_is_blamed_from_then_on(seconds: float) -> None:
    log = turned(0.0)
    (begin, end) = max(segments.build(log).spans("airborne"), key=lambda span: span[1] - span[0])
    since = begin + 0.4 * (end - begin)
    attitude = log.onboard_attitude
    share = np.clip((attitude.t - since) / max(seconds, 1e-3), 0.0, 1.0)
    attitude.q = rotation.turn_about_down(attitude.q, np.radians(-70.0) * share)
    check = checked(log)
    assert (check.kind, check.verdict) == ("attitude", "fault")
    assert check.t == pytest.approx(since + seconds * 15.0 / 70.0, abs=0.7)
    assert any("jumped by 70 deg" in text for text in check.evidence) == (seconds == 0.0)
    assert "alibrate the compass" not in check.action


def test_a_compass_that_leads_the_estimator_astray_stays_accused() -> None:
    log = turned(50.0)
    field = log.mags[log.mag].field
    mount = rotation.from_euler(0.0, 0.0, np.radians(50.0))  # its field turns as a heading too large by 50 deg
    field.x = rotation.rotate(np.tile(mount, (len(field.x), 1)), field.x)
    check = checked(log)
    assert (check.kind, check.verdict, check.action) == ("", "fault", "")
    assert CHECKS["heading_by_gnss"].remedy == "compass"


def test_rejected_gnss_is_laid_to_the_heading() -> None:
    log = turned(60.0)
    (begin, end) = max(segments.build(log).spans("airborne"), key=lambda span: span[1] - span[0])
    t = np.arange(begin + 5.0, end - 5.0, 0.2)
    log.estimator.innovation_tests = [InnovationTest("velocity", t, np.full(len(t), 1.7), "test")]
    assert any("its heading is wrong, not GNSS" in text for text in checked(log).evidence)


def test_nobody_is_accused_by_an_accelerometer_that_clips() -> None:
    log = turned(60.0)
    t = np.arange(0.0, log.seconds, 1.0)
    log.vibration.clippings = [Clipping("accelerometer", log.imu, "test", t, np.full(len(t), 50), True)]
    assert checked(log).verdict == "unknown"


def test_without_a_compass_the_attitude_itself_is_wrong() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    log.problems = [Problem("no_mag", "warning", "No compass is logged.")]
    found = findings(log, [checked(turned(40.0))])
    assert any(f.kind == "attitude" and "heading" in f.text and f.severity == "serious" for f in found)


def part(t0: float, off: float, sigma: float, told: bool) -> HeadingOffset:
    """30 s of a flight."""
    return HeadingOffset(off, sigma, 0.8, 0.75 if told else 0.65, 0.1, 4.0, t0, t0 + 30.0, told, "")


def test_neighbours_that_are_off_as_far_say_since_when_and_others_do_not() -> None:
    right, unclear, wrong = part(0.0, 2.0, 4.0, True), part(45.0, -50.0, 12.0, False), part(60.0, -48.0, 8.0, True)
    whole = right._replace(known=False)
    found = find_wrong_heading(whole, [right, part(30.0, 45.0, 12.0, False), unclear, wrong])
    assert found is not None
    assert found.spans == [(45.0, 90.0)]
    assert find_wrong_heading(whole, [right, unclear]) is None


def test_a_second_source_that_differs_is_not_left_open_where_gnss_tells() -> None:
    log = turned(40.0)
    log.truth = None
    flew = log.onboard_attitude
    assert flew is not None
    log.attitudes["second"] = replace(flew, q=rotation.turn_about_down(flew.q, np.full(len(flew.t), np.radians(-40.0))))
    phases = segments.build(log)
    (check,) = sources.source_checks(HealthCase(log, phases, choose(log, phases)))
    assert check.text.endswith(f"; GNSS acceleration contradicts {log.onboard}.")


def test_neighbours_on_both_sides_of_south_are_off_alike() -> None:
    """178 deg one way and 177 deg the other way are 5 deg from each other."""
    wrong, unclear = part(60.0, 178.0, 8.0, True), part(45.0, -177.0, 12.0, False)
    found = find_wrong_heading(wrong._replace(known=False), [unclear, wrong])
    assert found is not None
    assert found.spans == [(45.0, 90.0)]
