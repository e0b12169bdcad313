"""Aids of the onboard estimator, lanes and reception: limits from both sides, and planted ratios and noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Attitude, InnovationTest, Reception, Stream, TimeLine
from attlog.health import baro, delays, gnss, innovations, sources
from attlog.health import gnss as gnss_quality
from attlog.health.check import Check, HealthCase, unknown
from attlog.health.innovations import RatioSummary
from attlog.reference.model import Reference
from attlog.segments.model import Segments
from tests.health.made_flight import SECONDS, case, flight


def summary(median: float = 0.3, above: float = 0.0, longest: float = 0.0, **more: Any) -> RatioSummary:
    """Ratios of a compass in 100 s of flight."""
    stretch = (40.0, 40.0 + longest) if longest else None
    one = RatioSummary("compass", "XKF4:0.SM", median, (median, median), 0.9, above, stretch, 1000, 100.0)
    return one._replace(**more)


@pytest.mark.parametrize("aid", ["velocity", "position", "height", "airspeed"])
@pytest.mark.parametrize("verdict", ["ok", "warning"])
def test_a_wrong_heading_explains_rejected_velocities_and_positions_alone(aid: str, verdict: str) -> None:
    asked = case(flight(firmware="ArduPilot"))
    asked.found = [Check("heading_by_gnss", verdict, "It is off.")]
    found = innovations._ratio_check(asked, summary(0.3, 5.0, 5.0, aid=aid), None)
    explained = verdict == "warning" and aid in ("velocity", "position")
    assert ("heading is wrong" in found.why_no_setting) is ("It is off." in found.evidence) is explained


def suggested(one: RatioSummary, checks: tuple[Check, ...] = (), **params: float) -> Any:
    asked = case(flight(firmware="ArduPilot", params=PARAMS | params))
    asked.found = list(checks)
    told = unknown("innovations", "", "", sensor="EKF")
    told.verdict = "ok"
    innovations.suggest_noise(asked, one, told)
    return told


@pytest.mark.parametrize(
    ("one", "new"),
    [
        (summary(0.6), 0.09),
        (summary(0.6, interval=(0.5, 0.7)), None),
        (summary(0.6, interval=(0.51, 0.7)), 0.09),
        (summary(0.6, above=1.0), 0.09),
        (summary(0.6, above=1.01), None),
        (summary(0.6, seconds=60.0), 0.09),
        (summary(0.6, seconds=59.9), None),
        (summary(0.98), 0.15),
        (summary(1.7), 0.15),
    ],
)
def test_a_noise_is_suggested_by_the_median_of_a_long_sound_flight(one: RatioSummary, new: float | None) -> None:
    told = suggested(one)
    assert [s.new for s in told.settings] == ([] if new is None else [new])
    assert told.verdict == ("ok" if new is None else "warning")


def test_a_noise_ends_at_its_range_and_is_not_suggested_smaller() -> None:
    assert [s.new for s in suggested(summary(0.9), EK3_MAG_M_NSE=0.3).settings] == [0.5]
    assert "as large as it may be" in suggested(summary(0.9), EK3_MAG_M_NSE=0.5).why_no_setting
    assert "as large" in suggested(summary(0.6), EK3_MAG_I_GATE=150.0).why_no_setting
    assert "does not hold" in suggested(summary(0.6, aid="airspeed")).why_no_setting


@pytest.mark.parametrize(
    ("name", "verdict", "blamed"),
    [
        ("compass_offset", "fault", True),
        ("compass_offset", "ok", False),
        ("compass_offset", "unknown", False),
        ("gyro_bias", "warning", True),
        ("vibration_level", "warning", True),
        ("compass_motors", "warning", True),
        ("accelerometer_rest", "warning", True),
        ("second_source", "warning", True),
        ("gnss_quality", "warning", False),
        ("declination", "fault", False),
    ],
)
def test_a_check_that_names_another_cause_leaves_the_noise_alone(name: str, verdict: str, blamed: bool) -> None:
    told = suggested(summary(0.6), (Check(name, verdict, "It says so."),))
    assert (name.replace("_", " ") in told.why_no_setting, bool(told.settings)) == (blamed, not blamed)


def test_lanes_are_those_of_the_family_that_flew() -> None:
    log = flight(firmware="ArduPilot")
    log.attitudes = dict.fromkeys(("NKQ.0", "NKQ.1", "XKF1.0", "XKF1.1", "XKQ.0", "ATT"))  # type: ignore[arg-type]
    for source, names in (("XKF4.PI", {0: "XKF1.0", 1: "XKF1.1"}), ("NKF4.PI", {0: "NKQ.0", 1: "NKQ.1"})):
        log.estimator.lane = TimeLine(np.zeros(1), [0], source)
        assert sources.lanes_of(log) == names


@pytest.mark.parametrize(
    ("heading", "tilt", "reference", "name"),
    [
        (5.0, 9.0, "truth", "motion alone"),
        (5.1, 1.0, "truth", "the truth"),
        (5.1, 1.0, "smoother", "the smoother"),
        (5.1, 1.0, "onboard", "motion alone"),
        (5.1, 1.1, "onboard", None),
    ],
)
def test_delays_are_measured_by_motion_where_it_is_sure_else_by_truth_or_smoother(
    heading: float, tilt: float, reference: str, name: str | None
) -> None:
    asked = case(flight(), sigma_heading_deg=heading)
    assert asked.motion is not None
    asked.motion.quality["sigma_tilt_deg"] = tilt
    none = np.zeros(0, np.int64)
    kind: Any = reference
    asked.reference = Reference(kind, "made", np.zeros(0), np.zeros((0, 4)), none, none)
    found = delays.attitude_path(asked)
    assert (None if found is None else found.name) == name


@pytest.mark.parametrize(
    ("name", "good", "poor"), [("satellites", 6.0, 5.0), ("hdop", 2.5, 2.6), ("s_acc", 0.5, 0.51), ("h_acc", 3.0, 3.1)]
)
def test_reception_is_poor_beyond_what_px4_asks(name: str, good: float, poor: float) -> None:
    for value, verdict in ((good, "ok"), (poor, "warning")):
        log = flight()
        gnss, n = log.gnss[0], len(log.gnss[0].t)
        gnss.s_acc, gnss.h_acc = np.full(n, 0.3), np.full(n, 0.5)
        usual = {k: np.full(n, 15.0 if k == "satellites" else 0.8) for k in ("satellites", "hdop")}
        rest = {k: np.zeros(n) for k in ("noise", "jamming", "jamming_state", "spoofing_state")}
        gnss.reception = Reception(**usual, **rest)
        setattr(gnss.reception if name in usual else gnss, name, np.full(n, value))
        (found,) = (a for a in gnss_quality.gnss_checks(case(log)) if a.question == "gnss_quality")
        assert found.verdict == verdict


# Test ratios of given size: what is told of them, when a noise is suggested, and what a figure gets.


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


# Noise of given size on a climb comes back; more than the estimator expects is a warning.


def scattered(noise_m: float, repeat: int = 1, **params: float) -> Check:
    log = flight(firmware="ArduPilot", params=params)
    t = np.arange(0.0, SECONDS, 0.1)
    x = 3.0 * t + np.random.default_rng(4).normal(0.0, noise_m, len(t))
    x, t = np.repeat(x, repeat), np.sort(np.concatenate([t + 0.1 * k / repeat for k in range(repeat)]))
    log.baro = [Stream(t, x[:, None], "m", "", "BARO:0")]
    log.estimator.innovation_tests = [InnovationTest("height", t, np.full(len(t), 0.1), "XKF4:0.SH")]
    (one,) = baro.barometer_noise(case(log))
    return one


@pytest.mark.parametrize(("noise_m", "repeat"), [(0.1, 1), (0.5, 1), (0.5, 4)])
def test_the_noise_of_a_climb_is_found_inside_its_interval(noise_m: float, repeat: int) -> None:
    one = scattered(noise_m, repeat)
    assert one.value == pytest.approx(noise_m, rel=0.12)
    assert one.ci95 is not None
    assert one.ci95[0] < noise_m < one.ci95[1]
    assert one.verdict == "ok"


def test_the_limit_is_what_the_estimator_expects() -> None:
    expected = {"EK3_ALT_M_NSE": 2.0, "EK3_HGT_I_GATE": 500.0}
    assert scattered(1.5).verdict == "warning"
    assert scattered(1.5, **expected).verdict == "ok"
    assert scattered(3.0, **expected).verdict == "warning"


def test_a_barometer_without_values_is_no_question() -> None:
    log = flight()
    log.baro = [Stream(np.arange(100.0), np.full((100, 1), np.nan), "m", "", "BARO:0")]
    assert baro.barometer_noise(case(log)) == []


def test_a_barometer_that_drifts_against_gnss_says_by_how_much() -> None:
    log = flight()
    receiver, t = log.gnss[0], np.arange(0.0, SECONDS, 0.1)
    receiver.alt = 500.0 + 8.0 * np.sin(0.2 * receiver.t)
    log.baro = [Stream(t, 8.0 * np.sin(0.2 * t)[:, None] + 0.1 * t[:, None], "m", "", "BARO:0")]
    (one,) = baro.barometer_noise(case(log))
    # 10 cm/s over 88 s (both ends of the flight left out), of which nine tenths count
    assert one.evidence == ["Its height and that of GNSS move 7.9 m against each other in flight (90 %)."]
