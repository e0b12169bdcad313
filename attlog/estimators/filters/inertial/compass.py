"""The magnetometer of ``mekf``, and what its covariance leaves out: a lasting acceleration, a field fixed to the body.

Calibration of the magnetometer, a filter of its own:

    h   = h_0 + R o + tau (R w) x h_0              the field of a sensor with offset o and delay tau             (1)
    psi = atan2(h_E, h_N),  z = d - psi            heading of what is left without o and tau                     (2)
    z = home - psi                                 the same at rest, where norm and dip are those of the first rest

A magnetometer that answers 15 ms late is 4 deg off at 300 deg/s, always to the same side while the body turns to one
side; one with a field of 1 uT fixed to the body is 3 deg off where the earth's horizontal field is 20 uT. Both show in
(1) while the body turns, whatever the heading. The delay is taken off at once, the offset as far as it exceeds several
of its sigmas.

Sigmas beyond the covariance; none of them moves the attitude:

    D = d error / d bias:   D <- F D,   D <- (I - K H) D,   variance += sigma^2 D D^T                  (3)
    excess = <u^2 / w>,     u = sum of what velocity corrects in tilt,   w = its variance as modelled   (4)
    doubt  = (<(L - <L>)^2> + <(Z - <Z>)^2>) / <L>^2,   L, Z the field's level and down parts,
             or <(d - psi)^2> where that is more                                                     (5)

The prior of the accelerometer bias is tight, because a wide one takes every lasting acceleration for a bias (flights:
tilt 1.0 to 1.5 deg and more). (3) is Schmidt's consider parameter: a bias that is not estimated but counted. (4) tests
whether corrections add up as white noise would; velocity that lasts for seconds makes them agree with each other, and
the variance of tilt is multiplied by the excess. A field fixed to the body bends the heading as much as it changes L
and Z, on average over a turn; a compass that is stuck turns with the body. (5) beyond what rooms do is a variance of
heading that no averaging removes.

Source: Jazwinski1970, chapter 8 (consider parameters); Laidig2023 (tests of norm and dip).
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.inertial.model import (
    MOVING_RATE,
    NO_FIELD,
    RAD,
    RUNNING,
    E,
    K,
    N,
    S,
    product,
    square,
    turn_earth,
)
from attlog.estimators.vectors import cross

# Corrections add up over that long [s]; the excess is a mean over that long. 3 to 10 and 10 to 30 s give the same.
SLOW_TIME, EXCESS_TIME = 5.0, 20.0
# Rooms and currents bend a sound field by that much; sigma [rad] of a heading of which nothing is known.
SOUND_FIELD, UNKNOWN_HEADING = math.radians(12.0), math.radians(104.0)
# Seconds of motion over which the field is compared with itself; before that much the heading is its first.
FIELD_MEMORY, FIELD_KNOWN = 30.0, 20.0
# A field at one place says no more about north than this: buildings bend it by a few degrees from place to place.
REST_HEADING = 5.0 * RAD
# A field is the earth's while its norm (relative) and dip [rad] are near the references for that long [s].
NORM_LIMIT, DIP_LIMIT, UNDISTURBED_TIME = 0.09, 3.2 * RAD, 0.5
# The references: mean over the first seconds, time constant after that [s].
REFERENCE_START, REFERENCE_TIME = 15.0, 15.0
# New references: time constant [s], seconds in rotation before they are accepted, deviation allowed (relative).
CANDIDATE_TIME, CANDIDATE_AFTER, CANDIDATE_SIZE = 15.0, 10.0, 0.18
# Time constant [s] of the field that is tested, and the rate [rad/s] from which a body is in rotation.
FIELD_FOLLOW_S, ROTATION_RATE = 0.05, 20.0 * RAD
# After so many seconds of refusal a field counts again, with this weight.
REFUSED_S, REFUSED_WEIGHT = 60.0, 1.0 / 16.0
# Sigmas of heading by which a steady field may differ before the heading is opened.
REOPEN_SIGMAS = 4.0
# Deviation of the field in space, and its walk per sqrt(s) of motion (relative).
FIELD_NOISE, FIELD_WALK = 0.023, 0.01
# A field fixed to the body is taken off as far as it exceeds this many of its sigmas.
BODY_FIELD_SIGMAS = 4.0
# A rest counts after that long; a later one measures the first one's field for that long: more would average no room.
HOME_QUIET_S, HOME_SEEN_S = 1.0, 4.0
# The same field again: norm (relative) and dip [rad], and a heading within so many sigmas of drift and field together:
# what is farther off is as likely another field, which neither norm nor dip shows where it lies across north.
HOME_NORM, HOME_DIP, HOME_SIGMAS = 0.012, 0.6 * RAD, 1.0
# Largest slope of the field that carries tilt into heading: beyond it the field is too steep to show north.
MAX_FIELD_SLOPE = 6.0


def correct_reach(state: Any, k: int, s: float) -> None:
    """Correct D of (3) by an update of entry k of the error, whose gain is s times ``S.column``."""
    for i in range(3):
        c = s * state[S.reach + N * i + k]
        for j in range(N):
            state[S.reach + N * i + j] -= c * state[S.column + j]


def add_slow_variance(state: Any, k: int, r: float) -> None:
    """Add to w of (4) the variance that an update of entry k, measured with variance ``r``, corrects in tilt."""
    row = S.P + N * k
    state[S.slow_variance] += (square(state[row]) + square(state[row + 1])) / (state[row + k] + r)


def fade_slow(state: Any) -> None:
    """Fade older corrections in (4)."""
    fade = math.exp(-state[S.seconds] / SLOW_TIME)
    state[S.slow] *= fade
    state[S.slow + 1] *= fade
    state[S.slow_variance] *= fade * fade


def weigh_slow(state: Any) -> None:
    """Update the excess (4) once the block's velocity has corrected the tilt by the error x."""
    state[S.slow] += state[S.x]
    state[S.slow + 1] += state[S.x + 1]
    ratio = (square(state[S.slow]) + square(state[S.slow + 1])) / max(state[S.slow_variance], 1e-16)
    state[S.excess] += (1.0 - math.exp(-state[S.seconds] / EXCESS_TIME)) * (ratio - state[S.excess])


def motion_share(state: Any) -> float:
    """Return how much of the block counts as motion, 0 to 1."""
    return min(1.0, math.sqrt(state[S.turned] / state[S.seconds]) / MOVING_RATE)


def watch_field(state: Any, value: float) -> None:
    """Update the field's doubt (5) by the low-passed field, which would turn the heading by ``value`` [rad]."""
    level = math.sqrt(square(state[S.field_now]) + square(state[S.field_now + 1]))
    down = state[S.field_now + 2]
    if state[S.field_clock] == 0.0:
        state[S.level] = level
        state[S.down] = down
    moving = motion_share(state)
    state[S.field_clock] += moving * state[S.field_since]
    share = moving * state[S.field_since] / min(max(state[S.field_clock], 1.0), FIELD_MEMORY)
    off = level - state[S.level]
    state[S.level] += share * off
    state[S.level_spread] += share * (off * off - state[S.level_spread])
    off = down - state[S.down]
    state[S.down] += share * off
    state[S.down_spread] += share * (off * off - state[S.down_spread])
    state[S.field_off] += share * (value * value - state[S.field_off])
    spread = (state[S.level_spread] + state[S.down_spread]) / max(square(state[S.level]), 1e-30)
    spread = max(spread, state[S.field_off])
    state[S.field_doubt] = min(max(spread - square(SOUND_FIELD), 0.0), square(UNKNOWN_HEADING))
    if state[S.field_clock] < FIELD_KNOWN:
        state[S.heading_doubt] = state[S.field_doubt]


def residual_sigmas(state: Any, params: Any) -> None:
    """Write the sigmas of tilt (two axes together) and of heading."""
    tilt = 0.0
    heading = 0.0
    for i in range(3):
        tilt += square(state[S.reach + N * i]) + square(state[S.reach + N * i + 1])
        heading += square(state[S.reach + N * i + 2])
    bias = square(params[K.acc_bias_considered])
    known = max(state[S.P] + state[S.P + N + 1], 0.0)
    state[S.sigma_tilt] = math.sqrt(known * max(state[S.excess], 1.0) + bias * tilt)
    state[S.sigma_heading] = math.sqrt(max(state[S.P + 2 * (N + 1)], 0.0) + bias * heading + state[S.heading_doubt])


def field(state: Any, params: Any) -> None:
    """Take the block's mean field: calibrate it, test whether it is the earth's, correct heading (8)."""
    inv = 1.0 / state[S.field_count]
    x, y, z = inv * state[S.field_sum], inv * state[S.field_sum + 1], inv * state[S.field_sum + 2]
    if math.sqrt(x * x + y * y) <= 0.0:
        return
    if state[S.stage] == NO_FIELD:
        first_field(state, params, x, y, z)
        return
    if params[K.delay_sigma] > 0.0 or params[K.offset_sigma] > 0.0:
        x, y, z = calibrated(state, params, x, y, z)
    if math.sqrt(x * x + y * y) <= 0.0:
        return
    weight = trust(state, x, y, z)
    value = wrapped(state[S.d] - math.atan2(y, x))
    watch_field(state, value)
    if weight > 0.0:
        heading(state, params, value, x, y, z, weight)
    home_field(state, params)


def calibrated(state: Any, params: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the field without offset and delay, after an update of the filter (1) for (h_0, o, tau)."""
    if state[S.unit] == 0.0:
        state[S.unit] = math.sqrt(x * x + y * y + z * z)
        inv = 1.0 / state[S.unit]
        state[S.cal], state[S.cal + 1], state[S.cal + 2] = inv * x, inv * y, inv * z
        for i in range(3):
            state[S.cal_P + 8 * i] = 0.01
            state[S.cal_P + 8 * (3 + i)] = square(params[K.offset_sigma])
        state[S.cal_P + 48] = square(0.001 * params[K.delay_sigma])
    inv = 1.0 / state[S.unit]
    time = state[S.seconds]
    # Mean rate in earth axes, by the diagonals of B.
    wx = (state[S.B] + state[S.B + 4] + state[S.B + 8]) / time
    wy = (state[S.B + 9] + state[S.B + 13] + state[S.B + 17]) / time
    wz = (state[S.B + 18] + state[S.B + 22] + state[S.B + 26]) / time
    lx, ly, lz = cross(wx, wy, wz, state[S.cal], state[S.cal + 1], state[S.cal + 2])
    moving = motion_share(state)
    for i in range(3):
        state[S.cal_P + 8 * i] += square(FIELD_WALK) * moving * state[S.field_since]
    calibrate(state, 0, inv * x, lx)
    calibrate(state, 1, inv * y, ly)
    calibrate(state, 2, inv * z, lz)
    tau = time * state[S.cal + 6]
    unit = state[S.unit] / time
    size = square(state[S.cal + 3]) + square(state[S.cal + 4]) + square(state[S.cal + 5])
    doubt = square(BODY_FIELD_SIGMAS) * (state[S.cal_P + 24] + state[S.cal_P + 32] + state[S.cal_P + 40])
    weight = 1.0 - doubt / size if size > doubt else 0.0
    ox, oy, oz = product(state, S.A, weight * state[S.cal + 3], weight * state[S.cal + 4], weight * state[S.cal + 5])
    return x - unit * (ox + tau * lx), y - unit * (oy + tau * ly), z - unit * (oz + tau * lz)


def calibrate(state: Any, i: int, value: float, late: float) -> None:
    """Update (h_0, o, tau) with component i of the field; ``late``: that of (R w) x h_0."""
    time = state[S.seconds]
    a, b, c = state[S.A + 3 * i] / time, state[S.A + 3 * i + 1] / time, state[S.A + 3 * i + 2] / time
    z = value - (
        state[S.cal + i] + a * state[S.cal + 3] + b * state[S.cal + 4] + c * state[S.cal + 5] + late * state[S.cal + 6]
    )
    for j in range(7):
        state[S.column + j] = (
            state[S.cal_P + 7 * i + j]
            + a * state[S.cal_P + 21 + j]
            + b * state[S.cal_P + 28 + j]
            + c * state[S.cal_P + 35 + j]
            + late * state[S.cal_P + 42 + j]
        )
    known = (
        state[S.column + i]
        + a * state[S.column + 3]
        + b * state[S.column + 4]
        + c * state[S.column + 5]
        + late * state[S.column + 6]
    )
    spread = square(FIELD_NOISE) * 0.6 / min(state[S.field_since], 0.5)
    limit = 9.0 * (known + square(FIELD_NOISE))
    if z * z > limit:
        spread *= z * z / limit
    s = 1.0 / (known + spread)
    for j in range(7):
        state[S.cal + j] += s * z * state[S.column + j]
    for k in range(7):
        d = s * state[S.column + k]
        for j in range(7):
            state[S.cal_P + 7 * k + j] -= d * state[S.column + j]


def wrapped(angle: float) -> float:
    """Return the angle within +-pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def heading_variance(state: Any, reference: int) -> float:
    """Return the variance of d - psi, or home - psi, without the field's noise."""
    own: float = state[S.P + 2 * (N + 1)] + state[S.P + reference * (N + 1)] - 2.0 * state[S.P + 2 * N + reference]
    return max(own, 0.0)


def heading(state: Any, params: Any, value: float, x: float, y: float, z: float, weight: float) -> None:
    """Update (8) with the field (x, y, z), down-weighted beyond the gate and at rest."""
    limit = params[K.mag_gate] * math.sqrt(heading_variance(state, E.d) + square(3.0 * RAD))
    spread = square(RAD * params[K.mag_noise]) / (weight * min(state[S.field_since], 1.0))
    if abs(value) > limit:
        spread *= square(value / limit)
    room = state[S.P + 2 * (N + 1)] - square(REST_HEADING)
    if state[S.quiet] >= 0.2:
        if room <= 0.0:
            return
        spread *= state[S.P + 2 * (N + 1)] / room
    # The heading takes on a share of the field's doubt (5).
    keep = square(1.0 - update_heading(state, E.d, value, x, y, z, spread))
    state[S.heading_doubt] = keep * state[S.heading_doubt] + (1.0 - keep) * state[S.field_doubt]


def update_heading(state: Any, reference: int, value: float, x: float, y: float, z: float, spread: float) -> float:
    """Update with entry ``reference`` less psi measured as ``value``, variance ``spread``; return the heading's gain.

    Heading, gyro bias, gyro matrix, d and home are corrected.
    """
    square_level = x * x + y * y
    hx = -z * x / square_level
    hy = -z * y / square_level
    for j in range(N):
        state[S.column + j] = (
            state[S.P + 2 * N + j] + hx * state[S.P + j] + hy * state[S.P + N + j] - state[S.P + reference * N + j]
        )
    known = state[S.column + 2] + hx * state[S.column] + hy * state[S.column + 1] - state[S.column + reference]
    s = 1.0 / (known + spread)
    gain: float = s * state[S.column + 2]
    value -= state[S.x + 2] + hx * state[S.x] + hy * state[S.x + 1] - state[S.x + reference]
    subtract_column(state, S.x, -s * value)
    # Where neither row nor column is corrected, P stays.
    for i in range(N):
        c = s * state[S.column + i]
        if 2 <= i < E.ba or i >= E.d:
            for j in range(N):
                state[S.P + N * i + j] -= c * state[S.column + j]
        else:
            subtract_column(state, S.P + N * i, c)
    for i in range(3):
        k = S.reach + N * i
        subtract_column(state, k, s * (state[k + 2] + hx * state[k] + hy * state[k + 1] - state[k + reference]))
    return gain


def subtract_column(state: Any, at: int, c: float) -> None:
    """Subtract c times ``S.column`` from the row at ``at`` for what a heading corrects: itself, gyro, d, home."""
    for j in range(2, E.ba):
        state[at + j] -= c * state[S.column + j]
    for j in range(E.d, N):
        state[at + j] -= c * state[S.column + j]


def home_field(state: Any, params: Any) -> None:
    """Measure home - psi by the low-passed field in the first rest, and in later ones where the field is that one.

    A rest has one error of its field, in direction: steeper fields show north worse, and a longer look shows no more.
    """
    if params[K.home_noise] <= 0.0:
        return
    if state[S.quiet] < HOME_QUIET_S:
        state[S.home_left] = 1.0 if state[S.home_time] > 0.0 else 0.0
        return
    x, y, z = state[S.field_now], state[S.field_now + 1], state[S.field_now + 2]
    level = math.sqrt(x * x + y * y)
    if not level * MAX_FIELD_SLOPE > abs(z):
        return
    norm = math.sqrt(x * x + y * y + z * z)
    dip = math.atan2(z, level)
    time = min(state[S.field_since], 1.0)
    spread = square(RAD * params[K.home_noise] * norm / level)
    if state[S.home_time] == 0.0:
        state[S.home] = math.atan2(y, x)
    value = wrapped(state[S.home] - math.atan2(y, x))
    if state[S.home_left] == 0.0:
        state[S.home_time] += time
        state[S.home_norm] += time / state[S.home_time] * (norm - state[S.home_norm])
        state[S.home_dip] += time / state[S.home_time] * (dip - state[S.home_dip])
    elif (
        state[S.quiet] > HOME_QUIET_S + HOME_SEEN_S
        or abs(norm - state[S.home_norm]) > HOME_NORM * state[S.home_norm]
        or abs(dip - state[S.home_dip]) > HOME_DIP
        or abs(value) > HOME_SIGMAS * math.sqrt(heading_variance(state, E.home) + spread)
    ):
        return
    update_heading(state, E.home, value, x, y, z, spread * HOME_SEEN_S / time)


def trust(state: Any, x: float, y: float, z: float) -> float:
    """Return 1 where norm and dip are the earth's for some time, 1/16 after a minute of refusal, else 0."""
    time = state[S.field_since]
    h = (x, y, z)
    if state[S.field_time] == 0.0:
        for i in range(3):
            state[S.field_now + i] = state[S.candidate_field + i] = h[i]
        state[S.undisturbed] = UNDISTURBED_TIME
    follow = 1.0 - math.exp(-time / FIELD_FOLLOW_S)
    for i in range(3):
        state[S.field_now + i] += follow * (h[i] - state[S.field_now + i])
    now = S.field_now
    norm = math.sqrt(square(state[now]) + square(state[now + 1]) + square(state[now + 2]))
    dip = math.atan2(state[now + 2], math.sqrt(square(state[now]) + square(state[now + 1])))
    state[S.field_time] += time
    good = True
    if state[S.field_time] < REFERENCE_START:
        share = time / state[S.field_time]
        state[S.norm] += share * (norm - state[S.norm])
        state[S.dip] += share * (dip - state[S.dip])
    else:
        good = abs(norm - state[S.norm]) < NORM_LIMIT * state[S.norm] and abs(dip - state[S.dip]) < DIP_LIMIT
    if good:
        state[S.undisturbed] += time
        if state[S.undisturbed] >= UNDISTURBED_TIME:
            follow = 1.0 - math.exp(-time / REFERENCE_TIME)
            state[S.norm] += follow * (norm - state[S.norm])
            state[S.dip] += follow * (dip - state[S.dip])
    else:
        state[S.undisturbed] = 0.0
    good = candidate(state, time, good)
    if good and state[S.undisturbed] >= UNDISTURBED_TIME:
        state[S.rejected] = max(0.0, state[S.rejected] - 2.0 * time)
        return 1.0
    state[S.rejected] = min(state[S.rejected] + time, REFUSED_S)
    return REFUSED_WEIGHT if state[S.rejected] >= REFUSED_S else 0.0


def candidate(state: Any, time: float, good: bool) -> bool:
    """Make a field that stays put in earth axes while the body turns the reference; return whether the field counts.

    A magnet on the body cannot do that. The vector is tested, not norm and dip, so that a wrong heading recovers.
    """
    x = state[S.field_now] - state[S.candidate_field]
    y = state[S.field_now + 1] - state[S.candidate_field + 1]
    z = state[S.field_now + 2] - state[S.candidate_field + 2]
    size = (
        square(state[S.candidate_field]) + square(state[S.candidate_field + 1]) + square(state[S.candidate_field + 2])
    )
    if x * x + y * y + z * z >= square(CANDIDATE_SIZE) * size:
        state[S.candidate_time] = 0.0
        copy_field(state)
        return good
    if state[S.turned] > square(ROTATION_RATE) * state[S.seconds]:
        state[S.candidate_time] += time
    follow = 1.0 - math.exp(-time / CANDIDATE_TIME)
    state[S.candidate_field] += follow * x
    state[S.candidate_field + 1] += follow * y
    state[S.candidate_field + 2] += follow * z
    if state[S.candidate_time] < CANDIDATE_AFTER:
        return good
    state[S.candidate_time] = 0.0
    level = math.sqrt(square(state[S.candidate_field]) + square(state[S.candidate_field + 1]))
    psi = wrapped(math.atan2(state[S.candidate_field + 1], state[S.candidate_field]) - state[S.d])
    if not good:
        state[S.norm] = math.sqrt(square(level) + square(state[S.candidate_field + 2]))
        state[S.dip] = math.atan2(state[S.candidate_field + 2], level)
        state[S.undisturbed] = UNDISTURBED_TIME
    if abs(psi) > REOPEN_SIGMAS * math.sqrt(heading_variance(state, E.d) + square(4.0 * RAD)):
        state[S.P + 2 * (N + 1)] += psi * psi
        copy_field(state)
    return True


def copy_field(state: Any) -> None:
    """Start the candidate anew at the present field."""
    for i in range(3):
        state[S.candidate_field + i] = state[S.field_now + i]


def first_field(state: Any, params: Any, x: float, y: float, z: float) -> None:
    """Turn everything in earth axes to the heading that a late first field shows."""
    psi = math.atan2(y, x)
    s = -math.sin(psi)
    c = math.cos(psi)
    turn_earth(state, 0.0, 0.0, -psi)
    turn_pair(state, S.v, 1, c, s)
    turn_pair(state, S.x, 1, c, s)
    turn_pair(state, S.x + E.v, 1, c, s)
    for j in range(N):
        turn_pair(state, S.P + j, N, c, s)
        turn_pair(state, S.P + E.v * N + j, N, c, s)
    for i in range(3):
        turn_pair(state, S.reach + N * i, 1, c, s)
        turn_pair(state, S.reach + N * i + E.v, 1, c, s)
    for i in range(N):
        turn_pair(state, S.P + N * i, 1, c, s)
        turn_pair(state, S.P + N * i + E.v, 1, c, s)
    state[S.stage] = RUNNING
    first_heading(state, params, math.sqrt(x * x + y * y), z)


def turn_pair(state: Any, at: int, by: int, c: float, s: float) -> None:
    """Turn the north entry at ``at`` and the east entry at ``at + by``."""
    north = state[at]
    east = state[at + by]
    state[at] = c * north - s * east
    state[at + by] = s * north + c * east


def first_heading(state: Any, params: Any, level: float, down: float) -> None:
    """Set the variance of a heading from the field: its own, the tilt's part, and that of d, the same error."""
    lean = min(max(down / level, -MAX_FIELD_SLOPE), MAX_FIELD_SLOPE)
    offset = square(RAD * params[K.field_sigma])
    for j in range(N):
        state[S.P + 2 * N + j] = lean * state[S.P + j]
        state[S.P + N * E.d + j] = 0.0
    state[S.P + 2 * (N + 1)] = square(lean) * state[S.P] + square(RAD * params[K.heading_sigma]) + offset
    state[S.P + N * E.d + 2] = offset
    state[S.P + N * E.d + E.d] = offset
    for j in range(N):
        state[S.P + N * j + 2] = state[S.P + N * 2 + j]
        state[S.P + N * j + E.d] = state[S.P + N * E.d + j]
    for i in range(3):
        state[S.reach + N * i + 2] = lean * state[S.reach + N * i]
    state[S.x + 2] = lean * state[S.x]
    state[S.x + E.d] = 0.0
