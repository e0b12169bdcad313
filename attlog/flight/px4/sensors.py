"""Magnetometers of PX4 logs: calibrated topics first, raw ones with the vehicle's own calibration else."""

from __future__ import annotations

import numpy as np

from attlog.core.timestamps import changed_records
from attlog.flight import compass, limits
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration import compass_priority, px4_calibrate, px4_slot
from attlog.flight.model import Mag, OnboardSpectrum, OnboardVibration, Stream
from attlog.flight.px4.imu import sample_stamps, topic_device, topic_stamps
from attlog.flight.timestamps import read_stamps

RAW_RECORDS = 400
"""So many raw values of a compass tell what the firmware subtracts from it beside the parameters."""


def magnetometers(builder: LogBuilder, values: dict[str, float]) -> list[Mag]:
    """Every compass of the log; ``values`` are the parameters at boot."""
    calibrated = [*published_magnetometers(builder)] or [*combined_magnetometer(builder)]
    devices = {m.device for m in calibrated}
    if calibrated and devices == {None}:
        return calibrated  # old topics name no device: a raw one may be the same compass
    return calibrated + raw_magnetometers(builder, values, devices, {m.index for m in calibrated})


def published_magnetometers(builder: LogBuilder) -> list[Mag]:
    """``vehicle_magnetometer``: calibrated and rotated, gauss, sampled before its stamp."""
    found = []
    for i in builder.messages.instances("vehicle_magnetometer"):
        table = builder.messages["vehicle_magnetometer", i]
        own = topic_device(table)
        mag = compass.build_mag(
            builder,
            i,
            topic_stamps(table),
            columns(table, "magnetometer_ga") * compass.GAUSS,
            f"vehicle_magnetometer:{i}",
            t_sample_us=sample_stamps(table),
            device=str(own) if own else None,
        )
        if mag is not None:
            one = "device_id" in table and len(np.unique(table["device_id"])) == 1  # else two sensors take turns
            mag.raw = uncalibrated_field(builder, own) if one else None
            found.append(mag)
    return found


def uncalibrated_field(builder: LogBuilder, own: int) -> Stream | None:
    """At most RAW_RECORDS of what the driver of a device gave (``sensor_mag``), spread over the log; None without."""
    for i in builder.messages.instances("sensor_mag") if own else ():
        table = builder.messages["sensor_mag", i]
        if topic_device(table) != own or "x" not in table:
            continue
        some = table.rows(np.unique(np.linspace(0, len(table) - 1, RAW_RECORDS).astype(np.int64)))
        field, quiet = columns(some, "x", "y", "z") * compass.GAUSS, LogBuilder(builder.messages, t0_us=builder.t0_us)
        return quiet.stream(topic_stamps(some), field, "T", f"sensor_mag:{i}", t_sample_us=sample_stamps(some))
    return None


def combined_magnetometer(builder: LogBuilder) -> list[Mag]:
    """The field inside ``sensor_combined`` (1.5 to 1.7), repeated at the IMU's rate with its own relative time."""
    table = builder.messages.tables.get(("sensor_combined", 0))
    if table is None or "magnetometer_ga" not in table:
        return []
    field = columns(table, "magnetometer_ga") * compass.GAUSS
    t = topic_stamps(table)
    if "magnetometer_timestamp_relative" in table:
        t = t + table["magnetometer_timestamp_relative"].astype(np.int64)
    new = changed_records(field, t)
    mag = compass.build_mag(builder, 0, t[new], field[new], "sensor_combined.magnetometer_ga")
    return [mag] if mag is not None else []


def raw_magnetometers(
    builder: LogBuilder, values: dict[str, float], known: set[str | None], taken: set[int]
) -> list[Mag]:
    """``sensor_mag`` of devices that no calibrated topic shows; numbers in ``taken`` are not given again."""
    found: list[Mag] = []
    for i in builder.messages.instances("sensor_mag"):
        table = builder.messages["sensor_mag", i]
        own = topic_device(table)
        if str(own) in known or "x" not in table:
            continue
        field, calibrated = px4_calibrate("MAG", values, own, columns(table, "x", "y", "z"))
        enabled = compass_priority(values, own) != 0 and values.get("SYS_HAS_MAG", 1.0) != 0
        index = i if i not in taken else max(taken) + 1
        mag = compass.build_mag(
            builder,
            index,
            topic_stamps(table),
            field * compass.GAUSS,
            f"sensor_mag:{i}",
            t_sample_us=sample_stamps(table),
            calibrated=calibrated,
            device=str(own),
            enabled=enabled,
        )
        if mag is None:
            continue
        taken = taken | {index}
        found.append(mag)
        if enabled and calibrated:  # what is said of the others says it all
            slot = f"CAL_MAG{px4_slot('MAG', values, own)}"
            text = f"sensor_mag:{i} (device {own}): only raw values are logged; it is calibrated with {slot}."
            builder.problem("mag_raw", "note", text)
    return found


def flown_compass(builder: LogBuilder, mags: list[Mag]) -> int | None:
    """Index of the magnetometer that the estimator used, None where the log does not tell."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = builder.messages.tables.get((name, 0))
        if table is None or "mag_device_id" not in table:
            continue
        wanted = int(table["mag_device_id"][-1])
        match = [m.index for m in mags if m.device == str(wanted)]
        if wanted and match:
            return match[0]
    return None


# What PX4 measures of vibration itself: the level of every IMU, and the peaks of its own gyro spectrum.
#
# ``vehicle_imu_status.accel_vibration_metric`` (1.11 on; ``VehicleIMU.cpp``): 0.99 of itself and 0.01 of the length
# of
# the difference of successive samples, in m/s^2. 1.11 and 1.12 take the difference of velocity increments instead, in
# m/s, 200 times less at the default rate; those have no ``var_accel`` beside it. ``sensor_gyro_fft`` (1.12 on) holds
# the
# peaks where IMU_GYRO_FFT_EN is set.

MAX_INTEGRATION_HZ = 1000.0
DEFAULT_INTEGRATION_HZ = 200.0
"""IMU_INTEG_RATE where nothing tells it."""


def vibration_levels(builder: LogBuilder) -> list[OnboardVibration]:
    """The level of every IMU in m/s^2."""
    found = []
    for unit in builder.messages.instances("vehicle_imu_status"):
        table = builder.messages["vehicle_imu_status", unit]
        if "accel_vibration_metric" not in table:
            continue
        scale = 1.0 if "var_accel" in table else 1.0 / increment_seconds(builder, unit)
        source = f"vehicle_imu_status:{unit}"
        x = table.value("accel_vibration_metric") * scale
        stream = builder.stream(read_stamps(table, "timestamp"), x, "m/s^2", source, within=limits.VIBRATION)
        if stream is not None:
            found.append(OnboardVibration(unit, "difference", source, stream.t, stream.x[:, 0]))
    return found


def increment_seconds(builder: LogBuilder, unit: int) -> float:
    """Seconds that a unit's velocity increments cover."""
    table = builder.messages.tables.get(("vehicle_imu", unit))
    if table is not None and "delta_velocity_dt" in table and len(table):
        dt = float(np.median(table["delta_velocity_dt"])) * 1e-6
        if 1.0 / MAX_INTEGRATION_HZ <= dt < 1.0:
            return dt
    return 1.0 / DEFAULT_INTEGRATION_HZ


def onboard_spectrum(builder: LogBuilder) -> OnboardSpectrum | None:
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
    t = builder.seconds(read_stamps(table, "timestamp"))
    rising = np.isfinite(t) & np.concatenate([[True], np.diff(t) > 0])
    if not np.isfinite(rate) or not rising.any():
        return None
    resolution = float(np.median(table["resolution_hz"]))
    return OnboardSpectrum(t[rising], peaks[rising], rate, resolution, f"sensor_gyro_fft:{table.instance}")
