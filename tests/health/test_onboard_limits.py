"""Limits of ratios, noise, lanes, paths and reception from both sides, by summaries of given size."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Reception, TimeLine
from attlog.health import delays, innovations, sources
from attlog.health import gnss as gnss_quality
from attlog.health.check import Check, unknown
from attlog.health.innovations import RatioSummary
from attlog.reference.model import Reference
from tests.health.made_flight import case, flight

PARAMS = {"EK3_MAG_M_NSE": 0.05, "EK3_MAG_I_GATE": 300.0}


def summary(median: float = 0.3, above: float = 0.0, longest: float = 0.0, **more: Any) -> RatioSummary:
    """Ratios of a compass in 100 s of flight."""
    stretch = (40.0, 40.0 + longest) if longest else None
    one = RatioSummary("compass", "XKF4:0.SM", median, (median, median), 0.9, above, stretch, 1000, 100.0)
    return replace(one, **more)


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
