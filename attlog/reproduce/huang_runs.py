"""Huang's experiments for one seed: hover, returns to level and tracking on any filter; cost, compiled and in numpy.

The flight is the same for every row but for its filter. A filter is measured twice: in the loop, and over the samples
of one flight.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators.start import start_attitude
from attlog.reproduce import bench
from attlog.reproduce.bench import (
    AXES,
    COST_RATE_HZ,
    COST_ROUNDS,
    COST_UPDATES,
    CostSamples,
    FilterOutput,
    angles,
    cost_samples,
    flight_samples,
    overshoot_of,
    rise_s,
    rms,
    run_filter,
    time_updates,
)
from attlog.reproduce.paper import Measures
from attlog.simulate.controller import Gains, LoopAxis
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.onboard import TRUE_ATTITUDE
from attlog.simulate.scenario import Command, Controller, EstimatorChoice, Scenario, Vehicle, Wind
from attlog.simulate.sensor_settings import GnssSettings, ImuSettings, MagSettings, SensorSettings

Array = NDArray[np.float64]

RATE_HZ = 400.0
DCM, EKF = "mahony_dcm@huang", "ekf12@fan"
PASSIVE, NEW_EKF = "mahony_passive@huang", "mekf"
# Filters that the same flight is flown on.
FLOWN_ON = (DCM, TRUE_ATTITUDE, EKF, NEW_EKF)
# Filters in a table alone: the first seeds suffice.
BESIDE, BESIDE_SEEDS = (EKF, NEW_EKF), 5
# Filters over the samples of one flight.
ROWS = (DCM, PASSIVE, EKF, NEW_EKF)
WIND_M_S, MORE_WIND_M_S = 0.3, (1.0, 2.0)
HOVER = (15.0, 45.0)
WITHIN_DEG = 5.0
LEVELS = ((20.0, "roll"), (30.0, "pitch"), (45.0, "roll"))
# A return to level: tilted for a moment, then level, then back to the place.
LEVEL_AT, LEVEL_EVERY_S, TILTED_S, LEVEL_S = 45.0, 9.0, 0.8, 2.7
LEVEL_WITHIN_DEG = 2.0
# Amplitude in deg, period in s, axis.
TRACKS = ((15.0, 2.0, "roll"), (10.0, 1.0, "pitch"))
TRACK_AT, TRACK_EVERY_S, TRACK_S = 78.0, 12.0, 8.0
SECONDS = 98.0
# N s/m: with such drag a tilted vehicle does not gather speed, as on a stand.
STAND_DRAG = (30.0, 30.0, 30.0)
STAND_AT, STAND_EVERY_S = 12.0, 5.0


# Parts of a flight, s.
PHASES = {"hover": HOVER, "moving": (HOVER[1], np.inf)}
# Place of the returns to level on the stand, among the filters that are flown on.
STAND = "stand"


def huang_commands() -> tuple[Command, ...]:
    """Return take-off, hover, returns to level, tracking."""
    commands = [Command(t=2.0, do="arm"), Command(t=3.0, do="takeoff", up_m=10.0), Command(t=10.0, do="hold")]
    for k, (angle, axis) in enumerate(LEVELS):
        t = LEVEL_AT + k * LEVEL_EVERY_S
        commands += [*_level(t, angle, axis), Command(t=t + TILTED_S + LEVEL_S, do="hold")]
    for k, (size, period, axis) in enumerate(TRACKS):
        t = TRACK_AT + k * TRACK_EVERY_S
        commands += [
            Command(t=t, do="track", axis="roll" if axis == "roll" else "pitch", amplitude_deg=size, period_s=period),
            Command(t=t + TRACK_S, do="hold"),
        ]
    return tuple(commands)


def huang_scenario(estimator: str, wind: float = WIND_M_S, seconds: float = SECONDS) -> Scenario:
    """Return Huang's flight on a filter, or on ``truth``, in turbulence of ``wind`` m/s (1 sigma)."""
    return Scenario(
        name="huang",
        seconds=seconds,
        command=huang_commands(),
        estimator=EstimatorChoice(name=estimator),
        wind=Wind(turbulence_m_s=wind),
        sensors=SensorSettings(
            imu=(ImuSettings(rate_hz=RATE_HZ),), mag=(MagSettings(rate_hz=50.0),), gnss=(GnssSettings(rate_hz=5.0),)
        ),
    )


def huang_seed(seed: int) -> Measures:
    """Fly all flights of a seed.

    Measures of :func:`measure_flight` by the filter flown on, returns to level also of the STAND with RMS ``error`` of
    roll and pitch; ``hover`` and ``moving`` errors of filters over the samples of one flight (``replayed``) and
    between the DCM and the EKF (``apart``); ``windy``: largest true roll or pitch in hover by wind in m/s.
    """
    found: Measures = {}
    for estimator in FLOWN_ON:
        if estimator in BESIDE and seed >= BESIDE_SEEDS:
            continue
        flight = fly(huang_scenario(estimator), seed)
        found |= measure_flight(flight, estimator)
        if estimator == DCM:
            found |= replay_filters(flight)
    held = fly_stand(seed)
    output = _found(held)
    late = output.t >= STAND_AT
    found |= {("error", STAND, axis): rms(output.errors[late, axis]) for axis in (0, 1)}
    for k, level in enumerate(LEVELS):
        found |= _returned(held, (STAND, k), STAND_AT + k * STAND_EVERY_S, *level)
    return found | {("windy", wind): hover_extreme(seed, wind) for wind in MORE_WIND_M_S}


def fly_stand(seed: int, estimator: str = DCM) -> Flight:
    """Fly returns to level of a vehicle that cannot gather speed."""
    commands = [Command(t=2.0, do="arm"), Command(t=3.0, do="takeoff", up_m=1.5)]
    for k, (angle, axis) in enumerate(LEVELS):
        t = STAND_AT + k * STAND_EVERY_S
        commands += _level(t, angle, axis)
    seconds = STAND_AT + len(LEVELS) * STAND_EVERY_S
    free = huang_scenario(estimator, 0.0)
    held = replace(Vehicle(), drag_n_s_m=STAND_DRAG)
    return fly(free.changed(seconds=seconds, command=tuple(commands), vehicle=held), seed)


def replay_filters(flight: Flight) -> Measures:
    """Run all rows over the samples of a flight."""
    s = flight_samples(flight)
    outputs = {row: run_filter(row, s) for row in ROWS}
    dcm, ekf = outputs[DCM], outputs[EKF]
    found = _errors(FilterOutput(dcm.t, dcm.q, ekf.q), "apart", DCM)
    for row, one in outputs.items():
        found |= _errors(one, "replayed", row)
    return found


def hover_extreme(seed: int, wind: float) -> float:
    """Return the largest true roll or pitch in hover in turbulence of ``wind`` m/s."""
    flight = fly(huang_scenario(DCM, wind, HOVER[1]), seed)
    return float(np.abs(angles(flight.truth.q)[_between(flight.truth.t, *HOVER), :2]).max())


def measure_flight(flight: Flight, row: str) -> Measures:
    """Measure a flight on a filter.

    RMS ``flown`` errors by phase and axis (deg); in hover ``most``: largest true roll or pitch, ``spread`` of roll
    (deg), ``drift``: distance from the mean place (m); ``crashed``: it touched the ground; returns and sines by number.
    """
    truth = flight.truth
    hover = _between(truth.t, *HOVER)
    place = truth.p[hover] - truth.p[hover].mean(axis=0)
    level = angles(truth.q)[hover, :2]
    found = _errors(_found(flight), "flown", row)
    found["most", row] = float(np.abs(level).max())
    found["spread", row] = float(level[:, 0].std())
    found["drift", row] = float(np.hypot(place[:, 0], place[:, 1]).max())
    found["crashed", row] = float(truth.ground[truth.t > HOVER[0]].any())
    for k, one in enumerate(LEVELS):
        found |= _returned(flight, (row, k), LEVEL_AT + k * LEVEL_EVERY_S, *one)
    for k in range(len(TRACKS)):
        found |= _tracked(flight, (row, k), k)
    return found


def axis_of(index: int) -> LoopAxis:
    """Return the loop of roll (0) or pitch (1) as transfer functions of gains, rotors and inertia.

    The delay: half a period of the IMU's mean, half of the held command, one period until it acts.
    """
    vehicle, period = Vehicle(), 1.0 / RATE_HZ
    torque = 4.0 * 0.5 * vehicle.thrust_max_n * vehicle.arm_m / np.sqrt(2.0)
    authority = float(torque / vehicle.inertia_kg_m2[index])
    return LoopAxis(authority, vehicle.motor_lag_s, Gains.of(Controller()), index, delay=2.0 * period)


def microseconds(every: int = 1) -> dict[str, list[float]]:
    """Return microseconds for 4,000 updates of both filters, nine runs in turn; a field every ``every``-th."""
    spent = time_updates((DCM, EKF), every)
    return {row: [1e-3 * COST_UPDATES * ns for ns in found] for row, found in spent.items()}


def _between(t: Array, begin: float, end: float) -> NDArray[np.bool_]:
    return np.asarray((t >= begin) & (t < end))


def _errors(found: FilterOutput, what: str, row: str) -> Measures:
    """Return RMS errors (deg) by phase and axis."""
    return {
        (what, row, phase, axis): rms(found.errors[_between(found.t, *span), axis])
        for phase, span in PHASES.items()
        for axis in range(3)
    }


def _found(flight: Flight) -> FilterOutput:
    """Return the attitude that was flown on, with the truth at the same times."""
    truth, board = flight.truth, flight.onboard
    known = np.isfinite(board.q[:, 0])
    t = board.t[known]
    return FilterOutput(t, board.q[known], rotation.slerp(truth.t, truth.q, np.minimum(t, truth.t[-1])))


def _level(t: float, angle: float, axis: str) -> list[Command]:
    """Return a tilt from ``t`` on for a moment, then level."""
    tilted = Command(t=t, do="attitude", roll_deg=angle * (axis == "roll"), pitch_deg=angle * (axis == "pitch"))
    return [tilted, Command(t=t + TILTED_S, do="attitude")]


def _returned(flight: Flight, where: tuple[str, int], tilted_at: float, angle: float, axis: str) -> Measures:
    """Measure a return to level as the filter sees it.

    ``settling`` within 2 deg and ``fall`` from 90 to 10 % of the angle (s), ``overshoot`` beyond level (deg);
    ``left``: size of the true angle in the mean of the last second (deg).
    """
    since, found = tilted_at + TILTED_S, _found(flight)
    part = _between(found.t, since - 0.1, since + LEVEL_S)
    t, y = found.t[part], found.angles[part, AXES.index(axis)]
    true = angles(found.truth[part])[:, AXES.index(axis)]
    return {
        ("settling", *where): bench.settling_s(t, y, since, LEVEL_WITHIN_DEG),
        ("fall", *where): rise_s(t, y, since, float(np.interp(since, t, y)), 0.0),
        ("overshoot", *where): overshoot_of(t, y, since, angle, 0.0),
        ("left", *where): abs(float(true[t >= since + LEVEL_S - 1.0].mean())),
    }


def _tracked(flight: Flight, where: tuple[str, int], k: int) -> Measures:
    """Measure a tracked sine: ``delay`` (ms) and ``gain`` of the true angle's fundamental."""
    _, period, axis = TRACKS[k]
    begin = TRACK_AT + k * TRACK_EVERY_S
    # The first period is the start; whole periods after it.
    span = (begin + period, begin + period * int(TRACK_S / period))
    board, column = flight.onboard, AXES.index(axis)
    found, wanted = (
        _fundamental(t[_between(t, *span)] - begin, angles(q)[_between(t, *span), column], period)
        for t, q in ((flight.truth.t, flight.truth.q), (board.t, board.q_setpoint))
    )
    ratio = found / wanted
    return {
        ("delay", *where): float(-np.angle(ratio)) / (2.0 * np.pi) * period * 1e3,
        ("gain", *where): float(np.abs(ratio)),
    }


def _fundamental(t: Array, y: Array, period: float) -> complex:
    """Return the complex amplitude of a period in ``y``, beside a straight line."""
    w = 2.0 * np.pi / period
    columns = np.column_stack([np.cos(w * t), np.sin(w * t), np.ones_like(t), t])
    c, s, _, _ = np.linalg.lstsq(columns, y, rcond=None)[0]
    return complex(c, -s)


STEP_S = 1.0 / COST_RATE_HZ
MAHONY_KP, MAHONY_KI = 0.3, 0.01
# Noise of the EKF per sample: rad/s, rad/s, 1.
GYRO_NOISE, BIAS_NOISE, VECTOR_NOISE = 0.02, 1e-5, 0.3
DOWN = np.array([0.0, 0.0, 1.0])


def skew(v: Array) -> Array:
    """Return [v]x (3, 3) of a vector (3,)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def numpy_mahony(s: CostSamples, q0: Array) -> Array:
    """Return the rotation matrices (n, 3, 3), body to earth, of Huang 2.3.2 from ``q0`` (4,)."""
    r, bias, found = rotation.to_matrix(q0), np.zeros(3), np.empty((len(s.t), 3, 3))
    for k, (gyr, acc, mag) in enumerate(zip(s.gyr, s.acc, s.mag, strict=True)):
        field = r @ (mag / np.linalg.norm(mag))
        e = np.cross(-acc / np.linalg.norm(acc), r[2]) - field[1] * r[2]
        bias = bias - MAHONY_KI * STEP_S * e
        r = orthonormal(r + STEP_S * r @ skew(gyr - bias + MAHONY_KP * e))
        found[k] = r
    return found


def orthonormal(r: Array) -> Array:
    """Renormalise a matrix (3, 3) as Huang 2.3.1."""
    half = 0.5 * (r[0] @ r[1])
    x, y = r[0] - half * r[1], r[1] - half * r[0]
    x, y = 0.5 * (3.0 - x @ x) * x, 0.5 * (3.0 - y @ y) * y
    return np.array([x, y, np.cross(x, y)])


def numpy_ekf(s: CostSamples, q0: Array) -> Array:
    """Return the states [q, b] (n, 7) of a dense EKF from ``q0`` (4,).

    The textbook's, X = [q, b]:

        q'  = q (x) (0, w - b)/2,  F = [[I + dt Omega(w - b)/2, -dt Xi(q)/2], [0, I]]
        z   = [-f/|f|, m/|m|],     h = [R^T e_z, R^T m_n],  m_n the field's direction in earth axes

    and P = F P F^T + Q, K = P H^T (H P H^T + R)^-1, P = (I - K H) P.
    """
    x, p = np.concatenate([q0, np.zeros(3)]), np.diag([1e-2] * 4 + [1e-4] * 3)
    north = rotation.rotate(q0, s.mag[0] / np.linalg.norm(s.mag[0]))
    h, f, noise = np.zeros((6, 7)), np.eye(7), VECTOR_NOISE**2 * np.eye(6)
    walk = np.diag([(0.5 * STEP_S * GYRO_NOISE) ** 2] * 4 + [BIAS_NOISE**2] * 3)
    found = np.empty((len(s.t), 7))
    for k, (gyr, acc, mag) in enumerate(zip(s.gyr, s.acc, s.mag, strict=True)):
        turn = 0.5 * STEP_S * (gyr - x[4:])
        f[0, 1:4], f[1:4, 0], f[1:4, 1:4] = -turn, turn, np.eye(3) - skew(turn)
        f[0, 4:], f[1:4, 4:] = 0.5 * STEP_S * x[1:4], -0.5 * STEP_S * (x[0] * np.eye(3) + skew(x[1:4]))
        x[:4] = f[:4, :4] @ x[:4]
        p = f @ p @ f.T + walk
        seen, h[:3, :4] = turned_back(x[:4], DOWN)
        level, h[3:, :4] = turned_back(x[:4], north)
        z = np.concatenate([-acc / np.linalg.norm(acc), mag / np.linalg.norm(mag)])
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + noise)
        x = x + gain @ (z - np.concatenate([seen, level]))
        p = (np.eye(7) - gain @ h) @ p
        x[:4] /= np.linalg.norm(x[:4])
        found[k] = x
    return found


def turned_back(q: Array, v: Array) -> tuple[Array, Array]:
    """Return R^T v (3,) of a vector (3,) in earth axes, and its derivative by ``q`` (3, 4)."""
    w, u = q[0], q[1:]
    across = skew(u) @ v
    turned = (w * w - u @ u) * v + 2.0 * (u @ v) * u - 2.0 * w * across
    by_u = 2.0 * ((u @ v) * np.eye(3) + np.outer(u, v) - np.outer(v, u) + w * skew(v))
    return turned, np.column_stack([2.0 * (w * v - across), by_u])


def time_numpy(rounds: int = COST_ROUNDS, updates: int = 400, repeats: int = 3) -> tuple[list[float], list[float]]:
    """Return nanoseconds per update of both numpy filters, ``rounds`` times in turn, best of ``repeats``."""
    s = cost_samples(updates)
    q0 = start_attitude(s.acc[0], s.mag[0])
    spent: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for times, one in zip(spent, (numpy_mahony, numpy_ekf), strict=True):
            clocks = []
            for _ in range(repeats):
                clock = time.thread_time()
                one(s, q0)
                clocks.append(time.thread_time() - clock)
            times.append(1e9 * min(clocks) / updates)
    return spent
