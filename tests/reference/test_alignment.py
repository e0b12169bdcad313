"""Declination, input delay, replay floor: each step has the value it should, from the source it names."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog import segments
from attlog.core import earth, rotation
from attlog.flight.model import Gnss, Imu, Mag, Stream
from attlog.reference import Reference, ReferenceOptions, alignment, choose, observed_declination_deg
from tests.reference.flights import RATE, SECONDS, ardupilot, attitude_at, flight, sampled

T = np.arange(0.0, SECONDS, 1 / RATE)
MID_2024 = 1719792000.0


def receiver(lat: float = 47.4, lon: float = 8.5, fix: int = 3) -> Gnss:
    """A receiver that stands still."""
    t = np.arange(0.0, SECONDS, 0.2)
    one = np.ones(len(t))
    return Gnss(
        0, t, "GPS:0", lat * one, lon * one, 400 * one, np.zeros((len(t), 3)), one, one, one, np.full(len(t), fix)
    )


def chosen(log, **options) -> Reference:
    """The reference of a log."""
    return choose(log, segments.build(log), ReferenceOptions(**options))


def text_of(reference: Reference, name: str) -> str:
    """The sentence of a step."""
    return next(s.text for s in reference.alignment.steps if s.name == name)


# --- declination ------------------------------------------------------------------------------------------------


def test_declination_comes_from_the_model_of_place_and_date():
    log = flight()
    log.gnss, log.utc_offset = [receiver()], MID_2024
    expected = earth.field(47.4, 8.5, 400.0, MID_2024)
    assert expected is not None
    reference = chosen(log)
    assert reference.alignment.declination_deg == pytest.approx(expected.declination_deg)
    assert "WMM-2020 (2024.50)" in text_of(reference, "declination")


@pytest.mark.parametrize(("name", "value"), [("COMPASS_DEC", math.radians(11.0)), ("EKF2_MAG_DECL", 11.0)])
def test_without_a_place_the_autopilots_parameter_is_used_in_its_own_unit(name, value):
    reference = chosen(ardupilot(flight(), **{name: value}))
    assert reference.alignment.declination_deg == pytest.approx(11.0)
    assert name in text_of(reference, "declination")


def test_a_parameter_of_zero_is_not_believed():
    """The trap: 0 means "not set", and no heading may be claimed on it."""
    reference = chosen(ardupilot(flight(), COMPASS_DEC=0.0))
    assert reference.alignment.declination_deg is None
    assert "unknown, so headings are magnetic" in text_of(reference, "declination")


def test_the_model_goes_before_the_parameter_both_are_told_and_the_user_decides():
    log = ardupilot(flight(), COMPASS_DEC=math.radians(1.5))
    log.gnss, log.utc_offset = [receiver()], MID_2024
    both = chosen(log)
    assert both.alignment.declination_deg == pytest.approx(3.4, abs=0.2)
    assert "1.5 deg by COMPASS_DEC" in text_of(both, "declination")
    assert chosen(log, declination="param").alignment.declination_deg == pytest.approx(1.5)
    assert chosen(log, declination="model").alignment.declination_deg == both.alignment.declination_deg
    assert chosen(ardupilot(flight(), COMPASS_DEC=0.2), declination="model").alignment.declination_deg is None
    assert chosen(log, declination=-7).alignment.declination_deg == -7.0
    assert chosen(log, declination="-7.5").alignment.declination_deg == -7.5


@pytest.mark.parametrize("gnss", [receiver(0.0, 0.0), receiver(fix=1), receiver(fix=2), receiver(lat=float("nan"))])
def test_a_receiver_without_a_fix_gives_no_place(gnss):
    log = flight()
    log.gnss = [gnss]
    assert alignment.flight_place(log) is None
    assert chosen(log).alignment.declination_deg is None


def test_the_declination_seen_is_where_the_reference_turns_the_field_to():
    log = flight(truth_hz=50.0)
    north = np.array([math.cos(math.radians(12.0)), math.sin(math.radians(12.0)), 2.0]) * 2e-5
    t = T[::10]
    log.mags = [Mag(0, Stream(t, rotation.rotate_inverse(attitude_at(t), north), "T", "FRD", "MAG:0"))]
    log.mag = 0
    reference = chosen(log)
    assert observed_declination_deg(log, reference) == pytest.approx(12.0, abs=0.05)
    assert "points this far east" in text_of(reference, "declination_seen")


# --- input delay ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0.0, 0.003, 0.0113, 0.03, -0.004])
@pytest.mark.parametrize("rate", [10.0, 25.0, 50.0])
def test_the_rates_show_how_late_the_gyro_is(late, rate):
    reference = chosen(log := flight(truth_hz=rate, gyro_late=late))
    found = alignment.fit_gyro_delay(log.imus[0], reference)
    assert found is not None
    assert found[0] == pytest.approx(late, abs=3e-4)
    assert 0.0 < found[1] < 3e-4


def test_the_step_holds_the_formula_and_its_check():
    log = ardupilot(flight(truth_hz=50.0, gyro_late=0.0113), INS_GYRO_FILTER=20.0)
    reference = chosen(log)
    assert reference.alignment.input_delay_s == pytest.approx(0.01125, abs=1e-4)
    assert "11.3 ms by IMU:0, low-pass 20 Hz; the rates show 11.3 ms against SIM" in text_of(reference, "input_delay")
    assert "disagrees" in text_of(chosen(ardupilot(flight(truth_hz=50.0), INS_GYRO_FILTER=20.0)), "input_delay")


def test_the_input_delay_can_be_given_or_switched_off():
    log = ardupilot(flight(), INS_GYRO_FILTER=20.0)
    assert chosen(log, input_delay="off").alignment.input_delay_s == 0.0
    assert chosen(log, input_delay=4).alignment.input_delay_s == pytest.approx(0.004)
    assert chosen(log, input_delay="2.5").alignment.input_delay_s == pytest.approx(0.0025)


def test_a_log_that_hardly_turns_cannot_check_the_delay():
    log = flight(18.0, truth_hz=50.0)
    assert alignment.fit_gyro_delay(log.imus[0], chosen(log)) is None
    assert "turns too little" in text_of(chosen(log), "input_delay")


# --- replay floor -----------------------------------------------------------------------------------------------


def stored(step: float, seed: int = 1) -> np.ndarray:
    """Attitudes that were logged in steps of so many degrees (0: as float32 quaternions)."""
    rng = np.random.default_rng(seed)
    angles = np.degrees(rotation.to_euler(sampled(20.0).q)) + 0.03 * rng.normal(size=(1200, 3))
    if step:
        return rotation.from_euler(*np.radians(np.round(angles / step) * step).T)
    return rotation.from_euler(*np.radians(angles).T).astype(np.float32).astype(float)


@pytest.mark.parametrize("step", [0.01, 0.05, 0.1, 1.0])
def test_the_step_of_logged_angles_is_measured(step):
    assert alignment.logged_step_deg(stored(step)) == pytest.approx(step, rel=0.02)


def test_stamps_in_whole_milliseconds_cost_their_step_times_the_rate():
    rng = np.random.default_rng(2)
    log = flight()
    log.attitudes["ATT"].t = np.round(log.attitudes["ATT"].t + rng.uniform(0, 1.5e-3, 1200), 3)
    rate = np.degrees(np.sqrt(np.mean(np.sum((log.imus[0].gyro.x - np.median(log.imus[0].gyro.x, 0)) ** 2, 1))))
    assert chosen(log).alignment.floor_deg == pytest.approx(1e-3 / np.sqrt(12) * rate, rel=0.01)
    assert chosen(flight()).alignment.floor_deg < 1e-4


# The step of time stamps, of the attitude's own too.


def test_a_gap_that_ends_an_estimate_leaves_no_error_and_a_bridged_one_a_quarter_of_its_turn():
    """Rates that change by 40 deg/s over 0.4 s: 4 deg; over 0.8 s a filter starts anew and nothing is integrated."""
    found = []
    for seconds in (0.4, 0.8):
        t = np.concatenate([np.arange(0.0, 5.0, 0.01), np.arange(5.0 - 0.01 + seconds, 10.0, 0.01)])
        rate = np.radians(np.where(t < 5.0, 0.0, 40.0))[:, None] * [0.0, 0.0, 1.0]
        unit = Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU"), Stream(t, 0.0 * rate, "m/s^2", "FRD", "IMU"))
        found.append(alignment.bridged_gap_deg(unit))
    assert found == [pytest.approx(4.0), 0.0]
