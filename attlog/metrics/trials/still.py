"""A filter tried on a vehicle that stands still: does it follow a turn, does gravity correct it?

On the log's own rest, or on made samples at the log's rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.estimators.engine.samples import Sampling
from attlog.metrics.base import Case, per_row
from attlog.metrics.evidence.samples import imu_of, within
from attlog.reference.model import Row

Array = NDArray[np.float64]


GRAVITY_M_S2 = 9.81
FIELD = (0.2, 0.0, 0.4)
"""A field that points north and down; filters take its direction."""
HZ = (20.0, 200.0)
"""Made samples come at the rate of the log, within these."""
MIN_SAMPLES = 20


@dataclass(frozen=True, slots=True)
class StillSamples:
    """Samples at rest: ``t`` (n,) s, ``gyro`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) or None."""

    t: Array
    gyro: Array
    acc: Array
    mag: Array | None
    sampling: Sampling


def made(case: Case, row: Row, seconds: float) -> StillSamples | None:
    """A level vehicle without any noise; None for rows that are no replay."""
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None or len(imu.gyro.t) < 2:
        return None
    step = float(np.clip(np.median(np.diff(imu.gyro.t)), 1.0 / HZ[1], 1.0 / HZ[0]))
    t = np.arange(0.0, seconds, step)
    acc, mag = (np.tile(x, (len(t), 1)) for x in ((0.0, 0.0, -GRAVITY_M_S2), FIELD))
    return StillSamples(t, np.zeros((len(t), 3)), acc, mag if row.uses_mag else None, "interval")


def of_log(case: Case, row: Row, shortest: float, longest: float) -> StillSamples | None:
    """The end of the longest rest of the log, up to ``longest`` s; None under ``shortest`` s."""
    imu = imu_of(case, row)
    rest = max(case.segments.of("rest"), key=lambda s: s.seconds, default=None)
    if row.kind != "replay" or rest is None or imu is None:
        return None
    segments = within(imu.gyro.t, (max(rest.t0, rest.t1 - longest), rest.t1))
    own = max(segments, key=lambda p: p.stop - p.start, default=slice(0, 0))
    t = imu.gyro.t[own]
    if len(t) < MIN_SAMPLES or t[-1] - t[0] < shortest:
        return None
    mag = None
    if row.uses_mag and case.log.mag is not None:
        field = case.log.mags[case.log.mag].field
        near = (field.t_best >= t[0]) & (field.t_best <= t[-1])
        mag = estimators.place(t, field.t_best[near], field.x[near])
    return StillSamples(t, case.gyro_of(imu)[own], imu.acc.x[own], mag, imu.gyro.sampling)


def end(row: Row, still: StillSamples, gyro: Array, acc: Array, mag: Array | None) -> Array:
    """The attitude (4,) that the row's filter ends with over such samples. AttlogError where it cannot be run."""
    estimator = estimators.get(row.estimator)
    stands = estimators.Measurements(still.t[:1], np.zeros((1, 3))) if "gnss" in estimator.needs else None
    aids = estimators.Aids(velocity=stands)
    found = estimators.estimate(
        estimator, still.t, gyro, acc, mag, sampling=still.sampling, aids=aids, **row.parameters
    )
    return rotation.normalize(found.q[-1])


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
    """Shares (3,) of the pulse about body x, y, z that the row's filter shows at its end; None without a replay.

    On the end of the log's longest rest, else on made samples. Real filters show 1.00,
    accelerometer-only ones 0.2 to 0.7, a frozen one 0.
    """
    rest = of_log(case, row, SETTLE_S + PULSE_S, LONGEST_S) or made(case, row, LONGEST_S)
    if rest is None:
        return None
    t, mag = rest.t, rest.mag
    try:
        before = end(row, rest, rest.gyro, rest.acc, mag)
        shown = np.zeros(3)
        for axis in range(3):
            rate, acc_turned = pulsed(t, rest.acc, axis)
            mag_turned = None if mag is None else pulsed(t, mag, axis)[1]
            turned = end(row, rest, rest.gyro + rate, acc_turned, mag_turned)
            turn = np.degrees(rotation.to_rotvec(rotation.multiply(rotation.conjugate(before), turned)))
            whole = np.degrees(np.sum(rate[1:, axis] * np.diff(t)))
            shown[axis] = turn[axis] / whole
    except AttlogError:
        return None  # a filter that cannot be run again stays unranked
    return shown if np.isfinite(shown).all() else None


STILL_S, TILT_PULSE_S, AFTER_S = 20.0, 0.5, 10.0
MAX_LEFT = 0.8
"""Integrated gyro keeps 1.00 of the tilt, ``mekf``, which may take it for a bias of the accelerometer, 0.33 to 0.50
(6 logs), all others 0.00 to 0.32."""
UNCORRECTED = "it is not corrected by gravity"


@per_row
def tilt_left(case: Case, row: Row) -> float | None:
    """The share of a tilt seen by the gyro alone that is left 10 s later; None where the row cannot be replayed.

    None too for a row that looks ahead: what it says at the end of a made record says nothing of a flight.

    A level, still vehicle for 20 s, then 20 deg/s about x for 0.5 s in the gyro alone: the
    accelerometer goes on to show level, and a filter that listens to it comes back.
    """
    rest = made(case, row, STILL_S + TILT_PULSE_S + AFTER_S) if row.causal else None
    if rest is None:
        return None
    gyro = rest.gyro.copy()
    pulse = (rest.t > STILL_S) & (rest.t <= STILL_S + TILT_PULSE_S)
    gyro[pulse, 0] = np.radians(RATE_DPS)
    try:
        after = end(row, rest, gyro, rest.acc, rest.mag)
    except AttlogError:
        return None
    tilt = np.radians(RATE_DPS) * float(np.sum(np.diff(rest.t)[pulse[1:]]))
    left = float(rotation.inclination_angle(after)) / tilt
    return left if np.isfinite(left) else None


def why_uncorrected(case: Case, row: Row) -> str | None:
    """Why a row may win nothing by quietness, else None: gravity does not correct it."""
    left = tilt_left(case, row)
    return UNCORRECTED if left is not None and left > MAX_LEFT else None
