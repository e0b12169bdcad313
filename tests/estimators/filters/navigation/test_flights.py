"""`eskf` and `smoother` on flights with known truth: errors within their own sigma, levels and delays found again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.estimators import Measurements, estimate, place
from attlog.estimators.filters.navigation import passes
from attlog.estimators.filters.navigation.attitude import refusal
from attlog.estimators.filters.navigation.inputs import prepare_inputs
from attlog.estimators.filters.navigation.passes import most_turning_part
from attlog.pipeline import inputs
from attlog.reference import alignment
from attlog.testing import still, swing
from tests.conftest import few
from tests.estimators.filters.navigation.made import flight, off, without

SEEDS = range(4)


@pytest.fixture(scope="module")
def smoothed():
    made = [flight(seed=s) for s in SEEDS]
    return [(m, estimate("smoother", *m.motion.sensors, aids=m.aids)) for m in made]


def test_errors_are_as_large_as_they_are_said_to_be(smoothed):
    z = []
    for made, e in smoothed:
        tilt, heading = off(e.q, made.motion.q)
        z.append([np.mean((tilt / e.aux["sigma_tilt"]) ** 2), np.mean((heading / e.aux["sigma_heading"]) ** 2)])
    pooled = np.sqrt(np.mean(z, axis=0))
    assert (pooled > 0.4).all()
    assert (pooled < 1.5).all()


def test_the_smoother_is_far_better_than_the_sensors_biases(smoothed):
    """0.1 m/s^2 of bias are 0.6 deg, 0.9 uT of hard iron 2.4 deg of heading."""
    for made, e in smoothed:
        tilt, heading = (np.degrees(np.sqrt(np.mean(x[3000:] ** 2))) for x in off(e.q, made.motion.q))
        assert tilt < 0.2
        assert heading < 0.8
        assert e.bias is not None
        assert e.bias[-1] == pytest.approx([0.004, -0.003, 0.002], abs=3e-4)


def test_the_biases_are_told_with_a_sigma_that_holds_them(smoothed):
    """Told are (0.05, -0.08, 0.04) m/s^2 and (0.004, -0.003, 0.002) rad/s; the sigma is too small by half."""
    for _, e in smoothed:
        acc, acc_sigma, gyro, gyro_sigma = (
            np.array([e.quality[name.format(axis)] for axis in "xyz"])
            for name in ("acc_bias_{}_m_s2", "acc_bias_{}_sigma_m_s2", "gyro_bias_{}_dps", "gyro_bias_{}_sigma_dps")
        )
        assert (np.abs(acc - [0.05, -0.08, 0.04]) < 3.0 * np.hypot(1.5 * acc_sigma, 0.005)).all()
        assert (acc_sigma < 0.03).all()
        assert gyro == pytest.approx(np.degrees([0.004, -0.003, 0.002]), abs=0.02)
        assert (gyro_sigma < 0.1).all()


def test_the_delay_of_gnss_is_found(smoothed):
    found = [e.quality["gnss_delay_ms"] for _, e in smoothed]
    assert np.mean(found) == pytest.approx(100.0, abs=6.0)
    assert max(abs(np.array(found) - 100.0)) < 20.0


def test_the_gyro_s_noise_is_found(smoothed):
    found = [np.radians(e.quality["gyro_noise_dps_sqrt_hz"]) for _, e in smoothed]
    assert np.mean(found) == pytest.approx(4e-4, rel=0.4)


def test_a_late_magnetometer_is_found():
    made = flight(mag_delay=0.05)
    e = estimate("smoother", *made.motion.sensors, aids=made.aids)
    assert e.quality["mag_delay_ms"] == pytest.approx(50.0, abs=6.0)


@pytest.mark.slow
def test_the_filter_is_as_good_as_it_says():
    z = []
    for seed in SEEDS:
        made = flight(seed=seed)
        e = estimate("eskf", *made.motion.sensors, aids=made.aids)
        tilt, heading = off(e.q, made.motion.q)
        flown = made.motion.t > 30.0
        z.append(
            [np.mean((tilt / e.aux["sigma_tilt"])[flown] ** 2), np.mean((heading / e.aux["sigma_heading"])[flown] ** 2)]
        )
    assert (np.sqrt(np.mean(z, axis=0)) < 1.6).all()


@pytest.mark.parametrize(
    ("gone", "aided"),
    few(
        [
            ((), "gnss baro mag rest"),
            (("position",), "gnss baro mag rest"),
            (("velocity",), "position baro mag rest"),
            (("baro", "at_rest"), "gnss mag"),
            (("velocity", "position"), "baro mag rest"),
        ],
        3,
    ),
)
@pytest.mark.parametrize("name", ["eskf", "smoother"])
def test_it_works_with_what_there_is_and_says_so(name, gone, aided):
    made = flight(seconds=60.0)
    e = estimate(name, *made.motion.sensors, aids=without(made.aids, *gone))
    # Without GNSS both are the inertial model, which uses no barometer.
    inertial = {"eskf": "mag", "smoother": "mag rest"}
    assert e.quality["aided_by"] == (inertial[name] if aided.startswith("baro") else aided)
    tilt, heading = (np.degrees(np.sqrt(np.mean(x[1500:] ** 2))) for x in off(e.q, made.motion.q))
    assert tilt < (1.0 if "gnss" in aided or "position" in aided else 3.0)
    assert heading < (2.0 if "gnss" in aided else 4.0)


def test_gnss_shows_the_heading_without_a_magnetometer():
    made = flight()
    m = made.motion
    e = estimate("smoother", m.t, m.gyr, m.acc, aids=made.aids)
    assert e.quality["aided_by"] == "gnss baro rest"
    assert np.degrees(np.abs(off(e.q, m.q)[1][3000:])).max() < 3.0


def test_bare_samples_are_enough():
    m = swing(30.0)
    for name in ("eskf", "smoother"):
        e = estimate(name, m.t, m.gyr, m.acc)
        assert e.quality["aided_by"] == ("gravity" if name == "eskf" else "rest")
        assert np.degrees(off(e.q, m.q)[0][1000:]).max() < 2.0


def test_a_log_that_starts_in_the_air_starts_in_motion():
    made = flight(seconds=90.0)
    m = made.motion.part(made.motion.t > 27.0)
    e = estimate("smoother", *m.sensors, aids=made.aids.between(27.0, 90.0))
    tilt, heading = (np.degrees(np.sqrt(np.mean(x**2))) for x in off(e.q, m.q))
    assert tilt < 0.4
    assert heading < 1.5


def test_a_loss_of_gnss_is_bridged_and_told_by_sigma():
    made = flight(seconds=100.0)
    holes = {}
    for name in ("velocity", "position"):
        x = getattr(made.aids, name)
        kept = (x.t < 45.0) | (x.t > 75.0)
        holes[name] = Measurements(x.t[kept], x.x[kept], x.sigma[kept])
    e = estimate("smoother", *made.motion.sensors, aids=replace(made.aids, **holes))
    assert np.degrees(off(e.q, made.motion.q)[0]).max() < 1.0


def test_declination_turns_gnss_and_field_alike():
    """The field points 20 deg east: told as declination, headings are true ones again."""
    made = flight(seconds=60.0)
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    x = made.aids.velocity
    turned = x.x @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    aids = replace(without(made.aids, "position"), velocity=Measurements(x.t, turned, x.sigma))
    plain = estimate("smoother", *made.motion.sensors, aids=without(made.aids, "position"))
    e = estimate("smoother", *made.motion.sensors, aids=aids, declination=20.0)
    heading = np.degrees(off(e.q, plain.q)[1])
    assert heading == pytest.approx(20.0, abs=1e-3)


def test_a_low_pass_ahead_of_the_logger_is_taken_out():
    """Samples stamped 20 ms late: told so, attitudes stand at the stamps again."""
    made = flight(seconds=60.0)
    m = made.motion
    late = estimate("smoother", m.t + 0.02, m.gyr, m.acc, m.mag, aids=replace(made.aids, lag=(0.02, 0.02)))
    plain = estimate("smoother", *m.sensors, aids=made.aids)
    # What is asked for at the stamp t + 0.02 is the attitude of that time, two samples later.
    assert np.degrees(off(late.q[3000:-2], plain.q[3002:])[0]).max() < 0.1


@pytest.mark.parametrize("spec", ["eskf@fixed", "eskf"])
def test_a_causal_filter_does_not_see_what_comes(spec: str) -> None:
    """Cut in the middle of a stage, and with another flight behind it: the attitudes before stay to the bit."""
    made = flight(seconds=60.0)
    m, half = made.motion, 3500
    end = float(m.t[half - 1])
    whole = estimate(spec, *m.sensors, aids=made.aids)
    part = estimate(spec, *m.part(slice(0, half)).sensors, aids=made.aids.between(0.0, end))
    assert np.array_equal(whole.q[:half], part.q)
    assert whole.causal


@pytest.mark.parametrize("preset", ["whole_log", "whole_log_biases"])
def test_constants_of_the_whole_log_are_told_to_look_ahead(preset: str) -> None:
    made = flight(seconds=60.0)
    assert not estimate(f"eskf@{preset}", *made.motion.sensors, aids=made.aids).causal


def test_a_magnetic_fault_in_flight_is_learnt_as_an_offset():
    made = flight(seconds=120.0)
    mag = made.motion.mag.copy()
    mag[6000:] += [15e-6, -10e-6, 5e-6]
    m = replace(made.motion, mag=mag)
    e = estimate("smoother", *m.sensors, aids=made.aids)
    assert e.quality["kicks"] >= 1
    assert np.degrees(np.sqrt(np.mean(off(e.q, m.q)[1] ** 2))) < 3.0


def test_a_run_that_hardly_moves_is_no_reference():
    m = still(60.0)
    e = estimate("smoother", *m.sensors)
    assert "heading sigma" in str(e.quality["refused"]) or "tilt sigma" in str(e.quality["refused"])


def test_what_follows_an_impact_does_not_reach_back():
    made = flight(seconds=70.0)
    m = made.motion
    after = m.t > 55.0
    random = np.random.default_rng(1)
    gyr, acc = m.gyr.copy(), m.acc.copy()
    gyr[after] = 20.0 * random.standard_normal((after.sum(), 3))
    acc[after] = 40.0 * random.standard_normal((after.sum(), 3))
    e = estimate("smoother", m.t, gyr, acc, m.mag, aids=replace(made.aids, impact=55.0))
    cut = m.part(m.t < 54.8)
    alone = estimate("smoother", *cut.sensors, aids=made.aids.between(0.0, float(cut.t[-1])))
    assert np.array_equal(e.q[: len(cut.t)], alone.q)
    assert e.q.shape == (len(m.t), 4)
    assert np.isfinite(e.q).all()


def test_a_refusal_names_its_reason():
    told: dict[str, float | str] = {"sigma_tilt_deg": 0.1, "sigma_heading_deg": 0.3, "worst_ratio": 1.1}
    assert refusal(told) == ""
    assert "heading sigma" in refusal(told | {"sigma_heading_deg": 1.2})
    assert "5.0 times" in refusal(told | {"worst_ratio": 5.0})
    assert "41 %" in refusal(told | {"soft_gated_pct": 41.0})
    assert "6 times" in refusal(told | {"openings": 6.0})


@pytest.mark.slow
def test_constants_of_a_long_run_are_found_where_it_moves_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two minutes at rest, then a flight: 100 s of it tell the delay, and attitudes are those of the whole."""
    made = flight(seconds=240.0, still=120.0)
    sensors = dict(zip(("t", "gyr", "acc", "mag"), made.motion.sensors, strict=True))
    inputs = prepare_inputs(sensors["t"], sensors["gyr"], sensors["acc"], sensors["mag"], made.aids, 0.0, ahead=True)
    assert most_turning_part(inputs, 240.0) is inputs
    part = most_turning_part(inputs, 100.0)
    assert part.t[-1] - part.t[0] == pytest.approx(100.0, abs=0.1)
    assert part.t[0] >= 119.0
    assert part.dt[0] == 0.0
    assert part.velocity is not None
    assert part.velocity.t[0] >= part.sensed_at[0]
    assert part.velocity.t[-1] <= part.sensed_at[-1]
    whole = estimate("eskf@whole_log", *made.motion.sensors, aids=made.aids)
    monkeypatch.setattr(passes, "MAX_LEARNING_S", 100.0)
    short = estimate("eskf@whole_log", *made.motion.sensors, aids=made.aids)
    assert not np.array_equal(whole.q, short.q)
    tilt, heading = off(short.q, whole.q)
    assert np.degrees(np.abs(tilt)).max() < 0.1
    assert np.degrees(np.abs(heading)).max() < 0.5
    assert short.quality["gnss_delay_ms"] == pytest.approx(100.0, abs=10.0)


# `eskf` and `smoother` against the truth in simulated logs of both firmwares.

SAMPLES = Path(__file__).parents[4] / "sample_logs"
FLIGHTS = {"copter_yaw_turns.bin": (0.25, 0.9, 117.0, "none"), "px4_steps.ulg": (0.8, 0.6, 0.0, "both")}
"""Most that tilt and heading errors of the smoother may be of the onboard attitude's; the delay of GNSS in ms; what
heading rests on: turns on the spot show GNSS none."""


@pytest.fixture(scope="module", params=FLIGHTS)
def flown(request):
    case = attlog.prepare(SAMPLES / request.param)
    log, imu = case.log, case.log.imus[case.log.imu]
    field = log.mags[log.mag].field
    given = {
        "t": imu.gyro.t_best,
        "gyr": imu.gyro.x,
        "acc": imu.acc.x,
        "mag": place(imu.gyro.t_best, field.t_best, field.x),
        "sampling": imu.gyro.sampling,
        "aids": inputs.aids_of(log, case.segments, imu, alignment.earth_field(log)),
        "declination": case.reference.alignment.declination_deg,
    }
    return request.param, log, given


def rms_deg(log, t, q):
    """Tilt and heading RMSE against truth from 15 s on."""
    use = (log.truth.t > 15.0) & (log.truth.t < t[-1]) & np.isfinite(log.truth.q).all(axis=1)
    e = rotation.earth_error(rotation.slerp(t, q, log.truth.t[use]), log.truth.q[use])
    angles = rotation.tilt_angle(e), rotation.heading_angle(e)
    return np.degrees([np.sqrt(np.mean(x * x)) for x in angles])


def test_the_smoother_is_closer_to_truth_than_what_flew(flown):
    name, log, given = flown
    tilt, heading, delay, heading_from = FLIGHTS[name]
    e = estimate("smoother", **given)
    onboard = log.onboard_attitude
    at = onboard.t if onboard.t_sample is None else onboard.t_sample
    ratio = rms_deg(log, e.t, e.q) / rms_deg(log, at, onboard.q)
    assert ratio[0] < tilt
    assert ratio[1] < heading
    assert e.quality["gnss_delay_ms"] == pytest.approx(delay, abs=20.0)
    assert e.quality["heading_from"] == heading_from
    assert (e.quality["refused"] == "") == (heading_from == "both")


@pytest.mark.parametrize("spec", few(["eskf", "eskf@fixed"], 1))
def test_the_filter_does_not_diverge(flown, spec):
    _, log, given = flown
    tilt, heading = rms_deg(log, *(lambda e: (e.t, e.q))(estimate(spec, **given)))
    assert tilt < 1.2
    assert heading < 3.0
