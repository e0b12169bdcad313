"""Alignments, jumps of GNSS and ends of flights: limits from both sides on made texts and records."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, Problem, Stream
from attlog.segments.model import Segment, Segments
from attlog.story import estimator, flights, flown, gnss_steps, sensors
from tests.story.made import log

SPANS = Segments([Segment("continuous", 0, 60), Segment("armed", 5, 30), Segment("armed", 40, 55)])


@pytest.mark.parametrize(
    ("size", "words", "value"),
    [
        (4.94, "The EKF and GNSS came apart", 4.9),
        (5.0, "GNSS jumped", 5.0),
        (5.1, "GNSS jumped", 5.1),
        (np.inf, "The EKF and GNSS came apart", None),
        (np.nan, "The EKF and GNSS came apart", None),
    ],
)
def test_gnss_jumped_where_its_position_left_its_velocity_by_five_metres(
    monkeypatch: pytest.MonkeyPatch, size: float, words: str, value: float | None
) -> None:
    monkeypatch.setattr(gnss_steps, "disagreement", lambda receivers, t: size)
    found = estimator._apart(log(), 12.0, "warning", "", "ERR")
    assert (found.text, found.value, found.unit) == (f"{words} at 12.0 s.", value, "" if value is None else "m")
    assert len(found.evidence) == (1 if value is None else 2)
    assert estimator.is_steady(found) is (value is not None and value < 5.0)


@pytest.mark.parametrize(("count", "said"), [(1, ""), (2, ", 2 times in all")])
def test_reports_of_glitches_are_one_event_with_their_number(count: int, said: str) -> None:
    report = Problem("gnss_glitch", "warning", "GNSS glitch (ERR 11/2).", t=20.0, count=count)
    (found,) = estimator._gnss_jumps(log(problems=[report]), SPANS, [])
    assert found.text == f"The EKF and GNSS came apart at 20.0 s{said}."


def test_the_first_alignment_after_arming_is_usual_and_a_second_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = [(2.0, 6, "EKF yaw aligned"), (10.0, 6, "EKF yaw aligned"), (11.4, 6, "again"), (20.0, 6, "EKF yaw")]
    texts.append((45.0, 6, "EKF yaw aligned"))
    monkeypatch.setattr(estimator, "matching", lambda log, pattern: texts)
    told: list[Any] = []
    found = estimator._realigned(log(), SPANS, told)
    assert [(e.t, e.severity, "re-aligned" in e.text) for e in found] == [
        (10.0, "info", False),
        (20.0, "warning", True),
        (45.0, "info", False),
    ]
    assert [len(e.evidence) for e in found] == [2, 1, 1]
    assert told == texts


def test_a_switch_that_a_text_told_within_a_second_and_a_half_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimator, "matching", lambda log, p: [(10.0, 6, "lane (x)")] if p is estimator.LANE else [])
    problems = [Problem("lane_switch", "warning", f"At {t}.", t=t) for t in (11.4, 11.6, 33.0)]
    found = estimator._switches(log(problems=problems), SPANS, [])
    assert [(e.kind, e.t) for e in found] == [("lane_switch", 10.0), ("lane_switch", 11.6)]
    assert found[0].text == "The estimator changed its core at 10.0 s (x)."


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
    assert flown.ending_of_slow(made, 10.0) == said


@pytest.mark.parametrize(
    ("rate", "said"), [(10.0, "IMU at 10 Hz: a blow shorter than 100 ms would not show"), (400.0, ""), (0.0, "")]
)
def test_a_slow_imu_tells_no_short_blow(monkeypatch: pytest.MonkeyPatch, rate: float, said: str) -> None:
    monkeypatch.setattr(flights, "fast_enough", lambda log: rate > 50.0)
    made = log(imus=[SimpleNamespace(acc=SimpleNamespace(rate=r)) for r in ({0.5 * rate, rate} if rate else ())])
    assert flights.blows_told(made) == said


@pytest.mark.parametrize(("away", "edge"), [(0.49, 0.1), (0.51, 1.0)])
def test_clipping_counts_to_a_second_before_landing_and_to_the_blow_of_a_crash(away: float, edge: float) -> None:
    spans = Segments([Segment("armed", 5, 55), Segment("airborne", 10, 50)])
    ending: Any = SimpleNamespace(t=50.0 + away, is_crash=True)
    spans.endings = [ending]
    assert sensors.driven(spans) == [(10.0, pytest.approx(50.0 - edge))]
    assert sensors.driven(Segments([Segment("armed", 5, 8), Segment("armed", 7, 9)])) == [(5.0, 9.0)]


def test_a_vehicle_that_never_flew_is_told_by_its_motors_and_its_tilt() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    for deg, said in (
        (14.0, "motors never ran in 30 s."),
        (16.0, "motors never ran in 30 s, tilted up to 16° by hand."),
    ):
        q = rotation.from_euler(np.radians(np.where(t > 20.0, deg, 0.0)), 0.0 * t, 0.0 * t)
        made = log(attitudes={"ATT": Attitude(t, q, "ATT")}, onboard="ATT", seconds=30.0)
        made.vehicle = "quadrotor"
        assert flown._grounded(made, Segments([Segment("continuous", 0, 30)]), []) == [said]


@pytest.mark.parametrize(("tilt", "said"), [(14.2, "; tilt under 15°"), (0.3, "; tilt under 1°"), (15.1, "")])
def test_a_tilt_below_fifteen_degrees_is_why_it_did_not_fly(tilt: float, said: str) -> None:
    t = np.arange(0.0, 30.0, 0.1)
    q = rotation.from_euler(np.radians(tilt) + 0.0 * t, 0.0 * t, 0.0 * t)
    made = log(attitudes={"ATT": Attitude(t, q, "ATT")}, onboard="ATT")
    assert flown._still_reason(made, SPANS, [(5.0, 9.0)]) == said
    made.rangefinder = Stream(t, 0.0 * t[:, None], "m", "", "RFND")
    assert flown._still_reason(made, SPANS, [(5.0, 9.0)]).startswith("; rangefinder unmoved")
