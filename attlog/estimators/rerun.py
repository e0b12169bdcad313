"""Result of an onboard filter that was run again: attitudes, states and innovations, the same for every firmware.

:func:`Rerun.estimate` gives an :class:`~attlog.estimators.interface.Estimate`. Its ``aux`` holds, at every sample,
``sigma_tilt``, ``sigma_heading`` (n,) in rad, ``sigma_velocity`` (n, 3) in m/s north-east-down and ``acc_bias`` (n, 3)
in m/s^2, and beside them one table (m, 4) for each aid, named ``innovation.AID``. A table has its own times. Its
columns are :data:`INNOVATION_COLUMNS`; the test ratio is the squared innovation over the squared gate times the
variance, and above 1 the sample is rejected. :data:`AIDS` lists the aids with their units.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.estimators.interface import Estimate

Array = NDArray[np.float64]
# Resets, use of GNSS and compass in use: as logged, or by the filter's own rules.
Mode = Literal["flown", "own"]
# The earth's radius of the firmwares' map projections.
EARTH_RADIUS_M = 6371000.0
# More logged sigmas are thinned: those of a quaternion take a fit each.
MAX_LOGGED_SIGMAS = 500
INNOVATION = "innovation."
INNOVATION_COLUMNS = ("t", "innovation", "variance", "ratio")
# Aids in the order of the numbers that the loops write, with the unit of their innovations.
AIDS = {
    "mag_x": "gauss",
    "mag_y": "gauss",
    "mag_z": "gauss",
    "heading": "rad",
    "velocity_n": "m/s",
    "velocity_e": "m/s",
    "velocity_d": "m/s",
    "position_n": "m",
    "position_e": "m",
    "gnss_height": "m",
    "baro_height": "m",
    "airspeed": "m/s",
    "sideslip": "rad",
    "declination": "rad",
}


@dataclass(slots=True)
class Rerun:
    """An onboard filter's output on the autopilot's clock (s since boot).

    ``q`` (n, 4) at the IMU's times ``t``, NaN before the start. ``states`` (k,) or (k, 3) by name at the filter's steps
    ``t_step``, NaN before the start: ``attitude_variance`` (rad^2, earth axes), ``velocity_variance``, ``gyro_bias``
    (rad/s), ``acc_bias`` (m/s^2), ``gnss`` 1 while it is fused, and the filter's own. ``innovations`` (m, 4) by aid.
    ``start``: ``warm`` from logged states, ``cold`` from gravity. ``mode``: ``own`` also where the log holds no event.
    """

    t: Array
    q: Array
    t_step: Array
    states: dict[str, Array]
    innovations: dict[str, Array]
    start: str
    facts: dict[str, float] = field(default_factory=dict)
    mode: Mode = "flown"

    def estimate(self, t0_s: float) -> Estimate:
        """Return the re-run on a log's clock that begins ``t0_s`` after boot."""
        good = np.isfinite(self.q[:, 0])
        k = np.clip(np.searchsorted(self.t_step, self.t[good]), 0, len(self.t_step) - 1)
        known = np.isfinite(self.states["gyro_bias"][:, 0])
        last = np.maximum.accumulate(np.where(known, np.arange(len(known)), 0))[k]
        attitude = np.maximum(self.states["attitude_variance"][last], 0.0)
        aux = {
            "sigma_tilt": np.sqrt(attitude[:, 0] + attitude[:, 1]),
            "sigma_heading": np.sqrt(attitude[:, 2]),
            "sigma_velocity": np.sqrt(np.maximum(self.states["velocity_variance"][last], 0.0)),
            "acc_bias": self.states["acc_bias"][last],
        }
        for aid, table in self.innovations.items():
            aux[INNOVATION + aid] = table - np.array([t0_s, 0.0, 0.0, 0.0])
        t = self.t[good] - t0_s
        return Estimate(
            t, self.q[good], bias=self.states["gyro_bias"][last], aux=aux, segment=np.zeros(len(t), np.int64)
        )


def check_start(changes: Mapping[str, float], at_start: Collection[str], start: str) -> None:
    """UsageError where all changed parameters act on a cold start alone and the run starts warm."""
    if start == "warm" and changes and all(name in at_start for name in changes):
        names = " and ".join(changes)
        raise UsageError(f"{names} acts at switch-on; this re-run begins from logged states, where it changes nothing.")


def innovation_tables(log: Array) -> dict[str, Array]:
    """Sort a loop's log (m, 5) of kind, time, innovation, variance, test ratio into tables by aid."""
    found = {name: np.ascontiguousarray(log[log[:, 0] == number, 1:]) for number, name in enumerate(AIDS)}
    return {name: table for name, table in found.items() if len(table)}


def innovations(aux: Mapping[str, Array]) -> dict[str, Array]:
    """Return the tables (m, 4) of an estimate's ``aux`` by aid."""
    return {name.removeprefix(INNOVATION): table for name, table in aux.items() if name.startswith(INNOVATION)}


def logged_tables(inputs: Any) -> dict[str, Array]:
    """Return what a filter logged of itself, in tables with times (s since boot) in the first column.

    ``sigma``: of tilt and heading in rad. Innovations are named as in a re-run's ``aux``, those of aids that were never
    fused are left out.
    """
    found = {}
    if inputs.states is not None:
        t, q, variances = (x[:: max(len(x) // MAX_LOGGED_SIGMAS, 1)] for x in inputs.states.attitude())
        if variances.shape[1] == 3:
            both = np.column_stack([variances[:, 0] + variances[:, 1], variances[:, 2]])
        else:
            fitted = [attitude_variances(*one) for one in zip(q, variances, strict=True)]
            both = np.array(fitted).reshape(-1, 2) * (2.0, 1.0)
        if len(t):
            found["sigma"] = np.column_stack([t, np.sqrt(np.maximum(both, 0.0))])
    for aid, values in inputs.innovations.items():
        if aid != "t" and np.any(np.nan_to_num(values) != 0.0):
            found[INNOVATION + aid] = np.column_stack([inputs.innovations["t"], values])
    return found


def attitude_variances(q: Array, variances: Array) -> tuple[float, float]:
    """Fit tilt and yaw variance (rad^2) to the four variances of a quaternion: diag(P_q) = E^2 (s, s, s_D) / 4."""
    w, x, y, z = q
    E = np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]]) ** 2 / 4.0
    columns, wanted = np.column_stack([E[:, 0] + E[:, 1], E[:, 2]]), np.maximum(variances, 0.0)
    tilt, yaw = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    if tilt < 0.0:
        tilt, yaw = 0.0, columns[:, 1] @ wanted / (columns[:, 1] @ columns[:, 1])
    elif yaw < 0.0:
        tilt, yaw = columns[:, 0] @ wanted / (columns[:, 0] @ columns[:, 0]), 0.0
    return float(tilt), float(yaw)


def held(t: Array, value: Array, at: Array, before: float) -> Array:
    """Return the last value at or before each time; the first one earlier, ``before`` for an empty stream."""
    if not len(t):
        return np.full(len(at), before)
    return value[np.maximum(np.searchsorted(t, at, side="right") - 1, 0)]


def local_ned(lat: Array, lon: Array, lat0: float, lon0: float) -> tuple[Array, Array]:
    """Return north and east in m about a point: azimuthal equidistant projection."""
    a, b, a0 = np.radians(lat), np.radians(lon - lon0), math.radians(lat0)
    c = np.arccos(np.clip(np.sin(a0) * np.sin(a) + np.cos(a0) * np.cos(a) * np.cos(b), -1.0, 1.0))
    k = EARTH_RADIUS_M * np.where(c > 1e-12, c / np.maximum(np.sin(c), 1e-300), 1.0)
    return k * (np.cos(a0) * np.sin(a) - np.sin(a0) * np.cos(a) * np.cos(b)), k * np.cos(a) * np.sin(b)


def side_by_side(*columns: Array) -> Array:
    """Columns side by side as one contiguous array."""
    return np.ascontiguousarray(np.column_stack(columns), np.float64)
