"""A vehicle standing still, to try a filter on: the log's own rest, or made samples at the log's rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.base import rotation
from attlog.estimators.engine.samples import Sampling
from attlog.metrics.base import Case
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
class Still:
    """Samples at rest: ``t`` (n,) s, ``gyro`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) or None."""

    t: Array
    gyro: Array
    acc: Array
    mag: Array | None
    sampling: Sampling


def made(case: Case, row: Row, seconds: float) -> Still | None:
    """A level vehicle without any noise; None for rows that are no replay."""
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None or len(imu.gyro.t) < 2:
        return None
    step = float(np.clip(np.median(np.diff(imu.gyro.t)), 1.0 / HZ[1], 1.0 / HZ[0]))
    t = np.arange(0.0, seconds, step)
    acc, mag = (np.tile(x, (len(t), 1)) for x in ((0.0, 0.0, -GRAVITY_M_S2), FIELD))
    return Still(t, np.zeros((len(t), 3)), acc, mag if row.uses_mag else None, "interval")


def of_log(case: Case, row: Row, shortest: float, longest: float) -> Still | None:
    """The end of the longest rest of the log, up to ``longest`` s; None under ``shortest`` s."""
    imu = imu_of(case, row)
    rest = max(case.segments.of("rest"), key=lambda s: s.seconds, default=None)
    if row.kind != "replay" or rest is None or imu is None:
        return None
    pieces = within(imu.gyro.t, (max(rest.t0, rest.t1 - longest), rest.t1))
    own = max(pieces, key=lambda p: p.stop - p.start, default=slice(0, 0))
    t = imu.gyro.t[own]
    if len(t) < MIN_SAMPLES or t[-1] - t[0] < shortest:
        return None
    mag = None
    if row.uses_mag and case.log.mag is not None:
        field = case.log.mags[case.log.mag].field
        near = (field.t_best >= t[0]) & (field.t_best <= t[-1])
        mag = estimators.place(t, field.t_best[near], field.x[near])
    return Still(t, case.gyro_of(imu)[own], imu.acc.x[own], mag, imu.gyro.sampling)


def end(row: Row, still: Still, gyro: Array, acc: Array, mag: Array | None) -> Array:
    """The attitude (4,) that the row's filter ends with over such samples. AttlogError where it cannot be run."""
    estimator = estimators.get(row.estimator)
    found = estimators.estimate(estimator, still.t, gyro, acc, mag, sampling=still.sampling, **row.parameters)
    return rotation.normalize(found.q[-1])
