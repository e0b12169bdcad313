"""Does gravity correct a row? Integrated gyro pushes nothing into its attitude and must win nothing by that."""

from __future__ import annotations

import numpy as np

from attlog import estimators, rotation
from attlog.errors import AttlogError
from attlog.metrics.base import Case, per_row
from attlog.metrics.evidence import imu_of
from attlog.reference.model import Row

STILL_S, PULSE_S, AFTER_S = 20.0, 0.5, 10.0
RATE_DPS = 20.0
MAX_LEFT = 0.5
"""Of 14 filters integrated gyro keeps 1.00 of the tilt, all others 0.00 to 0.13."""
MAG = (0.2, 0.0, 0.4)
"""A field that points north and down; filters take its direction."""
HZ = (20.0, 200.0)
"""The probe runs at the rate of the log, within these."""
GRAVITY_M_S2 = 9.81
UNCORRECTED = "it is not corrected by gravity"


@per_row
def tilt_left(case: Case, row: Row) -> float | None:
    """The share of a tilt that only the gyro told which is left 10 s later; None where the row cannot be replayed.

    A level, still vehicle for 20 s, then 20 deg/s about x for 0.5 s in the gyro alone: the
    accelerometer goes on to show level, and a filter that listens to it comes back.
    """
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None or len(imu.gyro.t) < 2:
        return None
    step = float(np.clip(np.median(np.diff(imu.gyro.t)), 1.0 / HZ[1], 1.0 / HZ[0]))
    t = np.arange(0.0, STILL_S + PULSE_S + AFTER_S, step)
    gyro = np.zeros((len(t), 3))
    gyro[(t > STILL_S) & (t <= STILL_S + PULSE_S), 0] = np.radians(RATE_DPS)
    acc = np.tile([0.0, 0.0, -GRAVITY_M_S2], (len(t), 1))
    mag = np.tile(MAG, (len(t), 1)) if row.uses_mag else None
    try:
        estimator = estimators.get(row.estimator)
        q = estimators.estimate(estimator, t, gyro, acc, mag, sampling="interval", **row.parameters).q
    except AttlogError:
        return None
    told = float(np.sum(gyro[:, 0]) * step)
    left = float(rotation.inclination_angle(q[-1])) / told
    return left if np.isfinite(left) else None


def why_not(case: Case, row: Row) -> str | None:
    """Why a row may win nothing by quietness, else None: gravity does not correct it."""
    left = tilt_left(case, row)
    return UNCORRECTED if left is not None and left > MAX_LEFT else None
