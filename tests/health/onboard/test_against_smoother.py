"""The onboard attitude is judged by the smoother: in degrees, and in the smoother's own sigmas."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.health import Check, audit
from attlog.health.findings import findings
from attlog.health.onboard import against_smoother
from attlog.reference import Reference, choose
from attlog.reference.physics import accusing
from attlog.segments.model import Segment
from tests.reference.flights import flight
from tests.reference.test_smoothed import made

NAME = "onboard against smoother"


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
    return next(c for c in audit(log, phases, reference) if c.name == NAME), reference


def test_an_attitude_that_agrees_is_good_and_told_in_sigmas() -> None:
    check, _ = judged(off(flight(), (0.3, 0.0, 0.0), 0.0, 60.0))
    assert check.verdict == "ok"
    assert "tilt 0.3 deg (3.0 sigma), heading 0.0 deg (0.0 sigma)" in check.text


def test_a_tilt_that_is_off_for_long_is_the_wrong_one_with_size_sigma_and_time() -> None:
    check, _ = judged(off(flight(), (18.0, 0.0, 0.0), 30.0, 50.0), tilt=0.3)
    assert check.verdict == "fault"
    assert check.text.startswith("The onboard attitude was wrong: tilt 18.0 deg off (sigma 0.3) from 30 s to 50 s.")
    assert (check.value, check.unit) == (18.0, "deg")
    assert check.t == pytest.approx(30.0, abs=0.1)


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
    assert reference.heading_by == "onboard"
    assert check.verdict == "ok"
    assert "heading" not in check.text


def test_nothing_is_judged_where_the_smoother_is_no_reference() -> None:
    log = flight()
    phases = segments.build(log)
    assert all(c.name != NAME for c in audit(log, phases, choose(log, phases)))


def test_it_stands_in_the_list_of_what_is_wrong_and_takes_the_place_of_what_follows_from_it() -> None:
    """The onboard attitude is tilted at rest too: gravity disagrees with it, and that is the same thing."""
    log = off(flight(), (18.0, 0.0, 0.0), 0.0, 60.0)
    phases = segments.build(log)
    reference = choose(log, phases, smooth=made)
    checks = audit(log, phases, reference)
    assert {c.name for c in checks if c.verdict == "fault"} >= {NAME, "gravity direction"}
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
    checks = audit(log, phases, choose(log, phases))
    check = next(c for c in checks if c.name == "onboard against truth")
    assert (check.verdict, check.value) == ("fault", 60.0)
    assert check.text == "The onboard attitude was wrong: heading 60.0 deg off from 30 s to 50 s."
    assert "attitude" in {f.kind for f in findings(log, checks)}
    log.attitudes["ATT"] = flight().attitudes["ATT"]
    check = next(c for c in audit(log, phases, choose(log, phases)) if c.name == "onboard against truth")
    assert (check.verdict, check.text) == ("ok", "ATT differs from the truth by tilt 0.0 deg, heading 0.0 deg.")


def test_a_smoother_whose_sensors_failed_a_check_accuses_nobody() -> None:
    log = off(flight(), (18.0, 0.0, 0.0), 30.0, 50.0)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    reference = choose(log, phases, smooth=lambda: made(tilt=0.3))
    spikes = Check("gyro spikes", "fault", "The gyro jumps.")
    (check,) = against_smoother.checks(log, phases, reference, [spikes])
    assert check.verdict == "unknown"
    assert "Who is wrong is open: `gyro spikes` failed." in check.text
    constant = Check("gyro bias", "warning", "The gyro reads 1.2 deg/s.")
    (check,) = against_smoother.checks(log, phases, reference, [constant])
    assert check.verdict == "fault"  # a smoother finds a constant bias


@pytest.mark.parametrize(("what", "angles"), [("both", {"heading"}), ("compass", set())])
def test_a_heading_that_rests_on_the_compass_alone_accuses_nobody(what: str, angles: set[str]) -> None:
    log = off(flight(), (0.0, 0.0, 60.0), 30.0, 50.0)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    found = accusing.compared(log, phases, choose(log, phases, smooth=lambda: made(heading_from=what)))
    assert found is not None
    assert {error.angle for error in found.errors} == angles


def test_a_smoother_without_gnss_accuses_of_a_small_tilt_only_where_gravity_does() -> None:
    for aids, count in (("gnss mag", 1), ("mag", 0)):
        log = off(flight(), (5.0, 0.0, 0.0), 30.0, 50.0)
        phases = segments.build(log)
        phases.segments.append(Segment("airborne", 22.0, 60.0))
        found = accusing.compared(log, phases, choose(log, phases, smooth=lambda aids=aids: made(aided_by=aids)))
        assert found is not None
        assert len(found.errors) == count


def test_a_smoother_that_gravity_refutes_elsewhere_accuses_of_no_tilt_in_flight() -> None:
    log = off(flight(), (18.0, 0.0, 0.0), 30.0, 50.0)
    phases = segments.build(log)
    phases.segments.append(Segment("airborne", 22.0, 60.0))
    reference = choose(log, phases, smooth=lambda: made(tilt=0.3))
    for refuted, count in (([], 1), ([(5.0, 15.0)], 0)):
        reference.refuted = refuted
        found = accusing.compared(log, phases, reference)
        assert found is not None
        assert len(found.errors) == count
