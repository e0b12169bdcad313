"""The raw samples of an inertial unit and what becomes of them, as one compiled loop.

At the raw rate (loop rate x substeps) the body's rate and specific force are moved to the unit's place, shaken,
turned and scaled, biased, made noisy, clipped and rounded like a converter's counts, then low-passed. At each
sampling instant the loop writes the low-pass's value (instant) or the mean since the last instant (interval): for
the gyro the rotation vector over the interval, composed to second order with the term of a linearly changing rate
(Bortz 1971), divided by its length.
"""

from __future__ import annotations

import math
from typing import Any

RAW = 17
"""Columns of a raw row: w (3), w_dot (3), specific force at the centre of gravity (3), rotor speeds (4), rotor
angles (4)."""
OUT = 9
"""Columns of a sample: dt, gyro (3), acc (3), clipped raw samples of gyro and accelerometer."""
STATE = 50
"""y (6) 0, filter memories (6 x 2) 6, angle (3) 18, velocity (3) 21, last instant 24, clipped (2) 25, primed 27,
true rate and force of the raw row before 28, y of the raw row before 34."""
SIGNATURE = (
    "i8(i8, f8, f8[:, ::1], f8[:, ::1], i8, f8[:, ::1], i8, f8[:, :, ::1], f8[::1], f8[::1], f8[:, :, ::1], "
    "f8[:, :, ::1], f8[::1], f8[::1], i8, f8[:, ::1])"
)


def imu_samples(
    first: int,
    h: float,
    raw: Any,
    noise: Any,
    used: int,
    bias: Any,
    substeps: int,
    matrices: Any,
    numbers: Any,
    harmonics: Any,
    shake: Any,
    phase: Any,
    state: Any,
    instants: Any,
    k: int,
    out: Any,
) -> int:
    """Run through the raw rows from number ``first`` on, which end at ``(first + 1) h`` ...; fill ``out`` from row
    ``k`` on; the next row's number.

    ``noise`` (n, 6) is standard normal, its row ``used`` the first one's; ``bias`` (periods, 6) has a row for every
    ``substeps`` raw rows of the flight. ``numbers``: lever arm (3), limits (2), steps (2), noise
    (2), low-pass on (2) and coefficients (2 x 5), interval (1 or 0), hover speed.
    """
    mean = numbers[21] > 0.5
    for j in range(len(raw)):
        x0, x1, x2 = raw[j, 0], raw[j, 1], raw[j, 2]
        a0, a1, a2 = raw[j, 3], raw[j, 4], raw[j, 5]
        r0, r1, r2 = numbers[0], numbers[1], numbers[2]
        d = x0 * r0 + x1 * r1 + x2 * r2
        s2 = x0 * x0 + x1 * x1 + x2 * x2
        f0 = raw[j, 6] + a1 * r2 - a2 * r1 + x0 * d - r0 * s2
        f1 = raw[j, 7] + a2 * r0 - a0 * r2 + x1 * d - r1 * s2
        f2 = raw[j, 8] + a0 * r1 - a1 * r0 + x2 * d - r2 * s2
        for n in range(len(harmonics)):
            for r in range(4):
                size = raw[j, 9 + r] / numbers[22]
                size *= size
                if size > 1e-6:
                    angle = harmonics[n] * raw[j, 13 + r]
                    x0 += size * shake[n, r, 0] * math.sin(angle + phase[n, r, 0])
                    x1 += size * shake[n, r, 1] * math.sin(angle + phase[n, r, 1])
                    x2 += size * shake[n, r, 2] * math.sin(angle + phase[n, r, 2])
                    f0 += size * shake[n, r, 3] * math.sin(angle + phase[n, r, 3])
                    f1 += size * shake[n, r, 4] * math.sin(angle + phase[n, r, 4])
                    f2 += size * shake[n, r, 5] * math.sin(angle + phase[n, r, 5])
        b = (first + j) // substeps
        fresh = state[27] < 0.5
        state[27] = 1.0
        if mean:
            # What a converter that integrates sees: the mean over the raw step, for the rate its rotation vector.
            t0, t1, t2, t3, t4, t5 = x0, x1, x2, f0, f1, f2
            if not fresh:
                p0, p1, p2 = state[28], state[29], state[30]
                c = h / 12.0
                x0 = 0.5 * (p0 + t0) + c * (p1 * t2 - p2 * t1)
                x1 = 0.5 * (p1 + t1) + c * (p2 * t0 - p0 * t2)
                x2 = 0.5 * (p2 + t2) + c * (p0 * t1 - p1 * t0)
                f0, f1, f2 = 0.5 * (state[31] + t3), 0.5 * (state[32] + t4), 0.5 * (state[33] + t5)
            state[28], state[29], state[30], state[31], state[32], state[33] = t0, t1, t2, t3, t4, t5
        for i in range(6):
            state[34 + i] = state[i]
        for i in range(6):
            g = 0 if i < 3 else 1
            c = i - 3 * g
            if g == 0:
                y = matrices[0, c, 0] * x0 + matrices[0, c, 1] * x1 + matrices[0, c, 2] * x2
            else:
                y = matrices[1, c, 0] * f0 + matrices[1, c, 1] * f1 + matrices[1, c, 2] * f2
            y += bias[b, i] + numbers[7 + g] * noise[used + j, i]
            limit = numbers[3 + g]
            if abs(y) >= limit:
                y = limit if y > 0 else -limit
                state[25 + g] += 1.0
            if numbers[5 + g] > 0:
                y = numbers[5 + g] * math.floor(y / numbers[5 + g] + 0.5)
            if numbers[9 + g] > 0.5:
                q = 11 + 5 * g
                if fresh:
                    # Begin as if the first value had always been there.
                    state[6 + 2 * i] = y * (1.0 - numbers[q])
                    state[7 + 2 * i] = y * (numbers[q + 2] - numbers[q + 4])
                filtered = numbers[q] * y + state[6 + 2 * i]
                state[6 + 2 * i] = numbers[q + 1] * y - numbers[q + 3] * filtered + state[7 + 2 * i]
                state[7 + 2 * i] = numbers[q + 2] * y - numbers[q + 4] * filtered
                y = filtered
            state[i] = y
        if fresh:
            for i in range(6):
                state[34 + i] = state[i]
        begin = (first + j) * h
        done = 0.0
        while k < len(instants) and instants[k] <= begin + h * 1.000001:
            u = (instants[k] - begin) / h
            if u > 1.0:
                u = 1.0
            if mean:
                _integrate(state, (u - done) * h)
                dt = instants[k] - state[24]
                for i in range(6):
                    out[k, 1 + i] = state[18 + i] / dt
                    state[18 + i] = 0.0
            else:
                dt = instants[k] - state[24]
                for i in range(6):
                    out[k, 1 + i] = state[34 + i] + u * (state[i] - state[34 + i])
            out[k, 0] = dt
            out[k, 7] = state[25]
            out[k, 8] = state[26]
            state[25] = 0.0
            state[26] = 0.0
            state[24] = instants[k]
            done = u
            k += 1
        if mean and done < 1.0:
            _integrate(state, (1.0 - done) * h)
    return k


def _integrate(state: Any, seconds: float) -> None:
    """Add ``seconds`` of the present values: the turn composed to second order, the velocity as a sum."""
    d0, d1, d2 = state[0] * seconds, state[1] * seconds, state[2] * seconds
    a0, a1, a2 = state[18], state[19], state[20]
    state[18] = a0 + d0 + 0.5 * (a1 * d2 - a2 * d1)
    state[19] = a1 + d1 + 0.5 * (a2 * d0 - a0 * d2)
    state[20] = a2 + d2 + 0.5 * (a0 * d1 - a1 * d0)
    for i in range(3):
        state[21 + i] += seconds * state[3 + i]
