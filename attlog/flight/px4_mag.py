"""Magnetometers of PX4 logs: calibrated topics first, raw ones with the vehicle's own calibration else."""

from __future__ import annotations

import numpy as np

from attlog.flight import magnetic
from attlog.flight.model import Mag
from attlog.flight.px4_calibration import calibrate, priority, slot_of
from attlog.flight.px4_imu import device, sample_stamps, stamps
from attlog.flight.reading import Reading, columns


def magnetometers(reading: Reading, values: dict[str, float]) -> list[Mag]:
    """Every compass of the log; ``values`` are the parameters at boot."""
    calibrated = [*published(reading)] or [*combined(reading)]
    devices = {m.device for m in calibrated}
    if calibrated and devices == {None}:
        return calibrated  # old topics name no device: a raw one may be the same compass
    return calibrated + raw(reading, values, devices, {m.index for m in calibrated})


def published(reading: Reading) -> list[Mag]:
    """``vehicle_magnetometer``: calibrated and rotated, gauss, sampled before its stamp."""
    found = []
    for i in reading.messages.instances("vehicle_magnetometer"):
        table = reading.messages["vehicle_magnetometer", i]
        own = device(table)
        mag = magnetic.build(
            reading, i, stamps(table), columns(table, "magnetometer_ga") * magnetic.GAUSS, f"vehicle_magnetometer:{i}",
            t_sample_us=sample_stamps(table), device=str(own) if own else None,
        )  # fmt: skip
        found += [mag] if mag is not None else []
    return found


def combined(reading: Reading) -> list[Mag]:
    """The field inside ``sensor_combined`` (1.5 to 1.7), repeated at the IMU's rate with its own relative time."""
    table = reading.messages.tables.get(("sensor_combined", 0))
    if table is None or "magnetometer_ga" not in table:
        return []
    field = columns(table, "magnetometer_ga") * magnetic.GAUSS
    t = stamps(table)
    if "magnetometer_timestamp_relative" in table:
        t = t + table["magnetometer_timestamp_relative"].astype(np.int64)
    new = magnetic.only_new(field, t)
    mag = magnetic.build(reading, 0, t[new], field[new], "sensor_combined.magnetometer_ga")
    return [mag] if mag is not None else []


def raw(reading: Reading, values: dict[str, float], known: set[str | None], taken: set[int]) -> list[Mag]:
    """``sensor_mag`` of devices that no calibrated topic shows; numbers in ``taken`` are not given again."""
    found: list[Mag] = []
    for i in reading.messages.instances("sensor_mag"):
        table = reading.messages["sensor_mag", i]
        own = device(table)
        if str(own) in known or "x" not in table:
            continue
        field, calibrated = calibrate("MAG", values, own, columns(table, "x", "y", "z"))
        enabled = priority(values, own) != 0 and values.get("SYS_HAS_MAG", 1.0) != 0
        index = i if i not in taken else max(taken) + 1
        mag = magnetic.build(
            reading, index, stamps(table), field * magnetic.GAUSS, f"sensor_mag:{i}", t_sample_us=sample_stamps(table),
            calibrated=calibrated, device=str(own), enabled=enabled,
        )  # fmt: skip
        if mag is None:
            continue
        taken = taken | {index}
        found.append(mag)
        state = f"calibrated with CAL_MAG{slot_of('MAG', values, own)}" if calibrated else "never calibrated"
        reading.problem(
            "mag_raw",
            "note" if calibrated else "warning",
            f"sensor_mag:{i} (device {own}): only raw values are logged; it is {state}"
            + ("." if enabled else " and disabled on the vehicle."),
        )
    return found


def flown(reading: Reading, mags: list[Mag]) -> int | None:
    """Index of the magnetometer that the estimator used, None where the log does not tell."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = reading.messages.tables.get((name, 0))
        if table is None or "mag_device_id" not in table:
            continue
        wanted = int(table["mag_device_id"][-1])
        match = [m.index for m in mags if m.device == str(wanted)]
        if wanted and match:
            return match[0]
    return None
