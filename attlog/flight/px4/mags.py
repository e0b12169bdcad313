"""Magnetometers of PX4 logs: calibrated topics first, raw ones with the vehicle's own calibration else."""

from __future__ import annotations

import numpy as np

from attlog.flight import magnetic
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration.px4 import calibrate, priority, slot_of
from attlog.flight.clock.timing import only_new
from attlog.flight.model import Mag, Stream
from attlog.flight.px4.imus import device, sample_stamps, stamps

RAW_RECORDS = 400
"""So many raw values of a compass tell what the firmware subtracts from it beside the parameters."""


def magnetometers(builder: LogBuilder, values: dict[str, float]) -> list[Mag]:
    """Every compass of the log; ``values`` are the parameters at boot."""
    calibrated = [*published(builder)] or [*combined(builder)]
    devices = {m.device for m in calibrated}
    if calibrated and devices == {None}:
        return calibrated  # old topics name no device: a raw one may be the same compass
    return calibrated + raw(builder, values, devices, {m.index for m in calibrated})


def published(builder: LogBuilder) -> list[Mag]:
    """``vehicle_magnetometer``: calibrated and rotated, gauss, sampled before its stamp."""
    found = []
    for i in builder.messages.instances("vehicle_magnetometer"):
        table = builder.messages["vehicle_magnetometer", i]
        own = device(table)
        mag = magnetic.build(
            builder,
            i,
            stamps(table),
            columns(table, "magnetometer_ga") * magnetic.GAUSS,
            f"vehicle_magnetometer:{i}",
            t_sample_us=sample_stamps(table),
            device=str(own) if own else None,
        )
        if mag is not None:
            one = "device_id" in table and len(np.unique(table["device_id"])) == 1  # else two sensors take turns
            mag.raw = uncalibrated(builder, own) if one else None
            found.append(mag)
    return found


def uncalibrated(builder: LogBuilder, own: int) -> Stream | None:
    """At most RAW_RECORDS of what the driver of a device gave (``sensor_mag``), spread over the log; None without."""
    for i in builder.messages.instances("sensor_mag") if own else ():
        table = builder.messages["sensor_mag", i]
        if device(table) != own or "x" not in table:
            continue
        some = table.rows(np.unique(np.linspace(0, len(table) - 1, RAW_RECORDS).astype(np.int64)))
        field, quiet = columns(some, "x", "y", "z") * magnetic.GAUSS, LogBuilder(builder.messages, t0_us=builder.t0_us)
        return quiet.stream(stamps(some), field, "T", f"sensor_mag:{i}", t_sample_us=sample_stamps(some))
    return None


def combined(builder: LogBuilder) -> list[Mag]:
    """The field inside ``sensor_combined`` (1.5 to 1.7), repeated at the IMU's rate with its own relative time."""
    table = builder.messages.tables.get(("sensor_combined", 0))
    if table is None or "magnetometer_ga" not in table:
        return []
    field = columns(table, "magnetometer_ga") * magnetic.GAUSS
    t = stamps(table)
    if "magnetometer_timestamp_relative" in table:
        t = t + table["magnetometer_timestamp_relative"].astype(np.int64)
    new = only_new(field, t)
    mag = magnetic.build(builder, 0, t[new], field[new], "sensor_combined.magnetometer_ga")
    return [mag] if mag is not None else []


def raw(builder: LogBuilder, values: dict[str, float], known: set[str | None], taken: set[int]) -> list[Mag]:
    """``sensor_mag`` of devices that no calibrated topic shows; numbers in ``taken`` are not given again."""
    found: list[Mag] = []
    for i in builder.messages.instances("sensor_mag"):
        table = builder.messages["sensor_mag", i]
        own = device(table)
        if str(own) in known or "x" not in table:
            continue
        field, calibrated = calibrate("MAG", values, own, columns(table, "x", "y", "z"))
        enabled = priority(values, own) != 0 and values.get("SYS_HAS_MAG", 1.0) != 0
        index = i if i not in taken else max(taken) + 1
        mag = magnetic.build(
            builder,
            index,
            stamps(table),
            field * magnetic.GAUSS,
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
            slot = f"CAL_MAG{slot_of('MAG', values, own)}"
            text = f"sensor_mag:{i} (device {own}): only raw values are logged; it is calibrated with {slot}."
            builder.problem("mag_raw", "note", text)
    return found


def flown(builder: LogBuilder, mags: list[Mag]) -> int | None:
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
