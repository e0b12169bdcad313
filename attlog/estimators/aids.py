"""What helps an estimator beside gyro, accelerometer and magnetometer: GNSS, barometer, airspeed, rest.

A whole-run estimator gets :class:`Aids` as they are. A step whose ``USES`` names one of
``gnss``, ``baro``, ``airspeed`` and ``at_rest`` takes one argument more, ``aid``, a plain
float64 array with what arrived since the step before, NaN where nothing new did:

======================= ========== ===========================================================
element                 unit       meaning
======================= ========== ===========================================================
LAT, LON, ALT           deg deg m  GNSS position
POS_H_ACC, POS_V_ACC    m          its accuracy (1 sigma), NaN also where the receiver reports none
VEL_N, VEL_E, VEL_D     m/s        GNSS velocity, north-east-down; north is the filter's: magnetic with a declination
VEL_ACC                 m/s        its accuracy
BARO                    m          barometric height, any zero
AIRSPEED                m/s        true airspeed
AT_REST                 -          1 at rest, 0 in motion, at every step; NaN where unknown
======================= ========== ===========================================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core.brief import brief
from attlog.core.errors import UsageError
from attlog.core.jit import F2, I1
from attlog.estimators.interface import AIDS, Array, Estimator

LAT, LON, ALT, POS_H_ACC, POS_V_ACC = 0, 1, 2, 3, 4
VEL_N, VEL_E, VEL_D, VEL_ACC = 5, 6, 7, 8
BARO, AIRSPEED, AT_REST = 9, 10, 11
# Elements of ``aid``.
SIZE = 12
# No low-pass ahead of a logger is later: one at 10 Hz is late by 23 ms.
MAX_LAG_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Values ``x`` (n,) or (n, k) measured at ``t`` (n,) s, with standard deviations ``sigma`` (n,) or (n, j).

    Anything that numpy takes for an array. A missing component of a sample is NaN.
    UsageError for other shapes, times that are not finite or do not rise, infinite values
    and samples without any value.
    """

    t: Array
    x: Array
    sigma: Array | None = None
    __repr__ = brief

    def __post_init__(self) -> None:
        t, x = _array(self.t, "t"), _array(self.x, "x")
        if t.ndim != 1 or x.ndim not in (1, 2) or len(x) != len(t):
            raise UsageError(f"aids need t (n,) and x (n,) or (n, k), not {t.shape} and {x.shape}")
        if not np.isfinite(t).all() or not (np.diff(t) > 0).all():
            raise UsageError("times of aids must be finite and rise; sort them and leave out what comes twice")
        if np.isinf(x).any() or np.isnan(x).reshape(len(t), -1).all(axis=1).any():
            raise UsageError("values of aids must be finite; leave out samples without a value")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "x", x)
        if self.sigma is not None:
            sigma = _array(self.sigma, "sigma")
            if sigma.ndim not in (1, 2) or len(sigma) != len(t) or np.isinf(sigma).any() or (sigma < 0).any():
                raise UsageError(f"sigma of aids must be a number from 0 for each of the {len(t)} samples, or NaN")
            object.__setattr__(self, "sigma", sigma)

    def between(self, t0: float, t1: float) -> Measurements | None:
        """Return the samples with t0 <= t <= t1; None if there is none."""
        a, b = np.searchsorted(self.t, [t0, np.nextafter(t1, np.inf)])
        if a >= b:  # also for a span that ends before it begins
            return None
        if b - a == len(self.t):
            return self
        return Measurements(self.t[a:b], self.x[a:b], None if self.sigma is None else self.sigma[a:b])


@dataclass(frozen=True, slots=True, eq=False)
class Aids:
    """Measurements at their own times (on the clock of the IMU's ``t``), None where there are none.

    ``position`` x (n, 3) latitude and longitude in deg, altitude in m, sigma (n, 2) horizontal
    and vertical in m. ``velocity`` x (n, 3) m/s NED, sigma (n,) m/s. ``baro`` x (n,) height in
    m. ``airspeed`` x (n,) m/s, true. ``at_rest`` (k, 2): begin and end in s of each time at
    rest, in order; an empty (0, 2) says that there was none. ``field`` (3,): the earth's magnetic
    field at the place and date, NED in T. ``lag``: how late in s low-pass filters ahead of the
    logger make gyro and accelerometer. ``sampling``: as in
    :func:`~attlog.estimators.estimate`, which sets it. ``impact``: when in s
    a flight ended in one; what comes later must not reach back. ``mag`` x (n, 3) any unit, body axes: the
    magnetometer at its own times, which ``run`` otherwise sees at the first IMU sample from then on.
    UsageError for other shapes.
    """

    position: Measurements | None = None
    velocity: Measurements | None = None
    baro: Measurements | None = None
    airspeed: Measurements | None = None
    at_rest: Array | None = None
    field: Array | None = None
    lag: tuple[float, float] = (0.0, 0.0)
    sampling: Literal["interval", "instant"] = "interval"
    impact: float | None = None
    mag: Measurements | None = None
    __repr__ = brief

    def __post_init__(self) -> None:
        if self.field is not None:
            field = _array(self.field, "field")
            if field.shape != (3,) or not np.isfinite(field).all():
                raise UsageError(f"aids: field must be (3,), north-east-down in T, not {field.shape}")
            object.__setattr__(self, "field", field)
        if len(self.lag) != 2 or not all(0.0 <= s < MAX_LAG_S for s in self.lag):
            raise UsageError(f"aids: lag must be two times in s from 0 to {MAX_LAG_S}, not {self.lag}")
        three, one = ((3,), ()), ((), ())
        shapes = {"position": ((3,), (2,)), "velocity": three, "baro": one, "airspeed": one, "mag": three}
        for name, (values, sigmas) in shapes.items():
            m = getattr(self, name)
            if m is None:
                continue
            if not isinstance(m, Measurements):
                raise UsageError(f"aids: {name} must be attlog.estimators.Measurements(t, x, sigma)")
            if m.x.shape[1:] != values or (m.sigma is not None and m.sigma.shape[1:] != sigmas):
                wanted = f"x {('n', *values)} and sigma {('n', *sigmas)}".replace("'", "")
                raise UsageError(f"aids: {name} needs {wanted}, not x {m.x.shape}")
        if self.at_rest is not None:
            spans = _array(self.at_rest, "at_rest")
            if spans.ndim != 2 or spans.shape[1] != 2 or not np.isfinite(spans).all():
                raise UsageError(f"aids: at_rest must be (k, 2), begin and end in s of each rest, not {spans.shape}")
            if (np.diff(spans.ravel()) < 0).any():
                raise UsageError("aids: the spans of at_rest must follow each other")
            object.__setattr__(self, "at_rest", spans)

    def between(self, t0: float, t1: float) -> Aids:
        """Return what was measured in t0 <= t <= t1, spans of rest cut to it."""

        def cut(m: Measurements | None) -> Measurements | None:
            return None if m is None else m.between(t0, t1)

        rest = self.at_rest
        if rest is not None:
            rest = np.clip(rest[(rest[:, 1] >= t0) & (rest[:, 0] <= t1)], t0, t1)
        return replace(
            self,
            position=cut(self.position),
            velocity=cut(self.velocity),
            baro=cut(self.baro),
            airspeed=cut(self.airspeed),
            at_rest=rest,
            mag=cut(self.mag),
        )

    def resting(self, t: Array) -> NDArray[np.int64]:
        """Return 1 (n,) where the times ``t`` (n,) lie in a span of rest, else 0; -1 where rest is unknown."""
        if self.at_rest is None:
            return np.full(len(t), -1, np.int64)
        i = np.searchsorted(self.at_rest[:, 0], t, side="right") - 1
        ends = np.append(self.at_rest[:, 1], -np.inf)
        return (t <= ends[i]).astype(np.int64)


def _array(x: ArrayLike, name: str) -> Array:
    """Return a read-only float64 copy; UsageError for anything but numbers."""
    try:
        array = np.array(x, np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"aids: {name} must be an array of numbers ({error})") from None
    array.flags.writeable = False
    return array


# Aids as a step gets them: which measurement belongs to which sample, as rows of one table.


class AidRows(NamedTuple):
    """The ``aid`` of sample k is ``table[row[k]]``, that of a step in which nothing arrives ``table[quiet[k]]``.

    ``row``, ``quiet`` (n,), ``table`` (m, SIZE).
    """

    row: I1
    quiet: I1
    table: F2


def aid_rows(estimator: Estimator, aids: Aids | None, t: Array, declination: float = 0.0) -> AidRows:
    """Place the aids that the estimator uses, each at the first sample at or after its time.

    ``t`` (n,) rising. Of several between two samples the newest is kept. The loop takes no
    step at the first sample of a segment, so what arrived until then, and in the gap before,
    is left out; so is what comes after the last sample. Steps know magnetic north only:
    velocities are turned to it by the ``declination`` (rad).
    """
    quiet = np.zeros(len(t), np.int64)
    if not estimator.uses & AIDS:
        return AidRows(quiet, quiet, np.zeros((1, SIZE)))
    aids = aids or Aids()
    base = np.full((3, SIZE), np.nan)
    if "at_rest" in estimator.uses:
        # Rows 0, 1, 2 hold nothing new: rest unknown, in motion, at rest.
        quiet = aids.resting(t) + 1
        base[1:, AT_REST] = 0.0, 1.0
    arrivals: list[tuple[NDArray[np.int64], int, Array]] = []
    for name, m, parts in (
        ("gnss", aids.position, (slice(LAT, ALT + 1), slice(POS_H_ACC, POS_V_ACC + 1))),
        ("gnss", aids.velocity, (slice(VEL_N, VEL_D + 1), slice(VEL_ACC, VEL_ACC + 1))),
        ("baro", aids.baro, (slice(BARO, BARO + 1), None)),
        ("airspeed", aids.airspeed, (slice(AIRSPEED, AIRSPEED + 1), None)),
    ):
        if name in estimator.uses and m is not None:
            arrivals += _arrivals(m, parts, t)
    hit = np.zeros(len(t), bool)
    for at, _, _ in arrivals:
        hit[at] = True
    where = np.flatnonzero(hit)
    table = np.vstack([base, base[quiet[where]]])
    row = quiet.copy()
    row[where] = len(base) + np.arange(len(where))
    for at, column, values in arrivals:
        # Samples come in the order of time, so the newest overwrites the older ones.
        table[row[at], column] = values
    if declination:
        north, east = table[:, VEL_N].copy(), table[:, VEL_E].copy()
        table[:, VEL_N] = np.cos(declination) * north + np.sin(declination) * east
        table[:, VEL_E] = np.cos(declination) * east - np.sin(declination) * north
    return AidRows(row, quiet, table)


def _arrivals(
    m: Measurements, parts: tuple[slice, slice | None], t: Array
) -> list[tuple[NDArray[np.int64], int, Array]]:
    """Return sample number, column and value of every measurement."""
    at = np.searchsorted(t, m.t, side="left")
    inside = at < len(t)
    found = []
    for part, x in zip(parts, (m.x, m.sigma), strict=True):
        if part is None or x is None:
            continue
        columns = x.reshape(len(m.t), -1)[inside]
        found += [(at[inside], part.start + i, columns[:, i]) for i in range(columns.shape[1])]
    return found


# Airspeed of a body that flies where its nose points: accelerations that are no gravity.
#
#     v' = d/dt (V e_x) = (V', w_z V, -w_y V)        true airspeed V along the nose, no sideslip                (1)
#     f - v' = -g R^T e_z                            in air that moves steadily                                 (2)
#
# In a coordinated turn the specific force points out of the cabin floor, whatever the bank; (2) turns it back to
# gravity. The angle of attack is left out: it counts while the body rolls, and cancels over a turn.
#
# Source: centripetal correction of Premerlani2009, and the change of airspeed.

# Offsets in the state: V of (1) [m/s], V' [m/s^2], the low-passed reading, the last one, its age [s].
TRUE_AIRSPEED, AIRSPEED_RATE, AIRSPEED_LOWPASSED, AIRSPEED_READING, AIRSPEED_AGE = 0, 1, 2, 3, 4
# Below the first [m/s] a pitot tube does not count, from the second on it counts in full.
MIN_AIRSPEED, FULL_AIRSPEED = 1.0, 3.0
# Time constant of the low-pass [s], largest change accepted [m/s^2], how long a reading holds [s].
AIRSPEED_LOWPASS_S, MAX_AIRSPEED_RATE, MAX_AIRSPEED_AGE_S = 0.3, 10.0, 2.0
NEVER = 1e9


def update_airspeed(state: Any, at: int, dt: float, reading: float, still: bool) -> None:
    """Update the airspeed at ``at`` after another ``dt`` by its ``reading`` in m/s, NaN for none.

    The first reading counts at once. While the body is ``still`` the reading is followed and no acceleration
    concluded: tubes read anything before they are set to zero.
    """
    first = state[at + AIRSPEED_AGE] >= NEVER
    state[at + AIRSPEED_AGE] += dt
    if reading == reading:
        state[at + AIRSPEED_READING] = reading
        state[at + AIRSPEED_AGE] = 0.0
    state[at + TRUE_AIRSPEED] = 0.0
    state[at + AIRSPEED_RATE] = 0.0
    if state[at + AIRSPEED_AGE] > MAX_AIRSPEED_AGE_S:
        state[at + AIRSPEED_LOWPASSED] = 0.0
        state[at + AIRSPEED_AGE] = NEVER
    elif first or still:
        state[at + AIRSPEED_LOWPASSED] = state[at + AIRSPEED_READING]
    else:
        before = weighted_airspeed(state[at + AIRSPEED_LOWPASSED])
        step = (1.0 - math.exp(-dt / AIRSPEED_LOWPASS_S)) * (
            state[at + AIRSPEED_READING] - state[at + AIRSPEED_LOWPASSED]
        )
        state[at + AIRSPEED_LOWPASSED] += min(max(step, -MAX_AIRSPEED_RATE * dt), MAX_AIRSPEED_RATE * dt)
        state[at + TRUE_AIRSPEED] = weighted_airspeed(state[at + AIRSPEED_LOWPASSED])
        state[at + AIRSPEED_RATE] = (state[at + TRUE_AIRSPEED] - before) / dt


def weighted_airspeed(speed: float) -> float:
    """Return the part of an airspeed in m/s that counts: none of a breeze, all of a flight."""
    share = min(max((speed - MIN_AIRSPEED) / (FULL_AIRSPEED - MIN_AIRSPEED), 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share) * speed


def without_acceleration(state: Any, at: int, acc: Any, wy: float, wz: float) -> tuple[float, float, float]:
    """Return the specific force less v' of (2); a missing sample (zero) stays one. ``w`` rad/s without bias."""
    if acc[0] == 0.0 and acc[1] == 0.0 and acc[2] == 0.0:
        return 0.0, 0.0, 0.0
    speed = state[at + TRUE_AIRSPEED]
    return acc[0] - state[at + AIRSPEED_RATE], acc[1] - wz * speed, acc[2] + wy * speed
