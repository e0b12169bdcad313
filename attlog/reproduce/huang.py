"""Huang: Mahony's filter on the rotation matrix and a nested PI-PID controller, flown and timed.

The flight (hover, returns to level, tracking) is the same for every row but for its filter. A filter is measured twice:
in the loop, and over the samples of one flight.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators.start import start_attitude
from attlog.reproduce import bench
from attlog.reproduce.bench import (
    AXES,
    COST_METHOD,
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
    run_seeds,
    time_updates,
)
from attlog.reproduce.page import Span, curve_line, filter_lines
from attlog.reproduce.paper import (
    TRUTH_LINE,
    Claim,
    FigureLine,
    Measures,
    Paper,
    PaperFigure,
    PaperNumber,
    PaperOptions,
    PaperSetting,
    PaperTable,
    Seeds,
    above,
    below,
    combine_verdicts,
    mean,
    mean_text,
    put_first,
    ratio,
    settings,
    share_of_seeds,
    smallest_and_largest,
)
from attlog.simulate.controller import Gains, LoopAxis, margins, rise_and_overshoot
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.onboard import TRUE_ATTITUDE
from attlog.simulate.scenario import Command, Controller, EstimatorChoice, Scenario, Vehicle, Wind
from attlog.simulate.sensor_settings import GnssSettings, ImuSettings, MagSettings, SensorSettings
from attlog.words.numbers import number, quantity

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


PRINTED_MAHONY_S = (0.9995, 0.9880, 1.0023, 1.0029, 0.9851, 1.1822, 1.3897, 1.1918, 1.0115)
PRINTED_EKF_S = (1.8698, 1.8520, 1.8568, 2.2022, 2.0360, 1.9098, 2.1788, 2.4898, 1.8645)
FILTER_WORDS = {TRUE_ATTITUDE: "the true attitude", DCM: "Huang's filter", EKF: "Fan's EKF", NEW_EKF: "mekf"}


def times_table(spent: dict[str, list[float]]) -> PaperTable:
    """Return table 1 as printed and as measured here."""
    rows = [
        (str(k + 1), f"{a:.4f} s", f"{b:.4f} s", f"{b / a:.2f}", quantity(c, "us"), quantity(d, "us"), f"{d / c:.2f}")
        for k, (a, b, c, d) in enumerate(zip(PRINTED_MAHONY_S, PRINTED_EKF_S, spent[DCM], spent[EKF], strict=True))
    ]
    total = [float(np.mean(x)) for x in (PRINTED_MAHONY_S, PRINTED_EKF_S, spent[DCM], spent[EKF])]
    a, b, c, d = total
    rows.append(
        ("mean", f"{a:.4f} s", f"{b:.4f} s", f"{b / a:.2f}", quantity(c, "us"), quantity(d, "us"), f"{d / c:.2f}")
    )
    head = ("run", "paper: Mahony", "EKF", "ratio", "here: Mahony", "EKF", "ratio")
    return PaperTable(f"{COST_UPDATES:,} updates (table 1)", head, tuple(rows), "Here: a field at every update.")


def filter_table(found: Seeds) -> PaperTable:
    """Return the same flight on each filter."""
    rows = []
    for row in FLOWN_ON:
        crashed = found.of("crashed", row)
        tilts = [
            [math.hypot(*both) for both in zip(*(found.of("flown", row, phase, k) for k in (0, 1)), strict=True)]
            for phase in PHASES
        ]
        cells = [mean_text(found.of("most", row), "deg"), *(mean_text(tilt, "deg") for tilt in tilts)]
        cells += [mean_text(found.of("left", row, len(LEVELS) - 1), "deg"), mean_text(found.of("delay", row, 0), "ms")]
        rows.append((FILTER_WORDS[row], f"{sum(crashed):.0f} of {len(crashed)}", *cells))
    head = (
        "flown on",
        "crashed",
        "largest angle in hover",
        "tilt error, hover",
        "moves",
        f"left of {LEVELS[-1][0]:g} deg",
        "delay",
    )
    return PaperTable(
        "The same flight on other filters",
        head,
        tuple(rows),
        f"Means over seeds; of EKFs over the first {BESIDE_SEEDS}.",
    )


def loop_table(found: Seeds) -> PaperTable:
    """Return the transfer function beside the flight on the true attitude."""
    axis = axis_of(0)
    limits = margins(axis)
    t = np.linspace(0.0, 4.0, 4001)
    _, over = rise_and_overshoot(t, axis.step(t))
    back = axis.step(t + TILTED_S) - axis.step(t)
    fall = 1e3 * rise_s(t, back, 0.0, float(back[0]), 0.0)
    falls = [1e3 * x for x in found.of("fall", TRUE_ATTITUDE, 0)]
    rows = [
        ("phase margin", f"{limits.phase_deg:.0f} deg at {limits.phase_at:.0f} rad/s", ""),
        ("gain margin", f"{limits.gain:.1f}", ""),
        ("delay margin", f"{1e3 * limits.delay_s:.0f} ms", ""),
        ("90 to 10 % of 20 deg", quantity(fall, "ms"), mean_text(falls, "ms")),
        ("overshoot of a step", f"{100 * over:.1f} %", ""),
    ]
    for k, (size, period, name) in enumerate(TRACKS):
        answer = axis.response(2.0 * math.pi / period)
        late = -float(np.angle(answer)) * period / (2.0 * math.pi) * 1e3
        sine = f"{name}, {size:g} deg at {period:g} s"
        rows.append((f"delay, {sine}", quantity(late, "ms"), mean_text(found.of("delay", TRUE_ATTITUDE, k), "ms")))
        rows.append((f"gain, {sine}", f"{abs(answer):.2f}", mean_text(found.of("gain", TRUE_ATTITUDE, k), "1")))
    return PaperTable(
        "The loop: transfer function and flight on the true attitude",
        ("", "linear", "flown"),
        tuple(rows),
        "Rotor lag, inertia, gains and the time that sampling and holding take; means over seeds.",
    )


def cost_claim(
    spent: dict[str, list[float]], slow: dict[str, list[float]], numpy: tuple[list[float], list[float]]
) -> Claim:
    printed = ratio("the paper's own: EKF over Mahony", PRINTED_EKF_S, PRINTED_MAHONY_S)
    own = ratio("EKF over Mahony, compiled, a field at every update", spent[EKF], spent[DCM])
    rare = ratio("EKF over Mahony, compiled, a field at every 8th update", slow[EKF], slow[DCM])
    arrays = ratio("EKF with 7 states over Mahony, both plain numpy arrays", numpy[1], numpy[0])
    each = [
        mean(f"{COST_UPDATES:,} updates of {name}", spent[row], "us")
        for row, name in ((DCM, "Mahony"), (EKF, "the EKF"))
    ]
    compiled = (each[0].value or 0.0) / COST_UPDATES
    interpreted = [
        mean(f"an update of {name} in numpy", [1e-3 * ns for ns in found], "us")
        for name, found in zip(("Mahony", "the EKF"), numpy, strict=True)
    ]
    return Claim(
        "cost",
        "It takes less time than the EKF, about half.",
        "table 1",
        f"{COST_METHOD} mahony_dcm@huang and ekf12@fan, 12 states in blocks. Beside them the same filter and a dense "
        "EKF of 7 states as numpy arrays. Holds if all intervals of the ratio are above 1.",
        (own, arrays, rare, *each, *interpreted, printed),
        combine_verdicts([above(n, 1.0) for n in (own, arrays, rare)]),
        f"The direction holds, the number is the implementation's: {_ratio_text((own, rare))} compiled, "
        f"{quantity(arrays.value, 'ratio')} in numpy. The paper's 0.27 ms an update is interpreted code: in numpy "
        f"Mahony's takes {quantity(interpreted[0].value, 'us')}, compiled {quantity(compiled, 'us')}. "
        "Times are of this machine.",
        paper="1.084 s and 2.029 s, ratio 1.87",
        shown=2,
    )


def _ratio_text(numbers: Sequence[PaperNumber]) -> str:
    low, high = smallest_and_largest(numbers)
    return f"{number(low.value, 'ratio')} to {quantity(high.value, 'ratio')}"


OWN, WANTED, LINEAR = "Huang's filter", "set-point", "transfer function"
AXIS_TITLES = ("roll, deg", "pitch, deg", "heading, deg")
SINCE: Span = (HOVER[0], np.inf)


def paper_figures(
    spent: dict[str, list[float]], printed_mahony: Sequence[float], printed_ekf: Sequence[float], seed: int = 0
) -> tuple[PaperFigure, ...]:
    """Draw filter against truth and EKF, cost, return to level, hover, tracking."""
    flight = fly(huang_scenario(DCM), seed)
    return (
        _truth_figure(flight),
        _ekf_figure(flight),
        _cost_figure(spent, printed_mahony, printed_ekf),
        _level_figure(flight, seed),
        _hover_figure(flight),
        _tracking_figure(flight),
    )


def _truth_figure(flight: Flight) -> PaperFigure:
    return PaperFigure(
        "truth",
        "fig. 3",
        "The filter in the loop against the truth",
        "Hover, then three returns to level and two sines. Where the filter leaves the truth the vehicle has been "
        "tilted and gathers speed.",
        "time, s",
        AXIS_TITLES,
        _both(flight, len(AXIS_TITLES), SINCE),
        height=480,
    )


def _ekf_figure(flight: Flight) -> PaperFigure:
    rows = {DCM: OWN, EKF: "Fan's EKF", NEW_EKF: "mekf"}
    return PaperFigure(
        "ekf",
        "fig. 4",
        "The filter and EKFs over the same samples, errors",
        "Errors against the truth, because the angles themselves could hardly be distinguished.",
        "time, s",
        tuple(f"error of {name}" for name in AXIS_TITLES),
        tuple(filter_lines(flight_samples(flight), rows, errors=True, span=SINCE)),
        height=480,
    )


def _cost_figure(spent: dict[str, list[float]], mahony: Sequence[float], ekf: Sequence[float]) -> PaperFigure:
    run_of = np.arange(1.0, len(mahony) + 1.0)
    lines = (
        FigureLine("the paper", run_of, np.array(ekf) / np.array(mahony)),
        FigureLine("here", run_of, np.array(spent[EKF]) / np.array(spent[DCM])),
    )
    return PaperFigure(
        "cost",
        "table 1",
        "Time of the EKF over time of Mahony's filter",
        "4,000 updates, nine runs.",
        "run",
        ("ratio",),
        lines,
        kind="points",
        height=260,
    )


def _level_figure(flight: Flight, seed: int) -> PaperFigure:
    """Draw the three returns: true angle and the filter's, on the stand, and the linear loop."""
    lines: list[FigureLine] = []
    held = fly_stand(seed)
    shown = np.linspace(-TILTED_S, LEVEL_S, 701)
    for k, (angle, axis) in enumerate(LEVELS):
        column = ("roll", "pitch").index(axis)
        since = LEVEL_AT + k * LEVEL_EVERY_S + TILTED_S
        beside = STAND_AT + k * STAND_EVERY_S + TILTED_S
        step = axis_of(column).step
        linear = angle * (step(shown + TILTED_S) - step(shown))
        lines += [
            FigureLine(
                TRUTH_LINE, shown, np.interp(since + shown, flight.truth.t, angles(flight.truth.q)[:, column]), k
            ),
            FigureLine(OWN, shown, np.interp(since + shown, flight.onboard.t, _known(flight)[:, column]), k),
            FigureLine(
                "truth on the stand", shown, np.interp(beside + shown, held.truth.t, angles(held.truth.q)[:, column]), k
            ),
            FigureLine(LINEAR, shown, linear, k),
        ]
    panels = tuple(f"{axis} from {angle:g} deg, deg" for angle, axis in LEVELS)
    return PaperFigure(
        "level",
        "fig. 6",
        "From an angle back to level",
        "At 0 s the set-point becomes level. In free flight the filter is level and the vehicle is not.",
        "time, s",
        panels,
        tuple(lines),
        height=480,
    )


def _hover_figure(flight: Flight) -> PaperFigure:
    return PaperFigure(
        "hover",
        "fig. 8",
        "Hover",
        "Roll and pitch with the position held; the paper's bound is +-5 deg.",
        "time, s",
        AXIS_TITLES[:2],
        _both(flight, 2, HOVER),
    )


def _tracking_figure(flight: Flight) -> PaperFigure:
    lines = []
    for k, (_, _, axis) in enumerate(TRACKS):
        column = ("roll", "pitch").index(axis)
        begin = TRACK_AT + k * TRACK_EVERY_S
        for name, t, y in (
            (TRUTH_LINE, flight.truth.t, angles(flight.truth.q)),
            (OWN, flight.onboard.t, _known(flight)),
            (WANTED, flight.onboard.t, angles(flight.onboard.q_setpoint)),
        ):
            lines.append(curve_line(name, t - begin, y[:, column], k, (0.0, TRACK_S)))
    panels = tuple(f"{axis}, sine of {period:g} s, deg" for _, period, axis in TRACKS)
    return PaperFigure(
        "tracking",
        "fig. 9",
        "Angles that follow a set-point",
        "The angle comes a fifth of a second later.",
        "time since the begin, s",
        panels,
        tuple(lines),
    )


def _both(flight: Flight, axes: int, span: Span) -> tuple[FigureLine, ...]:
    """Return truth and onboard filter, axis by axis."""
    both = ((TRUTH_LINE, flight.truth.t, angles(flight.truth.q)), (OWN, flight.onboard.t, _known(flight)))
    return tuple(curve_line(name, t, y[:, axis], axis, span) for axis in range(axes) for name, t, y in both)


def _known(flight: Flight) -> Array:
    """Return the filter's angles (n, 3) at all times, NaN before its start."""
    q = flight.onboard.q
    found = np.full((len(q), 3), np.nan)
    known = np.isfinite(q[:, 0])
    found[known] = angles(q[known])
    return found


# Errors up to which an attitude can be flown on.
TILT_DEG, HEADING_DEG = 2.0, 5.0
NO_WORSE = 1.1
# Gain of -3 dB, the usual limit of following.
HALF_POWER = math.sqrt(0.5)
PHASE_NAMES = {"hover": "hover", "moving": "returns and sines"}


def paper(options: PaperOptions) -> Paper:
    """Measure Huang's claims."""
    found = Seeds(run_seeds("flights", huang_seed, options))
    spent, slow, numpy = microseconds(), microseconds(every=8), time_numpy()
    timed = cost_claim(spent, slow, numpy)
    return Paper(
        "huang",
        "Mahony Filter Applied to Attitude Estimation and Control of Quadrotor",
        "Huang Po, Ma Yan, Yang Wankou, 2014, 1009-3044(2014)07-1611-07, Southeast University (in Chinese)",
        _settings(),
        (
            _follow_claim(found),
            _ekf_claim(found),
            timed,
            _level_claim(found),
            _hover_claim(found),
            _tracking_claim(found),
        ),
        paper_figures(spent, PRINTED_MAHONY_S, PRINTED_EKF_S),
        (times_table(spent), filter_table(found), loop_table(found)),
        (
            "Fig. 5 is the controller's block diagram, fig. 7 the hardware: there is nothing to run again.",
            "Figures 3, 4, 8 and 9 do not say which flights they show. Tables 2 and 3 hold the controller's gains of "
            "roll and pitch; none are printed for yaw.",
            "Which EKF the paper compares with is not stated. Here it is Fan's with 12 states (ekf12@fan). Beside it "
            "is one that estimates biases and expects accelerations (mekf).",
            "The filter's equations are those that `attlog estimators mahony_dcm` shows.",
        ),
        seeds=options.seeds,
    )


def _settings() -> tuple[PaperSetting, ...]:
    return settings(
        paper={
            "filter": "kp 0.3, ki 0.01 (fig. 3), 400 Hz",
            "outer loop, roll and pitch": "PI on angle, 4.5 and 0.35 (table 2)",
            "inner loop, roll and pitch": "PID on rate, 0.14, 0.015, 0.0025 (table 3), 400 Hz",
            "GNSS": "5 Hz",
        },
        ours={
            "unit of the inner loop": "1 moves the rotors of a side by half of their thrust",
            "yaw": "2.5 on angle, 0.6 and 0.1 on rate",
            "vehicle": "1.5 kg, 0.45 m across, rotors with 25 ms lag",
            "sensors": "Pixhawk class; magnetometer 50 Hz",
            "wind": f"turbulence {WIND_M_S:g} m/s (1 sigma per axis)",
            "flight": f"hover 30 s, back to level from {_listed([a for a, _ in LEVELS])} deg, sines",
            "stand": "the same returns with so much drag that the vehicle does not gather speed",
        },
    )


def _follow_claim(found: Seeds) -> Claim:
    numbers = [
        found.mean(f"RMS error of {axis}, {name}", "deg", "flown", DCM, phase, k)
        for phase, name in PHASE_NAMES.items()
        for k, axis in enumerate(AXES)
    ]
    stand = [
        found.mean(f"RMS error of {axis}, same returns on the stand", "deg", "error", STAND, k)
        for k, axis in enumerate(AXES[:2])
    ]
    limits = (TILT_DEG, TILT_DEG, HEADING_DEG)
    verdicts = [below(n, limits[k % 3]) for k, n in enumerate(numbers)] + [below(n, TILT_DEG) for n in stand]
    words = [quantity(max(n.value or 0.0 for n in part), "deg") for part in (numbers[:2], numbers[3:5], stand)]
    return Claim(
        "follows",
        "The attitude of the filter follows the true attitude.",
        "fig. 3",
        "RMS error of what is flown on against the truth, in hover and from there on. Holds if the whole interval is "
        f"below {TILT_DEG:g} deg (roll, pitch) and {HEADING_DEG:g} deg (heading).",
        put_first((numbers[0], numbers[3]), (*numbers, *stand)),
        combine_verdicts(verdicts),
        f"Roll and pitch err by up to {words[0]} in hover, {words[1]} in free flight, {words[2]} on the stand. The "
        "filter takes the accelerometer for gravity. A tilted quadrotor that gathers speed feels its thrust alone: to "
        "the filter it is level.",
        shown=2,
    )


def _ekf_claim(found: Seeds) -> Claim:
    places = [(phase, k, name) for phase, name in PHASE_NAMES.items() for k in range(3)]
    numbers = [
        found.ratio(
            f"error of {AXES[k]}, Huang's over EKF's, {name}", ("replayed", DCM, phase, k), ("replayed", EKF, phase, k)
        )
        for phase, k, name in places
    ]
    verdicts = [below(n, NO_WORSE) for n in numbers]
    numbers += [
        found.mean(f"RMS of {AXES[k]} between the two, {name}", "deg", "apart", DCM, phase, k)
        for phase, k, name in places
    ]
    roll = found.ratio(
        "error of roll, Huang's over mekf's, returns and sines",
        ("replayed", DCM, "moving", 0),
        ("replayed", NEW_EKF, "moving", 0),
    )
    best, worst = smallest_and_largest(numbers[:6])
    return Claim(
        "ekf",
        "It gives the attitude of an extended Kalman filter.",
        "fig. 4",
        "Both over the samples of the same flight, errors against the truth. Holds if the whole interval of each "
        f"ratio of errors is below {NO_WORSE:g}.",
        put_first((best, worst), (*numbers, roll)),
        combine_verdicts(verdicts),
        f"Its error is {quantity(best.value, 'ratio')} ({_axis(best.what)}) to {quantity(worst.value, 'ratio')} "
        f"({_axis(worst.what)}) that of Fan's EKF. Another EKF, mekf, expects accelerations and estimates biases. In "
        f"the moves the error of roll is {quantity(roll.value, 'ratio')} that of mekf.",
        shown=2,
    )


def _level_claim(found: Seeds) -> Claim:
    numbers, verdicts = [], []
    largest, lasting, settled, times = [], [], [], []
    for place, row in (("free flight", DCM), ("stand", STAND)):
        rest = []
        for k, (angle, axis) in enumerate(LEVELS):
            after = f"from {angle:g} deg of {axis}, {place}"
            seen = found.of("settling", row, k)
            left = found.mean(f"true {axis} that is left, {after}", "deg", "left", row, k)
            there = share_of_seeds(f"settled as the filter sees it, {after}", list(map(math.isfinite, seen)))
            time = mean(f"settling time as the filter sees it, {after}", seen, "s")
            numbers += [left, there, time, found.mean(f"overshoot, {after}", "deg", "overshoot", row, k)]
            if row == STAND:
                verdicts.append(below(left, LEVEL_WITHIN_DEG))
            rest.append(left.value or 0.0)
            lasting.append(left)
            settled.append(there.value or 0.0)
            times.append(math.nan if time.value is None else time.value)
        largest.append(max(rest))
    return Claim(
        "level",
        "From an initial angle the controller brings the vehicle back to level.",
        "fig. 6",
        f"Tilted for {TILTED_S:g} s, then the set-point is level. Settled: within {LEVEL_WITHIN_DEG:g} deg "
        "for good. The figure simulates the attitude loop, which is our stand. Holds if there the whole intervals of "
        f"the true angle left are below {LEVEL_WITHIN_DEG:g} deg.",
        put_first((lasting[-1], max(lasting[:3], key=lambda n: n.value or 0.0)), numbers),
        combine_verdicts(verdicts),
        f"To the filter the vehicle is level in {_at_least(min(settled))} of the returns, after "
        f"{quantity(float(np.nanmin(times)), 's')} to {quantity(float(np.nanmax(times)), 's')}. Up to "
        f"{quantity(largest[0], 'deg')} are truly left in free flight, {quantity(largest[1], 'deg')} on the stand. "
        "What is left is the error of the filter, not of the controller.",
        shown=2,
    )


def _hover_claim(found: Seeds) -> Claim:
    def largest(wind: float, *key: str | float) -> tuple[PaperNumber, PaperNumber]:
        """Return the largest angle, and the share of flights within the bound."""
        most, turbulence = found.of(*key), f"turbulence {wind:g} m/s"
        share = f"flights within {WITHIN_DEG:g} deg{' all the time' if wind == WIND_M_S else f', {turbulence}'}"
        inside = share_of_seeds(share, [m < WITHIN_DEG for m in most])
        return mean(f"largest roll or pitch, {turbulence}", most, "deg"), inside

    size, inside = largest(WIND_M_S, "most", DCM)
    windy = [number for wind in MORE_WIND_M_S for number in largest(wind, "windy", wind)]
    scatter = found.mean("standard deviation of roll", "deg", "spread", DCM)
    reach = found.mean("farthest from the mean place", "m", "drift", DCM)
    return Claim(
        "hover",
        f"In hover roll and pitch stay within +-{WITHIN_DEG:g} deg.",
        "fig. 8",
        "Largest true roll or pitch in 30 s of hover on Huang's filter with GNSS and barometer. "
        f"Holds if its whole interval is below {WITHIN_DEG:g} deg.",
        (size, inside, scatter, reach, *windy),
        below(size, WITHIN_DEG),
        f"{quantity(inside.value, 'pct')} of the flights stay within. With turbulence of "
        f"{MORE_WIND_M_S[-1]:g} m/s the largest angle is {quantity(windy[-2].value, 'deg')}; "
        f"{quantity(windy[-1].value, 'pct')} of the flights stay within.",
        paper="+-5 deg",
    )


def _tracking_claim(found: Seeds) -> Claim:
    numbers, verdicts, words = [], [], []
    for k, (size, period, axis) in enumerate(TRACKS):
        name = f"{axis}, {size:g} deg at {period:g} s"
        gain = found.mean(f"gain, {name}", "1", "gain", DCM, k)
        delay = found.mean(f"delay, {name}", "ms", "delay", DCM, k)
        straight = found.mean(f"delay flown on the truth, {name}", "ms", "delay", TRUE_ATTITUDE, k)
        numbers += [delay, gain, straight]
        verdicts.append(above(gain, HALF_POWER))
        w = 2.0 * math.pi / period
        answer = axis_of(0 if axis == "roll" else 1).response(w)
        words.append(
            f"At a period of {period:g} s the gain is {number(gain.value, '1')}, the delay "
            f"{quantity(delay.value, 'ms', False)}. On the true attitude it is "
            f"{quantity(straight.value, 'ms', False)}, by the transfer function "
            f"{quantity(-float(np.angle(answer)) / w * 1e3, 'ms', False)}."
        )
    return Claim(
        "tracks",
        "The angle follows a moving set-point, with a delay.",
        "fig. 9",
        "Fundamental of the true angle against that of the set-point's sine. It follows where the whole interval of "
        f"the gain is above {HALF_POWER:.3f} (-3 dB).",
        put_first((numbers[0], numbers[1], numbers[4]), numbers),
        combine_verdicts(verdicts),
        f"{' '.join(words)} The delay is the loop's own, about 1 over the outer gain of 4.5/s. Nothing in the "
        "controller looks ahead.",
        shown=3,
    )


def _at_least(pct: float) -> str:
    return "all" if pct >= 100.0 else f"at least {quantity(pct, 'pct')}"


def _axis(what: str) -> str:
    """Return axis and part of the flight of an EKF number."""
    return what.removeprefix("error of ").replace(", Huang's over EKF's", "")


def _listed(values: list[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)
