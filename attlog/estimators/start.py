"""The start of a segment: vectors averaged while the body moves, attitude, and the north of the result.

    G_k = G_{k-1} exp(w_k dt_k),  G_0 = 1           the gyro alone, floating with the first sample
    F   = sum G_k f_k,  M = sum G_k m_k

Gravity and the field are constant in those axes; accelerations of a body that does not fly away
cancel in the sum, in a single sample they do not. Measured over starts cut into the motion of
15 BROAD trials, error of the start attitude: one sample 48 deg, 1 s 12, 2 s 7.7, 3 s 5.9.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation
from attlog.core.errors import PluginError, UsageError
from attlog.estimators.interface import Array, Estimator, plugin_errors
from attlog.estimators.vectors import GRAVITY

if TYPE_CHECKING:
    from attlog.estimators.samples import PreparedSamples


class DerotatedVectors(NamedTuple):
    """Vectors in the body axes of the first sample.

    ``turned`` (n, 4): the body's attitude relative to the first sample. ``acc``, ``mag`` (n, 3):
    every sample's vectors in those axes, zero rows where there is none; their means are what a filter starts from.
    """

    turned: Array
    acc: Array
    mag: Array


def derotate(dt: Array, gyr: Array, acc: Array, mag: Array) -> DerotatedVectors:
    """Turn vectors by the gyro into the body axes of the first sample.

    ``dt`` (n,) s is the time since the sample before (its first value is not used), ``gyr`` (n, 3)
    rad/s the mean rate over it, less its bias where known, ``acc`` and ``mag`` (n, 3) with zero or NaN rows where
    there is no sample.
    """
    turned = rotation.from_rotvec(gyr * dt[:, None])
    if len(turned):
        turned[0] = 1.0, 0.0, 0.0, 0.0
    reach = 1
    while reach < len(turned):
        # Products of 1, 2, 4, ... neighbours: as exact as one after the other, and some hundred times faster.
        turned[reach:] = rotation.multiply(turned[:-reach], turned[reach:])
        reach *= 2
    whole = [np.where(np.isfinite(x).all(axis=1, keepdims=True), x, 0.0) for x in (acc, mag)]
    return DerotatedVectors(turned, rotation.rotate(turned, whole[0]), rotation.rotate(turned, whole[1]))


# With which attitude and state a segment starts, and relative to which north it reports.
#
# Alike for every filter: at rest the vectors of the first 0.5 s are averaged as they are, in motion
# those of the first 3 s in axes that the gyro holds still (:mod:`attlog.estimators.start`);
# the attitude is that of the first sample. A field that comes later than that sets the heading when
# it comes (:func:`realigned`).

# Vectors of a start at rest are averaged over this long.
REST_S = 0.5
# In motion over this long: the longer the better accelerations cancel and the more a gyro bias turns the axes. Over
# starts in motion (177 of BROAD, 112 ArduPilot, 92 PX4) the start is off by 18, 21, 16 deg with 0.5 s, 7.7, 15.8, 12.6
# with 2 s, 5.9, 12.3, 11.8 with 3 s; with a bias of 4.4 deg/s (46 of EuRoC) tilt by 4.8, 5.2, 6.8.
MOTION_S = 3.0
# At rest the gyro shows no more than its bias, and the two halves of the first 0.5 s agree.
REST_RAD_S, REST_STEADY_RAD_S, REST_STEADY_M_S2 = np.deg2rad(10.0), np.deg2rad(1.0), 0.15


class StartVectors(NamedTuple):
    """What the first seconds of a segment show, in body axes of its first sample.

    ``acc``, ``mag`` (3,), zero where there is none; ``late`` is the number of the sample with the first
    field where that comes after the start, else None.
    """

    acc: Array
    mag: Array
    late: int | None


def first(samples: PreparedSamples, a: int, b: int, values: Mapping[str, float | str]) -> StartVectors:
    """Return the start vectors of samples a to b by the parameter ``init``; numbers count from sample 0."""
    init = str(values.get("init", "average"))
    if (a, b, init) not in samples.starts:
        part = slice(a, b)
        seen = first_seconds(
            samples.t[part], samples.gyr[part], samples.acc[part], samples.mag[part], samples.dt[part], init
        )
        samples.starts[a, b, init] = seen if seen.late is None else seen._replace(late=a + seen.late)
    kept: StartVectors = samples.starts[a, b, init]
    return kept


def first_seconds(
    t: Array, gyr: Array, acc: Array, mag: Array, dt: Array | None = None, init: str = "average"
) -> StartVectors:
    """Return the start vectors of a segment without gaps, also for whole runs that align themselves.

    ``t`` (n,) s; ``gyr`` (n, 3) rad/s; ``acc``, ``mag`` (n, 3), zero or NaN rows where there is no sample; ``dt``
    (n,) s where it is not the difference of times; ``init`` first (good sample), else an average. In motion nothing
    after a rate that is no number counts.
    """
    end = int(np.searchsorted(t, t[0] + MOTION_S, side="right"))
    late = None if _there(mag[:end]).any() else next(iter(end + np.flatnonzero(_there(mag[end:]))), None)
    t, gyr, acc, mag = t[:end], gyr[:end], acc[:end], mag[:end]
    soon = t - t[0] <= REST_S
    rest = at_rest(gyr[soon], acc[soon])
    # Where nothing moves the vectors stay as they are, and the gyro's noise out.
    if not (rest and init != "first" and _there(mag[soon]).any()):
        # What the gyro shows at rest is its bias: a field that comes a second later is not turned by that.
        step = np.diff(t, prepend=t[:1]) if dt is None else dt[:end]
        held = derotate(step, gyr - gyr[soon].mean(axis=0) if rest else gyr, acc, mag)
        acc, mag = held.acc, held.mag
    forces, fields = (np.flatnonzero(_there(x)) for x in (acc, mag))
    picked = []
    for rows in (forces, fields):
        if init == "first":
            picked.append(rows[:1])
        else:
            picked.append(rows[t[rows] - t[rows[0]] <= REST_S] if rest and len(rows) else rows)
    return StartVectors(
        acc[picked[0]].mean(axis=0) if len(forces) else np.zeros(3),
        mag[picked[1]].mean(axis=0) if len(fields) else np.zeros(3),
        None if late is None else int(late),
    )


def initial_state(
    estimator: Estimator, seen: StartVectors, params: Array, values: Mapping[str, float | str], q0: ArrayLike | None
) -> Array:
    """Return the state (size,) with which a segment starts.

    ``params`` packed; ``q0`` (4,), the user's attitude, body to true north, overrides the parameter ``init``.
    """
    if q0 is not None:
        attitude = _q0(q0, values)
    elif values.get("init") == "identity":
        attitude = np.array([1.0, 0.0, 0.0, 0.0])
    else:
        attitude = start_attitude(seen.acc, seen.mag, declination_rad(values))
    return _started(estimator, params, seen.acc, seen.mag, attitude)


def realigned(estimator: Estimator, state: Array, params: Array, mag: Array) -> Array:
    """Set the state's heading from the first field ``mag`` (3,), turned by the state's own tilt.

    Tilt and bias go on; what else a filter keeps is started anew around them.
    """
    q = turned_to_field(state[:4], mag)
    force = rotation.rotate_inverse(q, np.array([0.0, 0.0, -GRAVITY]))
    new = _started(estimator, params, force, mag, q)
    bias = estimator.slices.get("bias")
    if bias is not None:
        new[bias] = state[bias]
    return new


def turned_to_field(q: Array, mag: Array) -> Array:
    """Turn the attitude (4,) about the vertical so that the field (3,) points north; a vertical field turns nothing."""
    h = rotation.rotate(q, mag)
    return rotation.turn_about_down(q, -np.arctan2(h[1], h[0])) if h[:2].any() else q


def _started(estimator: Estimator, params: Array, acc: Array, mag: Array, attitude: Array) -> Array:
    """Return the state by the filter's own start."""
    assert estimator.start is not None
    with plugin_errors(estimator.origin):
        own = np.asarray(estimator.start(params, acc, mag, attitude.copy()))
        if own.dtype.kind not in "fiub":  # a cast would drop imaginary parts and take None for a number
            raise PluginError(f"{estimator.origin}: start returns {own.dtype} where real numbers are wanted")
        state = np.array(own, np.float64)
    if state.shape != (estimator.state_size,):
        raise PluginError(
            f"{estimator.origin}: start returns an array of shape {state.shape}, STATE says ({estimator.state_size},)"
        )
    state[:4] = rotation.normalize(state[:4])
    return state


def start_attitude(acc: Array, mag: Array, declination: float = 0.0) -> Array:
    """Return the attitude (4,) by specific force and field at rest: tilt and magnetic heading.

    Without accelerometer level, without magnetometer *true* heading 0 (``declination``
    in rad is what the loop adds to the heading later).
    """
    v = -acc
    roll = np.arctan2(v[1], v[2]) if v.any() else 0.0
    pitch = np.arctan2(-v[0], np.hypot(v[1], v[2])) if v.any() else 0.0
    level = rotation.from_euler(roll, pitch, 0.0)
    h = rotation.rotate(level, mag)
    heading = np.arctan2(-h[1], h[0]) if h[:2].any() else -declination
    return rotation.turn_about_down(level, heading)


def at_rest(gyr: Array, acc: Array) -> bool:
    """Return whether rates (n, 3) are small and the halves of rates and forces agree."""
    half = len(gyr) // 2
    forces = [x[_there(x)] for x in (acc[:half], acc[half:])]
    if half == 0 or not (len(forces[0]) and len(forces[1])):
        return False
    turned = gyr[:half].mean(axis=0) - gyr[half:].mean(axis=0)
    pushed = forces[0].mean(axis=0) - forces[1].mean(axis=0)
    sizes = [float(np.sqrt(np.sum(x**2))) for x in (gyr.mean(axis=0), turned, pushed)]
    return sizes[0] < REST_RAD_S and sizes[1] < REST_STEADY_RAD_S and sizes[2] < REST_STEADY_M_S2


def _there(x: Array) -> NDArray[np.bool_]:
    """Select the rows (n,) that hold a vector: finite and not zero."""
    there: NDArray[np.bool_] = np.isfinite(x).all(axis=1) & (x != 0.0).any(axis=1)
    return there


def _q0(q0: ArrayLike, values: Mapping[str, float | str]) -> Array:
    """Return the user's start attitude (true north) relative to magnetic north."""
    q = np.asarray(q0, np.float64)
    if q.shape != (4,) or not np.isfinite(q).all() or not q.any():
        raise UsageError("q0 must be a quaternion of four numbers (scalar first), not all zero")
    return rotation.turn_about_down(rotation.normalize(q), -declination_rad(values))


def declination_rad(values: Mapping[str, float | str]) -> float:
    """Return the declination in rad, positive east; 0 for estimators without a magnetometer."""
    return float(np.deg2rad(float(values.get("declination", 0.0))))


def to_true_north(q: Array, values: Mapping[str, float | str]) -> Array:
    """Turn magnetic attitudes ``q`` (n, 4) by the declination to true north."""
    angle = declination_rad(values)
    return rotation.turn_about_down(q, angle) if angle else q
