"""The headings of ``gsf``, tried at once: each a Kalman filter of a horizontal velocity and a heading.

Hypothesis i is turned by x_i about the vertical against the attitude before any turn. Equations: ``gsf``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from attlog.estimators.aids import AIRSPEED, AT_REST, VEL_ACC, VEL_E, VEL_N
from attlog.estimators.interface import LogInfo, Parameter
from attlog.estimators.vectors import GRAVITY, down, turn, turned_back

N = 5
# Where things stand in the state: sigma of the heading, w_i, x_i, v_i (2 each), P_i (6 each: NN, NE, N psi, EE, E psi,
# psi psi), x with its cosine and sine, and whether the bank runs.
SIGMA, W, X, V, P, MIX, RUNS = 7, 8, 13, 18, 28, 58, 61

UNKNOWN, TURN = math.pi / math.sqrt(3.0), 2.0 * math.pi
CLIP, LEAST_VAR = 25.0, 1e-6
RAD = math.pi / 180.0


def begin_hypotheses(state: Any, vn: float, ve: float, var: float) -> None:
    """Five equal parts of the circle, all at the velocity of the fix."""
    psi = 2.0 * math.atan2(state[3], state[0]) - state[MIX]
    for i in range(N):
        state[X + i] = wrapped((i + 0.5) * TURN / N - math.pi - psi)
        state[V + 2 * i] = vn
        state[V + 2 * i + 1] = ve
        p = P + 6 * i
        state[p] = var
        state[p + 3] = var
        state[p + 5] = (math.pi / N) ** 2
    state[RUNS] = 1.0
    state[SIGMA] = math.sqrt(spread(state))


def predict_hypothesis(state: Any, params: Any, i: int, dn: float, de: float, dt: float) -> None:
    """Velocity and covariance of hypothesis i after a change of velocity (2,) m/s, in axes before x, over dt."""
    c = math.cos(state[X + i])
    s = math.sin(state[X + i])
    n = c * dn - s * de
    e = s * dn + c * de
    state[V + 2 * i] += n
    state[V + 2 * i + 1] += e
    p = P + 6 * i
    q = params[4] * params[4] * dt
    # First what needs the old covariances of velocity and heading.
    state[p] += e * (e * state[p + 5] - 2.0 * state[p + 2]) + q
    state[p + 1] += n * state[p + 2] - e * state[p + 4] - n * e * state[p + 5]
    state[p + 3] += n * (n * state[p + 5] + 2.0 * state[p + 4]) + q
    state[p + 2] -= e * state[p + 5]
    state[p + 4] += n * state[p + 5]
    walk = RAD * params[3]
    state[p + 5] += walk * walk * dt


def correct_hypothesis(state: Any, i: int, vn: float, ve: float, var: float) -> float:
    """The likelihood of the velocity (2,) m/s of a fix under hypothesis i, which is corrected by it."""
    p = P + 6 * i
    nn = state[p]
    ne = state[p + 1]
    ny = state[p + 2]
    ee = state[p + 3]
    ey = state[p + 4]
    inv = 1.0 / ((nn + var) * (ee + var) - ne * ne)
    inn = inv * (ee + var)
    ine = -inv * ne
    iee = inv * (nn + var)
    zn = vn - state[V + 2 * i]
    ze = ve - state[V + 2 * i + 1]
    square = zn * (inn * zn + ine * ze) + ze * (ine * zn + iee * ze)
    if square > CLIP:
        shorter = math.sqrt(CLIP / square)
        zn *= shorter
        ze *= shorter
        square = CLIP
    # The gains of v_N, v_E and psi, then P - K S K^T with S K^T the columns before.
    kn0 = nn * inn + ne * ine
    kn1 = nn * ine + ne * iee
    ke0 = ne * inn + ee * ine
    ke1 = ne * ine + ee * iee
    ky0 = ny * inn + ey * ine
    ky1 = ny * ine + ey * iee
    state[V + 2 * i] += kn0 * zn + kn1 * ze
    state[V + 2 * i + 1] += ke0 * zn + ke1 * ze
    state[X + i] = wrapped(state[X + i] + ky0 * zn + ky1 * ze)
    state[p] = max(nn - kn0 * nn - kn1 * ne, LEAST_VAR)
    state[p + 1] = ne - kn0 * ne - kn1 * ee
    state[p + 2] = ny - kn0 * ny - kn1 * ey
    state[p + 3] = max(ee - ke0 * ne - ke1 * ee, LEAST_VAR)
    state[p + 4] = ey - ke0 * ny - ke1 * ey
    state[p + 5] = max(state[p + 5] - ky0 * ny - ky1 * ey, LEAST_VAR)
    return math.sqrt(inv) * math.exp(-0.5 * square) / TURN


def mix(state: Any) -> None:
    """Turn the attitude to the weighted mean of the hypotheses, and tell how far they are apart."""
    c = 0.0
    s = 0.0
    for i in range(N):
        c += state[W + i] * math.cos(state[X + i])
        s += state[W + i] * math.sin(state[X + i])
    x = math.atan2(s, c)
    half = 0.5 * (x - state[MIX])
    state[MIX] = x
    state[MIX + 1] = math.cos(x)
    state[MIX + 2] = math.sin(x)
    c = math.cos(half)
    s = math.sin(half)
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    state[0] = c * q0 - s * q3
    state[1] = c * q1 - s * q2
    state[2] = c * q2 + s * q1
    state[3] = c * q3 + s * q0
    state[SIGMA] = math.sqrt(spread(state))


def spread(state: Any) -> float:
    """The variance [rad^2] of the heading: of the hypotheses about their mean, and their own."""
    var = 0.0
    for i in range(N):
        off = wrapped(state[X + i] - state[MIX])
        var += state[W + i] * (state[P + 6 * i + 5] + off * off)
    return var


def wrapped(angle: float) -> float:
    """The angle [rad] within +- pi."""
    return angle - TURN * math.floor(angle / TURN + 0.5)


# Heading without a compass from GNSS velocity: five headings tried at once, as both autopilots do beside their EKF.
#
#     q'    = q (x) (0, w - b + e)/2,  e = tilt_gain k (d x u),  d = R^T e_z,  b' = -bias_gain e below 10 deg/s
#             u = h/|h|,  h: f - (w - b) x (V, 0, 0), low-passed with 1/(10 tilt_gain);  V: airspeed, forward only
#             k = (1 - min(n ||h|/g - 1|, 1))^2,  n = 2, with V above g 1
#     i     of 5: turned by x_i about the vertical, spread over the circle; velocity v_i (2,), P_i (3, 3) of (v_i,
# psi_i)
#             v_i' = a_i,  a_i: horizontal part of Rz(x_i) R f as it was ``delay`` ago, in steps of 10 ms
#             P_i' = F P_i + P_i F^T + diag(acc_noise^2, acc_noise^2, gyro_noise^2),  F_v,psi = (-a_E, a_N)
#     fix   y = z - v_i,  S = P_vv + s^2 I,  s = max(receiver's sigma, velocity_noise),  y shortened to 5 sigma
#             P_v S^-1 y corrects v_i and x_i;  w_i <- max(w_i exp(-y^T S^-1 y / 2) / (2 pi |S|^1/2), weight_floor)
#     psi   x: angle of sum w_i (cos x_i, sin x_i);  sigma_heading^2 = sum w_i (P_psi,i + (x_i - x)^2),  sum w_i = 1
#
# All five have one tilt: a turn about the vertical moves none, so one attitude serves them. Heading is from true
# north.
# The five start with the first fix that is faster than s, not at rest. Until then the heading counts from that of the
# start attitude (0 where nothing told it) and means nothing; ``sigma_heading`` is that of a whole circle, 104 deg. It
# stays wide until horizontal accelerations have told which one is right: hovering and straight flight tell little.
# An analysis scores nothing before it was below 15 deg, and refuses a log in which it never was.
#
# Source: PX4 ``EKFGSF_yaw`` (since 1.11), ArduPilot ``EKFGSF_yaw`` (since 4.1, pull request 13603). From a log come
# EKF2_GPS_V_NOISE, EKF2_GPS_DELAY, SENS_GPS0_DELAY, EK2_VELNE_M_NSE, EK3_VELNE_M_NSE, GPS_DELAY_MS, GPS1_DELAY_MS,
# and
# which of the two flew.
#
# Departures. The low-pass turns with the body (``smoothing=body``, as flown: of f alone, in body axes). At rest the
# gyro's mean is the bias, where the firmwares hand over their EKF's. Noise is a density, for any rate. A forward
# vehicle
# without airspeed sensor takes the GNSS speed for V (firmwares: a constant). PX4 starts the five at take-off too;
# ArduPilot starts them anew at each, and corrects no tilt below 1 g.

SOURCE = "PX4 EKFGSF_yaw (1.11 to 1.18); ArduPilot EKFGSF_yaw (4.1 to 4.6)"
NEEDS = {"gyro", "acc", "gnss"}
USES = {"airspeed", "at_rest"}
VECTORS_AT = "end"
BINS = 32
STATE = {"q": 4, "bias": 3, "sigma_heading": 1, "weights": N, "_bank": 49, "_now": 14, "_past": 3 * BINS}
# Where things stand in the state behind the bank; PAST holds what is younger than ``delay``, BINS times (dv_N, dv_E,
# dt) in the axes before x.
FORCE, HELD, SUM, FIRST, COUNT, PAST_S, AIR, AIR_AGE, SPEED, REST_S, PAST = 62, 65, 66, 69, 70, 71, 72, 73, 74, 75, 76

BIN_S, HELD_S, AIR_LOST_S, REST_MEAN_S, NEVER = 0.0095, 0.2, 5.0, 10.0, 1e9
SPIN, LEAST_ARDUPILOT = math.radians(10.0), 0.5

PARAMETERS = (
    Parameter("tilt_gain", 0.2, "1/s", 0.01, 10, "how fast gravity corrects roll and pitch", "PX4; ArduPilot"),
    Parameter("bias_gain", 0.04, "1/s", 0, 10, "how fast these corrections become gyro bias", "PX4; ArduPilot"),
    Parameter("bias_limit", 0.05, "rad/s", 0, 2, "limit of the bias of each axis", "PX4; ArduPilot 0.087"),
    Parameter("gyro_noise", 0.573, "deg/sqrt(s)", 1e-3, 100, "random walk of the heading", "PX4: 0.1 rad/s in 10 ms"),
    Parameter("acc_noise", 0.2, "m/s/sqrt(s)", 1e-3, 100, "random walk of the velocity", "PX4: 2 m/s^2 in 10 ms"),
    Parameter("velocity_noise", 0.3, "m/s", 0.01, 100, "least sigma of the GNSS velocity", "PX4; ArduPilot 0.5"),
    Parameter("delay", 0.11, "s", 0, 0.3, "how late the GNSS velocity is", "PX4 EKF2_GPS_DELAY"),
    Parameter(
        "weight_floor", 1e-5, "", 0, 0.1, "least weight of a hypothesis before they are scaled", "PX4; ArduPilot 0"
    ),
    Parameter(
        "forward", "off", "", 0, 1, "a vehicle that moves where its nose points", "attlog, by vehicle", ("off", "on")
    ),
    Parameter(
        "smoothing",
        "turned",
        "",
        0,
        1,
        "whether the force's low-pass turns with the body; in body axes, as flown, swings tilt it",
        "attlog; PX4 and ArduPilot: body",
        ("turned", "body"),
    ),
)
PRESETS: dict[str, dict[str, float | str]] = {
    "px4": {"smoothing": "body"},
    "ardupilot": {
        "smoothing": "body",
        "bias_limit": 0.0873,
        "velocity_noise": LEAST_ARDUPILOT,
        "delay": 0.12,
        "weight_floor": 0.0,
    },
}


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    """The autopilot's own noise and delay, and what ArduPilot has otherwise than PX4."""
    values: dict[str, float | str] = {}
    if "EKF2_GPS_V_NOISE" in params:
        values["velocity_noise"] = min(max(params["EKF2_GPS_V_NOISE"], 0.01), 100.0)
    for name in ("EKF2_GPS_DELAY", "SENS_GPS0_DELAY"):
        if name in params:
            values["delay"] = min(max(1e-3 * params[name], 0.0), 0.3)
    noise = [params[name] for name in ("EK3_VELNE_M_NSE", "EK2_VELNE_M_NSE") if name in params]
    if noise:
        values |= {name: value for name, value in PRESETS["ardupilot"].items() if name != "smoothing"}
        values["velocity_noise"] = min(max(noise[0], LEAST_ARDUPILOT), 100.0)
        for name in ("GPS_DELAY_MS", "GPS1_DELAY_MS"):
            if params.get(name, 0.0) > 0.0:
                values["delay"] = min(1e-3 * params[name], 0.3)
    if info.forward is not None:
        values["forward"] = "on" if info.forward else "off"
    return values


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, equal weights, no fix yet."""
    state = np.zeros(PAST + 3 * BINS)
    state[0:4] = q0
    state[SIGMA] = UNKNOWN
    state[W : W + N] = 1.0 / N
    state[MIX + 1] = 1.0
    state[FORCE : FORCE + 3] = acc
    state[AIR_AGE] = NEVER
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """One update: attitude, velocities of ``delay`` ago, the fix."""
    state[AIR_AGE] += dt
    if aid[AIRSPEED] == aid[AIRSPEED]:
        state[AIR] = aid[AIRSPEED]
        state[AIR_AGE] = 0.0
    learn_at_rest(state, params, dt, gyr, aid[AT_REST] == 1.0)
    wx = gyr[0] - state[4]
    wy = gyr[1] - state[5]
    wz = gyr[2] - state[6]
    there = acc[0] != 0.0 or acc[1] != 0.0 or acc[2] != 0.0
    speed = airspeed(state, params)
    smooth(state, params, dt, acc, there, speed, wx, wy, wz)
    turn_by_gyro(state, params, dt, speed, wx, wy, wz)
    state[HELD] = min(state[HELD] + dt, HELD_S)
    if there:
        gather(state, acc)
        if state[SUM + 2] >= BIN_S:
            pass_on(state, params)
    if aid[VEL_N] == aid[VEL_N] and aid[VEL_E] == aid[VEL_E]:
        take_fix(state, params, aid)


def airspeed(state: Any, params: Any) -> float:
    """V of a vehicle that flies forward, m/s: that of its sensor, else of GNSS; else 0."""
    if params[8] < 0.5:
        return 0.0
    return state[AIR] if state[AIR_AGE] < AIR_LOST_S else state[SPEED]  # type: ignore[no-any-return]


def smooth(
    state: Any, params: Any, dt: float, acc: Any, there: bool, speed: float, wx: float, wy: float, wz: float
) -> None:
    """The low-pass of the force without a turn's acceleration, turned with the body; or as flown, of the force."""
    if params[9] < 0.5:
        x, y, z = turned_back(state[FORCE], state[FORCE + 1], state[FORCE + 2], wx, wy, wz, dt)
        state[FORCE] = x
        state[FORCE + 1] = y
        state[FORCE + 2] = z
    else:
        speed = 0.0
    if there:
        share = min(10.0 * params[0] * dt, 1.0)
        state[FORCE] += share * (acc[0] - state[FORCE])
        state[FORCE + 1] += share * (acc[1] - speed * wz - state[FORCE + 1])
        state[FORCE + 2] += share * (acc[2] + speed * wy - state[FORCE + 2])


def learn_at_rest(state: Any, params: Any, dt: float, gyr: Any, rests: bool) -> None:
    """The bias as the mean rate at rest, of at most the last 10 s or so."""
    x = gyr[0] - state[4]
    y = gyr[1] - state[5]
    z = gyr[2] - state[6]
    still = rests and x * x + y * y + z * z < SPIN * SPIN
    state[REST_S] = min(state[REST_S] + dt, REST_MEAN_S) if still else 0.0
    if still:
        share = dt / state[REST_S]
        for i in range(3):
            state[4 + i] = clipped(state[4 + i] + share * (gyr[i] - state[4 + i]), params[2])


def turn_by_gyro(state: Any, params: Any, dt: float, speed: float, wx: float, wy: float, wz: float) -> None:
    """The attitude by the rate (3,) rad/s without bias and the tilt's correction, which becomes bias in slow turns."""
    fx = state[FORCE]
    fy = state[FORCE + 1]
    fz = state[FORCE + 2]
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    steep = 1.0 if speed > 0.0 and norm > GRAVITY else 2.0
    near = 1.0 - min(steep * abs(norm / GRAVITY - 1.0), 1.0)
    gain = params[0] * near * near / norm if norm > 0.0 else 0.0
    if params[9] > 0.5:
        fy -= speed * wz
        fz += speed * wy
    dx, dy, dz = down(state)
    ex = gain * (dy * fz - dz * fy)
    ey = gain * (dz * fx - dx * fz)
    ez = gain * (dx * fy - dy * fx)
    if wx * wx + wy * wy + wz * wz < SPIN * SPIN and state[REST_S] == 0.0:
        k = params[1] * dt
        state[4] = clipped(state[4] - k * ex, params[2])
        state[5] = clipped(state[5] - k * ey, params[2])
        state[6] = clipped(state[6] - k * ez, params[2])
    turn(state, wx + ex, wy + ey, wz + ez, dt, 0.0)


def clipped(x: float, limit: float) -> float:
    """x within +- limit."""
    return min(max(x, -limit), limit)


def gather(state: Any, acc: Any) -> None:
    """Add the horizontal change of velocity since the last sample to that of the present 10 ms, in axes before x."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    an = (1.0 - 2.0 * (q2 * q2 + q3 * q3)) * acc[0] + 2.0 * (q1 * q2 - q0 * q3) * acc[1]
    an += 2.0 * (q1 * q3 + q0 * q2) * acc[2]
    ae = 2.0 * (q1 * q2 + q0 * q3) * acc[0] + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * acc[1]
    ae += 2.0 * (q2 * q3 - q0 * q1) * acc[2]
    c = state[MIX + 1]
    s = state[MIX + 2]
    state[SUM] += state[HELD] * (c * an + s * ae)
    state[SUM + 1] += state[HELD] * (c * ae - s * an)
    state[SUM + 2] += state[HELD]
    state[HELD] = 0.0


def pass_on(state: Any, params: Any) -> None:
    """Put the present 10 ms to the past, and predict with what is older than ``delay``."""
    at = PAST + 3 * (int(state[FIRST] + state[COUNT]) % BINS)
    for i in range(3):
        state[at + i] = state[SUM + i]
        state[SUM + i] = 0.0
    state[COUNT] += 1.0
    state[PAST_S] += state[at + 2]
    while state[COUNT] > 0.0:
        old = PAST + 3 * int(state[FIRST])
        if state[PAST_S] - state[old + 2] < params[6] - 0.5 * BIN_S and state[COUNT] < BINS:
            break
        if state[RUNS] > 0.0:
            for i in range(N):
                predict_hypothesis(state, params, i, state[old], state[old + 1], state[old + 2])
            state[SIGMA] = math.sqrt(spread(state))
        state[PAST_S] -= state[old + 2]
        state[FIRST] = float((int(state[FIRST]) + 1) % BINS)
        state[COUNT] -= 1.0


def take_fix(state: Any, params: Any, aid: Any) -> None:
    """Correct every hypothesis, weigh them, and turn the attitude to their mean; the first fast fix starts them."""
    told = aid[VEL_ACC]
    s = told if told > params[5] else params[5]
    state[SPEED] = math.sqrt(aid[VEL_N] * aid[VEL_N] + aid[VEL_E] * aid[VEL_E])
    if state[RUNS] == 0.0:
        if state[SPEED] > s and aid[AT_REST] != 1.0:
            begin_hypotheses(state, aid[VEL_N], aid[VEL_E], s * s)
        return
    total = 0.0
    for i in range(N):
        w = max(state[W + i] * correct_hypothesis(state, i, aid[VEL_N], aid[VEL_E], s * s), params[7])
        state[W + i] = w
        total += w
    if total > 0.0:
        for i in range(N):
            state[W + i] /= total
    else:
        for i in range(N):
            state[W + i] = 1.0 / N
    mix(state)
