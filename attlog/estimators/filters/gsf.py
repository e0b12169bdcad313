"""Heading without a compass from GNSS velocity: five headings tried at once, as both autopilots do beside their EKF.

    q'    = q (x) (0, w - b + e)/2,  e = tilt_gain k (d x u),  d = R^T e_z,  b' = -bias_gain e below 10 deg/s
            u = h/|h|,  h: f - (w - b) x (V, 0, 0), low-passed with 1/(10 tilt_gain);  V: airspeed, forward only
            k = (1 - min(n ||h|/g - 1|, 1))^2,  n = 2, with V above g 1
    i     of 5: turned by x_i about the vertical, spread over the circle; velocity v_i (2,), P_i (3, 3) of (v_i, psi_i)
            v_i' = a_i,  a_i: horizontal part of Rz(x_i) R f as it was ``delay`` ago, in steps of 10 ms
            P_i' = F P_i + P_i F^T + diag(acc_noise^2, acc_noise^2, gyro_noise^2),  F_v,psi = (-a_E, a_N)
    fix   y = z - v_i,  S = P_vv + s^2 I,  s = max(receiver's sigma, velocity_noise),  y shortened to 5 sigma
            P_v S^-1 y corrects v_i and x_i;  w_i <- max(w_i exp(-y^T S^-1 y / 2) / (2 pi |S|^1/2), weight_floor)
    psi   x: angle of sum w_i (cos x_i, sin x_i);  sigma_heading^2 = sum w_i (P_psi,i + (x_i - x)^2),  sum w_i = 1

All five have one tilt: a turn about the vertical moves none, so one attitude serves them. Heading is from true north.
The five start with the first fix that is faster than s, not at rest. Until then the heading counts from that of the
start attitude (0 where none is given) and means nothing; ``sigma_heading`` is that of a whole circle, 104 deg. It stays
wide until horizontal accelerations favour one hypothesis: hovering and straight flight favour none. An analysis scores
nothing before it was below 15 deg, and refuses a log in which it never was.

Source: PX4 ``EKFGSF_yaw`` (since 1.11), ArduPilot ``EKFGSF_yaw`` (since 4.1, pull request 13603). From a log come
EKF2_GPS_V_NOISE, EKF2_GPS_DELAY, SENS_GPS0_DELAY, EK2_VELNE_M_NSE, EK3_VELNE_M_NSE, GPS_DELAY_MS, GPS1_DELAY_MS, and
which of the two flew.

Departures. The low-pass turns with the body (``smoothing=body``, as flown: of f alone, in body axes). At rest the
gyro's mean is the bias, where the firmwares hand over their EKF's. Noise is a density, for any rate. A forward vehicle
without airspeed sensor takes the GNSS speed for V (firmwares: a constant). PX4 starts the five at take-off too;
ArduPilot starts them anew at each, and corrects no tilt below 1 g.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from attlog.estimators.aids import AIRSPEED, AT_REST, VEL_ACC, VEL_E, VEL_N
from attlog.estimators.interface import LogInfo, Parameter, choice
from attlog.estimators.vectors import GRAVITY, cross, down, is_present, matrix, places, turn, turn_heading, turned_back

SOURCE = "PX4 EKFGSF_yaw (1.11 to 1.18); ArduPilot EKFGSF_yaw (4.1 to 4.6)"
NEEDS = {"gyro", "acc", "gnss"}
USES = {"airspeed", "at_rest"}
VECTORS_AT = "end"
# Hypotheses, and steps of 10 ms that the longest delay holds.
N, BINS = 5, 32
STATE = {
    "q": 4,
    "bias": 3,
    "sigma_heading": 1,
    "weights": N,
    # Of each hypothesis: turn, velocity, covariance (NN, NE, N psi, EE, E psi, psi psi).
    "_x": N,
    "_v": 2 * N,
    "_P": 6 * N,
    # The mean turn x with its cosine and sine, and 1 once the five have started.
    "_mean": 3,
    "_runs": 1,
    "_force": 3,
    # Time since the last force, and the present 10 ms: change of velocity in axes before x, time.
    "_held": 1,
    "_bin": 3,
    # The past ``delay``: first and number of the steps, their time, then the steps themselves.
    "_first": 1,
    "_count": 1,
    "_past_s": 1,
    "_air": 1,
    "_air_age": 1,
    "_speed": 1,
    "_rest_s": 1,
    "_past": 3 * BINS,
}

# Sigma of a heading of which nothing is known, a whole turn, limit of y^T S^-1 y (5 sigma), least variance.
UNKNOWN_HEADING, TURN, MAX_NIS, MIN_VARIANCE = math.pi / math.sqrt(3.0), 2.0 * math.pi, 25.0, 1e-6
RAD = math.pi / 180.0
# A step of the past, the longest time that one force counts, and when airspeed is lost [s].
BIN_S, HELD_S, AIR_LOST_S = 0.0095, 0.2, 5.0
# The bias at rest is the mean of so many seconds.
REST_MEAN_S, NEVER = 10.0, 1e9
# Below this rate corrections become bias; ArduPilot's least sigma of the velocity.
SLOW_RATE, ARDUPILOT_SIGMA_M_S = math.radians(10.0), 0.5

BOTH = "PX4; ArduPilot"
PARAMETERS = (
    Parameter("tilt_gain", 0.2, "1/s", 0.01, 10, "how fast gravity corrects roll and pitch", BOTH),
    Parameter("bias_gain", 0.04, "1/s", 0, 10, "how fast these corrections become gyro bias", BOTH),
    Parameter("bias_limit", 0.05, "rad/s", 0, 2, "limit of the bias of each axis", "PX4; ArduPilot 0.087"),
    Parameter("gyro_noise", 0.573, "deg/sqrt(s)", 1e-3, 100, "random walk of the heading", "PX4: 0.1 rad/s in 10 ms"),
    Parameter("acc_noise", 0.2, "m/s/sqrt(s)", 1e-3, 100, "random walk of the velocity", "PX4: 2 m/s^2 in 10 ms"),
    Parameter("velocity_noise", 0.3, "m/s", 0.01, 100, "least sigma of the GNSS velocity", "PX4; ArduPilot 0.5"),
    Parameter("delay", 0.11, "s", 0, 0.3, "how late the GNSS velocity is", "PX4 EKF2_GPS_DELAY"),
    Parameter("weight_floor", 1e-5, "", 0, 0.1, "least weight of a hypothesis before scaling", "PX4; ArduPilot 0"),
    choice("forward", ("off", "on"), "a vehicle that moves where its nose points", "attlog, by vehicle"),
    # Flown: in body axes, where swings tilt it.
    choice("smoothing", ("turned", "body"), "the force's low-pass turns with the body, or not", "attlog; flown: body"),
)
K = places({p.name: 1 for p in PARAMETERS})
S = places(STATE)
PRESETS: dict[str, dict[str, float | str]] = {
    "px4": {"smoothing": "body"},
    "ardupilot": {
        "smoothing": "body",
        "bias_limit": 0.0873,
        "velocity_noise": ARDUPILOT_SIGMA_M_S,
        "delay": 0.12,
        "weight_floor": 0.0,
    },
}


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    """Return the autopilot's own noise and delay, and what ArduPilot has otherwise than PX4."""
    values: dict[str, float | str] = {}
    if "EKF2_GPS_V_NOISE" in params:
        values["velocity_noise"] = min(max(params["EKF2_GPS_V_NOISE"], 0.01), 100.0)
    for name in ("EKF2_GPS_DELAY", "SENS_GPS0_DELAY"):
        if name in params:
            values["delay"] = min(max(1e-3 * params[name], 0.0), 0.3)
    noise = [params[name] for name in ("EK3_VELNE_M_NSE", "EK2_VELNE_M_NSE") if name in params]
    if noise:
        values |= {name: value for name, value in PRESETS["ardupilot"].items() if name != "smoothing"}
        values["velocity_noise"] = min(max(noise[0], ARDUPILOT_SIGMA_M_S), 100.0)
        for name in ("GPS_DELAY_MS", "GPS1_DELAY_MS"):
            if params.get(name, 0.0) > 0.0:
                values["delay"] = min(1e-3 * params[name], 0.3)
    if info.forward is not None:
        values["forward"] = "on" if info.forward else "off"
    return values


def begin_hypotheses(state: Any, vn: float, ve: float, var: float) -> None:
    """Start the five over equal parts of the circle, all at the velocity of the fix."""
    psi = 2.0 * math.atan2(state[3], state[0]) - state[S.mean]
    for i in range(N):
        state[S.x + i] = wrapped((i + 0.5) * TURN / N - math.pi - psi)
        state[S.v + 2 * i] = vn
        state[S.v + 2 * i + 1] = ve
        p = S.P + 6 * i
        state[p] = var
        state[p + 3] = var
        state[p + 5] = (math.pi / N) ** 2
    state[S.runs] = 1.0
    state[S.sigma_heading] = math.sqrt(heading_variance(state))


def predict_hypothesis(state: Any, params: Any, i: int, dn: float, de: float, dt: float) -> None:
    """Predict hypothesis i by a change of velocity (2,) m/s, in axes before x, over dt."""
    c = math.cos(state[S.x + i])
    s = math.sin(state[S.x + i])
    n = c * dn - s * de
    e = s * dn + c * de
    state[S.v + 2 * i] += n
    state[S.v + 2 * i + 1] += e
    p = S.P + 6 * i
    q = params[K.acc_noise] * params[K.acc_noise] * dt
    # First what needs the old covariances of velocity and heading.
    state[p] += e * (e * state[p + 5] - 2.0 * state[p + 2]) + q
    state[p + 1] += n * state[p + 2] - e * state[p + 4] - n * e * state[p + 5]
    state[p + 3] += n * (n * state[p + 5] + 2.0 * state[p + 4]) + q
    state[p + 2] -= e * state[p + 5]
    state[p + 4] += n * state[p + 5]
    walk = RAD * params[K.gyro_noise]
    state[p + 5] += walk * walk * dt


def correct_hypothesis(state: Any, i: int, vn: float, ve: float, var: float) -> float:
    """Correct hypothesis i by the velocity (2,) m/s of a fix; return the likelihood of the fix."""
    p = S.P + 6 * i
    nn, ne, ny, ee, ey = state[p], state[p + 1], state[p + 2], state[p + 3], state[p + 4]
    inv = 1.0 / ((nn + var) * (ee + var) - ne * ne)
    inn = inv * (ee + var)
    ine = -inv * ne
    iee = inv * (nn + var)
    zn = vn - state[S.v + 2 * i]
    ze = ve - state[S.v + 2 * i + 1]
    square = zn * (inn * zn + ine * ze) + ze * (ine * zn + iee * ze)
    if square > MAX_NIS:
        shorter = math.sqrt(MAX_NIS / square)
        zn *= shorter
        ze *= shorter
        square = MAX_NIS
    # The gains of v_N, v_E and psi, then P - K S K^T with S K^T the columns before.
    kn0, kn1 = nn * inn + ne * ine, nn * ine + ne * iee
    ke0, ke1 = ne * inn + ee * ine, ne * ine + ee * iee
    ky0, ky1 = ny * inn + ey * ine, ny * ine + ey * iee
    state[S.v + 2 * i] += kn0 * zn + kn1 * ze
    state[S.v + 2 * i + 1] += ke0 * zn + ke1 * ze
    state[S.x + i] = wrapped(state[S.x + i] + ky0 * zn + ky1 * ze)
    state[p] = max(nn - kn0 * nn - kn1 * ne, MIN_VARIANCE)
    state[p + 1] = ne - kn0 * ne - kn1 * ee
    state[p + 2] = ny - kn0 * ny - kn1 * ey
    state[p + 3] = max(ee - ke0 * ne - ke1 * ee, MIN_VARIANCE)
    state[p + 4] = ey - ke0 * ny - ke1 * ey
    state[p + 5] = max(state[p + 5] - ky0 * ny - ky1 * ey, MIN_VARIANCE)
    return math.sqrt(inv) * math.exp(-0.5 * square) / TURN


def mix(state: Any) -> None:
    """Turn the attitude to the weighted mean of the hypotheses and update its sigma."""
    c = 0.0
    s = 0.0
    for i in range(N):
        c += state[S.weights + i] * math.cos(state[S.x + i])
        s += state[S.weights + i] * math.sin(state[S.x + i])
    x = math.atan2(s, c)
    half = 0.5 * (x - state[S.mean])
    state[S.mean] = x
    state[S.mean + 1] = math.cos(x)
    state[S.mean + 2] = math.sin(x)
    turn_heading(state, math.cos(half), math.sin(half))
    state[S.sigma_heading] = math.sqrt(heading_variance(state))


def heading_variance(state: Any) -> float:
    """Return the variance [rad^2] of the heading: of the hypotheses about their mean, and their own."""
    var = 0.0
    for i in range(N):
        off = wrapped(state[S.x + i] - state[S.mean])
        var += state[S.weights + i] * (state[S.P + 6 * i + 5] + off * off)
    return var


def wrapped(angle: float) -> float:
    """Return the angle [rad] within +- pi."""
    return angle - TURN * math.floor(angle / TURN + 0.5)


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude, equal weights, no fix yet."""
    state = np.zeros(sum(STATE.values()))
    state[0:4] = q0
    state[S.sigma_heading] = UNKNOWN_HEADING
    state[S.weights : S.weights + N] = 1.0 / N
    state[S.mean + 1] = 1.0
    state[S.force : S.force + 3] = acc
    state[S.air_age] = NEVER
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """Take one update: attitude, velocities of ``delay`` ago, the fix."""
    state[S.air_age] += dt
    if aid[AIRSPEED] == aid[AIRSPEED]:
        state[S.air] = aid[AIRSPEED]
        state[S.air_age] = 0.0
    learn_at_rest(state, params, dt, gyr, aid[AT_REST] == 1.0)
    wx, wy, wz = gyr[0] - state[4], gyr[1] - state[5], gyr[2] - state[6]
    there = is_present(acc)
    speed = airspeed(state, params)
    smooth(state, params, dt, acc, there, speed, wx, wy, wz)
    turn_by_gyro(state, params, dt, speed, wx, wy, wz)
    state[S.held] = min(state[S.held] + dt, HELD_S)
    if there:
        gather(state, acc)
        if state[S.bin + 2] >= BIN_S:
            pass_on(state, params)
    if aid[VEL_N] == aid[VEL_N] and aid[VEL_E] == aid[VEL_E]:
        take_fix(state, params, aid)


def airspeed(state: Any, params: Any) -> float:
    """Return V [m/s] of a vehicle that flies forward: that of its sensor, else of GNSS; else 0."""
    if params[K.forward] < 0.5:
        return 0.0
    return state[S.air] if state[S.air_age] < AIR_LOST_S else state[S.speed]  # type: ignore[no-any-return]


def smooth(
    state: Any, params: Any, dt: float, acc: Any, there: bool, speed: float, wx: float, wy: float, wz: float
) -> None:
    """Low-pass the force without a turn's acceleration, turned with the body; or as flown, the force."""
    if params[K.smoothing] < 0.5:
        x, y, z = turned_back(state[S.force], state[S.force + 1], state[S.force + 2], wx, wy, wz, dt)
        state[S.force], state[S.force + 1], state[S.force + 2] = x, y, z
    else:
        speed = 0.0
    if there:
        share = min(10.0 * params[K.tilt_gain] * dt, 1.0)
        state[S.force] += share * (acc[0] - state[S.force])
        state[S.force + 1] += share * (acc[1] - speed * wz - state[S.force + 1])
        state[S.force + 2] += share * (acc[2] + speed * wy - state[S.force + 2])


def learn_at_rest(state: Any, params: Any, dt: float, gyr: Any, rests: bool) -> None:
    """Average the rate at rest to the bias, over at most the last 10 s or so."""
    x, y, z = gyr[0] - state[4], gyr[1] - state[5], gyr[2] - state[6]
    still = rests and x * x + y * y + z * z < SLOW_RATE * SLOW_RATE
    state[S.rest_s] = min(state[S.rest_s] + dt, REST_MEAN_S) if still else 0.0
    if still:
        share = dt / state[S.rest_s]
        for i in range(3):
            state[4 + i] = clipped(state[4 + i] + share * (gyr[i] - state[4 + i]), params[K.bias_limit])


def turn_by_gyro(state: Any, params: Any, dt: float, speed: float, wx: float, wy: float, wz: float) -> None:
    """Turn the attitude by the rate (3,) rad/s without bias and the tilt's correction, which becomes bias if slow."""
    fx, fy, fz = state[S.force], state[S.force + 1], state[S.force + 2]
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    steep = 1.0 if speed > 0.0 and norm > GRAVITY else 2.0
    near = 1.0 - min(steep * abs(norm / GRAVITY - 1.0), 1.0)
    gain = params[K.tilt_gain] * near * near / norm if norm > 0.0 else 0.0
    if params[K.smoothing] > 0.5:
        fy -= speed * wz
        fz += speed * wy
    dx, dy, dz = down(state)
    ex, ey, ez = cross(dx, dy, dz, fx, fy, fz)
    ex, ey, ez = gain * ex, gain * ey, gain * ez
    if wx * wx + wy * wy + wz * wz < SLOW_RATE * SLOW_RATE and state[S.rest_s] == 0.0:
        k = params[K.bias_gain] * dt
        state[4] = clipped(state[4] - k * ex, params[K.bias_limit])
        state[5] = clipped(state[5] - k * ey, params[K.bias_limit])
        state[6] = clipped(state[6] - k * ez, params[K.bias_limit])
    turn(state, wx + ex, wy + ey, wz + ez, dt, 0.0)


def clipped(x: float, limit: float) -> float:
    """Return x within +- limit."""
    return min(max(x, -limit), limit)


def gather(state: Any, acc: Any) -> None:
    """Add the horizontal change of velocity since the last sample to that of the present 10 ms, in axes before x."""
    r00, r01, r02, r10, r11, r12, _, _, _ = matrix(state, 0)
    an = r00 * acc[0] + r01 * acc[1] + r02 * acc[2]
    ae = r10 * acc[0] + r11 * acc[1] + r12 * acc[2]
    c, s = state[S.mean + 1], state[S.mean + 2]
    state[S.bin] += state[S.held] * (c * an + s * ae)
    state[S.bin + 1] += state[S.held] * (c * ae - s * an)
    state[S.bin + 2] += state[S.held]
    state[S.held] = 0.0


def pass_on(state: Any, params: Any) -> None:
    """Put the present 10 ms to the past, and predict with what is older than ``delay``."""
    at = S.past + 3 * (int(state[S.first] + state[S.count]) % BINS)
    for i in range(3):
        state[at + i] = state[S.bin + i]
        state[S.bin + i] = 0.0
    state[S.count] += 1.0
    state[S.past_s] += state[at + 2]
    while state[S.count] > 0.0:
        old = S.past + 3 * int(state[S.first])
        if state[S.past_s] - state[old + 2] < params[K.delay] - 0.5 * BIN_S and state[S.count] < BINS:
            break
        if state[S.runs] > 0.0:
            for i in range(N):
                predict_hypothesis(state, params, i, state[old], state[old + 1], state[old + 2])
            state[S.sigma_heading] = math.sqrt(heading_variance(state))
        state[S.past_s] -= state[old + 2]
        state[S.first] = float((int(state[S.first]) + 1) % BINS)
        state[S.count] -= 1.0


def take_fix(state: Any, params: Any, aid: Any) -> None:
    """Correct every hypothesis, weigh them, and turn the attitude to their mean; the first fast fix starts them."""
    # NaN where the receiver reports no accuracy.
    s = aid[VEL_ACC] if aid[VEL_ACC] > params[K.velocity_noise] else params[K.velocity_noise]
    state[S.speed] = math.sqrt(aid[VEL_N] * aid[VEL_N] + aid[VEL_E] * aid[VEL_E])
    if state[S.runs] == 0.0:
        if state[S.speed] > s and aid[AT_REST] != 1.0:
            begin_hypotheses(state, aid[VEL_N], aid[VEL_E], s * s)
        return
    total = 0.0
    for i in range(N):
        w = max(
            state[S.weights + i] * correct_hypothesis(state, i, aid[VEL_N], aid[VEL_E], s * s), params[K.weight_floor]
        )
        state[S.weights + i] = w
        total += w
    if total > 0.0:
        for i in range(N):
            state[S.weights + i] /= total
    else:
        for i in range(N):
            state[S.weights + i] = 1.0 / N
    mix(state)
