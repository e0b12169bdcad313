"""The controller against closed forms, and its behaviour at limits."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from attlog.core import rotation
from attlog.simulate import controller
from attlog.simulate.controller import (
    ANGLE_INTEGRAL,
    CUT,
    ENGAGED,
    RATE_INTEGRAL,
    THRUST,
    Gains,
    LoopAxis,
    margins,
    rise_and_overshoot,
)
from attlog.simulate.guidance import BRAKING_M_S2, Guidance, _lean
from attlog.simulate.scenario import ROTOR_SIGNS, ROTOR_TURNS, Command, Controller, Vehicle
from tests.conftest import few
from tests.simulate.plant import authority, flown

HUANG = Gains.of(Controller())
SHARES = controller.mixer(ROTOR_SIGNS, ROTOR_TURNS)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def step_of(axis: int, degrees: float, gains: Gains, vehicle: Vehicle, seconds: float = 4.0) -> tuple:
    angles = np.zeros(3)
    angles[axis] = np.radians(degrees)
    t, q, out = flown(gains, LEVEL, rotation.from_euler(*angles), seconds, vehicle=vehicle)
    return t, rotation.to_euler(q)[:, axis] / np.radians(degrees), out


@pytest.mark.parametrize("axis", few([0, 1, 2], 1))
@pytest.mark.parametrize(
    ("lag", "gains"),
    [
        (0.025, HUANG),
        (0.04, dataclasses.replace(HUANG, angle_kp=(8.0, 8.0, 2.0), rate_ki=(0.1,) * 3, rate_kd=(0.006, 0.006, 0.0))),
    ],
)
def test_a_small_step_is_the_one_of_the_transfer_function(axis: int, lag: float, gains: Gains) -> None:
    vehicle = Vehicle(motor_lag_s=lag)
    t, y, _ = step_of(axis, 2.0, gains, vehicle)
    expected = LoopAxis(float(authority(vehicle)[axis]), lag, gains, axis).step(t)
    assert np.abs(y - expected).max() < 0.02
    rise, over = rise_and_overshoot(t, y)
    rise_expected, over_expected = rise_and_overshoot(t, expected)
    assert rise == pytest.approx(rise_expected, rel=0.02)
    assert over == pytest.approx(over_expected, abs=0.01)


@pytest.mark.parametrize("index", [0, 1, 2])
def test_the_default_gains_are_well_damped_on_the_default_vehicle(index: int) -> None:
    """The paper's for roll and pitch, ours for yaw; also with 4 ms more of delay, as a slow IMU has."""
    vehicle = Vehicle()
    for delay in (0.00125, 0.005):
        axis = LoopAxis(float(authority(vehicle)[index]), vehicle.motor_lag_s, HUANG, index, delay)
        found = margins(axis)
        assert found.phase_deg > 50.0
        assert found.gain > 4.0
        rise, over = rise_and_overshoot(t := np.linspace(0, 6, 6001), axis.step(t))
        assert 0.2 < rise < 0.7
        assert over < 0.05


def test_the_closed_loop_is_that_of_scipy_from_its_parts() -> None:
    signal = pytest.importorskip("scipy.signal")
    axis = LoopAxis(150.0, 0.03, HUANG, delay=0.0)
    kp, ki, kd = HUANG.rate_kp[0], HUANG.rate_ki[0], HUANG.rate_kd[0]
    k, i, f = HUANG.angle_kp[0], HUANG.angle_ki[0], 2 * math.pi * HUANG.derivative_hz
    # States: angle, rate, torque of the rotors, both integrals, low-passed rate for the derivative.
    a = np.zeros((6, 6))
    a[0, 1], a[1, 2] = 1.0, 150.0
    wanted = np.array([-k, 0, 0, 1.0, 0, 0])
    error = wanted - np.array([0, 1.0, 0, 0, 0, 0])
    u = kp * error + np.array([0, 0, 0, 0, 1.0, 0]) - kd * f * np.array([0, 1.0, 0, 0, 0, -1.0])
    a[2] = (u - np.array([0, 0, 1.0, 0, 0, 0])) / 0.03
    a[3, 0], a[4], a[5] = -i, ki * error, f * np.array([0, 1.0, 0, 0, 0, -1.0])
    b = np.array([0, 0, kp * k / 0.03, i, ki * k, 0])[:, None]
    t, y = signal.step((a, b, np.eye(1, 6), 0.0), T=np.linspace(0, 3, 601))
    np.testing.assert_allclose(axis.step(t), y, atol=1e-6)
    omega = 9.0
    exact = (np.eye(1, 6) @ np.linalg.solve(1j * omega * np.eye(6) - a, b)).item()
    assert axis.response(omega) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(("part", "stable"), few([(0.9, True), (1.1, False)], 1))
def test_the_gain_margin_is_where_the_nonlinear_loop_begins_to_swing(part: float, stable: bool) -> None:
    lag = 0.05
    vehicle = Vehicle(motor_lag_s=lag)
    slow = dataclasses.replace(HUANG, derivative_hz=8.0)
    found = margins(LoopAxis(float(authority(vehicle)[0]), lag, slow))
    ix, iy, iz = vehicle.inertia_kg_m2
    by = found.gain * part
    light = Vehicle(motor_lag_s=lag, inertia_kg_m2=(ix / by, iy / by, iz / by))
    _, y, _ = step_of(0, 1e-6, slow, light, seconds=1.2)
    early, late = (np.abs(np.diff(y[k : k + 80], 2)).max() for k in (160, 400))
    assert (late < early) == stable


def rotor(u: tuple[float, float, float], thrust: float, idle: float = 0.03) -> tuple[np.ndarray, float, np.ndarray]:
    out, state = np.zeros(11), controller.new_controller_state()
    out[7:10] = u
    given = controller.mix(out, 4, SHARES, thrust, idle, state)
    return out[:4], given, state[CUT : CUT + 3]


def test_the_mixer_gives_what_was_asked_for() -> None:
    rng = np.random.default_rng(1)
    inverse = np.linalg.pinv(np.column_stack([SHARES, np.ones(4)]))
    for _ in range(200):
        u, thrust = tuple(rng.uniform(-0.2, 0.2, 3)), rng.uniform(0.35, 0.65)
        shares, given, cut = rotor(u, thrust)
        np.testing.assert_allclose(inverse @ shares, [*u, thrust], atol=1e-12)
        assert given == thrust
        assert not cut.any()


def test_rotors_turn_the_body_to_where_the_torque_points() -> None:
    place = np.column_stack([np.array(ROTOR_SIGNS), np.zeros(4)])
    for axis in range(3):
        u = [0.0, 0.0, 0.0]
        u[axis] = 0.2
        shares, _, _ = rotor((u[0], u[1], u[2]), 0.5)
        torque = np.cross(place, np.column_stack([np.zeros((4, 2)), -shares])).sum(axis=0)
        torque[2] += 0.1 * shares @ np.array(ROTOR_TURNS)
        assert torque[axis] > 0.01
        assert np.abs(np.delete(torque, axis)).max() < 1e-12


def test_at_its_limits_the_mixer_gives_up_yaw_then_thrust_and_roll_and_pitch_last() -> None:
    rng = np.random.default_rng(2)
    inverse = np.linalg.pinv(np.column_stack([SHARES, np.ones(4)]))
    seen = set()
    for _ in range(2000):
        u, thrust = tuple(rng.uniform(-1.0, 1.0, 3)), rng.uniform(0.0, 1.2)
        shares, given, cut = rotor(u, thrust)
        assert shares.min() >= 0.03 - 1e-12
        assert shares.max() <= 1.0 + 1e-12
        roll, pitch, yaw, _ = inverse @ shares
        # Roll and pitch keep their direction, whole while the rotors can span them.
        fits = abs(u[0]) + abs(u[1]) <= 0.97
        scale = 1.0 if fits else 0.97 / (abs(u[0]) + abs(u[1]))
        np.testing.assert_allclose([roll, pitch], [scale * u[0], scale * u[1]], atol=1e-9)
        assert -1e-9 <= yaw / u[2] <= 1.0 + 1e-9
        assert cut[0] == (0.0 if fits else np.sign(u[0]))
        if cut[2] == 0.0:
            assert yaw == pytest.approx(u[2], abs=1e-9)
        assert given == pytest.approx(shares.mean())
        seen.add((fits, bool(cut[2]), abs(given - thrust) > 1e-9))
    assert len(seen) >= 5


def test_integrals_stop_where_the_command_is_limited() -> None:
    packed, state, out = HUANG.pack(), controller.new_controller_state(), np.zeros(11)
    far = rotation.from_euler(1.4, 0.0, 0.0)
    for _ in range(4000):
        controller.control(state, packed, LEVEL, np.zeros(3), np.array([*far, 0.4, 1.0]), SHARES, 0.0025, out)
    assert out[4] == pytest.approx(HUANG.rate_limit[0])
    assert state[ANGLE_INTEGRAL] == 0.0
    # The rate error of 3.8 rad/s asks for half of the torque; its integral goes to its own limit and no further.
    assert state[RATE_INTEGRAL] == pytest.approx(HUANG.rate_part[0])
    strong = dataclasses.replace(HUANG, rate_kp=(0.5, 0.5, 0.4)).pack()
    state = controller.new_controller_state()
    for _ in range(4000):
        controller.control(state, strong, LEVEL, np.zeros(3), np.array([*far, 0.4, 1.0]), SHARES, 0.0025, out)
    assert out[7] == 1.0
    assert state[RATE_INTEGRAL] < 0.001


@pytest.mark.parametrize("degrees", few([120.0, 179.0], 1))
def test_it_comes_back_from_any_angle(degrees: float) -> None:
    rng = np.random.default_rng(int(degrees))
    axis = rng.standard_normal(3)
    q0 = rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis))
    _, q, _ = flown(HUANG, q0, LEVEL, 5.0)
    assert np.degrees(rotation.total_angle(rotation.earth_error(q[-1], LEVEL))) < 1.0


def test_the_error_of_one_axis_is_the_difference_of_its_angles() -> None:
    for axis in range(3):
        for degrees in (-170.0, -30.0, 1e-4, 90.0, 175.0):
            angle = np.zeros(3)
            angle[axis] = np.radians(degrees)
            q = rotation.from_rotvec(angle)
            np.testing.assert_allclose(controller.angle_error(LEVEL, q), angle, atol=1e-9)
            np.testing.assert_allclose(controller.angle_error(LEVEL, -q), angle, atol=1e-9)
            np.testing.assert_allclose(controller.angle_error(q, LEVEL), -angle, atol=1e-9)


def test_the_error_turns_the_thrust_axis_the_shortest_way() -> None:
    rng = np.random.default_rng(4)
    for q, wanted in rotation.normalize(rng.standard_normal((300, 2, 4))):
        x, y, heading = controller.angle_error(q, wanted)
        tilt = rotation.from_rotvec(np.array([x, y, 0.0]))
        reached = rotation.multiply(q, rotation.multiply(tilt, rotation.from_rotvec(np.array([0.0, 0.0, heading]))))
        assert rotation.total_angle(rotation.earth_error(reached, wanted)) < 1e-7
        axes = rotation.rotate(np.stack([q, wanted]), np.array([0.0, 0.0, 1.0]))
        assert math.hypot(x, y) == pytest.approx(math.acos(np.clip(axes[0] @ axes[1], -1, 1)), abs=1e-6)
    upside = rotation.from_euler(np.pi, 0.0, 0.0)
    assert math.hypot(*controller.angle_error(LEVEL, upside)) == pytest.approx(np.pi)


def test_compiled_it_is_the_plain_function(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    plain, fast = controller.new_controller_state(), controller.new_controller_state()
    packed, out, out_fast = HUANG.pack(), np.zeros(11), np.zeros(11)
    for _ in range(300):
        q, wanted = rotation.normalize(rng.standard_normal((2, 4)))
        rate, command = 3.0 * rng.standard_normal(3), np.array([*wanted, rng.uniform(0, 1), 1.0])
        controller.control.function(plain, packed, q, rate, command, SHARES, 0.0025, out)
        controller.control(fast, packed, q, rate, command, SHARES, 0.0025, out_fast)
        np.testing.assert_allclose(out_fast, out, atol=1e-12)
    np.testing.assert_allclose(fast, plain, atol=1e-12)


# Set-points from commands, by closed forms and without a simulator.

G, HOVER, DT = 9.81, 0.43, 0.0025
LEVEL_ATTITUDE, NOWHERE = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
UP = (Command(t=0.0, do="arm"), Command(t=0.0, do="takeoff", up_m=0.0))


def after(
    *commands: Command,
    seconds: float,
    placed: bool = True,
    p: np.ndarray = NOWHERE,
    v: np.ndarray = NOWHERE,
    q: np.ndarray = LEVEL_ATTITUDE,
) -> Guidance:
    """The guidance of a vehicle that is held where it is, ``seconds`` later."""
    made = Guidance((*UP, *commands), Controller(), HOVER, G)
    for k in range(round(seconds / DT) + 1):
        made.step(k * DT, DT, q, p, v, placed)
    return made


def wanted(made: Guidance) -> np.ndarray:
    return np.degrees(rotation.to_euler(made.command[:4]))


def test_the_lean_points_the_thrust_where_the_acceleration_is() -> None:
    rng = np.random.default_rng(1)
    for north, east, heading in zip(*rng.uniform(-2.5, 2.5, (3, 100)), strict=True):
        roll, pitch = _lean(north, east, G + 1.0, heading, 60.0)
        thrust = rotation.rotate(rotation.from_euler(roll, pitch, heading), np.array([0.0, 0.0, -1.0]))
        np.testing.assert_allclose(thrust / -thrust[2], [north / (G + 1.0), east / (G + 1.0), -1.0], atol=1e-12)


def test_the_lean_is_limited_and_keeps_its_direction() -> None:
    roll, pitch = _lean(30.0, 40.0, G, 0.3, 35.0)
    thrust = rotation.rotate(rotation.from_euler(roll, pitch, 0.3), np.array([0.0, 0.0, -1.0]))
    assert math.degrees(math.acos(-thrust[2])) == pytest.approx(35.0)
    assert math.atan2(thrust[1], thrust[0]) == pytest.approx(math.atan2(40.0, 30.0))


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_tracking_is_the_wave_that_was_asked_for(axis: str) -> None:
    index = ("roll", "pitch").index(axis)
    for shape, seconds, angle in (
        ("sine", 0.5, 10.0),
        ("sine", 1.0, 0.0),
        ("sine", 1.5, -10.0),
        ("square", 0.3, 10.0),
        ("square", 1.3, -10.0),
    ):
        wave = Command(t=1.0, do="track", axis=axis, shape=shape, amplitude_deg=10.0, period_s=2.0)
        found = wanted(after(wave, seconds=1.0 + seconds))
        assert found[index] == pytest.approx(angle, abs=0.02)
        assert found[1 - index] == pytest.approx(0.0, abs=1e-9)


def test_an_attitude_command_counts_in_the_heading_it_has() -> None:
    east = rotation.from_euler(0.0, 0.0, np.pi / 2)
    found = wanted(after(Command(t=1.0, do="attitude", roll_deg=12.0, pitch_deg=-7.0), seconds=1.1, q=east))
    assert found == pytest.approx([12.0, -7.0, 90.0])


def test_the_heading_turns_at_its_rate_the_shorter_way() -> None:
    start = rotation.from_euler(0.0, 0.0, np.radians(170.0))
    turn = Command(t=1.0, do="hold", heading_deg=-160.0, yaw_rate_dps=20.0)
    assert wanted(after(turn, seconds=1.25, q=start))[2] == pytest.approx(175.0, abs=0.1)
    assert wanted(after(turn, seconds=2.0, q=start))[2] == pytest.approx(-170.0, abs=0.1)
    assert wanted(after(turn, seconds=4.0, q=start))[2] == pytest.approx(-160.0, abs=0.1)


def test_the_point_that_is_followed_gathers_speed_gently() -> None:
    made = after(Command(t=1.0, do="goto", north_m=100.0, speed_m_s=4.0), seconds=3.0)
    assert made._path[0] == pytest.approx(0.5 * BRAKING_M_S2 * 2.0**2, rel=0.01)
    made = after(Command(t=1.0, do="goto", north_m=5.0, speed_m_s=4.0), seconds=15.0)
    assert made._path == pytest.approx([5.0, 0.0], abs=0.01)


def test_the_weight_is_carried_also_tilted_and_rotors_stand_unless_armed() -> None:
    made, tilted = after(seconds=3.0), rotation.from_euler(np.radians(40.0), 0.0, 0.0)
    assert (wanted(made), made.command[ENGAGED]) == (pytest.approx([0.0, 0.0, 0.0], abs=1e-9), 1.0)
    assert made.command[THRUST] == pytest.approx(HOVER)
    assert after(seconds=0.5, q=tilted).command[THRUST] == pytest.approx(HOVER / math.cos(math.radians(40.0)))
    made = after(Command(t=1.0, do="disarm"), seconds=1.1)
    assert (made.armed, made.command[ENGAGED]) == (False, 0.0)
    state, out = np.full(controller.STATE_SIZE, 0.3), np.full(11, 0.3)
    controller.control(state, HUANG.pack(), LEVEL, np.ones(3), np.array([*LEVEL, 0.5, 0.0]), SHARES, 0.0025, out)
    assert not state.any()
    assert not out.any()


def test_without_a_position_it_asks_for_level() -> None:
    moving = np.array([3.0, -2.0, 0.0])
    far = Command(t=1.0, do="goto", north_m=100.0)
    assert wanted(after(far, seconds=3.0, placed=False, v=moving)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert wanted(after(far, seconds=3.0, v=moving))[1] != pytest.approx(0.0, abs=1.0)


def test_it_has_landed_when_it_does_not_sink_any_more_and_disarms_itself() -> None:
    sinking, landing = np.array([0.0, 0.0, 0.5]), Command(t=1.0, do="land")
    assert not after(landing, seconds=6.0, v=sinking).landed
    made = after(landing, seconds=3.0)
    assert (made.landed, made.armed, made.mode) == (True, True, "LAND")
    assert not after(landing, seconds=6.0).armed


def test_what_has_not_begun_to_sink_has_not_landed() -> None:
    """For 0.9 s after the command it still stands in the air; on the ground it is landed after 0.6 s."""
    made = after(seconds=3.0)
    made._commands += (Command(t=3.0, do="land"),)
    for k in range(round(4.0 / DT)):
        t = 3.0 + k * DT
        sinking = 0.9 <= t - 3.0 < 2.0
        made.step(t, DT, LEVEL_ATTITUDE, NOWHERE, np.array([0.0, 0.0, 0.5 if sinking else 0.0]), True)
        assert made.landed == (t - 3.0 > 2.0 + 0.6 + DT) or abs(t - 5.6) < 3 * DT
