"""Find resets: jumps of an attitude without a matching gyro rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.log_cache import cached_per_log
from attlog.flight.model import Attitude, FlightLog, Imu
from attlog.segments import increments, model
from attlog.segments.model import Segments

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Limit of an unexplained rotation: max(SMALLEST_DEG, SIGMAS x robust sigma) + SHARE of the interval's rotation.
SMALLEST_DEG, SIGMAS, SHARE = 1.0, 6.0, 0.1
# Intervals on each side, and the minimum ratio to their 90th percentile. On simulated flights all logged resets are
# found; agile flights show 0 to 1 false ones.
NEIGHBOURS, NEIGHBOUR_FACTOR = 10, 4.0
# Intervals per pass, to limit memory on long logs.
CHUNK = 50_000


def find_resets(attitude: Attitude, imu: Imu | None) -> tuple[Index, list[str]]:
    """Return indices i (k,) of resets between samples i-1 and i, with reasons.

    Resets are those of the log's counters and events, and rotation that the gyro does not explain: above ``max(1 deg, 6
    sigma) + 10 %`` of the interval's rotation, and above 4 times the 90th percentile of the unexplained rotation in the
    10 intervals on each side without the direct neighbours (docs/metrics.md). Gaps are excluded.
    """
    counted = {int(i): "reset counter or event of the autopilot" for i in attitude.resets if 0 < i < len(attitude.t)}
    unexplained = unexplained_deg(attitude, imu)
    found = dict(counted)
    if unexplained is not None:
        jump, rotated = unexplained
        for i in _jump_indices(jump, rotated) + 1:
            if not {int(i) - 1, int(i), int(i) + 1} & counted.keys():
                found[int(i)] = f"jump of {jump[i - 1]:.1f} deg that the gyro does not explain"
            elif int(i) in counted:
                found[int(i)] = f"{counted[int(i)]}, {jump[i - 1]:.1f} deg"
    order = sorted(found)
    return np.array(order, np.int64), [found[i] for i in order]


def known_resets(log: FlightLog, name: str, segments: Segments) -> tuple[Index, list[str]]:
    """Return resets as :func:`find_resets`, for the onboard attitude from its segments."""
    attitude = log.attitudes[name]
    if name != log.onboard:
        return find_resets(attitude, log.replay_imu)
    there = segments.of("reset")
    return np.searchsorted(attitude.t, [s.t1 for s in there]).astype(np.int64), [s.why for s in there]


@cached_per_log
def unexplained_deg(attitude: Attitude, imu: Imu | None) -> tuple[Array, Array] | None:
    """Return rotation (n-1,) in deg per interval: unexplained by the gyro, and by the gyro.

    The unexplained one is NaN for intervals in or across a gap of attitude or gyro. None without a gyro.
    """
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    if imu is None or len(t) < 3 or len(imu.gyro.t) < 3:
        return None
    turning = increments.gyro_increments(imu)
    gyro_t, segment = turning.t, turning.segment
    if len(gyro_t) < 3:
        return None
    jump, rotated = np.empty(len(t) - 1), np.empty(len(t) - 1)
    for a in range(0, len(t) - 1, CHUNK):
        b = min(a + CHUNK, len(t) - 1)
        by_gyro = turning.between(t[a:b], t[a + 1 : b + 1])
        by_attitude = rotation.multiply(rotation.conjugate(attitude.q[a:b]), attitude.q[a + 1 : b + 1])
        rest = rotation.multiply(rotation.conjugate(rotation.from_rotvec(by_gyro)), by_attitude)
        jump[a:b] = np.degrees(rotation.total_angle(rest))
        rotated[a:b] = np.degrees(rotation.length(by_gyro))
    where = np.clip(np.searchsorted(gyro_t, t), 0, len(gyro_t) - 1)
    whole = segment[where[:-1]] == segment[where[1:]]
    whole &= np.diff(model.number_segments(t)) == 0
    whole &= (t[:-1] >= gyro_t[0]) & (t[1:] <= gyro_t[-1]) & (np.diff(t) > 0)
    jump[~whole] = np.nan
    return jump, rotated


def _jump_indices(jump: Array, rotated: Array) -> Index:
    """Return indices of intervals whose unexplained rotation exceeds both limits."""
    known = np.isfinite(jump)
    if not known.any():
        return np.zeros(0, np.int64)
    sigma = 1.4826 * float(np.median(jump[known]))
    limit = max(SMALLEST_DEG, SIGMAS * sigma) + SHARE * rotated
    candidates = np.flatnonzero(known & (np.where(known, jump, 0.0) > limit))
    offsets = np.concatenate([np.arange(-NEIGHBOURS - 1, -1), np.arange(2, NEIGHBOURS + 2)])
    padded = np.concatenate([np.full(NEIGHBOURS + 1, np.nan), jump, np.full(NEIGHBOURS + 1, np.nan)])
    kept = []
    for a in range(0, len(candidates), CHUNK):
        rows = candidates[a : a + CHUNK]
        around = padded[rows[:, None] + offsets + NEIGHBOURS + 1]
        usual = _percentile_90(around)
        kept.append(rows[jump[rows] > NEIGHBOUR_FACTOR * usual])
    return np.concatenate(kept) if kept else np.zeros(0, np.int64)


def _percentile_90(rows: Array) -> Array:
    """Return the 90th percentile (n,) of the finite values of each row (n, k), 0 without any."""
    ordered = np.sort(rows, axis=1)
    count = np.sum(np.isfinite(rows), axis=1)
    place = 0.9 * np.maximum(count - 1, 0)
    low = np.floor(place).astype(np.int64)
    high = np.minimum(low + 1, np.maximum(count - 1, 0))
    row = np.arange(len(rows))
    value = ordered[row, low] + (place - low) * (ordered[row, high] - ordered[row, low])
    return np.where(count > 0, value, 0.0)
