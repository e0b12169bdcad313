"""Satellite receivers of an ArduPilot log: as flown, and as given to the EKF for replay.

GPA.SMS (boot time, ms) is ``last_message_time_ms``, from which the EKF subtracts GPS_DELAY_MS; GPS and GPA are written
10 to 50 ms later.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import receiver
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.ardupilot.imus import units
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.clock.timing import stamps_of
from attlog.flight.clock.utc import gps_time_us
from attlog.flight.model import Array, Gnss
from attlog.formats.base import Table


def one_receiver(builder: LogBuilder, clock: Clock, unit: int, table: Table) -> Gnss | None:
    """One receiver: GPS with the accuracies of GPA; velocity from ground speed, course and vertical speed."""
    if not all(c in table for c in ("Lat", "Lng", "Spd", "GCrs")) or "Status" not in table:
        return None
    t_us = clock.of(table)
    source = f"GPS:{unit}"
    altitude = table.value("Alt") if "Alt" in table else np.full(len(table), np.nan)
    place = np.column_stack([table.value("Lat"), table.value("Lng"), altitude])
    speed, course = table.value("Spd"), np.radians(table.value("GCrs"))
    down = table.value("VZ") if "VZ" in table else np.full(len(table), np.nan)
    velocity = np.column_stack([speed * np.cos(course), speed * np.sin(course), down])
    h_acc, v_acc, s_acc = (accuracy(builder, clock, unit, t_us, c) for c in ("HAcc", "VAcc", "SAcc"))
    yaw = np.radians(table.value("Yaw")) if "Yaw" in table else None
    if yaw is not None:
        yaw = np.where(yaw == 0.0, np.nan, (yaw + np.pi) % (2 * np.pi) - np.pi)  # 0: the receiver has no heading
    return receiver.build(
        builder,
        unit,
        t_us,
        source,
        place=place,
        velocity=velocity,
        fix=table["Status"].astype(np.int64),
        accuracy=(h_acc, v_acc, s_acc),
        yaw=yaw,
        utc_us=utc_us(table),
        received_us=1e3 * accuracy(builder, clock, unit, t_us, "SMS"),
        reception={name: told(table, column) for name, column in RECEPTION.items()},
    )


RECEPTION = {"satellites": "NSats", "hdop": "HDop"}


def told(table: Table, column: str) -> Array:
    """A column (n,), NaN where the record has none."""
    return table.value(column).astype(np.float64) if column in table else np.full(len(table), np.nan)


def replay_receivers(builder: LogBuilder) -> list[Gnss]:
    """Receivers as LOG_REPLAY gave them to the EKF (RGPJ): 1e-7 deg, cm, m/s NED, boot time in ms."""
    found = []
    for unit, table in units(builder.messages, "RGPJ").items():
        t_us = stamps_of(table, "TS", 1000)
        place = columns(table, "Lat", "Lon", "Alt") * [1e-7, 1e-7, 1e-2]
        new = np.concatenate([[True], np.diff(t_us) != 0]) if len(t_us) else np.zeros(0, bool)
        told = new & (place[:, :2] != 0).any(axis=1)
        one = receiver.build(
            builder,
            unit,
            t_us[told],
            f"RGPJ:{unit}",
            place=place[told],
            velocity=columns(table, "VX", "VY", "VZ")[told],
            fix=np.full(int(told.sum()), 3),
            accuracy=(table.value("HA")[told], table.value("VA")[told], table.value("SA")[told]),
        )
        found += [] if one is None else [one]
    return found


def accuracy(builder: LogBuilder, clock: Clock, unit: int, t_us: np.ndarray, column: str) -> Array:
    """An accuracy from the GPA record that belongs to each GPS record (at most 0.5 s away), else NaN."""
    table = units(builder.messages, "GPA").get(unit)
    if table is None or column not in table or len(table) == 0:
        return np.full(len(t_us), np.nan)
    at = clock.of(table)
    order = np.argsort(at, kind="stable")
    at, x = at[order], table.value(column)[order]
    k = np.clip(np.searchsorted(at, t_us), 1, max(len(at) - 1, 1))
    k = np.minimum(k, len(at) - 1)
    k = np.where(np.abs(at[k - 1] - t_us) < np.abs(at[k] - t_us), k - 1, k)
    return np.where(np.abs(at[k] - t_us) <= 500_000, x[k], np.nan)


def utc_us(table: Table) -> np.ndarray | None:
    """Unix time in us from GPS week and milliseconds, 0 where the receiver did not know it; None without columns."""
    week = next((c for c in ("GWk", "Week") if c in table), None)
    ms = next((c for c in ("GMS", "TimeMS") if c in table), None)
    if week is None or ms is None:
        return None
    return gps_time_us(table[week].astype(np.int64), table[ms].astype(np.int64))
