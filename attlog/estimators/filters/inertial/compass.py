"""What the covariance of ``mekf`` leaves out: an accelerometer bias beyond its prior, accelerations that last.

    D = d error / d bias:   D <- F D,   D <- (I - K H) D,   variance += sigma^2 D D^T                  (1)
    excess = <u^2 / w>,     u = sum of what velocity corrects in tilt,   w = its variance as modelled   (2)
    doubt  = (<(L - <L>)^2> + <(Z - <Z>)^2>) / <L>^2,   L, Z the field's level and down parts,
             or <(D - psi)^2> where that is more                                                     (3)

The prior of the bias is tight, because a wide one takes every acceleration that lasts for a bias (flights: tilt 1.0 to
1.5 deg and more). The attitude keeps it; the sigma does not: (1) is Schmidt's consider parameter, a bias that is not
estimated but counted. (2) asks whether corrections add up as white noise would. Velocity that lasts for seconds makes
them agree with each other; the variance of tilt is multiplied by their excess.

A field fixed to the body bends the heading as much as it changes L and Z, on average over a turn; a compass that is
stuck turns with the body. (3) beyond what rooms do is a variance of heading that no averaging takes away. It moves no
attitude either.

Source: Jazwinski1970, chapter 8 (consider parameters).
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.inertial.recursion import (
    ACC_BIAS_CONSIDERED,
    CAL,
    CAL_P,
    CLOCK,
    DD,
    DELAY_SIGMA,
    DIP,
    DM,
    DOWN,
    DOWN_SPREAD,
    DV,
    EXCESS,
    FIELD_CLOCK,
    FIELD_DOUBT,
    FIELD_OFF,
    FIELD_SIGMA,
    H_COUNT,
    H_SINCE,
    H_TIME,
    HC,
    HEADING_DOUBT,
    HEADING_SIGMA,
    HL,
    LEVEL,
    LEVEL_SPREAD,
    MAG_GATE,
    MAG_NOISE,
    MOVING_RATE,
    NO_FIELD,
    NORM,
    OFFSET_SIGMA,
    QUIET,
    RAD,
    REACH,
    REJECTED,
    RUNNING,
    SIGMA,
    SLOW,
    SLOW_VARIANCE,
    STAGE,
    TURNED,
    UNDISTURBED,
    UNIT,
    A,
    B,
    C,
    D,
    H,
    N,
    P,
    T,
    V,
    X,
    square,
    turn_earth,
)

# Corrections add up over that long [s]; the excess is a mean over that long. 3 to 10 and 10 to 30 s give the same.
SLOW_TIME, EXCESS_TIME = 5.0, 20.0

# Rooms and currents bend a sound field by that much; sigma [rad] of a heading of which nothing is known.
SOUND_FIELD, LOST = math.radians(12.0), math.radians(104.0)
# Seconds of motion over which the field is compared with itself; before that much the heading is its first.
FIELD_MEMORY, FIELD_KNOWN = 30.0, 20.0


def correct_reach(state: Any, k: int, s: float, C: int) -> None:
    """(1) at the update that measures entry k of the error: K = s times the column at ``C``."""
    for i in range(3):
        c = s * state[REACH + N * i + k]
        for j in range(N):
            state[REACH + N * i + j] -= c * state[C + j]


def add_slow_variance(state: Any, k: int, r: float) -> None:
    """(2): the variance of what an update with entry k, measured with variance ``r``, will correct in tilt."""
    row = P + N * k
    state[SLOW_VARIANCE] += (square(state[row]) + square(state[row + 1])) / (state[row + k] + r)


def fade_slow(state: Any) -> None:
    """(2): older corrections count less."""
    fade = math.exp(-state[T] / SLOW_TIME)
    state[SLOW] *= fade
    state[SLOW + 1] *= fade
    state[SLOW_VARIANCE] *= fade * fade


def weigh_slow(state: Any) -> None:
    """(2): the excess after the block's velocity has corrected the tilt by the error x."""
    state[SLOW] += state[X]
    state[SLOW + 1] += state[X + 1]
    ratio = (square(state[SLOW]) + square(state[SLOW + 1])) / max(state[SLOW_VARIANCE], 1e-16)
    state[EXCESS] += (1.0 - math.exp(-state[T] / EXCESS_TIME)) * (ratio - state[EXCESS])


def watch_field(state: Any, value: float) -> None:
    """(3) after the low-passed field ``HL`` was renewed; ``value`` [rad]: by how much it would turn the heading."""
    level = math.sqrt(square(state[HL]) + square(state[HL + 1]))
    down = state[HL + 2]
    if state[FIELD_CLOCK] == 0.0:
        state[LEVEL] = level
        state[DOWN] = down
    moving = min(1.0, math.sqrt(state[TURNED] / state[T]) / MOVING_RATE)
    state[FIELD_CLOCK] += moving * state[H_SINCE]
    share = moving * state[H_SINCE] / min(max(state[FIELD_CLOCK], 1.0), FIELD_MEMORY)
    off = level - state[LEVEL]
    state[LEVEL] += share * off
    state[LEVEL_SPREAD] += share * (off * off - state[LEVEL_SPREAD])
    off = down - state[DOWN]
    state[DOWN] += share * off
    state[DOWN_SPREAD] += share * (off * off - state[DOWN_SPREAD])
    state[FIELD_OFF] += share * (value * value - state[FIELD_OFF])
    spread = (state[LEVEL_SPREAD] + state[DOWN_SPREAD]) / max(square(state[LEVEL]), 1e-30)
    spread = max(spread, state[FIELD_OFF])
    state[FIELD_DOUBT] = min(max(spread - square(SOUND_FIELD), 0.0), square(LOST))
    if state[FIELD_CLOCK] < FIELD_KNOWN:
        state[HEADING_DOUBT] = state[FIELD_DOUBT]


def take_field(state: Any, gain: float) -> None:
    """(3): the heading takes on that share of the field's doubt."""
    keep = square(1.0 - gain)
    state[HEADING_DOUBT] = keep * state[HEADING_DOUBT] + (1.0 - keep) * state[FIELD_DOUBT]


def residual_sigmas(state: Any, params: Any) -> None:
    """Sigma of tilt (two axes together) and of heading."""
    tilt = 0.0
    heading = 0.0
    for i in range(3):
        tilt += square(state[REACH + N * i]) + square(state[REACH + N * i + 1])
        heading += square(state[REACH + N * i + 2])
    bias = square(params[ACC_BIAS_CONSIDERED])
    known = max(state[P] + state[P + N + 1], 0.0)
    state[SIGMA] = math.sqrt(known * max(state[EXCESS], 1.0) + bias * tilt)
    state[SIGMA + 1] = math.sqrt(max(state[P + 2 * (N + 1)], 0.0) + bias * heading + state[HEADING_DOUBT])


# What ``mekf`` makes of the magnetometer: the field's own calibration, whether it is the earth's, and the heading.
#
#     h   = h_0 + R o + tau (R w) x h_0              the field of a sensor with offset o and delay tau             (1)
#     psi = atan2(h_E, h_N),  z = d - psi            heading of what is left without o and tau                     (2)
#
# A magnetometer that answers 15 ms late is 4 deg off at 300 deg/s, always to the same side while the body turns to
# one
# side; one with a field of 1 uT fixed to the body is 3 deg off where the earth's horizontal field is 20 uT. Both show
# in
# (1) while the body turns, whatever the heading: a filter of its own finds them, relative to the size of the field.
# The delay is taken off at once, the offset as far as it exceeds several of its sigmas.

# A field at one place says no more about north than this: buildings bend it by a few degrees from place to place.
REST_HEADING = 5.0 * RAD
# A field is the earth's while its norm (relative) and dip [rad] are near the references for that long [s].
NORM_LIMIT, DIP_LIMIT, UNDISTURBED_TIME = 0.09, 3.2 * RAD, 0.5
# The references: mean over the first seconds, time constant after that [s].
REFERENCE_START, REFERENCE_TIME = 15.0, 15.0
# New references: time constant [s], seconds in rotation before they are believed, deviation allowed (relative).
CANDIDATE_TIME, CANDIDATE_AFTER, CANDIDATE_SIZE = 15.0, 10.0, 0.18
# Sigmas of heading by which a steady field may differ before the heading is opened.
ALARM = 4.0
# Deviation of the field in space, and its walk per sqrt(s) of motion (relative).
FIELD_NOISE, FIELD_WALK = 0.023, 0.01
# A field fixed to the body is taken off as far as it exceeds this many of its sigmas.
SIGNIFICANT = 4.0


def field(state: Any, params: Any) -> None:
    """The block's mean field: is it the earth's, and if so what does it say about heading (8)."""
    inv = 1.0 / state[H_COUNT]
    x = inv * state[H]
    y = inv * state[H + 1]
    z = inv * state[H + 2]
    level = math.sqrt(x * x + y * y)
    if level <= 0.0:
        return
    if state[STAGE] == NO_FIELD:
        first_field(state, params, x, y, z)
        return
    if params[DELAY_SIGMA] > 0.0 or params[OFFSET_SIGMA] > 0.0:
        x, y, z = calibrated(state, params, x, y, z)
    level = math.sqrt(x * x + y * y)
    if level <= 0.0:
        return
    weight = trust(state, params, x, y, z)
    value = wrapped(state[D] - math.atan2(y, x))
    watch_field(state, value)
    if weight > 0.0:
        heading(state, params, value, x, y, z, weight)


def calibrated(state: Any, params: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The field without what is fixed to the body and without its delay, both learnt from the turning body.

    A filter of its own for (h_0, o, tau) in h = h_0 + R o + tau (R w) x h_0.
    """
    if state[UNIT] == 0.0:
        state[UNIT] = math.sqrt(x * x + y * y + z * z)
        inv = 1.0 / state[UNIT]
        state[CAL] = inv * x
        state[CAL + 1] = inv * y
        state[CAL + 2] = inv * z
        for i in range(3):
            state[CAL_P + 8 * i] = 0.01
            state[CAL_P + 8 * (3 + i)] = square(params[OFFSET_SIGMA])
        state[CAL_P + 48] = square(0.001 * params[DELAY_SIGMA])
    inv = 1.0 / state[UNIT]
    time = state[T]
    wx = (state[B] + state[B + 4] + state[B + 8]) / time
    wy = (state[B + 9] + state[B + 13] + state[B + 17]) / time
    wz = (state[B + 18] + state[B + 22] + state[B + 26]) / time
    lx = wy * state[CAL + 2] - wz * state[CAL + 1]
    ly = wz * state[CAL] - wx * state[CAL + 2]
    lz = wx * state[CAL + 1] - wy * state[CAL]
    moving = min(1.0, math.sqrt(state[TURNED] / time) / MOVING_RATE)
    for i in range(3):
        state[CAL_P + 8 * i] += square(FIELD_WALK) * moving * state[H_SINCE]
    calibrate(state, params, 0, inv * x, lx, moving)
    calibrate(state, params, 1, inv * y, ly, moving)
    calibrate(state, params, 2, inv * z, lz, moving)
    tau = time * state[CAL + 6]
    unit = state[UNIT] / time
    size = square(state[CAL + 3]) + square(state[CAL + 4]) + square(state[CAL + 5])
    doubt = square(SIGNIFICANT) * (state[CAL_P + 24] + state[CAL_P + 32] + state[CAL_P + 40])
    weight = 1.0 - doubt / size if size > doubt else 0.0
    ox = weight * state[CAL + 3]
    oy = weight * state[CAL + 4]
    oz = weight * state[CAL + 5]
    return (
        x - unit * (state[A] * ox + state[A + 1] * oy + state[A + 2] * oz + tau * lx),
        y - unit * (state[A + 3] * ox + state[A + 4] * oy + state[A + 5] * oz + tau * ly),
        z - unit * (state[A + 6] * ox + state[A + 7] * oy + state[A + 8] * oz + tau * lz),
    )


def calibrate(state: Any, params: Any, i: int, value: float, late: float, moving: float) -> None:
    """Update of (h_0, o, tau) with one component of the field."""
    time = state[T]
    a = state[A + 3 * i] / time
    b = state[A + 3 * i + 1] / time
    c = state[A + 3 * i + 2] / time
    z = value - (state[CAL + i] + a * state[CAL + 3] + b * state[CAL + 4] + c * state[CAL + 5] + late * state[CAL + 6])
    for j in range(7):
        state[C + j] = (
            state[CAL_P + 7 * i + j]
            + a * state[CAL_P + 21 + j]
            + b * state[CAL_P + 28 + j]
            + c * state[CAL_P + 35 + j]
            + late * state[CAL_P + 42 + j]
        )
    known = state[C + i] + a * state[C + 3] + b * state[C + 4] + c * state[C + 5] + late * state[C + 6]
    spread = square(FIELD_NOISE) * 0.6 / min(state[H_SINCE], 0.5)
    limit = 9.0 * (known + square(FIELD_NOISE))
    if z * z > limit:
        spread *= z * z / limit
    s = 1.0 / (known + spread)
    for j in range(7):
        state[CAL + j] += s * z * state[C + j]
    for k in range(7):
        d = s * state[C + k]
        for j in range(7):
            state[CAL_P + 7 * k + j] -= d * state[C + j]


def wrapped(angle: float) -> float:
    """The angle within +-pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def heading(state: Any, params: Any, value: float, x: float, y: float, z: float, weight: float) -> None:
    """Update (8) with the field (x, y, z); only heading, gyro bias and d are corrected."""
    square_level = x * x + y * y
    hx = -z * x / square_level
    hy = -z * y / square_level
    known = state[P + 2 * (N + 1)] + state[P + DD * (N + 1)] - 2.0 * state[P + 2 * N + DD]
    for j in range(N):
        state[C + j] = state[P + 2 * N + j] + hx * state[P + j] + hy * state[P + N + j] - state[P + DD * N + j]
    limit = params[MAG_GATE] * math.sqrt(max(known, 0.0) + square(3.0 * RAD))
    spread = square(RAD * params[MAG_NOISE]) / (weight * min(state[H_SINCE], 1.0))
    if abs(value) > limit:
        spread *= square(value / limit)
    room = state[P + 2 * (N + 1)] - square(REST_HEADING)
    if state[QUIET] >= 0.2:
        if room <= 0.0:
            return
        spread *= state[P + 2 * (N + 1)] / room
    s = 1.0 / (state[C + 2] + hx * state[C] + hy * state[C + 1] - state[C + DD] + spread)
    take_field(state, s * state[C + 2])
    value -= state[X + 2] + hx * state[X] + hy * state[X + 1] - state[X + DD]
    for i in range(2, DM):
        state[X + i] += s * value * state[C + i]
    state[X + DD] += s * value * state[C + DD]
    # Where neither row nor column is corrected, P stays.
    for i in range(N):
        c = s * state[C + i]
        if 2 <= i < DM or i == DD:
            for j in range(N):
                state[P + N * i + j] -= c * state[C + j]
        else:
            for j in range(2, DM):
                state[P + N * i + j] -= c * state[C + j]
            state[P + N * i + DD] -= c * state[C + DD]
    for i in range(3):
        k = REACH + N * i
        c = s * (state[k + 2] + hx * state[k] + hy * state[k + 1] - state[k + DD])
        for j in range(2, DM):
            state[k + j] -= c * state[C + j]
        state[k + DD] -= c * state[C + DD]


def trust(state: Any, params: Any, x: float, y: float, z: float) -> float:
    """1 where norm and dip of the field are the earth's for some time, 1/16 after a minute of refusal, else 0."""
    time = state[H_SINCE]
    if state[H_TIME] == 0.0:
        for i in range(3):
            state[HL + i] = x * (i == 0) + y * (i == 1) + z * (i == 2)
            state[HC + i] = state[HL + i]
        state[UNDISTURBED] = UNDISTURBED_TIME
    follow = 1.0 - math.exp(-time / 0.05)
    state[HL] += follow * (x - state[HL])
    state[HL + 1] += follow * (y - state[HL + 1])
    state[HL + 2] += follow * (z - state[HL + 2])
    norm = math.sqrt(square(state[HL]) + square(state[HL + 1]) + square(state[HL + 2]))
    dip = math.atan2(state[HL + 2], math.sqrt(square(state[HL]) + square(state[HL + 1])))
    state[H_TIME] += time
    good = True
    if state[H_TIME] < REFERENCE_START:
        share = time / state[H_TIME]
        state[NORM] += share * (norm - state[NORM])
        state[DIP] += share * (dip - state[DIP])
    else:
        good = abs(norm - state[NORM]) < NORM_LIMIT * state[NORM] and abs(dip - state[DIP]) < DIP_LIMIT
    if good:
        state[UNDISTURBED] += time
        if state[UNDISTURBED] >= UNDISTURBED_TIME:
            follow = 1.0 - math.exp(-time / REFERENCE_TIME)
            state[NORM] += follow * (norm - state[NORM])
            state[DIP] += follow * (dip - state[DIP])
    else:
        state[UNDISTURBED] = 0.0
    good = candidate(state, params, time, norm, dip, good)
    if good and state[UNDISTURBED] >= UNDISTURBED_TIME:
        state[REJECTED] = max(0.0, state[REJECTED] - 2.0 * time)
        return 1.0
    state[REJECTED] += time
    if state[REJECTED] >= 60.0:
        state[REJECTED] = 60.0
        return 1.0 / 16.0
    return 0.0


def candidate(state: Any, params: Any, time: float, norm: float, dip: float, good: bool) -> bool:
    """A field that stays put in earth axes while the body turns is the earth's: it becomes the reference.

    A magnet on the body cannot do that. The vector is tested, not norm and dip, so that a wrong heading recovers.
    """
    x = state[HL] - state[HC]
    y = state[HL + 1] - state[HC + 1]
    z = state[HL + 2] - state[HC + 2]
    size = square(state[HC]) + square(state[HC + 1]) + square(state[HC + 2])
    if x * x + y * y + z * z >= square(CANDIDATE_SIZE) * size:
        state[CLOCK] = 0.0
        copy_field(state)
        return good
    if state[TURNED] > square(20.0 * RAD) * state[T]:
        state[CLOCK] += time
    follow = 1.0 - math.exp(-time / CANDIDATE_TIME)
    state[HC] += follow * x
    state[HC + 1] += follow * y
    state[HC + 2] += follow * z
    if state[CLOCK] < CANDIDATE_AFTER:
        return good
    state[CLOCK] = 0.0
    level = math.sqrt(square(state[HC]) + square(state[HC + 1]))
    psi = wrapped(math.atan2(state[HC + 1], state[HC]) - state[D])
    if not good:
        state[NORM] = math.sqrt(square(level) + square(state[HC + 2]))
        state[DIP] = math.atan2(state[HC + 2], level)
        state[UNDISTURBED] = UNDISTURBED_TIME
    known = state[P + 2 * (N + 1)] + state[P + DD * (N + 1)] - 2.0 * state[P + 2 * N + DD]
    if abs(psi) > ALARM * math.sqrt(max(known, 0.0) + square(4.0 * RAD)):
        state[P + 2 * (N + 1)] += psi * psi
        copy_field(state)
    return True


def copy_field(state: Any) -> None:
    """The candidate begins anew at the field as it is."""
    state[HC] = state[HL]
    state[HC + 1] = state[HL + 1]
    state[HC + 2] = state[HL + 2]


def first_field(state: Any, params: Any, x: float, y: float, z: float) -> None:
    """A field that comes late: everything that is told in earth axes turns to the heading that it shows."""
    psi = math.atan2(y, x)
    s = -math.sin(psi)
    c = math.cos(psi)
    turn_earth(state, 0.0, 0.0, -psi)
    turn_pair(state, V, 1, c, s)
    turn_pair(state, X, 1, c, s)
    turn_pair(state, X + DV, 1, c, s)
    for j in range(N):
        turn_pair(state, P + j, N, c, s)
        turn_pair(state, P + DV * N + j, N, c, s)
    for i in range(3):
        turn_pair(state, REACH + N * i, 1, c, s)
        turn_pair(state, REACH + N * i + DV, 1, c, s)
    for i in range(N):
        turn_pair(state, P + N * i, 1, c, s)
        turn_pair(state, P + N * i + DV, 1, c, s)
    state[STAGE] = RUNNING
    first_heading(state, params, math.sqrt(x * x + y * y), 0.0, z)


def turn_pair(state: Any, at: int, by: int, c: float, s: float) -> None:
    """Turn the north and the east entry, which stand at ``at`` and ``at + by``."""
    north = state[at]
    east = state[at + by]
    state[at] = c * north - s * east
    state[at + by] = s * north + c * east


def first_heading(state: Any, params: Any, x: float, y: float, z: float) -> None:
    """Variance of a heading taken from the field: its own, the tilt's part, and that of d, which is the same error."""
    lean = min(max(z / x, -6.0), 6.0)
    offset = square(RAD * params[FIELD_SIGMA])
    for j in range(N):
        state[P + 2 * N + j] = lean * state[P + j]
    state[P + 2 * (N + 1)] = square(lean) * state[P] + square(RAD * params[HEADING_SIGMA]) + offset
    for j in range(N):
        state[P + N * DD + j] = 0.0
    state[P + N * DD + 2] = offset
    state[P + N * DD + DD] = offset
    for j in range(N):
        state[P + N * j + 2] = state[P + N * 2 + j]
        state[P + N * j + DD] = state[P + N * DD + j]
    for i in range(3):
        state[REACH + N * i + 2] = lean * state[REACH + N * i]
    state[X + 2] = lean * state[X]
    state[X + DD] = 0.0
