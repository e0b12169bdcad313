"""What PX4 measures of vibration itself: the level of every IMU, and the peaks of its own gyro spectrum.

``vehicle_imu_status.accel_vibration_metric`` (1.11 on; ``VehicleIMU.cpp``): 0.99 of itself and 0.01 of the length of
the difference of successive samples, in m/s^2. 1.11 and 1.12 take the difference of velocity increments instead, in
m/s, 200 times less at the default rate; those have no ``var_accel`` beside it. ``sensor_gyro_fft`` (1.12 on) holds the
peaks where IMU_GYRO_FFT_EN is set.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.clock.timing import stamps_of
from attlog.flight.vibration.model import OnboardSpectrum, OnboardVibration

FASTEST_INTEGRATION_HZ = 1000.0
DEFAULT_RATE_HZ = 200.0
"""IMU_INTEG_RATE where nothing tells it."""


def levels(builder: LogBuilder) -> list[OnboardVibration]:
    """The level of every IMU in m/s^2."""
    found = []
    for unit in builder.messages.instances("vehicle_imu_status"):
        table = builder.messages["vehicle_imu_status", unit]
        if "accel_vibration_metric" not in table:
            continue
        scale = 1.0 if "var_accel" in table else 1.0 / increment_s(builder, unit)
        source = f"vehicle_imu_status:{unit}"
        x = table.value("accel_vibration_metric") * scale
        stream = builder.stream(stamps_of(table, "timestamp"), x, "m/s^2", source, within=physics.VIBRATION)
        if stream is not None:
            found.append(OnboardVibration(unit, "difference", source, stream.t, stream.x[:, 0]))
    return found


def increment_s(builder: LogBuilder, unit: int) -> float:
    """Seconds that a unit's velocity increments cover."""
    table = builder.messages.tables.get(("vehicle_imu", unit))
    if table is not None and "delta_velocity_dt" in table and len(table):
        dt = float(np.median(table["delta_velocity_dt"])) * 1e-6
        if 1.0 / FASTEST_INTEGRATION_HZ <= dt < 1.0:
            return dt
    return 1.0 / DEFAULT_RATE_HZ


def spectrum(builder: LogBuilder) -> OnboardSpectrum | None:
    """The peaks of the onboard gyro spectrum of all axes (n, k) in Hz, None where it did not run."""
    table = builder.messages.first("sensor_gyro_fft")
    names = [f"peak_frequencies_{axis}" for axis in "xyz"]
    needed = (*names, "sensor_sample_rate_hz", "resolution_hz")
    if table is None or len(table) < 2 or not all(c in table for c in needed):
        return None
    peaks = np.column_stack([columns(table, name) for name in names])
    rate = float(np.median(table["sensor_sample_rate_hz"]))
    with np.errstate(invalid="ignore"):
        peaks[~((peaks > 0) & (peaks < 0.5 * rate))] = np.nan
    t = builder.seconds(stamps_of(table, "timestamp"))
    rising = np.isfinite(t) & np.concatenate([[True], np.diff(t) > 0])
    if not np.isfinite(rate) or not rising.any():
        return None
    resolution = float(np.median(table["resolution_hz"]))
    return OnboardSpectrum(t[rising], peaks[rising], rate, resolution, f"sensor_gyro_fft:{table.instance}")
