"""A wrong onboard heading is found by GNSS acceleration, with its time; it stands with the compass that caused it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.estimators.evidence.gnss_heading import HeadingOffset
from attlog.flight.model import Clipping, FlightLog, InnovationTest, Problem
from attlog.health import Check
from attlog.health.findings import findings
from attlog.health.onboard import gnss_heading, sources
from attlog.reference import choose
from attlog.reference.physics.onboard_heading import wrong_heading
from attlog.story.rejections import Rejection
from tests.health.test_health import good


def turned(off_deg: float, t0: float = -np.inf) -> FlightLog:
    """A simulated flight of real firmware whose onboard heading is off by this from ``t0`` s on."""
    log = deepcopy(good("px4_steps.ulg"))
    attitude = log.onboard_attitude
    assert attitude is not None
    attitude.q = rotation.turn_about_down(attitude.q, np.where(attitude.t >= t0, np.radians(off_deg), 0.0))
    return log


def checked(log: FlightLog) -> Check:
    (check,) = gnss_heading.checks(log, segments.build(log))
    return check


def test_a_sound_heading_is_ok_with_its_size() -> None:
    check = checked(turned(0.0))
    assert check.verdict == "ok"
    assert isinstance(check.value, float)
    assert check.value < 2.0


@pytest.mark.parametrize(("off", "verdict"), [(5.0, "ok"), (12.0, "warning"), (-28.0, "fault"), (150.0, "fault")])
def test_a_heading_that_is_off_is_named_with_degrees_sigma_and_time(off: float, verdict: str) -> None:
    check = checked(turned(off))
    assert check.verdict == verdict
    assert check.value == pytest.approx(abs(off), abs=2.0)
    assert "by GNSS acceleration (±" in check.text
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


def test_rejected_gnss_is_laid_to_the_heading() -> None:
    log = turned(60.0)
    (begin, end) = max(segments.build(log).spans("airborne"), key=lambda span: span[1] - span[0])
    t = np.arange(begin + 5.0, end - 5.0, 0.2)
    log.innovation_tests = [InnovationTest("velocity", t, np.full(len(t), 1.7), "test")]
    assert "its heading is wrong, not GNSS" in checked(log).evidence[-1]


def test_nobody_is_accused_by_an_accelerometer_that_clips() -> None:
    log = turned(60.0)
    t = np.arange(0.0, log.seconds, 1.0)
    log.clippings = [Clipping("accelerometer", log.imu, "test", t, np.full(len(t), 50), True)]
    assert checked(log).verdict == "unknown"


def test_heading_and_field_are_one_entry_with_one_action() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    log.problems = []
    field = Check("field", "warning", "The field is too small.")
    second = Check("second source", "fault", "Another heading differs.", about="heading")
    found = findings(log, [field, second, checked(turned(40.0))])
    (one,) = [f for f in found if f.is_trouble]
    assert (one.kind, one.severity) == ("compass", "serious")
    assert one.text.startswith("The onboard heading is 40 deg off by GNSS acceleration")
    assert {"The field is too small.", "Another heading differs."} <= set(one.evidence)
    assert one.action.startswith("Calibrate the compass")


def test_without_a_compass_the_attitude_itself_is_wrong() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    log.problems = [Problem("no_mag", "warning", "No compass is logged.")]
    found = findings(log, [checked(turned(40.0))])
    assert any(f.kind == "attitude" and "GNSS acceleration" in f.text and f.severity == "serious" for f in found)


def part(t0: float, off: float, sigma: float, told: bool) -> HeadingOffset:
    """30 s of a flight."""
    return HeadingOffset(off, sigma, 0.8, 0.75 if told else 0.65, 0.1, 4.0, t0, t0 + 30.0, told, "")


def test_neighbours_that_are_off_as_far_say_since_when_and_others_do_not() -> None:
    right, unclear, wrong = part(0.0, 2.0, 4.0, True), part(45.0, -50.0, 12.0, False), part(60.0, -48.0, 8.0, True)
    whole = replace(right, told=False)
    found = wrong_heading(whole, [right, part(30.0, 45.0, 12.0, False), unclear, wrong])
    assert found is not None
    assert found.spans == [(45.0, 90.0)]
    assert wrong_heading(whole, [right, unclear]) is None


def test_a_second_source_that_differs_is_not_left_open_where_gnss_tells() -> None:
    log = turned(40.0)
    log.truth = None
    flew = log.onboard_attitude
    assert flew is not None
    log.attitudes["second"] = replace(flew, q=rotation.turn_about_down(flew.q, np.full(len(flew.t), np.radians(-40.0))))
    phases = segments.build(log)
    (check,) = sources.checks(log, phases, choose(log, phases))
    assert check.text.endswith(f"; GNSS acceleration contradicts {log.onboard}.")


def test_neighbours_on_both_sides_of_south_are_off_alike() -> None:
    """178 deg one way and 177 deg the other way are 5 deg from each other."""
    wrong, unclear = part(60.0, 178.0, 8.0, True), part(45.0, -177.0, 12.0, False)
    found = wrong_heading(replace(wrong, told=False), [unclear, wrong])
    assert found is not None
    assert found.spans == [(45.0, 90.0)]


def test_a_rejected_compass_is_not_told_as_rejected_gnss(monkeypatch: pytest.MonkeyPatch) -> None:
    """What counts are GNSS aids, a second and more of them, while the heading was wrong."""
    found = [
        Rejection(aid, spans, 2.0, "XKF4", 60.0)
        for aid, spans in (
            ("compass", [(10.0, 40.0)]),
            ("velocity", [(5.0, 15.0), (30.0, 32.0)]),
            ("position", [(19.5, 30.0)]),
        )
    ]
    monkeypatch.setattr(gnss_heading, "tested", lambda log, segments: found)
    assert gnss_heading._rejected(None, None, [(10.0, 20.0)]) == "GNSS velocity for 5 s"  # type: ignore[arg-type]
