"""Does gravity correct a row? Integrated gyro pushes nothing into its attitude and must win nothing by that."""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.metrics.base import Case, per_row
from attlog.metrics.evidence import still
from attlog.reference.model import Row

STILL_S, PULSE_S, AFTER_S = 20.0, 0.5, 10.0
RATE_DPS = 20.0
MAX_LEFT = 0.8
"""Integrated gyro keeps 1.00 of the tilt, ``mekf``, which may take it for a bias of the accelerometer, 0.33 to 0.50
(6 logs), all others 0.00 to 0.32."""
UNCORRECTED = "it is not corrected by gravity"


@per_row
def tilt_left(case: Case, row: Row) -> float | None:
    """The share of a tilt that only the gyro told which is left 10 s later; None where the row cannot be replayed.

    None too for a row that looks ahead: what it says at the end of a made record says nothing of a flight.

    A level, still vehicle for 20 s, then 20 deg/s about x for 0.5 s in the gyro alone: the
    accelerometer goes on to show level, and a filter that listens to it comes back.
    """
    rest = still.made(case, row, STILL_S + PULSE_S + AFTER_S) if row.causal else None
    if rest is None:
        return None
    gyro = rest.gyro.copy()
    pulse = (rest.t > STILL_S) & (rest.t <= STILL_S + PULSE_S)
    gyro[pulse, 0] = np.radians(RATE_DPS)
    try:
        after = still.end(row, rest, gyro, rest.acc, rest.mag)
    except AttlogError:
        return None
    told = np.radians(RATE_DPS) * float(np.sum(np.diff(rest.t)[pulse[1:]]))
    left = float(rotation.inclination_angle(after)) / told
    return left if np.isfinite(left) else None


def why_not(case: Case, row: Row) -> str | None:
    """Why a row may win nothing by quietness, else None: gravity does not correct it."""
    left = tilt_left(case, row)
    return UNCORRECTED if left is not None and left > MAX_LEFT else None
