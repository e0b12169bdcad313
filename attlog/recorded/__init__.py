"""An attitude that somebody computed elsewhere, read from a CSV file and put on the log's clock and axes by physics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base import gap, rotation
from attlog.base.errors import UsageError
from attlog.estimators import Estimate
from attlog.flight.model import FlightLog, Imu
from attlog.recorded import clock, columns, frame

Array = NDArray[np.float64]
LEAST = 10
"""Attitudes that make a row."""


def read(path: Path, log: FlightLog, imu: Imu, asked: Mapping[str, float | str]) -> Estimate:
    """The attitude of a file as an estimate on the log's clock, body FRD to earth NED.

    ``asked`` are the parameters of :mod:`attlog.estimators.recorded`. ``quality`` says what was found: clock, frame,
    how well gyro and gravity agree. LogUnreadable if the file cannot be opened; UsageError, with what to do, for
    columns that are not there, a file that does not overlap the log, and axes that physics contradicts.
    """
    table = columns.read(path)
    readings: list[tuple[str, Array, frame.FrameFit]] = []
    refused: list[UsageError] = []
    for t, rows, said in clock.on_log(path, table, log, float(asked.get("offset") or 0.0)):
        candidates = frame.candidates(table, rows, str(asked.get("frame", "auto")), str(asked.get("angles", "auto")))
        try:
            readings.append((said, t, frame.chosen(path, t, candidates, imu)))
        except UsageError as error:
            refused.append(error)
    if not readings:
        raise refused[0]
    said, t, found = min(readings, key=lambda r: r[2].apart)
    q = rotation.normalize(found.q)
    good = np.isfinite(q).all(axis=1)
    if good.sum() < LEAST:
        raise UsageError(f"{path}: {int(good.sum())} usable attitudes within the log; {LEAST} are needed")
    t, q = t[good], q[good]
    quality: dict[str, float | str] = {"clock": said, "frame": found.name, **found.quality}
    broken = np.concatenate([[0], np.cumsum(np.diff(t) > max(gap.RESTART_S, gap.limit_of(t)))])
    skipped = {"nan": int((~good).sum())} if not good.all() else {}
    return Estimate(t, q, segment=broken.astype(np.int64), skipped=skipped, quality=quality)
