"""Where a re-run of EKF2 begins: the states that the log holds, and the events that the log dates."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import unique
from attlog.estimators.ekf2 import state as s
from attlog.estimators.error_state import N_ERR, N_STATE
from attlog.estimators.rerun import attitude_variances

if TYPE_CHECKING:
    from attlog.flight.px4.ekf2_inputs import Ekf2Inputs

Array = NDArray[np.float64]
# Smallest start variance of an attitude error, rad^2: a logged zero would never be corrected.
MIN_ATTITUDE_VARIANCE = 1e-9
# Flags are logged once a second; a heading reset dates them to one record of the attitude.
FLAGS_BEFORE_S, FLAGS_AFTER_S, RESET_RECORD_S = 0.6, 0.2, 0.01
# GNSS is fused; the name changed in 1.16.
GNSS_FLAGS = ("cs_gps", "cs_gnss_pos")


class WarmStart(NamedTuple):
    """A logged state: time since boot, state (24,), covariance (23, 23) and control state."""

    t: float
    x: Array
    P: Array
    c: Array


def warm_starts(inputs: Ekf2Inputs, era: int, step_s: float) -> list[WarmStart]:
    """Return the first complete logged state, and the first one after each switch of lanes; empty without any."""
    if inputs.states is None or not len(inputs.states.t):
        return []
    first = np.searchsorted(inputs.states.t, np.append(-np.inf, inputs.switches))
    return [warm_start(inputs, int(i), era, step_s) for i in unique(first[first < len(inputs.states.t)])]


def warm_start(inputs: Ekf2Inputs, i: int, era: int, step_s: float) -> WarmStart:
    """Return the logged state ``i``.

    Only variances are logged: correlations begin at zero and are there again after about 5 s. Up to 1.14 the states
    hold biases per step, and four variances of the quaternion, which are fitted by tilt and yaw about earth axes.
    """
    logged = inputs.states
    assert logged is not None
    t, states, variances = float(logged.t[i]), logged.states[i], logged.covariances[i].copy()
    x, P, c = np.zeros(N_STATE), np.zeros((N_ERR, N_ERR)), np.zeros(s.N_CONTROL)
    x[:] = states[:N_STATE]
    x[:4] /= np.linalg.norm(x[:4])
    if era <= s.ERA_C:
        x[10:16] /= step_s
        variances[10:16] /= step_s**2
    if era == s.ERA_D:
        np.fill_diagonal(P, np.maximum(variances[:N_ERR], 0.0))
    else:
        np.fill_diagonal(P, np.maximum(variances[1 : N_ERR + 1], 0.0))
        tilt, yaw = attitude_variances(x[:4], variances[:4])
        P[0, 0] = P[1, 1] = tilt
        P[2, 2] = yaw
    for i in range(3):
        P[i, i] = max(P[i, i], MIN_ATTITUDE_VARIANCE)
    set_modes(c, inputs, t, era)
    c[s.FALSE_N], c[s.FALSE_E] = x[7], x[8]
    return WarmStart(t, x, P, c)


def set_modes(c: Array, inputs: Ekf2Inputs, t: float, era: int) -> None:
    """Set alignment, GNSS and magnetometer modes from the flags just after ``t``."""

    def flag(*names: str) -> float | None:
        for name in names:
            column = inputs.flags.get(name)
            if column is not None and len(column):
                return float(column[min(int(np.searchsorted(inputs.flags["t"], t)), len(column) - 1)] > 0)
        return None

    c[s.TILT] = 0.0 if flag("cs_tilt_align") == 0.0 else 1.0
    c[s.YAW] = 0.0 if flag("cs_yaw_align") == 0.0 else 1.0
    c[s.GNSS_ON] = c[s.GNSS_CHECKED] = flag(*GNSS_FLAGS) or 0.0
    c[s.ALIGNED] = flag("cs_mag_aligned_in_flight") or 0.0
    if flag("cs_mag_3d", "cs_mag_3D"):
        c[s.MAG_MODE] = s.MAG_3D
    elif flag("cs_mag_hdg"):
        c[s.MAG_MODE] = s.MAG_HEADING
    elif era == s.ERA_D and c[s.YAW]:
        c[s.MAG_MODE] = s.MAG_FIELD_ONLY
    consistent = flag("cs_mag_heading_consistent")
    c[s.CONSISTENT] = float(c[s.MAG_MODE] in (s.MAG_3D, s.MAG_HEADING)) if consistent is None else consistent
    c[s.WIND_ON] = flag("cs_wind", "cs_wind_vel") or 0.0


# Kinds of logged resets of the heading, by the flag that rises with them.
RESET_FLAGS = ("cs_mag_aligned_in_flight", "cs_mag_fault")


def logged_resets(inputs: Ekf2Inputs, kind: int) -> Array | None:
    """Return when a flag of :data:`RESET_FLAGS` rose, dated by the counter of resets; None if it is not logged."""
    flags, attitude = inputs.flags, inputs.attitude
    if not len(flags["t"]) or RESET_FLAGS[kind] not in flags:
        return None
    on = flags[RESET_FLAGS[kind]] > 0
    resets = np.zeros(0)
    if "resets" in attitude:
        resets = attitude["t_now"][1:][np.diff(attitude["resets"]) != 0]
    times = []
    for i in np.flatnonzero(on[1:] & ~on[:-1]) + 1:
        before, after = float(flags["t"][i - 1]), float(flags["t"][i])
        if np.any((inputs.switches > before) & (inputs.switches <= after)):
            continue  # another lane's flag
        near = resets[(resets >= before - FLAGS_BEFORE_S) & (resets <= after + FLAGS_AFTER_S)]
        times.append(float(near[0]) - RESET_RECORD_S if len(near) else 0.5 * (before + after))
    return np.array(times, np.float64)


def logged_gnss(inputs: Ekf2Inputs) -> tuple[Array, Array]:
    """Return times of the flags and whether GNSS was fused; empty if it is not logged."""
    for name in GNSS_FLAGS:
        if name in inputs.flags and len(inputs.flags["t"]):
            return inputs.flags["t"], (inputs.flags[name] > 0).astype(np.float64)
    return np.zeros(0), np.zeros(0)
