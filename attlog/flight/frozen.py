"""Find runs of equal records, and remove stuck attitudes: estimates that never ran, began late, or froze.

ArduPilot also logs the records of an EKF that does not run: roll and pitch equal the trim, heading is exactly 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import nanmedian
from attlog.flight.model import Array, Attitude, FlightLog, Problem, Severity, Stream, without_pauses

Mask = NDArray[np.bool_]

STUCK_CODE = "attitude_frozen"
# Least number and duration of equal records: an attitude logged in steps of 0.01 deg is constant for 1 s at rest.
MIN_RECORDS, MIN_STUCK_S = 10, 2.0
# An attitude that never changes over this time is stuck.
MIN_WHOLE_LOG_S = 10.0
# Largest sine of a heading that was never set.
UNSET_HEADING_SINE = 1e-9
# A run is stuck if the gyro turned by more than this, plus a possible drift of its bias.
TURNED_DEG, DRIFT_DPS = 2.0, 0.2
# The gyro is integrated across a gap for at most this time.
MAX_STEP_S = 0.5


def equal_runs(t: Array, x: Array, min_records: int, min_s: float, breaks: Mask | None = None) -> list[tuple[int, int]]:
    """Return index ranges of equal records x (n, k) at ``t`` (n,) s.

    Ranges have at least ``min_records`` and ``min_s``. ``breaks`` (n - 1,): steps that end a range in any case.
    """
    changed = np.zeros(max(len(t) - 1, 0), bool) if breaks is None else breaks.copy()
    for column in x.T:  # column by column, to save memory
        changed |= column[1:] != column[:-1]
    edges = np.concatenate([[0], np.flatnonzero(changed) + 1, [len(t)]])
    long = np.flatnonzero(np.diff(edges) >= min_records)
    runs = zip(edges[long].tolist(), edges[long + 1].tolist(), strict=True)
    return [(a, b) for a, b in runs if t[b - 1] - t[a] >= min_s]


def turned_deg(gyro: Stream, t0: float, t1: float) -> float:
    """Return the largest excursion (deg) of the integrated gyro about any axis between two times.

    The median rate of the whole log is subtracted as bias.
    """
    mine = (gyro.t >= t0) & (gyro.t <= t1) & rotation.finite_rows(gyro.x)
    if np.count_nonzero(mine) < 2:
        return 0.0
    dt = np.minimum(np.diff(gyro.t[mine]), MAX_STEP_S)
    rate = gyro.x[mine][1:] - nanmedian(gyro.x, axis=0)
    return float(np.degrees(np.ptp(np.cumsum(rate * dt[:, None], axis=0), axis=0).max()))


def drop_stuck_attitudes(log: FlightLog) -> None:
    """Remove and report stuck records of the log's attitudes.

    Records are stuck if they repeat an attitude while the vehicle turned, or before the estimate began. An attitude
    without other records is removed from the log.
    """
    if not _anything_moves(log):
        return
    imu = log.replay_imu or next(iter(log.imus), None)
    for name, attitude in list(log.attitudes.items()):
        runs = equal_runs(attitude.t, attitude.q, MIN_RECORDS, MIN_STUCK_S, ~without_pauses(attitude.t))
        runs = [run for run in runs if _is_stuck(attitude, run, None if imu is None else imu.gyro)]
        if not runs:
            continue
        kept = np.ones(len(attitude.t), bool)
        for a, b in runs:
            kept[a:b] = False
        log.problems.append(_stuck_problem(name, attitude, runs, kept, name == log.onboard))
        if kept.any():
            log.attitudes[name] = _kept_records(attitude, kept)
        else:
            del log.attitudes[name]
            log.onboard = None if log.onboard == name else log.onboard


def _anything_moves(log: FlightLog) -> bool:
    """Return whether any gyro (without gyros any attitude) changes; a synthetic log may be constant."""
    moving = [imu.gyro.x for imu in log.imus] or [a.q for a in log.attitudes.values()]
    return any(len(x) > 1 and bool((x[1:] != x[:-1]).any()) for x in moving)


def _is_stuck(attitude: Attitude, run: tuple[int, int], gyro: Stream | None) -> bool:
    """Return whether a run has an unset heading, is the whole log, or misses a turn of the gyro."""
    a, b = run
    w, x, y, z = attitude.q[a]
    t0, t1 = float(attitude.t[a]), float(attitude.t[b - 1])
    if abs(2.0 * (w * z + x * y)) < UNSET_HEADING_SINE or (b - a == len(attitude.t) and t1 - t0 >= MIN_WHOLE_LOG_S):
        return True
    return gyro is not None and turned_deg(gyro, t0, t1) > TURNED_DEG + DRIFT_DPS * (t1 - t0)


def _stuck_problem(name: str, attitude: Attitude, runs: list[tuple[int, int]], kept: Mask, flew: bool) -> Problem:
    """Return the problem that reports the removed records."""
    a, b = runs[0]
    t0, t1 = float(attitude.t[a]), float(attitude.t[b - 1])
    count = int(np.count_nonzero(~kept))
    weight: Severity = "warning" if flew else "note"
    if not kept.any():
        text = f"{name}: all {count:,} records hold one attitude, so this estimate never ran; it is not used."
        return Problem(STUCK_CODE, weight, text)
    if len(runs) == 1 and a == 0:
        text = f"{name}: it holds one attitude to {t1:.1f} s, before this estimate ran; {count:,} records are left out."
        return Problem(STUCK_CODE, "note", text)
    more = f", first for {t1 - t0:.1f} s from {t0:.1f} s" if len(runs) > 1 else f" for {t1 - t0:.1f} s from {t0:.1f} s"
    often = f" {len(runs)} times" if len(runs) > 1 else ""
    text = f"{name}: the attitude froze{often}{more}; {count:,} records are left out."
    return Problem(STUCK_CODE, "warning", text, t=t0)


def _kept_records(attitude: Attitude, kept: Mask) -> Attitude:
    """Return the attitude reduced to the records ``kept`` (n,)."""
    place = np.cumsum(kept) - 1
    resets = attitude.resets[kept[attitude.resets]] if len(attitude.resets) else attitude.resets
    return replace(
        attitude,
        t=attitude.t[kept],
        q=attitude.q[kept],
        t_sample=None if attitude.t_sample is None else attitude.t_sample[kept],
        resets=np.asarray(place[resets], np.int64),
        position=None if attitude.position is None else attitude.position[kept],
    )
