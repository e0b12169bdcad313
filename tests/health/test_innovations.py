"""Test ratios of given size: what is told of them, when a noise is suggested, and what a figure gets."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Attitude, InnovationTest, TimeLine
from attlog.health import gnss, innovations
from attlog.health.check import Check, HealthCase
from attlog.segments.model import Segments
from tests.health.made_flight import SECONDS, case, flight

PARAMS = {"EK3_MAG_M_NSE": 0.05, "EK3_MAG_I_GATE": 300.0}


def ratios(level: float, above: tuple[float, float] | None = None, aid: str = "compass") -> HealthCase:
    """10 Hz, between 0.8 and 1.2 of a level; 2 within ``above`` s."""
    log = flight(firmware="ArduPilot", params=PARAMS)
    t = np.arange(0.0, SECONDS, 0.1)
    ratio = level * np.random.default_rng(3).uniform(0.8, 1.2, len(t))
    if above is not None:
        ratio[(t >= above[0] - 1e-9) & (t < above[1] - 1e-9)] = 2.0
    log.estimator.innovation_tests = [InnovationTest(aid, t, ratio, "XKF4:0.SM")]
    log.attitudes = {"ATT": Attitude(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), "ATT")}
    return case(log)


def told(asked: HealthCase) -> Check:
    (one,) = innovations.innovation_checks(asked)
    return one


def test_a_sound_aid_is_ok_with_its_median_inside_the_interval() -> None:
    one = told(ratios(0.2))
    assert (one.verdict, one.settings) == ("ok", [])
    assert one.value == pytest.approx(0.2, abs=0.01)
    assert one.ci95 is not None
    assert one.ci95[0] <= 0.2 <= one.ci95[1]
    assert one.seconds == pytest.approx(88.0, abs=0.3)


@pytest.mark.parametrize(
    ("above", "verdict"), [((40.0, 40.3), "ok"), ((40.0, 43.0), "warning"), ((40.0, 55.0), "fault")]
)
def test_time_above_the_gate_is_told_with_its_longest_stretch(above: tuple[float, float], verdict: str) -> None:
    one = told(ratios(0.2, above))
    assert one.verdict == verdict
    assert one.t == pytest.approx(above[0], abs=0.11)
    (summary,) = innovations.ratio_summaries(ratios(0.2, above))
    assert summary.above == pytest.approx(above[1] - above[0], abs=0.11)
    assert summary.longest_s == pytest.approx(above[1] - above[0], abs=0.11)


def test_an_aid_of_zeros_is_not_used_and_none_at_all_is_unknown() -> None:
    asked = ratios(0.0)
    assert [one.verdict for one in innovations.innovation_checks(asked)] == ["unknown"]
    asked.log.estimator.innovation_tests = []
    (one,) = innovations.innovation_checks(asked)
    assert "LOG_BITMASK" in one.text


def test_ratios_that_are_no_numbers_raise_nothing() -> None:
    asked = ratios(0.2)
    asked.log.estimator.innovation_tests[0].ratio[:] = np.nan
    assert told(asked).verdict == "unknown"


def test_telemetry_without_segments_is_judged_while_armed() -> None:
    asked = ratios(0.2, (40.0, 43.0))
    asked.log.imus, asked.log.imu = [], None
    asked.log.state.armed = TimeLine(np.array([0.0, 20.0, 60.0]), [False, True, False], "HEARTBEAT")
    one = told(HealthCase(asked.log, Segments([], unknown=("airborne",))))
    assert (one.verdict, one.t) == ("warning", pytest.approx(40.0, abs=0.11))
    assert one.seconds == pytest.approx(38.0, abs=0.3)
    found = gnss.gnss_checks(HealthCase(asked.log, Segments([], unknown=("airborne",))))
    assert {a.question for a in found} == {"gnss_quality", "gnss_jumps"}
