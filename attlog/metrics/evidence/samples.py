"""What several questions need: segments of samples, and small rotations and lines within them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Imu
from attlog.metrics.base import Case, per_row
from attlog.reference import clock
from attlog.reference.model import Row
from attlog.segments import gaps, resets
from attlog.segments.spans import Span

Array = NDArray[np.float64]

DRIFT_AIR_S, DRIFT_REST_S = 20.0, 8.0
"""Shortest record of a drift in the air, and at rest after settling: four groups of 5 s, of 2 s."""
DRIFT_SLACK_S = 0.5
"""A record may lack this much: half a block of 1 s."""


def unbroken(t: Array, inside: NDArray[np.bool_], segment_of: NDArray[np.int64] | None = None) -> list[slice]:
    """Index ranges of consecutive samples (n,) inside, cut at gaps of ``t`` and where ``segment_of`` (n,) changes."""
    segment = gaps.number(t)
    return gaps.slices(inside, segment if segment_of is None else gaps.renumber(segment, segment_of))


def within(t: Array, span: Span, segment_of: NDArray[np.int64] | None = None) -> list[slice]:
    """Unbroken segments of samples with span[0] <= t <= span[1]; ``t`` (n,) s ascending."""
    i, j = int(np.searchsorted(t, span[0], side="left")), int(np.searchsorted(t, span[1], side="right"))
    found = unbroken(t[i:j], np.ones(j - i, bool), None if segment_of is None else segment_of[i:j])
    return [slice(s.start + i, s.stop + i) for s in found]


def seconds(t: Array, segments: list[slice]) -> float:
    """Time covered by segments of the times ``t`` (n,) s, in s."""
    return float(sum(t[s.stop - 1] - t[s.start] for s in segments))


@per_row
def row_segments(case: Case, row: Row) -> NDArray[np.int64]:
    """Segments of a row (n,) between restarts, and for onboard rows between resets of that attitude."""
    attitude = case.log.attitudes.get(row.estimator) if row.kind == "onboard" else None
    if attitude is None:
        return row.segment
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[resets.known(case.log, row.estimator, case.segments)[0]] = 1
    _, _, kept = clock.usable(attitude, case.reference.clock)
    return row.segment + np.cumsum(jumped)[kept]


def imu_of(case: Case, row: Row) -> Imu | None:
    """The unit that a row was replayed from; of onboard rows the one that the others were. None without one."""
    if row.imu is not None:
        return row.imu
    return case.log.replay_imu


def logged_unit(case: Case, imu: Imu) -> int | None:
    """Which of the log's units this is; None where its samples were changed before the filter saw them."""
    return next((k for k, unit in enumerate(case.log.imus) if unit is imu), None)


def detrended(t: Array, x: Array) -> Array:
    """``x`` (n,) or (n, k) without its least-squares straight line over ``t`` (n,)."""
    u = t - np.mean(t)
    centred = x - np.mean(x, axis=0)
    slope = np.tensordot(u, centred, axes=(0, 0)) / float(u @ u)
    return np.asarray(centred - (u[:, None] * slope if x.ndim == 2 else u * slope))


def deviations(q: Array) -> Array:
    """Small rotations (n, 3) in deg away from the mean attitude: about the level roll and pitch axis and the vertical.

    Level, not body axes: these are inclined to the vertical, and a heading that wanders would pass for tilt.
    """
    centre = rotation.mean(q)
    away = rotation.error(q, centre)
    heading = rotation.unwrap(rotation.heading_angle(away))
    north, east = rotation.to_rotvec(away)[:, :2].T
    yaw = rotation.to_euler(centre)[2]
    roll, pitch = north * np.cos(yaw) + east * np.sin(yaw), east * np.cos(yaw) - north * np.sin(yaw)
    return np.asarray(np.degrees(np.column_stack([roll, pitch, heading])))
