"""Would a replayed filter follow, if it moved? A synthetic pulse added to the sensors at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog import estimators, rotation
from attlog.errors import AttlogError
from attlog.metrics.base import Case, per_row
from attlog.metrics.evidence import within
from attlog.reference.model import Row

Array = NDArray[np.float64]

RATE_DPS, PULSE_S = 20.0, 1.0
"""METRICS 3."""
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

    Real filters show 1.00, accelerometer-only ones 0.2 to 0.7, a frozen one 0.
    """
    rest = max(case.segments.of("rest"), key=lambda s: s.seconds, default=None)
    if row.kind != "replay" or rest is None or case.log.imu is None:
        return None
    imu = case.log.imus[case.log.imu]
    pieces = within(imu.gyro.t, (max(rest.t0, rest.t1 - LONGEST_S), rest.t1))
    segment = max(pieces, key=lambda p: p.stop - p.start, default=slice(0, 0))
    t, gyro, acc = imu.gyro.t[segment], imu.gyro.x[segment], imu.acc.x[segment]
    if len(t) < 20 or t[-1] - t[0] < SETTLE_S + PULSE_S:
        return None
    mag = None
    if row.uses_mag and case.log.mag is not None:
        field = case.log.mags[case.log.mag].field
        near = (field.t_best >= t[0]) & (field.t_best <= t[-1])
        mag = estimators.place(t, field.t_best[near], field.x[near])

    def end(gyro: Array, acc: Array, mag: Array | None) -> Array:
        found = estimators.estimate(estimator, t, gyro, acc, mag, sampling=imu.gyro.sampling, **row.parameters)
        return np.asarray(found.q[-1])

    try:
        estimator = estimators.get(row.estimator)
        still = end(gyro, acc, mag)
        shown = np.zeros(3)
        for axis in range(3):
            rate, acc_turned = pulsed(t, acc, axis)
            turned = end(gyro + rate, acc_turned, None if mag is None else pulsed(t, mag, axis)[1])
            apart = np.degrees(rotation.to_rotvec(rotation.multiply(rotation.conjugate(still), turned)))
            whole = np.degrees(np.sum(rate[1:, axis] * np.diff(t)))
            shown[axis] = apart[axis] / whole
    except AttlogError:
        return None  # a filter that cannot be run again stays unranked
    return shown if np.isfinite(shown).all() else None
