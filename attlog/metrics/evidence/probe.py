"""Would a replayed filter follow, if it moved? A synthetic pulse added to the sensors at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.metrics.base import Case, per_row
from attlog.metrics.evidence import still
from attlog.reference.model import Row

Array = NDArray[np.float64]

RATE_DPS, PULSE_S = 20.0, 1.0
"""The pulse and what precedes it: docs/metrics.md, Noise."""
SETTLE_S, LONGEST_S = 1.0, 8.0
"""The filter runs so long on the rest before the pulse, at least and at most."""


def pulsed(t: Array, vectors: Array, axis: int) -> tuple[Array, Array]:
    """The pulse in the last second of ``t``: rates (n, 3) in rad/s, and fixed vectors (n, 3) as the body sees them."""
    on = t > t[-1] - PULSE_S
    rate = np.zeros((len(t), 3))
    rate[on, axis] = np.radians(RATE_DPS)
    turned = np.zeros((len(t), 3))
    turned[1:, axis] = np.cumsum(rate[1:, axis] * np.diff(t))
    return rate, rotation.rotate_inverse(rotation.from_rotvec(turned), vectors)


@per_row
def gains(case: Case, row: Row) -> Array | None:
    """How much of the pulse the row's filter shows at its end, about body x, y, z; None where it cannot be replayed.

    On the end of the log's longest rest, else on made samples. Real filters show 1.00,
    accelerometer-only ones 0.2 to 0.7, a frozen one 0.
    """
    rest = still.of_log(case, row, SETTLE_S + PULSE_S, LONGEST_S) or still.made(case, row, LONGEST_S)
    if rest is None:
        return None
    t, mag = rest.t, rest.mag
    try:
        before = still.end(row, rest, rest.gyro, rest.acc, mag)
        shown = np.zeros(3)
        for axis in range(3):
            rate, acc_turned = pulsed(t, rest.acc, axis)
            mag_turned = None if mag is None else pulsed(t, mag, axis)[1]
            turned = still.end(row, rest, rest.gyro + rate, acc_turned, mag_turned)
            apart = np.degrees(rotation.to_rotvec(rotation.multiply(rotation.conjugate(before), turned)))
            whole = np.degrees(np.sum(rate[1:, axis] * np.diff(t)))
            shown[axis] = apart[axis] / whole
    except AttlogError:
        return None  # a filter that cannot be run again stays unranked
    return shown if np.isfinite(shown).all() else None
