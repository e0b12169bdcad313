"""The rigid body against closed forms: energy, momentum, tops, projectiles, hover, motor lag, rest on the ground."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

from attlog.simulate.rigid_body import ANGLE, ROTOR, Body, P, Q, V, W
from attlog.simulate.scenario import Vehicle

Array = NDArray[np.float64]
H = 5e-4
STILL = np.zeros(3)
FREE = Vehicle(
    inertia_kg_m2=(0.01, 0.02, 0.025),
    drag_n_s_m=(0, 0, 0),
    drag_area_m2=(0, 0, 0),
    damping_n_m_s=(0, 0, 0),
    rotor_inertia_kg_m2=0.0,
)
"""Nothing but its inertia: no air, rotors without inertia."""


def body(vehicle: Vehicle = FREE, gravity: float = 9.81, density: float = 1.2, **state: Any) -> Body:
    """A body 1 km up with a state of one's own."""
    one = Body(vehicle, gravity, density)
    one.state[:] = 0.0
    one.state[P + 2], one.state[Q] = -1000.0, 1.0
    for name, value in state.items():
        at = {"p": P, "v": V, "q": Q, "w": W, "rotor": ROTOR}[name]
        one.state[at : at + len(value)] = value
    return one


def run(one: Body, seconds: float, command: Any = (0, 0, 0, 0), wind: Array = STILL) -> tuple[Array, Array]:
    """States (n, 49) and raw rows (n, 17) at the end of each step."""
    n = round(seconds / H)
    states, raws = np.zeros((n, len(one.state))), np.zeros((n, 17))
    raw = np.zeros((1, 17))
    for k in range(n):
        one.advance(np.asarray(command, float), wind, H, raw)
        states[k], raws[k] = one.state, raw[0]
    return states, raws


def turned(q: Array) -> Rotation:
    """scipy's rotation of attlog's quaternions."""
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def test_a_free_asymmetric_top_keeps_energy_and_angular_momentum_in_space() -> None:
    inertia = np.array(FREE.inertia_kg_m2)
    one = body(gravity=0.0, w=(3.0, 7.0, -5.0), v=(1.0, 2.0, 3.0))
    states, _ = run(one, 20.0)
    w = states[:, W : W + 3]
    energy = 0.5 * np.sum(inertia * w * w, axis=1)
    momentum = turned(states[:, Q : Q + 4]).apply(inertia * w)
    assert np.ptp(energy) / energy[0] < 1e-9
    assert np.ptp(momentum, axis=0).max() / np.linalg.norm(momentum[0]) < 1e-8
    assert np.ptp(states[:, V : V + 3], axis=0).max() < 1e-12


def test_an_asymmetric_top_turns_as_jacobis_elliptic_functions_say() -> None:
    """Landau and Lifshitz, Mechanics, paragraph 37: I1 < I2 < I3, M^2 > 2 E I2, w2 = 0 at the start."""
    i1, i2, i3 = FREE.inertia_kg_m2
    w1, w3 = 1.5, 6.0
    e2, m2 = i1 * w1**2 + i3 * w3**2, (i1 * w1) ** 2 + (i3 * w3) ** 2
    assert m2 > e2 * i2
    speed = math.sqrt((i3 - i2) * (m2 - e2 * i1) / (i1 * i2 * i3))
    k2 = (i2 - i1) * (e2 * i3 - m2) / ((i3 - i2) * (m2 - e2 * i1))
    states, _ = run(body(gravity=0.0, w=(w1, 0.0, w3)), 3.0 * 4.0 * float(ellipk(k2)) / speed)
    t = H * np.arange(1, len(states) + 1)
    sn, cn, dn, _ = ellipj(speed * t, k2)
    want = np.column_stack(
        [
            math.sqrt((e2 * i3 - m2) / (i1 * (i3 - i1))) * cn,
            math.sqrt((e2 * i3 - m2) / (i2 * (i3 - i2))) * sn,
            math.sqrt((m2 - e2 * i1) / (i3 * (i3 - i1))) * dn,
        ]
    )
    assert np.abs(states[:, W : W + 3] - want).max() < 1e-7


def test_spinning_rotors_turn_a_body_like_a_gyroscope() -> None:
    """Rotor momentum h about z and none of the body's: w' = -w x h / I, a turn of (wx, wy) at the rate h / I."""
    vehicle = dataclasses.replace(
        FREE, inertia_kg_m2=(0.02, 0.02, 0.02), rotor_inertia_kg_m2=1e-4, motor_lag_s=1e9, thrust_max_n=1e-9
    )
    one = body(vehicle, gravity=0.0, w=(0.5, 0.0, 0.0), rotor=(800.0, 800.0, 0.0, 0.0))
    states, _ = run(one, 2.0)
    # The first two rotors turn anticlockwise seen from above: their momentum points up, against body down.
    rate = -2 * 800.0 * 1e-4 / 0.02
    t = H * np.arange(1, len(states) + 1)
    assert np.abs(states[:, W] - 0.5 * np.cos(rate * t)).max() < 1e-6
    assert np.abs(states[:, W + 1] - 0.5 * np.sin(rate * t)).max() < 1e-6


def test_rotors_that_speed_up_turn_the_body_the_other_way() -> None:
    """Without drag torque the momentum of body and rotors about the yaw axis stays zero."""
    vehicle = dataclasses.replace(FREE, rotor_inertia_kg_m2=1e-4, torque_m=0.0)
    states, _ = run(body(vehicle, gravity=0.0), 0.3, (0.5, 0.5, 0.0, 0.0))
    gained = states[:, ROTOR : ROTOR + 2].sum(axis=1) * 1e-4
    assert np.abs(states[:, W + 2] - gained / 0.025).max() < 1e-6


def test_a_projectile_without_air_falls_on_a_parabola() -> None:
    states, raw = run(body(v=(5.0, -3.0, -20.0)), 4.0)
    t = H * np.arange(1, len(states) + 1)[:, None]
    want = np.array([0.0, 0.0, -1000.0]) + t * [5.0, -3.0, -20.0] + 0.5 * t**2 * [0.0, 0.0, 9.81]
    assert np.abs(states[:, :3] - want).max() < 1e-8
    assert np.abs(raw[:, 6:9]).max() < 1e-12  # free fall: an accelerometer feels nothing


def test_a_falling_body_approaches_the_terminal_velocity_of_quadratic_drag() -> None:
    vehicle = dataclasses.replace(FREE, drag_area_m2=(0.0, 0.0, 0.05))
    terminal = math.sqrt(vehicle.mass_kg * 9.81 / (0.5 * 1.2 * 0.05))
    states, _ = run(body(vehicle), 8.0)
    t = H * np.arange(1, len(states) + 1)
    assert np.abs(states[:, V + 2] - terminal * np.tanh(9.81 * t / terminal)).max() < 1e-8


def test_linear_drag_follows_the_wind_exponentially() -> None:
    vehicle = dataclasses.replace(FREE, drag_n_s_m=(0.6, 0.6, 0.6))
    states, _ = run(body(vehicle, gravity=0.0), 5.0, wind=np.array([4.0, -2.0, 1.0]))
    t = H * np.arange(1, len(states) + 1)[:, None]
    want = np.array([4.0, -2.0, 1.0]) * (1.0 - np.exp(-0.6 / vehicle.mass_kg * t))
    assert np.abs(states[:, V : V + 3] - want).max() < 1e-10


def test_the_hover_command_carries_the_weight() -> None:
    vehicle = dataclasses.replace(FREE, motor_lag_s=0.03)
    hover = vehicle.hover_command(9.81)
    speed = vehicle.speed_max_rad_s * math.sqrt(hover)
    states, raw = run(body(vehicle, rotor=(speed,) * 4), 2.0, (hover,) * 4)
    assert np.abs(states[:, V : V + 3]).max() < 1e-9
    assert np.abs(states[:, W : W + 3]).max() < 1e-12
    assert raw[-1, 8] == pytest.approx(-9.81, abs=1e-9)


def test_rotor_speed_follows_a_command_with_its_time_constant() -> None:
    vehicle = dataclasses.replace(FREE, motor_lag_s=0.04)
    states, raw = run(body(vehicle), 0.2, (0.25, 1.0, 0.0, 0.49))
    t = H * np.arange(1, len(states) + 1)[:, None]
    goal = vehicle.speed_max_rad_s * np.array([0.5, 1.0, 0.0, 0.7])
    want = goal * (1.0 - np.exp(-t / 0.04))
    assert np.abs(states[:, ROTOR : ROTOR + 4] - want).max() < 1e-9
    angle = goal * (t - 0.04 * (1.0 - np.exp(-t / 0.04)))
    assert np.abs(states[:, ANGLE : ANGLE + 4] - angle).max() < 1e-6
    assert np.array_equal(raw[:, 9:13], states[:, ROTOR : ROTOR + 4])


@pytest.mark.parametrize(
    ("rotors", "axis", "sign"),
    [((2, 1), 0, +1), ((0, 3), 0, -1), ((0, 2), 1, +1), ((1, 3), 1, -1), ((0, 1), 2, +1), ((2, 3), 2, -1)],
)
def test_more_thrust_on_two_rotors_turns_the_right_way(rotors: tuple[int, int], axis: int, sign: int) -> None:
    """Left pair: roll right; front pair: pitch up; the pair that turns anticlockwise: yaw right, by the third law."""
    command = np.full(4, 0.4)
    command[list(rotors)] = 0.6
    states, _ = run(body(), 0.3, command)
    w = states[-1, W : W + 3]
    assert w[axis] * sign > 0.01
    assert np.abs(np.delete(w, axis)).max() < 1e-9


def test_a_rotor_torque_has_the_size_that_thrust_and_arm_give() -> None:
    vehicle = dataclasses.replace(FREE, motor_lag_s=0.0)
    _, raw = run(body(vehicle), H, (0.5, 0.4, 0.4, 0.4))
    extra, side = 0.1 * vehicle.thrust_max_n, vehicle.arm_m / math.sqrt(2.0)
    want = np.array([-extra * side, extra * side, vehicle.torque_m * extra]) / np.array(vehicle.inertia_kg_m2)
    assert raw[0, 3:6] == pytest.approx(want, rel=1e-3)


def test_specific_force_is_acceleration_less_gravity_in_body_axes() -> None:
    one = body(Vehicle(), w=(2.0, -3.0, 1.0), v=(8.0, 1.0, -2.0))
    states, raw = run(one, 1.0, (0.5, 0.4, 0.45, 0.42), np.array([3.0, 0.0, 0.0]))
    a = np.gradient(states[:, V : V + 3], H, axis=0)
    felt = turned(states[:, Q : Q + 4]).inv().apply(a - [0.0, 0.0, 9.81])
    assert np.abs(felt - raw[:, 6:9])[200:-2].max() < 1e-3
    w_dot = np.gradient(raw[:, :3], H, axis=0)
    assert np.abs(w_dot - raw[:, 3:6])[2:-2].max() < 0.02


@pytest.mark.slow
def test_at_rest_on_its_feet_nothing_moves_even_in_wind() -> None:
    one = Body(Vehicle(), 9.81, 1.2, heading_rad=1.0)
    start = one.state[:10].copy()
    calm, raw = run(one, 10.0)
    assert np.abs(calm[:, :10] - start).max() < 1e-12
    assert np.abs(raw[:, :6]).max() < 1e-9
    assert np.abs(raw[:, 6:9] - [0, 0, -9.81]).max() < 1e-9
    windy, _ = run(one, 20.0, wind=np.array([6.0, -3.0, 0.5]))
    late = windy[20_000:]
    assert np.ptp(late[:, :10], axis=0).max() < 1e-9  # it leans a little and stays there: nothing creeps
    assert np.abs(windy[-1, :2] - start[:2]).max() < 2e-3


def test_a_body_that_is_dropped_comes_to_rest_on_its_feet() -> None:
    one = Body(Vehicle(), 9.81, 1.2)
    one.state[P + 2] -= 0.3
    one.state[V] = 0.5
    one.state[Q : Q + 4] = np.roll(Rotation.from_euler("xyz", [8, -5, 20], degrees=True).as_quat(), 1)
    states, raw = run(one, 4.0)
    assert np.abs(states[-1, V : V + 3]).max() < 1e-4
    assert np.abs(states[-1, W : W + 3]).max() < 1e-3
    assert states[-1, P + 2] == pytest.approx(-Vehicle().foot_m, abs=0.01)
    lifted = turned(states[-1, Q : Q + 4]).apply([0, 0, 1])
    assert lifted[2] > 0.9999
    energy = 0.5 * 1.5 * np.sum(states[:, V : V + 3] ** 2, axis=1) - 1.5 * 9.81 * states[:, P + 2]
    assert energy[-1] < energy[0]
    assert raw[:, 8].min() < -20.0  # the blow is felt


def test_friction_slows_a_sliding_body_by_its_coefficient() -> None:
    vehicle = dataclasses.replace(FREE, friction=0.4)
    one = Body(vehicle, 9.81, 1.2)
    one.state[V] = 3.0
    states, _ = run(one, 2.0)
    sliding = states[200:1000, V]
    slope = np.polyfit(H * np.arange(len(sliding)), sliding, 1)[0]
    assert slope == pytest.approx(-0.4 * 9.81, rel=0.02)
    assert states[-1, P] == pytest.approx(9.0 / (2 * 0.4 * 9.81), rel=0.03)
    assert abs(states[-1, V]) < 1e-6
    assert states[:, P].max() - states[-1, P] < 0.0018  # friction's spring gives way, it does not throw back


def test_a_rotor_that_strikes_the_ground_breaks_and_stays_broken() -> None:
    one = Body(Vehicle(), 9.81, 1.2)
    one.state[P + 2] -= 1.0
    one.state[Q : Q + 4] = [0.0, 1.0, 0.0, 0.0]
    states, _ = run(one, 3.0, (0.3, 0.3, 0.3, 0.3))
    assert (states[-1, 45:49] > 0).any()
    dead = states[-1, 45:49] > 0
    assert np.abs(states[-1, ROTOR : ROTOR + 4][dead]).max() < 1.0


def test_the_compiled_body_is_the_plain_function_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, plain = (Body(Vehicle(), 9.81, 1.2) for _ in range(2))
    raws = [np.zeros((40, 17)) for _ in range(2)]
    for one, raw, jit in zip((compiled, plain), raws, ("0", "1"), strict=True):
        monkeypatch.setenv("ATTLOG_NO_JIT", jit)
        one.state[P + 2] -= 0.01
        one.state[W] = 2.0
        one.advance(np.array([0.5, 0.6, 0.4, 0.7]), np.array([3.0, -1.0, 0.2]), H, raw)
    assert compiled.state.tobytes() == plain.state.tobytes()
    assert raws[0].tobytes() == raws[1].tobytes()
