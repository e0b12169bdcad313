"""The autopilots' light filters follow what flew, are what their equations say, and take the log's gains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from attlog import pipeline
from attlog.core import rotation
from attlog.estimators import Aids, LogFacts, LogInfo, Measurements, estimate, get
from attlog.estimators.aids import SIZE, VEL_D, VEL_E, VEL_N
from attlog.estimators.filters import ap_dcm as dcm
from attlog.pipeline.config import Config
from attlog.pipeline.replay import run_rows
from attlog.testing import Motion, Noise, flight, motion, still, swing
from attlog.testing.motions import GRAVITY, heading_deg, tilt_deg, total_deg
from tests.conftest import few

Array = NDArray[np.float64]
NOISE = Noise(gyro=1e-3, acc=0.02, mag=1e-7, bias=(0.01, -0.008, 0.012))


def distance(path: Path, onboard: str, row: str, gyro_bias: str = "none") -> tuple[float, float]:
    """RMS tilt and heading difference in deg to an onboard attitude, as an analysis of the log compares them."""
    case = pipeline.prepare(path, Config(reference=f"onboard:{onboard}", gyro_bias=gyro_bias))  # type: ignore[arg-type]
    errors = run_rows(case, [row])[0].errors
    assert errors is not None
    use = errors.scored
    tilt, heading = (np.sqrt(np.mean(x[use] ** 2)) for x in (errors.tilt, errors.heading))
    return float(tilt), float(heading)


@pytest.mark.parametrize(
    ("name", "tilt", "heading", "wrong"),
    few(
        [
            ("copter_yaw_turns.bin", 0.1, 0.8, {"AHRS_RP_P=0.1": 0.3, "AHRS_RP_P=0.4": 0.2}),
            (
                "copter_steps_stabilize.bin",
                0.3,
                1.0,
                {"AHRS_RP_P=0.1": 0.8, "AHRS_GPS_GAIN=0": 0.8, "AHRS_GPS_USE=0": 0.8},
            ),
        ],
        1,
    ),
)
def test_ap_dcm_follows_the_autopilot_s_dcm(
    samples: Path, name: str, tilt: float, heading: float, wrong: dict[str, float]
) -> None:
    """AHR2 of logs that begin at power-up is DCM: with the log's gains the replay is it, with others it is not."""
    found = distance(samples / name, "AHR2", "ap_dcm")
    assert found[0] < tilt
    assert found[1] < heading
    for values, least in wrong.items():
        assert distance(samples / name, "AHR2", f"ap_dcm:{values}")[0] > least
    for other in ("mahony", "vqf", "madgwick"):
        assert distance(samples / name, "AHR2", other)[0] > 3 * found[0]


def test_ap_dcm_follows_in_heading_with_the_log_s_gain_only(samples: Path) -> None:
    path = samples / "copter_yaw_turns.bin"
    assert distance(path, "AHR2", "ap_dcm:AHRS_YAW_P=0.1")[1] > 1.5 > distance(path, "AHR2", "ap_dcm")[1]


@pytest.mark.parametrize(
    ("name", "onboard", "gyro_bias", "tilt", "heading"),
    [
        ("sitl/ardupilot/copter_wind_guided.bin", "AHR2", "none", 0.3, 1.0),
        ("sitl/ardupilot/copter_long.bin", "AHR2", "rest", 0.3, 1.0),
        ("sitl/ardupilot/copter_gps_loss.bin", "AHR2", "rest", 0.6, 1.0),
        ("sitl/ardupilot/plane_dcm.bin", "ATT", "none", 1.5, 2.5),
        ("logs/cases/copter_4.7dev_sitl_climb.BIN", "AHR2", "rest", 0.3, 0.5),
        ("logs/bin_copter_4.7dev_hand_isb_cut.bin", "AHR2", "rest", 0.4, 3.0),
    ],
)
def test_ap_dcm_follows_on_more_flights(
    corpus: Path, name: str, onboard: str, gyro_bias: str, tilt: float, heading: float
) -> None:
    found = distance(corpus / name, onboard, "ap_dcm", gyro_bias)
    assert found[0] < tilt
    assert found[1] < heading


def fixes(m: Motion, velocity: Array, every: int, offset: int = 0) -> Aids:
    """GNSS velocity (n, 3) at each n-th sample."""
    at = slice(every + offset, None, every)
    return Aids(velocity=Measurements(m.t[at], velocity[at]), at_rest=np.empty((0, 2)))


def straight_px4(m: Motion, velocity: Array | None, every: int, v: dict[str, float]) -> Array:
    """``attitude_estimator_q`` written down with scipy rotations: attitudes (n, 4)."""
    r = Rotation.from_quat(m.q[0], scalar_first=True)
    bias, a, last = np.zeros(3), np.zeros(3), None
    found = [m.q[0]]
    for k in range(1, len(m.t)):
        dt = m.t[k] - m.t[k - 1]
        if velocity is not None and k % every == 0:
            if last is not None:
                a = r.inv().apply((velocity[k] - last[1]) / (m.t[k] - last[0]))
            last = m.t[k], velocity[k]
        spin = np.linalg.norm(m.gyr[k])
        h = r.apply(m.mag[k])
        gain = min(spin / 0.873, 10.0) if spin > 0.873 else 1.0
        c = r.inv().apply([0.0, 0.0, -np.arctan2(h[1], h[0])]) * v["ATT_W_MAG"] * gain
        if v["ATT_ACC_COMP"] or 0.9 < np.linalg.norm(m.acc[k]) / GRAVITY < 1.1:
            u = m.acc[k] - a
            c = c + np.cross(r.inv().apply([0.0, 0.0, 1.0]), u / np.linalg.norm(u)) * v["ATT_W_ACC"]
        if spin < 0.175:
            bias = np.clip(bias + c * v["ATT_W_GYRO_BIAS"] * dt, -v["ATT_BIAS_MAX"], v["ATT_BIAS_MAX"])
        w = m.gyr[k] + bias + c
        r = r * Rotation.from_rotvec(w * dt)
        found.append(r.as_quat(scalar_first=True))
    return np.array(found)


@pytest.mark.parametrize("comp", few([0.0, 1.0], 1))
def test_px4_q_is_the_filter_written_down_plainly(comp: float) -> None:
    """In calm and in lively motion, so that every branch is taken; steps as the firmware orders them."""
    for m in (flight(20.0, noise=NOISE), motion(lambda t: (0.05 * np.sin(t), 0.0, 0.1), 20.0, noise=NOISE)):
        velocity = np.column_stack([np.sin(m.t), 2.0 * np.cos(0.7 * m.t), 0.3 * m.t])
        v = {"ATT_W_ACC": 0.3, "ATT_W_MAG": 0.2, "ATT_W_GYRO_BIAS": 0.5, "ATT_BIAS_MAX": 0.008, "ATT_ACC_COMP": comp}
        q = stepped("px4_q", m, v, velocity, 20)
        assert total_deg(q, straight_px4(m, velocity if comp else None, 20, v)).max() < 1e-6


def stepped(name: str, m: Motion, values: dict[str, float], velocity: Array, every: int) -> Array:
    """The attitudes (n, 4) of a filter's bare steps, one for each sample, a fix with every n-th."""
    e = get(name)
    assert e.start is not None
    assert e.step is not None
    params = e.pack({p.name: p.default for p in e.parameters} | values)
    state = e.start(params, m.acc[0], m.mag[0], m.q[0])
    found = [m.q[0]]
    for k in range(1, len(m.t)):
        aid = np.full(12, np.nan)
        aid[11] = 0.0
        if k % every == 0:
            aid[5:8] = velocity[k]
        e.step(state, params, m.t[k] - m.t[k - 1], m.gyr[k], m.acc[k], m.mag[k], aid)
        found.append(state[:4].copy())
    return np.array(found)


def straight_dcm(m: Motion, velocity: Array, every: int, p: float, yaw_p: float) -> Array:
    """DCM of a flying copter with compass and GNSS on a rotation matrix, in the order of this filter: (n, 3, 3)."""
    r = Rotation.from_quat(m.q[0], scalar_first=True).as_matrix()
    omega_i, omega_p, total, total_s = np.zeros(3), np.zeros(3), np.zeros(3), 0.0
    force, force_s, before, last = np.zeros(3), 0.0, None, None
    since = 1e9
    found = [r]
    for k in range(1, len(m.t)):
        dt = m.t[k] - m.t[k - 1]
        since += dt
        omega = m.gyr[k] + omega_i
        spin = np.rad2deg(np.linalg.norm(omega))
        gain = float(np.clip(spin / 50.0, 1.0, 10.0))
        a = r @ m.acc[k]
        h = (r @ m.mag[k])[:2]
        error = -r[2, 2] * h[1] / np.linalg.norm(h)
        moved = float(np.hypot(a[0], a[1]))
        loops = 400.0 / 10.0
        left = (1 - 0.97**loops) / (0.03 * loops)
        omega_yaw = error * gain * yaw_p * (0.2 * (4.5 - moved) if moved <= 4.0 else 0.1) * left
        if spin < 20.0:
            total[2] += error * 0.01 * dt
        force, force_s = force + a * dt, force_s + dt
        due = k % every == 0
        lost = since > 0.6 and not due
        if due or (lost and force_s >= 0.2):
            g = np.array([0.0, 0.0, -1.0])
            if due:
                since = 0.0
                if last is not None:
                    g = g + (velocity[k] - last) / (force_s * GRAVITY)
                last = velocity[k]
            seen = force / (force_s * GRAVITY)
            if due:
                seen, before = (seen if before is None else before), seen
            e = np.cross(seen / np.linalg.norm(seen), g / np.linalg.norm(g))
            e[2] *= abs(np.sin(np.arctan2(r[2, 1], r[2, 2]))) if due else 0.0
            e = r.T @ e
            omega_p = e * gain * p
            if spin < 20.0:
                total, total_s = total + e * 0.0087 * force_s, total_s + force_s
            if total_s >= 5.0:
                limit = np.deg2rad(0.5 / 60.0) * total_s
                omega_i, total, total_s = omega_i + np.clip(total, -limit, limit), np.zeros(3), 0.0
            force, force_s = np.zeros(3), 0.0
        w = omega + omega_p + np.array([0.0, 0.0, omega_yaw])
        r = r @ Rotation.from_rotvec(w * dt).as_matrix()
        found.append(r)
    return np.array(found)


def test_ap_dcm_is_the_filter_written_down_plainly() -> None:
    m = flight(30.0, noise=NOISE)
    velocity = np.column_stack([np.sin(m.t), 2.0 * np.cos(0.7 * m.t), 0.3 * np.sin(m.t)])
    q = stepped("ap_dcm", m, {"AHRS_RP_P": 0.3, "AHRS_YAW_P": 0.25}, velocity, 20)
    expected = Rotation.from_matrix(straight_dcm(m, velocity, 20, 0.3, 0.25)).as_quat(scalar_first=True)
    assert total_deg(q, expected).max() < 1e-6


def circle(seconds: float) -> tuple[Motion, Array]:
    """A coordinated turn of 20 m/s, 30 deg bank: specific force along the body's z all the time; and its velocity."""
    speed, bank = 20.0, np.deg2rad(30.0)
    rate = GRAVITY * np.tan(bank) / speed

    def acceleration(t: Array) -> Array:
        a = speed * rate
        return np.stack([-a * np.sin(rate * t), a * np.cos(rate * t), 0.0 * t], axis=-1)

    m = motion(lambda t: (bank, 0.0, rate * t), seconds, acceleration=acceleration)
    return m, np.stack([speed * np.cos(rate * m.t), speed * np.sin(rate * m.t), 0.0 * m.t], axis=-1)


def test_gnss_takes_the_acceleration_of_a_turn_out() -> None:
    m, velocity = circle(60.0)
    aids = fixes(m, velocity, 20)
    for row, none, without in (("ap_dcm", "ap_dcm:AHRS_GPS_GAIN=0", aids), ("px4_q:ATT_ACC_COMP=1",) * 2 + (None,)):
        taken = estimate(row, *m.sensors, aids=aids, q0=m.q[0]).q[3000:]
        left = estimate(none, *m.sensors, aids=without, q0=m.q[0]).q[3000:]
        assert tilt_deg(taken, m.q[3000:]).max() < 3.0
        assert tilt_deg(left, m.q[3000:]).max() > 10.0


@pytest.mark.parametrize("row", ["ap_dcm", "px4_q:ATT_ACC_COMP=1"])
def test_velocities_are_of_true_north_whatever_the_declination(row: str) -> None:
    """The same sensors where magnetic north lies 40 deg east: the flight, with its velocity, is turned by just that."""
    m, velocity = circle(40.0)
    angle = np.deg2rad(40.0)
    east = rotation.rotate(rotation.from_euler(0.0, 0.0, angle), velocity)
    plain = estimate(row, *m.sensors, aids=fixes(m, velocity, 20)).q
    other = estimate(row, *m.sensors, aids=fixes(m, east, 20), declination=40.0).q
    assert total_deg(rotation.turn_about_down(plain, angle), other).max() < 1e-6


def test_a_plane_takes_its_heading_from_the_course_without_a_compass_or_with_a_wrong_one() -> None:
    """20 m/s along 60 deg, seen from a start heading of 0; a compass 90 deg off is left while it is 45 deg off."""
    m = still(40.0, yaw=np.deg2rad(60.0))
    aids = fixes(m, np.tile(20.0 * np.array([np.cos(np.pi / 3), np.sin(np.pi / 3), 0.0]), (len(m.t), 1)), 20)
    wrong = rotation.rotate(rotation.from_euler(0.0, 0.0, 0.5 * np.pi), m.mag)
    for forward, mag, off in (("on", None, 1.0), ("on", wrong, 60.0), ("off", wrong, np.inf)):
        q = estimate("ap_dcm", m.t, m.gyr, m.acc, mag, aids=aids, forward=forward).q
        left = abs(float(heading_deg(q[-1:], m.q[-1:])[0]))
        assert left < off
        assert off < np.inf or left > 80.0


def test_gains_are_raised_for_20_s_on_the_ground_only() -> None:
    """20 deg off: 8 times the gain brings it back in a second, at rest; in the air, or later, it takes seven."""
    m = still(6.0)
    q0 = rotation.multiply(m.q[0], rotation.from_rotvec((0.35, 0.0, 0.0)))
    rest, air = Aids(at_rest=np.array([[0.0, 6.0]])), Aids(at_rest=np.empty((0, 2)))
    left = {}
    for aids in (rest, air):
        for fast in (20.0, 0.0):
            q = estimate("ap_dcm", *m.sensors, q0=q0, aids=aids, fast_gains_s=fast).q
            left[aids is rest, fast] = tilt_deg(q[-1:], m.q[-1:])[0]
    assert left[True, 20.0] < 0.1
    assert min(left[True, 0.0], left[False, 20.0]) > 5.0


def test_the_compass_can_be_switched_off() -> None:
    m = swing(30.0, yaw=1.0, noise=NOISE)
    q0 = rotation.turn_about_down(m.q[0], 0.5)
    off = {
        use: heading_deg(estimate("ap_dcm", *m.sensors, q0=q0, COMPASS_USE=use).q[-1:], m.q[-1:])[0]
        for use in (0.0, 1.0)
    }
    assert abs(off[1.0]) < 10.0
    assert off[0.0] > 25.0
    assert total_deg(
        estimate("ap_dcm", m.t, m.gyr, m.acc, q0=q0).q, estimate("ap_dcm", *m.sensors, q0=q0, COMPASS_USE=0.0).q
    ).max() == pytest.approx(0.0, abs=1e-9)


def test_parameters_come_from_the_log_under_their_own_names() -> None:
    log = LogFacts(
        {
            "AHRS_RP_P": 0.13,
            "AHRS_YAW_P": 0.01,
            "AHRS_GPS_GAIN": 0.5,
            "COMPASS_DEC": 0.1,
            "COMPASS_USE": 0.0,
            "COMPASS_USE2": 0.0,
            "SCHED_LOOP_RATE": 300.0,
            "ATT_W_ACC": 0.4,
            "ATT_MAG_DECL_A": 0.0,
            "ATT_MAG_DECL": 7.0,
        },
        LogInfo(declination_deg=3.0, mag_rate_hz=10.0, forward=True, since_boot_s=8.0),
    )
    values = get("ap_dcm").resolve(log=log)
    assert values["AHRS_RP_P"] == (0.13, "log")
    assert values["AHRS_YAW_P"] == (0.05, "log")  # the autopilot raises what is less
    assert values["AHRS_GPS_GAIN"] == (0.5, "log")
    assert values["AHRS_GPS_USE"] == (1.0, "default")
    assert values["COMPASS_USE"] == (0.0, "log")
    assert values["SCHED_LOOP_RATE"] == (300.0, "log")
    assert float(values["declination"][0]) == pytest.approx(np.rad2deg(0.1))
    assert values["forward"] == ("on", "log")
    assert values["fast_gains_s"] == (12.0, "log")
    values = get("px4_q").resolve(log=log)
    assert values["ATT_W_ACC"] == (0.4, "log")
    assert values["declination"] == (7.0, "log")
    bare = LogFacts({"COMPASS_DEC": 0.0, "ATT_MAG_DECL_A": 1.0, "ATT_MAG_DECL": 7.0}, LogInfo(3.0, mag_rate_hz=10.0))
    assert get("ap_dcm").resolve(log=bare)["declination"] == (3.0, "log")
    assert get("px4_q").resolve(log=bare)["declination"] == (3.0, "log")


@pytest.mark.parametrize(
    ("params", "place_deg", "used"),
    [
        ({"COMPASS_DEC": np.radians(12.0), "COMPASS_AUTODEC": 1.0}, 3.0, 3.0),  # kept from another place
        ({"COMPASS_DEC": np.radians(4.5), "COMPASS_AUTODEC": 1.0}, 3.0, 4.5),  # its map's value for this place
        ({"COMPASS_DEC": np.radians(12.0)}, 3.0, 3.0),  # the firmware's default
        ({"COMPASS_DEC": np.radians(12.0), "COMPASS_AUTODEC": 1.0}, None, 12.0),  # no fix: it stays
        ({"COMPASS_DEC": np.radians(12.0), "COMPASS_AUTODEC": 0.0}, 3.0, 12.0),
        ({"COMPASS_DEC": 0.0, "COMPASS_AUTODEC": 0.0}, 3.0, 0.0),
    ],
)
def test_dcm_takes_the_declination_that_the_autopilot_would(params, place_deg, used):
    facts = LogFacts(params, LogInfo(declination_deg=place_deg, mag_rate_hz=10.0))
    assert get("ap_dcm").values_of(facts, {"declination"})["declination"] == pytest.approx(used)


# ArduPilot's drift correction as a function of its state: no north is special, and the bias has its limit.

TILT = Rotation.from_euler("ZYX", [0.0, -0.2, 0.35])
FORCE = np.array([0.4, -1.1, -9.5])
"""Mean specific force, m/s^2, in the axes of a vehicle that looks north."""
BEFORE_M_S = np.array([9.0, 1.5, -0.4])
GPS_M_S = np.array([10.0, 2.5, -0.7])


def corrected(heading: float, fix: bool, forward: bool, gain: float = 1.0) -> np.ndarray:
    """State after one correction of a vehicle at a heading, its force and velocities turned with it."""
    turn = Rotation.from_euler("Z", heading)
    state = np.zeros(sum(dcm.STATE.values()))
    state[:4] = np.roll((turn * TILT).as_quat(), 1)
    state[dcm.S.force : dcm.S.force + 3] = 0.3 * turn.apply(FORCE)
    state[dcm.S.force_s], state[dcm.S.air], state[dcm.S.interval] = 0.3, 11.0, 0.2
    state[dcm.S.fix_age] = 0.0 if fix else dcm.NEVER
    state[dcm.S.velocity : dcm.S.velocity + 3] = turn.apply(BEFORE_M_S)
    state[dcm.S.lock] = 1.0 if fix else -1.0
    params = np.array([0.2, 0.2, gain, 1.0, 1.0, 400.0, float(forward), 0.0])
    aid = np.full(SIZE, np.nan)
    if fix:
        aid[[VEL_N, VEL_E, VEL_D]] = turn.apply(GPS_M_S)
    dcm.correct_tilt(state, params, 0.01, np.zeros(3), aid, fix, False, 1.0, 0.0)
    return state


def wanted(fix: bool, forward: bool, gain: float = 1.0) -> np.ndarray:
    """f x t in body axes: t is gravity less the change of velocity, in g."""
    velocity = GPS_M_S if fix else 11.0 * TILT.as_matrix()[:, 0]
    target = np.array([0.0, 0.0, -1.0])
    if fix or forward:
        target = target + gain * (velocity - BEFORE_M_S) / (0.3 * 9.80665)
    error = np.cross(FORCE, target) / np.linalg.norm(FORCE) / np.linalg.norm(target)
    return 0.2 * TILT.inv().apply(error)


@pytest.mark.parametrize("heading", [0.0, 0.9, -2.4])
@pytest.mark.parametrize(("fix", "forward"), [(True, False), (True, True), (False, True), (False, False)])
def test_the_correction_is_the_same_in_body_axes_whatever_the_heading(heading: float, fix: bool, forward: bool) -> None:
    state = corrected(heading, fix, forward)
    np.testing.assert_allclose(state[dcm.S.tilt : dcm.S.tilt + 3], wanted(fix, forward), atol=1e-9)
    velocity = GPS_M_S if fix else 11.0 * TILT.as_matrix()[:, 0]
    turned = Rotation.from_euler("Z", heading).apply(velocity)
    np.testing.assert_allclose(state[dcm.S.velocity : dcm.S.velocity + 3], turned, atol=1e-9)
    assert not state[dcm.S.force : dcm.S.force + 3].any()
    if fix:
        assert state[dcm.S.air] == pytest.approx(TILT.as_matrix()[:, 0] @ GPS_M_S)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("error", [1e-4, 0.9, -0.9])
def test_the_bias_is_learnt_in_slow_turns_after_five_seconds_up_to_its_limit(axis: int, error: float) -> None:
    vector = np.zeros(3)
    vector[axis] = error
    for spin, learns in ((np.radians(19.0), True), (np.radians(21.0), False)):
        state = np.zeros(sum(dcm.STATE.values()))
        state[dcm.S.force_s] = 1.0
        for _ in range(4):
            dcm.learn_bias(state, *vector, spin)
        assert not state[4:7].any()
        dcm.learn_bias(state, *vector, spin)
        limit = np.radians(0.5 / 60.0) * 5.0
        learnt = -np.clip(5.0 * 0.0087 * vector, -limit, limit) if learns else np.zeros(3)
        np.testing.assert_allclose(state[4:7], learnt, atol=1e-12)
        assert not state[dcm.S.drift : dcm.S.drift + 3].any() or not learns
        assert state[dcm.S.drift_s] == 0.0


@pytest.mark.parametrize(
    ("age", "every", "known"),
    [(0.59, 0.1, True), (0.61, 0.1, False), (2.9, 1.0, True), (3.1, 1.0, False), (3.9, 5.0, True), (4.1, 5.0, False)],
)
def test_fixes_are_lost_after_three_intervals_or_four_seconds(age: float, every: float, known: bool) -> None:
    state = np.zeros(sum(dcm.STATE.values()))
    state[dcm.S.fix_age], state[dcm.S.interval] = age, every
    assert dcm.has_gnss(state) is known
