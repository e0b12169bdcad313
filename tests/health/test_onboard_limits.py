"""Limits of ratios, noise, lanes, paths and reception from both sides, by summaries of given size."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Reception, Stream, TimeLine
from attlog.health import baro, delays, innovations, sources
from attlog.health import gnss as gnss_quality
from attlog.health.check import Check, HealthCase, unknown
from attlog.health.innovations import RatioSummary
from attlog.health.sources import LaneError
from attlog.reference.model import Reference
from attlog.segments.model import Segment, Segments
from tests.health.made_flight import SECONDS, case, flight

PARAMS = {"EK3_MAG_M_NSE": 0.05, "EK3_MAG_I_GATE": 300.0}


def summary(median: float = 0.3, above: float = 0.0, longest: float = 0.0, **more: Any) -> RatioSummary:
    """Ratios of a compass in 100 s of flight."""
    stretch = (40.0, 40.0 + longest) if longest else None
    one = RatioSummary("compass", "XKF4:0.SM", median, (median, median), 0.9, above, stretch, 1000, 100.0)
    return replace(one, **more)


@pytest.mark.parametrize(
    ("above", "longest", "verdict"),
    [
        (0.99, 0.99, "ok"),
        (1.0, 1.0, "warning"),
        (1.9, 0.9, "ok"),
        (2.1, 0.9, "warning"),
        (9.9, 0.9, "warning"),
        (10.1, 0.9, "fault"),
        (9.9, 9.9, "warning"),
        (10.0, 10.0, "fault"),
    ],
)
def test_ratios_above_one_are_told_by_their_share_and_their_longest_stretch(
    above: float, longest: float, verdict: str
) -> None:
    found = innovations._ratio_check(
        case(flight(firmware="ArduPilot", params=PARAMS)), summary(0.3, above, longest), None
    )
    assert found.verdict == verdict
    assert (found.t, found.value) == (40.0, 0.3)
    assert f"{above:.1f} s ({above:.1f} %)" in found.evidence[-1]
    assert bool(found.cause) is (verdict != "ok")


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


def lane(number: int, tilt: float, heading: float = 1.0) -> LaneError:
    return LaneError(number, tilt, heading, 100)


@pytest.mark.parametrize(
    ("mine", "other", "verdict", "what"),
    [
        (lane(1, 2.9), lane(0, 0.1), "ok", ""),
        (lane(1, 3.1), lane(0, 1.23), "warning", "tilt"),
        (lane(1, 3.1), lane(0, 1.25), "ok", ""),
        (lane(1, 1.0, 9.9), lane(0, 1.0, 0.1), "ok", ""),
        (lane(1, 1.0, 10.1), lane(0, 1.0, 4.0), "warning", "heading"),
        (lane(1, 1.0, 10.1), lane(0, 1.0, 4.1), "ok", ""),
        (lane(1, 1.0, 30.0), lane(0, 1.0, float("nan")), "ok", ""),
        (lane(1, 9.0, 30.0), lane(0, 1.0, 1.0), "warning", "tilt"),
    ],
)
def test_a_lane_is_worse_beyond_its_limit_and_where_another_has_two_fifths_of_its_error(
    mine: LaneError, other: LaneError, verdict: str, what: str
) -> None:
    none = np.zeros(0, np.int64)
    truth = Reference("truth", "SIM", np.zeros(0), np.zeros((0, 4)), none, none)
    told = sources._lane_assessment("XKF4.PI", mine, [other, mine, lane(2, 50.0, 90.0)], truth)
    assert told.verdict == verdict
    if what:
        assert f"in {what}; lane 0 errs" in told.text
        assert told.value == getattr(mine, what)
    else:
        assert told.value == mine.tilt


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


def test_a_sample_stands_for_its_step_and_at_most_for_three_usual_ones() -> None:
    t = np.array([0.0, 1.0, 2.0, 2.5, 5.0, 9.0, 10.0])
    np.testing.assert_array_equal(delays.held_seconds(t), [1.0, 1.0, 0.5, 2.5, 3.0, 1.0, 1.0])
    assert delays.held_seconds(t[:1]).tolist() == [0.0]


def test_the_interval_of_a_median_is_by_ranks_of_blocks_of_five_seconds() -> None:
    """16 blocks with medians 0 to 15 in any order: ranks 8 minus and plus 0.98 times 4, outwards."""
    order = np.random.default_rng(0).permutation(16)
    t = np.arange(0.0, 80.0, 0.5)
    x = order[(t // 5.0).astype(int)] + np.tile([-0.2, 0.0, 0.0, 0.0, 0.3], 32)
    assert delays.median_interval(t, x) == (4.0, 12.0)
    assert delays.median_interval(t[:20], np.arange(20.0)) == (4.5, 14.5)


def test_a_flight_loses_its_first_and_last_second_and_what_follows_a_crash() -> None:
    asked = case(flight())
    asked.segments = Segments([Segment("airborne", 5.0, 7.0), Segment("airborne", 10.0, 12.1)])
    assert delays.flight_spans(asked) == [(11.0, pytest.approx(11.1))]
    log = flight()
    log.state.armed = TimeLine(np.array([0.0, 20.0, 60.0, 80.0]), [False, True, False, True], "made")
    last = max(float(g.t[-1]) for g in log.gnss)
    assert delays.armed_spans(log) == [(20.0, 60.0), (80.0, last)]
    assert delays.flight_spans(HealthCase(log, Segments([], unknown=("airborne",)))) == [
        (21.0, 59.0),
        (81.0, last - 1.0),
    ]


@pytest.mark.parametrize(("states", "verdict"), [(4, "ok"), (5, "warning"), (6, "warning")])
def test_jamming_of_a_second_is_told(states: int, verdict: str) -> None:
    """Five records a second."""
    log = flight()
    n = len(log.gnss[0].t)
    state = np.ones(n)
    state[200 : 200 + states] = 2.0
    usual = dict(satellites=np.full(n, 15.0), hdop=np.full(n, 0.8), noise=np.zeros(n), jamming=np.zeros(n))
    log.gnss[0].reception = Reception(**usual, jamming_state=state, spoofing_state=np.full(n, np.nan))
    (found,) = (a for a in gnss_quality.gnss_checks(case(log)) if a.question == "gnss_interference")
    assert found.verdict == verdict
    assert found.evidence == []
    if verdict != "ok":
        assert found.value == states / 5.0


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


@pytest.mark.parametrize(("count", "answered"), [(49, 0), (50, 1)])
def test_a_barometer_needs_fifty_new_values_in_flight(count: int, answered: int) -> None:
    log = flight()
    t = 20.0 + 0.1 * np.arange(count)
    log.baro = [Stream(t, np.random.default_rng(1).normal(0.0, 0.2, (count, 1)), "m", "", "BARO:0")]
    assert len(baro.barometer_noise(case(log))) == answered


@pytest.mark.parametrize(("noise_m", "verdict"), [(0.97, "ok"), (1.03, "warning")])
def test_a_barometer_without_a_parameter_may_scatter_by_a_metre(noise_m: float, verdict: str) -> None:
    """Values that alternate by a have second differences of four times a."""
    log = flight()
    t = np.arange(10.0, SECONDS - 10.0, 0.1)
    a = noise_m * 0.6745 * np.sqrt(6.0) / 4.0
    log.baro = [Stream(t, (5.0 * t + a * (-1.0) ** np.arange(len(t)))[:, None], "m", "", "BARO:0")]
    (found,) = baro.barometer_noise(case(log))
    assert found.value == pytest.approx(noise_m, abs=1e-3)
    assert found.verdict == verdict
