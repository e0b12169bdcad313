"""On which clock are the times of a file? One that the log knows, or the offset that the user gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import UsageError
from attlog.flight.model import FlightLog
from attlog.recorded.columns import AttitudeColumns

Array = NDArray[np.float64]
OVERLAP = 0.5
"""So much of the file, or of the log, must lie within the other."""


def on_log(
    path: Path, table: AttitudeColumns, log: FlightLog, offset: float
) -> list[tuple[Array, NDArray[np.int64], str]]:
    """For each clock on which the file overlaps the log: times (m,) s on the log's clock, which rows (m,) of the table
    they are, and what clock it is.

    Rows whose time does not rise are left out. UsageError where nothing overlaps.
    """
    good = np.isfinite(table.t)
    highest = np.maximum.accumulate(np.where(good, table.t, -np.inf))
    good[1:] &= highest[1:] > highest[:-1]
    rows = np.flatnonzero(good)
    raw = table.t[rows]
    if len(raw) < 2:
        raise UsageError(f"{path}: {len(raw)} rows whose time rises; an attitude needs more")
    imu = log.replay_imu
    begin, end = (0.0, log.seconds) if imu is None else (float(imu.gyro.t_best[0]), float(imu.gyro.t_best[-1]))
    found = []
    for shift, said in _clocks(log, offset):
        t = raw + shift
        common = min(end, float(t[-1])) - max(begin, float(t[0]))
        if common >= OVERLAP * min(end - begin, float(t[-1] - t[0])):
            inside = (t >= begin) & (t <= end)
            found.append((t[inside], rows[inside], said))
    if found:
        return found
    raise UsageError(
        f"{path}: does not overlap the log: its times are {raw[0]:.3f} to {raw[-1]:.3f} s, the log's {begin:.3f} to "
        f"{end:.3f} s (0 is the first IMU sample, {log.t0_us / 1e6:.3f} s after the autopilot's boot); "
        f"give the difference as {path.name}:offset=SECONDS"
    )


def _clocks(log: FlightLog, offset: float) -> list[tuple[float, str]]:
    if offset:
        return [(offset, f"{offset:g} s added")]
    known = [(0.0, "the log's own, 0 is the first IMU sample")]
    if log.t0_us:
        known.append((-log.t0_us / 1e6, "the autopilot's, since its boot"))
    if log.utc_offset is not None:
        known.append((-log.utc_offset, "Unix time, by the log's GNSS"))
    return known
