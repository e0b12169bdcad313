"""Delays of receiver and compass planted in a flight in closed form come back, inside their standard errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.aiding import DelayParameter
from attlog.flight.model import FlightLog, Imu, Mag, Stream
from attlog.health import delays
from attlog.health.check import Check, HealthCase
from attlog.health.delays import DelayFit
from attlog.reference import alignment
from attlog.segments.model import Segment, Segments
from tests.health.made_flight import EARTH_UT, RATE, SECONDS, attitude, case, flight
from tests.reference.flights import ardupilot
from tests.reference.flights import flight as flights_flight
from tests.reference.test_alignment import chosen

FLOWN = [(5.0, SECONDS - 5.0)]


def path(turn_deg: float = 0.0) -> delays.AttitudePath:
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    return delays.AttitudePath(t, rotation.turn_about_down(attitude(t), np.radians(turn_deg)), None, "truth")


def found(late_s: float, turn_deg: float = 0.0, seed: int = 0) -> delays.DelayFit:
    log = flight(late_s, seed)
    imu = log.replay_imu
    assert imu is not None
    one = delays.fit_gnss_delay(imu, log.gnss[0], path(turn_deg), FLOWN, 0.1)
    assert one is not None
    return one


@pytest.mark.parametrize("late_s", [-0.05, 0.0, 0.06, 0.12, 0.2, 0.4])
def test_a_late_receiver_is_found_from_any_start(late_s: float) -> None:
    one = found(late_s)
    assert one.delay == pytest.approx(late_s, abs=0.006)
    assert all(half == pytest.approx(late_s, abs=0.012) for half in one.halves)


def test_the_standard_error_is_that_of_the_scatter() -> None:
    every = [found(0.12, seed=seed) for seed in range(8)]
    scatter = np.std([one.delay for one in every], ddof=1)
    assert np.median([one.sigma for one in every]) == pytest.approx(scatter, rel=0.6)


def test_a_turned_heading_is_no_delay() -> None:
    one = found(0.12, turn_deg=6.0)
    assert one.delay == pytest.approx(0.12, abs=0.008)
    assert abs(one.turn_deg) == pytest.approx(6.0, abs=0.5)


def test_the_time_of_receipt_counts_and_not_that_of_the_record() -> None:
    log = flight(0.12)
    log.gnss[0].received = log.gnss[0].t - 0.03
    imu = log.replay_imu
    assert imu is not None
    one = delays.fit_gnss_delay(imu, log.gnss[0], path(), FLOWN, 0.1)
    assert one is not None
    assert one.delay == pytest.approx(0.09, abs=0.006)


def test_holes_between_inertial_samples_are_not_bridged() -> None:
    log = flight(0.12)
    imu = log.replay_imu
    assert imu is not None
    keep = (imu.acc.t % 20.0) > 3.0
    for stream in (imu.gyro, imu.acc):
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    one = delays.fit_gnss_delay(imu, log.gnss[0], path(), FLOWN, 0.1)
    assert one is not None
    assert one.delay == pytest.approx(0.12, abs=0.008)
    assert one.n < 0.8 * found(0.12).n


def test_nothing_is_made_of_nothing() -> None:
    log = flight()
    imu = log.replay_imu
    assert imu is not None
    log.gnss[0].fix[:] = 0
    assert delays.fit_gnss_delay(imu, log.gnss[0], path(), FLOWN, 0.1) is None
    assert delays.fit_gnss_delay(imu, flight().gnss[0], path(), [], 0.1) is None
    assert delays.fit_compass_delay(np.zeros(0), np.zeros((0, 3)), EARTH_UT, path()) is None


@pytest.mark.parametrize("late_s", [0.0, 0.05, -0.03])
def test_a_late_compass_is_found_beside_offset_turn_and_scale(late_s: float) -> None:
    t = np.arange(5.0, SECONDS - 5.0, 0.1)
    q = rotation.turn_about_down(attitude(t - late_s), np.radians(4.0))
    field = 1.03 * rotation.rotate_inverse(q, np.tile(EARTH_UT, (len(t), 1))) + np.array([4.0, -3.0, 2.0])
    field += np.random.default_rng(1).normal(0.0, 0.3, field.shape)
    one = delays.fit_compass_delay(t, field, EARTH_UT, path())
    assert one is not None
    assert one.delay == pytest.approx(late_s, abs=0.006)
    assert one.sigma < 0.004


def test_force_that_a_filter_makes_late_is_not_taken_for_an_early_receiver() -> None:
    log = flight(0.12)
    imu = log.replay_imu
    assert imu is not None
    imu.acc.t, imu.acc.delay = imu.acc.t + 0.04, 0.04
    one = delays.fit_gnss_delay(imu, log.gnss[0], path(), FLOWN, 0.1)
    assert one is not None
    assert one.delay == pytest.approx(0.12, abs=0.006)


# How late the rates are, beside what their filter explains.


@pytest.mark.parametrize(("late_ms", "verdict"), [(11.3, "ok"), (19.0, "warning"), (35.0, "fault"), (3.0, "warning")])
def test_a_gyro_may_be_as_late_as_its_low_pass_makes_it(late_ms: float, verdict: str) -> None:
    """At 20 Hz that is 11.3 ms: 8 ms more or less are another clock's, 24 ms more a wrong one's."""
    log = ardupilot(flights_flight(truth_hz=50.0, gyro_late=1e-3 * late_ms), INS_GYRO_FILTER=20.0)
    _, check = delays.imu_delay_checks(HealthCase(log, Segments(), chosen(log)))
    assert (check.question, check.verdict) == ("imu_delay", verdict)
    assert check.value == pytest.approx(late_ms, abs=0.5)


# How late the gyro is beside what its filter explains: the limits on either side, from a delay that is given.


def checks(
    monkeypatch: pytest.MonkeyPatch,
    late_ms: float | None,
    sigma_ms: float = 0.0,
    own_ms: float = 0.0,
    filtered: str = "low-pass 30 Hz",
    kind: str = "truth",
) -> tuple[Check, Check]:
    t = np.arange(3.0)
    gyro = Stream(t, np.zeros((3, 3)), "rad/s", "FRD", "GYR", delay=1e-3 * own_ms)
    log: Any = SimpleNamespace(imus=[Imu(0, gyro, gyro, filtered=filtered)], imu=0)
    reference: Any = SimpleNamespace(kind=kind, source="TRUTH")
    seen = None if late_ms is None else (1e-3 * late_ms, 1e-3 * sigma_ms)
    monkeypatch.setattr(delays.alignment, "gyro_delay", lambda imu, reference: seen)
    own, unexplained = delays.imu_delay_checks(HealthCase(log, Segments(), reference))
    return own, unexplained


@pytest.mark.parametrize(
    ("off_ms", "verdict"),
    [
        (-20.1, "fault"),
        (-19.9, "warning"),
        (-4.1, "warning"),
        (-3.9, "ok"),
        (0.0, "ok"),
        (3.9, "ok"),
        (4.1, "warning"),
        (19.9, "warning"),
        (20.1, "fault"),
    ],
)
@pytest.mark.parametrize("own_ms", [0.0, 5.0])
def test_beside_a_named_filter_four_milliseconds_are_allowed_both_ways(
    monkeypatch: pytest.MonkeyPatch, off_ms: float, verdict: str, own_ms: float
) -> None:
    _, found = checks(monkeypatch, own_ms + off_ms, own_ms=own_ms)
    assert (found.verdict, found.value) == (verdict, pytest.approx(own_ms + off_ms))
    if verdict != "ok":
        assert f"comes {abs(off_ms):.1f} ms {'later' if off_ms > 0 else 'earlier'} " in found.text
        low, high = abs(off_ms) - 1.96 * 0.5, abs(off_ms) + 1.96 * 0.5
        assert f"({low:.1f} to {high:.1f}, 95 %)" in found.text


@pytest.mark.parametrize("filtered", ["unknown", "driver"])
def test_what_no_filter_is_named_for_may_be_ten_milliseconds_late_and_four_early(
    monkeypatch: pytest.MonkeyPatch, filtered: str
) -> None:
    for late, verdict in ((-4.1, "warning"), (-3.9, "ok"), (9.9, "ok"), (10.1, "warning")):
        own, found = checks(monkeypatch, late, filtered=filtered)
        assert (own.verdict, found.verdict) == ("unknown", verdict)


@pytest.mark.parametrize(("sigma_ms", "verdict"), [(1.5, "ok"), (1.3, "warning")])
def test_four_sigmas_of_half_a_millisecond_and_the_fits_own_are_no_delay(
    monkeypatch: pytest.MonkeyPatch, sigma_ms: float, verdict: str
) -> None:
    """8.5 ms beside 4 hypot(1.5 sigma, 0.5): 9.2 and 8.05 ms."""
    assert checks(monkeypatch, 8.5, sigma_ms)[1].verdict == verdict
    assert checks(monkeypatch, -8.5, sigma_ms)[1].verdict == verdict


def test_an_onboard_attitude_that_comes_later_accuses_no_imu(monkeypatch: pytest.MonkeyPatch) -> None:
    for kind, off, verdict in (("onboard", -9.0, "ok"), ("onboard", 9.0, "warning"), ("truth", -9.0, "warning")):
        assert checks(monkeypatch, off, kind=kind)[1].verdict == verdict


def test_a_filter_of_more_than_six_milliseconds_is_a_warning_and_none_is_told_as_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for own_ms, verdict in ((5.9, "ok"), (6.1, "warning"), (600.0, "warning")):
        own, _ = checks(monkeypatch, own_ms, own_ms=own_ms)
        assert (own.verdict, own.value) == (verdict, own_ms)
    assert "without a low-pass" in checks(monkeypatch, 0.0)[0].text
    assert checks(monkeypatch, None)[1].verdict == "unknown"


# A late receiver is offered its delay where both limits are passed, and nothing else is offered anything.


def gnss_delay_of(log: FlightLog, delay_ms: float | None = None) -> Check:
    (one,) = delays.gnss_delays(case(log, delay_ms))
    return one


def test_a_receiver_as_late_as_the_parameter_says_is_ok() -> None:
    one = gnss_delay_of(flight(0.11, params={"EKF2_GPS_DELAY": 110.0}))
    assert (one.verdict, one.settings) == ("ok", [])
    assert one.value == pytest.approx(110.0, abs=6.0)
    assert one.ci95 is not None
    assert one.ci95[0] < 110.0 < one.ci95[1]
    assert "EKF2_GPS_DELAY says 110 ms" in one.text


def test_a_later_one_is_offered_its_delay_and_a_longer_buffer() -> None:
    one = gnss_delay_of(flight(0.25, params={"EKF2_GPS_DELAY": 110.0, "EKF2_DELAY_MAX": 200.0}), delay_ms=250.0)
    assert one.verdict == "warning"
    offered = {s.name: (s.old, s.new) for s in one.settings}
    assert offered == {"EKF2_GPS_DELAY": (110.0, 250.0), "EKF2_DELAY_MAX": (200.0, 250.0)}


@pytest.mark.parametrize(("flights", "verdict"), [(1, "unknown"), (2, "warning")])
def test_two_flights_of_a_log_that_agree_offer_a_smaller_change(flights: int, verdict: str) -> None:
    """The receiver is 30 ms later than set: one flight may err by that, two are unlikely to."""
    given = case(flight(0.14, params={"EKF2_GPS_DELAY": 110.0}), None)
    spans = (
        [(2.0, SECONDS - 2.0)] if flights == 1 else [(2.0, 0.5 * SECONDS - 2.0), (0.5 * SECONDS + 2.0, SECONDS - 2.0)]
    )
    flown = [Segment("airborne", a, b) for a, b in spans]
    given.segments.segments[:] = [*(s for s in given.segments.segments if s.kind != "airborne"), *flown]
    (one,) = delays.gnss_delays(given)
    assert one.verdict == verdict
    assert [s.new for s in one.settings] == ([140.0] if flights == 2 else [])


def test_the_filter_of_the_logged_imu_widens_the_interval_until_nothing_is_offered() -> None:
    log = flight(0.16, params={"EKF2_GPS_DELAY": 110.0})
    assert gnss_delay_of(log).settings
    log.imus[0].gyro.delay = 0.0113
    slow = gnss_delay_of(log)
    assert (slow.verdict, slow.settings, bool(slow.action)) == ("unknown", [], True)


def test_estimates_that_disagree_tell_nothing() -> None:
    one = gnss_delay_of(flight(0.2, params={"EKF2_GPS_DELAY": 110.0}), delay_ms=110.0)
    assert (one.verdict, one.settings) == ("unknown", [])
    assert "differ" in one.text


def test_their_disagreement_widens_the_interval() -> None:
    near, far = (gnss_delay_of(flight(0.2, params={"EKF2_GPS_DELAY": 200.0}), delay_ms=ms) for ms in (200.0, 170.0))
    assert near.ci95 is not None
    assert far.ci95 is not None
    assert far.ci95[1] - far.ci95[0] > 1.5 * (near.ci95[1] - near.ci95[0])


def test_a_delay_beyond_the_range_is_a_warning_without_value() -> None:
    one = gnss_delay_of(flight(0.35, params={"EKF2_GPS_DELAY": 110.0}))
    assert (one.verdict, one.settings) == ("warning", [])
    assert "300 ms" in one.why_no_setting


def test_a_parameter_of_zero_is_the_drivers_own_delay_by_hardware() -> None:
    params = {"GPS1_DELAY_MS": 0.0, "AHRS_EKF_TYPE": 3.0}
    log = flight(0.2, firmware="ArduPilot", params=params)
    log.gnss[0].received = log.gnss[0].t
    unnamed = gnss_delay_of(log)  # between 50 and 220 ms, as drivers take it
    assert (unnamed.verdict, unnamed.settings) == ("unknown", [])
    assert unnamed.value == pytest.approx(200.0, abs=6.0)
    log.texts = [(0.0, 6, "u-blox 1 HW: 00080000 SW: EXT CORE 3.01 (107900)")]
    (setting,) = gnss_delay_of(log).settings
    assert (setting.name, setting.old, setting.new) == ("GPS1_DELAY_MS", 0.0, 200.0)


def test_without_the_time_of_receipt_that_parameter_is_not_offered() -> None:
    one = gnss_delay_of(flight(0.2, firmware="ArduPilot", params={"GPS_DELAY_MS": 100.0, "AHRS_EKF_TYPE": 3.0}))
    assert (one.verdict, one.settings) == ("unknown", [])
    assert "GPA.SMS" in one.why_no_setting


def test_a_flight_that_hardly_moves_cannot_tell() -> None:
    log = flight(0.2, params={"EKF2_GPS_DELAY": 110.0})
    imu = log.replay_imu
    assert imu is not None
    imu.acc.x[:, :2] *= 0.05
    log.gnss[0].vel_ned *= 0.05
    assert gnss_delay_of(log).verdict == "unknown"


def test_broken_receivers_raise_nothing() -> None:
    for break_it in ("vel_ned", "lat"):
        log = flight(0.1)
        getattr(log.gnss[0], break_it)[:] = np.nan
        delays.gnss_delays(case(log))
    log = flight(0.1)
    log.imu = None
    assert gnss_delay_of(log).verdict == "unknown"


# A late compass is found against an attitude, and offered only where a parameter is off by both limits.


@pytest.fixture
def known_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """The earth's field is that of the made flight."""

    class Known:
        ned_t = tuple(1e-6 * EARTH_UT)
        declination_deg = 0.0
        strength_t = 5e-5

    monkeypatch.setattr(alignment, "earth_field", lambda log: Known())


def compass_delay_of(late_s: float, firmware: str = "PX4", noise_ut: float = 0.3, **params: float) -> Check:
    log = flight(firmware=firmware, params=params)
    t = np.arange(0.0, SECONDS, 0.1)
    field = rotation.rotate_inverse(attitude(t - late_s), np.tile(EARTH_UT, (len(t), 1)))
    field += np.random.default_rng(2).normal(0.0, noise_ut, field.shape)
    log.mags, log.mag = [Mag(0, Stream(t, 1e-6 * field, "T", "FRD", "MAG:0"))], 0
    (one,) = delays.compass_delay(case(log))
    return one


@pytest.mark.usefixtures("known_field")
@pytest.mark.parametrize(("late_s", "verdict"), [(0.0, "ok"), (0.05, "ok"), (0.12, "warning")])
def test_where_no_parameter_sets_it_words_say_so(late_s: float, verdict: str) -> None:
    one = compass_delay_of(late_s, "ArduPilot")
    assert (one.verdict, one.settings) == (verdict, [])
    assert "the EKF takes 60 ms" in one.text


@pytest.mark.usefixtures("known_field")
def test_a_disturbed_field_tells_nothing() -> None:
    assert compass_delay_of(0.06, noise_ut=30.0, EKF2_MAG_DELAY=0.0).verdict == "unknown"


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
    ],
)
def test_a_fit_is_believed_by_its_length_its_field_its_sigma_and_its_halves(found: DelayFit, word: str) -> None:
    why = delays.compass_reason_unsure(found)
    assert (why == "") if not word else (word in why)


def parameter(low: float, high: float, most: float = 300.0) -> DelayParameter:
    return DelayParameter("EKF2_MAG_DELAY", low, low, high, most, "it says so")


@pytest.mark.parametrize(
    ("late", "sigma", "low", "high", "verdict", "new"),
    [
        (79.0, 2.0, 60.0, 60.0, "ok", None),
        (99.0, 2.0, 60.0, 60.0, "unknown", None),
        (101.0, 2.0, 60.0, 60.0, "warning", 100.0),
        (18.0, 2.0, 60.0, 60.0, "warning", 20.0),
        (18.0, 2.0, 30.0, 60.0, "ok", None),
        (107.0, 10.0, 60.0, 60.0, "ok", None),
        (131.0, 10.0, 60.0, 60.0, "unknown", None),
    ],
)
def test_a_delay_is_offered_from_40_ms_on_with_an_interval_below_20_ms_rounded_to_five(
    late: float, sigma: float, low: float, high: float, verdict: str, new: float | None
) -> None:
    """One sigma is 1.5 times that of the fit, and the floor of 5 ms beside it."""
    one = delays.delay_check(delays.COMPASS, "MAG:0", late, float(np.hypot(1.5 * sigma, 5.0)), parameter(low, high))
    assert (one.verdict, [s.new for s in one.settings]) == (verdict, [new] if new else [])
    assert one.value == late
    half = 1.96 * np.hypot(1.5 * sigma, 5.0)
    assert one.ci95 == pytest.approx((late - half, late + half), abs=0.06)
