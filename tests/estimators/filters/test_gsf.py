"""``gsf`` finds a heading that nothing told it from GNSS velocity, is unsure before, and is what its equations say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from attlog import pipeline
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators import Aids, Estimate, LogFacts, LogInfo, Measurements, estimate, get
from attlog.estimators.filters import gsf as bank
from attlog.pipeline.replay import aids_of, log_facts, run_rows
from attlog.testing import Motion, Noise, motion
from attlog.testing.motions import heading_deg, tilt_deg, total_deg
from tests.conftest import few

Array = NDArray[np.float64]
RATE = 100.0
UNKNOWN_DEG = 180.0 / np.sqrt(3.0)
QUIET = Noise()


def dash(yaw_deg: float, course_deg: float = 0.0, seconds: float = 10.0, noise: Noise = QUIET) -> Motion:
    """From 4 s on for 3 s forward in the course with 3 m/s^2, held level with heading ``yaw``."""
    ahead = np.array([np.cos(np.deg2rad(course_deg)), np.sin(np.deg2rad(course_deg)), 0.0])

    def angles(t: Array) -> tuple[float, float, float]:
        return 0.0, 0.0, float(np.deg2rad(yaw_deg))

    return motion(angles, seconds, RATE, acceleration=lambda t: np.outer(pushed(t), ahead), noise=noise)


def pushed(t: Array) -> Array:
    """The acceleration (n,) m/s^2 of :func:`dash`."""
    return np.where((t > 4.0) & (t <= 7.0), 3.0, 0.0)


def fixes(m: Motion, course_deg: float = 0.0, late: float = 0.11, sigma: float = 0.1) -> Aids:
    """Velocity of :func:`dash` at 5 Hz, told ``late`` s after it was true."""
    speed = np.cumsum(pushed(m.t)) / RATE
    course = np.deg2rad(course_deg)
    velocity = np.outer(speed, [np.cos(course), np.sin(course), 0.0])[::20]
    return Aids(velocity=Measurements(m.t[::20] + late, velocity, np.full(len(velocity), sigma)))


def found(m: Motion, aids: Aids, **values: float | str) -> Estimate:
    return estimate("gsf", m.t, m.gyr, m.acc, aids=aids, **values)


@pytest.mark.parametrize("yaw", few([float(x) for x in range(-180, 180, 20)], 5))
def test_a_straight_acceleration_north_tells_every_heading(yaw: float) -> None:
    """Whichever of the five is next to the truth, or between two of them: the mean comes to it."""
    m = dash(yaw)
    e = found(m, fixes(m))
    end = np.searchsorted(m.t, 7.1)
    assert np.abs(heading_deg(e.q, m.q)[end]) < 0.5
    assert np.rad2deg(e.aux["sigma_heading"][end]) < 10.0
    assert tilt_deg(e.q, m.q)[end] < 8.0  # a lasting force is taken for gravity by and by


@pytest.mark.parametrize("course", few([0.0, 90.0, 200.0], 2))
def test_heading_is_not_the_course(course: float) -> None:
    """Flying sideways and backwards: the nose stays where it is."""
    m = dash(40.0, course)
    e = found(m, fixes(m, course))
    assert np.abs(heading_deg(e.q, m.q)[700]) < 0.5


def test_without_motion_it_stays_unsure() -> None:
    """Receiver noise of 0.2 m/s in place for two minutes, tilted, with gyro noise: no heading is claimed."""
    m = motion(lambda t: (0.1, -0.05, 1.0), 120.0, RATE, noise=Noise(gyro=1e-4, acc=0.01))
    random = np.random.default_rng(4)
    t = m.t[::20]
    aids = Aids(velocity=Measurements(t, 0.2 * random.standard_normal((len(t), 3)), np.full(len(t), 0.3)))
    e = found(m, aids)
    assert np.rad2deg(e.aux["sigma_heading"]).min() > 45.0
    assert tilt_deg(e.q, m.q).max() < 1.0


def test_before_the_first_fast_fix_the_heading_is_that_of_the_start_and_its_sigma_a_circle_s() -> None:
    m = dash(70.0)
    for q0, told in ((None, 0.0), (rotation.from_euler(0.0, 0.0, 2.0), 2.0)):
        e = estimate("gsf", m.t, m.gyr, m.acc, aids=fixes(m), q0=q0)
        before = m.t < 4.0
        np.testing.assert_allclose(rotation.to_euler(e.q[before])[:, 2], told, atol=1e-9)
        np.testing.assert_allclose(np.rad2deg(e.aux["sigma_heading"][before]), UNKNOWN_DEG)
        np.testing.assert_allclose(e.aux["weights"][before], 0.2)
        assert np.abs(heading_deg(e.q, m.q)[700]) < 0.5


def test_a_turned_world_turns_the_result() -> None:
    """By a fifth of the circle the five change places, so all of it turns, weights included."""
    noise = Noise(gyro=1e-3, acc=0.05, bias=(0.01, -0.01, 0.005))
    a, b = dash(10.0, 30.0, noise=noise), dash(82.0, 102.0, noise=noise)
    b = Motion(b.t, b.q, a.gyr, a.acc, b.mag)
    one, other = (found(m, fixes(m, course)) for m, course in ((a, 30.0), (b, 102.0)))
    known = a.t > 4.6  # the second fix that is fast
    assert total_deg(other.q[known], rotation.turn_about_down(one.q[known], np.deg2rad(72.0))).max() < 1e-6
    np.testing.assert_allclose(other.aux["sigma_heading"], one.aux["sigma_heading"], atol=1e-9)
    np.testing.assert_allclose(other.aux["weights"], np.roll(one.aux["weights"], 1, axis=1), atol=1e-9)


def test_a_receiver_s_delay_is_taken_out() -> None:
    """An acceleration that turns at 2 rad/s: a delay that is wrong by d turns the heading by 2 d."""

    def along(t: Array) -> Array:
        return np.stack([3.0 * np.cos(2.0 * t), 3.0 * np.sin(2.0 * t), 0.0 * t], axis=-1)

    m = motion(lambda t: (0.0, 0.0, 0.5), 12.0, RATE, acceleration=along)
    velocity = np.cumsum(along(m.t), axis=0) / RATE
    aids = Aids(velocity=Measurements(m.t[::20] + 0.2, velocity[::20], np.full(60, 0.1)))
    off = [heading_deg(found(m, aids, delay=d).q, m.q)[-200:].mean() for d in (0.2, 0.15, 0.1, 0.0)]
    assert abs(off[0]) < 4.0
    np.testing.assert_allclose(np.abs(np.array(off) - off[0]), np.rad2deg([0.0, 0.1, 0.2, 0.4]), atol=0.3)


def test_airspeed_takes_the_turn_s_acceleration_out_of_the_tilt() -> None:
    """A coordinated turn of 20 m/s at 30 deg of bank for a minute: forward it stays banked, else it is levelled."""
    speed, bank_rad = 20.0, np.deg2rad(30.0)
    rate = 9.80665 * np.tan(bank_rad) / speed

    def inwards(t: Array) -> Array:
        return speed * rate * np.stack([-np.sin(rate * t), np.cos(rate * t), 0.0 * t], axis=-1)

    m = motion(lambda t: (bank_rad, 0.0, rate * t), 60.0, RATE, acceleration=inwards)
    velocity = speed * np.stack([np.cos(rate * m.t), np.sin(rate * m.t), 0.0 * m.t], axis=-1)
    gnss = Measurements(m.t[::20] + 0.11, velocity[::20], np.full(len(m.t[::20]), 0.1))
    wind = Measurements(m.t[::10], np.full(len(m.t[::10]), speed))
    off = {}
    for name, aids in (("airspeed", Aids(velocity=gnss, airspeed=wind)), ("gnss", Aids(velocity=gnss))):
        for forward in ("on", "off"):
            e = estimate("gsf", m.t, m.gyr, m.acc, aids=aids, q0=m.q[0], forward=forward)
            off[name, forward] = tilt_deg(e.q, m.q)[-1]
    assert off["airspeed", "on"] < 1.0
    assert off["gnss", "on"] < 1.0
    assert off["airspeed", "off"] > 5.0


def test_a_bias_is_learnt_at_rest_about_the_vertical_too() -> None:
    m = dash(0.0, noise=Noise(bias=(0.004, -0.006, 0.01)))
    aids = fixes(m)
    e = found(m, Aids(velocity=aids.velocity, at_rest=np.array([[0.0, 3.5]])))
    assert e.bias is not None
    np.testing.assert_allclose(e.bias[340], (0.004, -0.006, 0.01), atol=1e-4)
    without = found(m, aids)
    assert without.bias is not None
    assert abs(without.bias[340, 2]) < 1e-4


def test_one_hypothesis_is_a_dense_kalman_filter() -> None:
    """Random steps and fixes against matrices: F = I + dv/dpsi, P of (v_N, v_E, psi), z = v."""
    random = np.random.default_rng(1)
    e = get("gsf")
    params = e.pack({p.name: p.default for p in e.parameters} | {"gyro_noise": 3.0, "acc_noise": 0.4})
    state = np.zeros(e.state_size)
    state[0] = 1.0
    bank.begin_hypotheses(state, 2.0, -1.0, 0.09)
    for i in range(bank.N):
        x, p = np.array([2.0, -1.0, state[bank.S.x + i]]), np.diag([0.09, 0.09, (np.pi / 5) ** 2])
        for k in range(60):
            dv, dt = random.standard_normal(2), 0.01
            bank.predict_hypothesis(state, params, i, dv[0], dv[1], dt)
            turned = Rotation.from_rotvec([0.0, 0.0, x[2]]).apply([*dv, 0.0])[:2]
            f = np.eye(3)
            f[:2, 2] = -turned[1], turned[0]
            x[:2] += turned
            p = f @ p @ f.T + np.diag([0.16, 0.16, np.deg2rad(3.0) ** 2]) * dt
            if k % 5 == 4:
                z, r = x[:2] + (8.0 if k == 29 else 0.3) * random.standard_normal(2), 0.25
                s = p[:2, :2] + r * np.eye(2)
                y = z - x[:2]
                nis = y @ np.linalg.solve(s, y)
                y, nis = (y * np.sqrt(25.0 / nis), 25.0) if nis > 25.0 else (y, nis)
                density = np.exp(-0.5 * nis) / (2.0 * np.pi * np.sqrt(np.linalg.det(s)))
                assert bank.correct_hypothesis(state, i, z[0], z[1], r) == pytest.approx(density, rel=1e-9)
                gain = p[:, :2] @ np.linalg.inv(s)
                x, p = x + gain @ y, p - gain @ s @ gain.T
        at = bank.S.P + 6 * i
        np.testing.assert_allclose(state[bank.S.v + 2 * i : bank.S.v + 2 * i + 2], x[:2], rtol=1e-9)
        assert rotation.wrap(state[bank.S.x + i] - x[2]) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(state[at : at + 6], p[np.triu_indices(3)], rtol=1e-7, atol=1e-12)


def test_parameters_come_from_the_log_of_either_firmware() -> None:
    def told(params: dict[str, float], forward: bool | None = None) -> dict[str, tuple[float | str, str]]:
        return get("gsf").resolve(log=LogFacts(params, LogInfo(forward=forward)))

    px4 = told({"EKF2_GPS_V_NOISE": 0.5, "EKF2_GPS_DELAY": 80.0}, False)
    assert (px4["velocity_noise"][0], px4["delay"][0], px4["weight_floor"][0]) == (0.5, 0.08, 1e-5)
    ardupilot = told({"EK3_VELNE_M_NSE": 0.3, "GPS1_DELAY_MS": 200.0}, True)
    assert (ardupilot["velocity_noise"][0], ardupilot["delay"][0], ardupilot["weight_floor"][0]) == (0.5, 0.2, 0.0)
    assert ardupilot["forward"] == ("on", "log")
    assert told({"EK3_VELNE_M_NSE": 0.7, "GPS_DELAY_MS": 0.0})["delay"][0] == 0.12
    assert told({"EK3_VELNE_M_NSE": 0.7})["velocity_noise"][0] == 0.7
    assert all(value[0] == px4[name][0] or name in ("velocity_noise", "delay") for name, value in told({}).items())


def test_gnss_is_needed_and_motion_too(samples: Path) -> None:
    m = dash(0.0)
    with pytest.raises(UsageError, match="gsf needs gnss, which was not given"):
        estimate("gsf", m.t, m.gyr, m.acc)
    with pytest.raises(
        UsageError, match="no GNSS motion told the heading: its sigma is 98 deg at the least, 15 are needed"
    ):
        run_rows(pipeline.prepare(samples / "copter_yaw_turns.bin"), ["gsf"])


def test_an_analysis_scores_nothing_before_motion_told_the_heading(samples: Path) -> None:
    """What follows is of one north with the truth: no offset is taken out."""
    case = pipeline.prepare(samples / "px4_steps.ulg")
    row = run_rows(case, ["gsf"])[0]
    assert row.errors is not None
    assert row.heading_offset_deg is None
    step = next(s for s in row.steps if s.name == "late_motion")
    assert step.applied
    e = row.errors
    imu = case.imus[""]
    aids, log = aids_of(case, ""), log_facts(case, "")
    own = estimate("gsf", imu.gyro.t, case.gyro_of(imu), imu.acc.x, dt=imu.dt, aids=aids, log=log)
    known = own.t[np.argmax(np.rad2deg(own.aux["sigma_heading"]) < 15.0)]
    assert known > 20.0
    assert e.t[e.scored].min() == pytest.approx(known, abs=0.1)
    assert np.median(np.abs(e.heading[e.scored])) < 2.0
    assert row.status == "ok"
