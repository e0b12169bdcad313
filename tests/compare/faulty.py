"""Flights made worse on purpose: PX4 logs whose sensors are changed, their truth left as it was."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pyulog import ULog

GYRO = [f"gyro_rad[{k}]" for k in range(3)]
ACCELEROMETER = [f"accelerometer_m_s2[{k}]" for k in range(3)]


def delayed(log: ULog, ms: float = 10.0) -> None:
    """Gyro and accelerometer so much later."""
    imu = _data(log, "sensor_combined")
    t = imu["timestamp"].astype(float)
    for name in GYRO + ACCELEROMETER:
        imu[name][:] = np.interp(t - 1000.0 * ms, t, imu[name])


def biased(log: ULog, deg_per_s: float = 0.5) -> None:
    """The gyro about the vertical axis off by so much, from 5 s after take-off on."""
    imu, land = _data(log, "sensor_combined"), _data(log, "vehicle_land_detected")
    off_the_ground = land["timestamp"][np.flatnonzero(land["landed"] == 0)[0]]
    imu[GYRO[2]][imu["timestamp"] > off_the_ground + 5e6] += np.radians(deg_per_s)


def scaled(log: ULog, by: float = 1.03) -> None:
    """All rates too large."""
    for name in GYRO:
        _data(log, "sensor_combined")[name] *= by


def swapped(log: ULog) -> None:
    """The magnetometer's x and y axes exchanged."""
    _swap(_data(log, "vehicle_magnetometer"), "magnetometer_ga[0]", "magnetometer_ga[1]")


def swapped_gyro(log: ULog) -> None:
    """The gyro's x and y axes exchanged."""
    _swap(_data(log, "sensor_combined"), GYRO[0], GYRO[1])


def write(source: Path, target: Path, fault: Callable[[ULog], None] | None) -> Path:
    """Write a log with a fault."""
    log = ULog(str(source))
    if fault is not None:
        fault(log)
    log.write_ulog(str(target))
    return target


def _swap(data: dict[str, Any], one: str, other: str) -> None:
    kept = data[one].copy()
    data[one][:] = data[other]
    data[other][:] = kept


def _data(log: ULog, message: str) -> dict[str, Any]:
    return next(d.data for d in log.data_list if d.name == message and d.multi_id == 0)
