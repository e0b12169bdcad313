"""With which attitude and state a segment starts, and relative to which north it reports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from attlog import rotation
from attlog.errors import PluginError, UsageError
from attlog.estimators.base import Array, Estimator, plugin_errors

if TYPE_CHECKING:
    from attlog.estimators.engine.samples import Samples

INIT_S = 0.5
QUIET_RAD_S = 0.15


def initial_state(
    estimator: Estimator,
    samples: Samples,
    a: int,
    b: int,
    params: Array,
    values: Mapping[str, float | str],
    q0: ArrayLike | None,
) -> Array:
    """The state (float64) with which the segment of samples a to b starts; ``q0`` is the user's."""
    acc, mag = _start_vectors(samples, a, b, str(values.get("init", "average")))
    attitude = start_attitude(acc, mag, declination_rad(values)) if q0 is None else _q0(q0, values)
    assert estimator.start is not None
    with plugin_errors(estimator):
        state = np.array(estimator.start(params, acc, mag, attitude.copy()), np.float64)
    if state.shape != (estimator.state_size,):
        raise PluginError(
            f"{estimator.origin}: start returns an array of shape {state.shape}, STATE says ({estimator.state_size},)"
        )
    state[:4] = rotation.normalize(state[:4])
    return state


def start_attitude(acc: Array, mag: Array, declination: float = 0.0) -> Array:
    """Attitude (4,) that a specific force and a field at rest show: tilt and magnetic heading.

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


def _start_vectors(samples: Samples, a: int, b: int, init: str) -> tuple[Array, Array]:
    """Accelerometer and magnetometer at the start of the segment a to b; zero vectors where there is none."""
    end = a + int(np.searchsorted(samples.t[a:b], samples.t[a] + INIT_S, side="right"))
    acc, mag, gyr = samples.acc[a:end], samples.mag[a:end], samples.gyr[a:end]
    quiet = bool(np.sqrt(np.sum(np.mean(gyr, axis=0) ** 2)) < QUIET_RAD_S and np.abs(gyr).max() < 10 * QUIET_RAD_S)
    pick = _mean_good if init == "average" and quiet else _first_good
    return pick(acc), pick(mag)


def _mean_good(x: Array) -> Array:
    """The mean of the vectors that are there, else zeros."""
    good = x[x.any(axis=1)]
    return good.mean(axis=0) if len(good) else np.zeros(3)


def _first_good(x: Array) -> Array:
    """The first vector that is there, else zeros."""
    good = np.flatnonzero(x.any(axis=1))
    return x[good[0]].copy() if len(good) else np.zeros(3)


def _q0(q0: ArrayLike, values: Mapping[str, float | str]) -> Array:
    """The user's start attitude (true north) as the filter sees it (magnetic north)."""
    q = np.asarray(q0, np.float64)
    if q.shape != (4,) or not np.isfinite(q).all() or not q.any():
        raise UsageError("q0 must be a quaternion of four numbers (scalar first), not all zero")
    return rotation.turn_about_down(rotation.normalize(q), -declination_rad(values))


def declination_rad(values: Mapping[str, float | str]) -> float:
    """The declination in rad, positive east; 0 for estimators without a magnetometer."""
    return float(np.deg2rad(float(values.get("declination", 0.0))))


def to_true_north(q: Array, values: Mapping[str, float | str]) -> Array:
    """Attitudes relative to true north: magnetic ones turned by the declination."""
    angle = declination_rad(values)
    return rotation.turn_about_down(q, angle) if angle else q
