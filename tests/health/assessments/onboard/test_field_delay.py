"""A late compass is found against an attitude, and offered only where a parameter is off by both limits."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.aiding.delays import DelayParameter
from attlog.flight.model import Mag, Stream
from attlog.health.assessments import Assessment
from attlog.health.assessments.onboard import field_delay
from attlog.health.fits.delays import DelayFit
from attlog.health.model import Check
from attlog.reference import declination
from tests.health.assessments.onboard.made import EARTH_UT, SECONDS, attitude, case, flight


@pytest.fixture(autouse=True)
def known_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """The earth's field is that of the made flight."""

    class Known:
        ned_t = tuple(1e-6 * EARTH_UT)

    monkeypatch.setattr(declination, "model", lambda log: Known())


def told(late_s: float, firmware: str = "PX4", noise_ut: float = 0.3, **params: float) -> Assessment:
    log = flight(firmware=firmware, params=params)
    t = np.arange(0.0, SECONDS, 0.1)
    field = rotation.rotate_inverse(attitude(t - late_s), np.tile(EARTH_UT, (len(t), 1)))
    field += np.random.default_rng(2).normal(0.0, noise_ut, field.shape)
    log.mags, log.mag = [Mag(0, Stream(t, 1e-6 * field, "T", "FRD", "MAG:0"))], 0
    (one,) = field_delay.assessments(case(log))
    return one


def test_a_compass_on_time_is_ok() -> None:
    one = told(0.0, EKF2_MAG_DELAY=0.0)
    assert (one.verdict, one.settings) == ("ok", [])
    assert one.value == pytest.approx(0.0, abs=6.0)


def test_a_late_one_is_offered_its_delay() -> None:
    one = told(0.06, EKF2_MAG_DELAY=0.0)
    (setting,) = one.settings
    assert (one.verdict, setting.name, setting.old, setting.new) == ("warning", "EKF2_MAG_DELAY", 0.0, 60.0)


def test_15_ms_are_not_offered() -> None:
    assert told(0.015, EKF2_MAG_DELAY=0.0).settings == []


@pytest.mark.parametrize(("late_s", "verdict"), [(0.0, "ok"), (0.05, "ok"), (0.12, "warning")])
def test_where_no_parameter_sets_it_words_say_so(late_s: float, verdict: str) -> None:
    one = told(late_s, "ArduPilot")
    assert (one.verdict, one.settings) == (verdict, [])
    assert "the EKF takes 60 ms" in one.text


def test_a_disturbed_field_tells_nothing() -> None:
    assert told(0.06, noise_ut=30.0, EKF2_MAG_DELAY=0.0).verdict == "unknown"


def test_the_delay_of_the_imu_is_the_audits() -> None:
    asked = case(flight())
    assert field_delay.of_imu(asked) == []
    asked.checks = [Check("imu delay", "fault", "IMU comes 25 ms later.", 25.0, "ms")]
    (one,) = field_delay.of_imu(asked)
    assert (one.verdict, one.value, one.settings) == ("fault", 25.0, [])
    assert one.why_no_setting


def fitted(late_ms: float, sigma_ms: float = 2.0, apart_ms: float = 0.0, **more: float) -> DelayFit:
    """A fit whose halves lie so far apart."""
    halves = (1e-3 * (late_ms - 0.4 * apart_ms), 1e-3 * (late_ms + 0.6 * apart_ms))
    known = {"moving": 5.0, "n": 400, "seconds": 60.0} | more
    return DelayFit(1e-3 * late_ms, 1e-3 * sigma_ms, halves, 0.0, known["moving"], int(known["n"]), known["seconds"])


@pytest.mark.parametrize(
    ("found", "word"),
    [
        (fitted(40.0, seconds=20.0, moving=1.5), ""),
        (fitted(40.0, seconds=19.9), "turn more"),
        (fitted(40.0, moving=1.49), "1.5 uT/s in 60 s"),
        (fitted(40.0, 9.9), ""),
        (fitted(40.0, 10.1), "known to 15 ms only"),
        (fitted(40.0, 2.0, 24.9), ""),
        (fitted(40.0, 2.0, 25.1), "disturbed"),
        (fitted(40.0, 2.0, -25.1), "disturbed"),
        (fitted(40.0, 5.0, 42.0), ""),
        (fitted(40.0, 5.0, 43.0), "disturbed"),
        (fitted(40.0, 2.0, float("nan")), "disturbed"),
        (None, "Too few samples"),
    ],
)
def test_a_fit_is_believed_by_its_length_its_field_its_sigma_and_its_halves(found: DelayFit | None, word: str) -> None:
    why = field_delay._doubt(found)
    assert (why == "") if not word else (word in why)


def parameter(low: float, high: float, most: float = 300.0) -> DelayParameter:
    return DelayParameter("EKF2_MAG_DELAY", low, low, high, most, "it says so")


@pytest.mark.parametrize(
    ("late", "sigma", "low", "high", "new"),
    [
        (79.0, 2.0, 60.0, 60.0, None),
        (81.0, 2.0, 60.0, 60.0, 80.0),
        (41.0, 2.0, 60.0, 60.0, None),
        (38.0, 2.0, 60.0, 60.0, 40.0),
        (38.0, 2.0, 30.0, 60.0, None),
        (107.0, 10.0, 60.0, 60.0, None),
        (108.0, 10.0, 60.0, 60.0, 110.0),
    ],
)
def test_a_delay_is_told_beyond_20_ms_and_three_sigmas_and_rounded_to_five(
    late: float, sigma: float, low: float, high: float, new: float | None
) -> None:
    """One sigma is 1.5 times that of the fit, and the floor of 5 ms beside it."""
    one = field_delay._told("MAG:0", fitted(late, sigma), parameter(low, high))
    assert (one.verdict, [s.new for s in one.settings]) == ("ok" if new is None else "warning", [new] if new else [])
    assert one.value == late
    half = 1.96 * np.hypot(1.5 * sigma, 5.0)
    assert one.ci95 == pytest.approx((late - half, late + half), abs=0.06)


@pytest.mark.parametrize(
    ("late", "most", "offered"), [(100.0, 100.0, True), (104.0, 100.0, False), (-40.0, 300.0, False)]
)
def test_what_lies_outside_the_range_of_the_parameter_is_not_offered(late: float, most: float, offered: bool) -> None:
    one = field_delay._told("MAG:0", fitted(late), parameter(0.0, 0.0, most))
    assert (one.verdict, bool(one.settings), bool(one.why_no_setting)) == ("warning", offered, not offered)


def test_without_a_parameter_a_delay_is_told_and_not_judged() -> None:
    one = field_delay._told("MAG:0", fitted(90.0), "No parameter.")
    assert (one.verdict, one.why_no_setting, one.value) == ("unknown", "No parameter.", 90.0)
