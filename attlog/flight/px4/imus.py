"""Inertial data of PX4 logs, best source first (docs/flight.md).

FIFO topics > ``vehicle_imu`` > ``sensor_combined`` > ``vehicle_angular_velocity``
with ``vehicle_acceleration`` > raw ``sensor_gyro`` with ``sensor_accel``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.flight import physics
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration.px4 import calibrate
from attlog.flight.clock.timing import Stamps, stamps_of
from attlog.flight.inertial import REFUSED_SHARE, ImuCandidate, complete, low_pass_delay, onto, validated
from attlog.flight.model import Array, Problem
from attlog.flight.px4.clipping import gyro_mask_problem
from attlog.formats.base import Table

FAST_HZ = 100.0
DECIMATED = 1.5
"""Stamps further apart than this many integration times: the logger dropped samples between."""


def stamps(table: Table, column: str = "timestamp") -> Stamps:
    """The stamps (n,) in us as int64."""
    return stamps_of(table, column)


def sample_stamps(table: Table) -> Stamps | None:
    """The times of measurement (n,) of a topic in us, None where it has none."""
    return stamps(table, "timestamp_sample") if "timestamp_sample" in table else None


def candidates(builder: LogBuilder, values: dict[str, float], selected: int) -> list[ImuCandidate]:
    """Every inertial source of the log; ``selected`` is the unit whose data ``sensor_combined`` holds."""
    sources: dict[str, Callable[[], list[ImuCandidate]]] = {
        "sensor_gyro_fifo": lambda: fifo(builder, values),
        "vehicle_imu": lambda: vehicle_imu(builder),
        "sensor_combined": lambda: sensor_combined(builder, selected),
        "vehicle_angular_velocity": lambda: filtered(builder, values, selected),
        "sensor_gyro": lambda: raw(builder, values),
    }
    found = [c for name, source in sources.items() for c in builder.attempt(name, source, [])]
    return validated(builder, found)


def fifo(builder: LogBuilder, values: dict[str, float]) -> list[ImuCandidate]:
    """``sensor_gyro_fifo``: every sample of the sensor; acceleration from ``sensor_accel_fifo``, else the voted one."""
    messages, found = builder.messages, []
    for i in messages.instances("sensor_gyro_fifo"):
        table = messages["sensor_gyro_fifo", i]
        own = device(table)
        accelerometer = fifo_acceleration(builder, values, i)
        if accelerometer is None:
            continue
        t_acc, acc, known_acc, source, acc_device = accelerometer
        t, gyro = unpack_fifo(table)
        gyro, known = calibrate("GYRO", values, own, gyro)
        unit = unit_of_device(builder, own)
        one = ImuCandidate(
            i if unit is None else unit,
            0,
            t,
            gyro,
            onto(t, t_acc, acc),
            f"sensor_gyro_fifo:{i}",
            "interval",
            calibrated=known and known_acc,
            filtered="none",
            device=str(own),
            acc_source=source,
            acc_device=acc_device,
        )
        damaged = too_many(table)
        one.problems += damaged
        one.usable = all(p.count <= REFUSED_SHARE * len(table) for p in damaged)
        found.append(complete(one))
    return found


def too_many(table: Table) -> list[Problem]:
    """What is wrong with the batches of a FIFO topic, a problem or none."""
    count = int(np.count_nonzero(table["samples"].astype(np.int64) > table["x"].shape[1]))
    if not count:
        return []
    text = f"{table.name}:{table.instance}: left out {count:,} of {len(table):,} batches, which tell of more samples "
    text += f"than the {table['x'].shape[1]} that they have room for."
    return [Problem("values_out_of_range", "warning", text, count=count)]


def fifo_acceleration(
    builder: LogBuilder, values: dict[str, float], unit: int
) -> tuple[Stamps, Array, bool, str, str | None] | None:
    """Stamps, body-frame acceleration, whether calibrated, source and device, to go with a gyro FIFO; None without."""
    messages = builder.messages
    instances = messages.instances("sensor_accel_fifo")
    if instances:
        table = messages["sensor_accel_fifo", unit if unit in instances else instances[0]]
        t, raw_acc = unpack_fifo(table)
        acc, known = calibrate("ACC", values, device(table), raw_acc)
        return t, acc, known, f"sensor_accel_fifo:{table.instance}", str(device(table))
    voted = messages.first("sensor_combined")
    if voted is None or "accelerometer_m_s2" not in voted:
        return None
    acc = columns(voted, "accelerometer_m_s2")
    return stamps(voted), acc, True, "sensor_combined", voted_accelerometer(builder)


def unpack_fifo(table: Table) -> tuple[Stamps, Array]:
    """Stamps (m,) in us and samples (m, 3) in SI of a FIFO topic, one row per sensor sample.

    The batch's stamp is that of its last sample. The samples are spread evenly since
    the batch before, so that jitter of the stamps moves no rotation; after a lost
    batch the sensor's own interval ``dt`` counts.
    """
    x = np.stack([table[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    scale = table["scale"].astype(np.float64)
    count = sample_counts(table, x.shape[1])
    end = stamps(table, "timestamp_sample")
    since = np.diff(end, prepend=end[:1]).astype(np.float64)
    own = sample_intervals(table["dt"].astype(np.float64), since, count)
    expected = own * count
    near = (since > 0.5 * expected) & (since < 1.5 * expected)
    dt = np.where(near, since / np.maximum(count, 1), own)
    column = np.arange(x.shape[1])
    valid = column[None, :] < count[:, None]
    age = (count[:, None] - 1 - column[None, :]) * dt[:, None]
    t = end[:, None] - np.round(age).astype(np.int64)
    return t[valid], (x * scale[:, None, None])[valid]


def sample_counts(table: Table, room: int) -> NDArray[np.int64]:
    """The samples (n,) of each batch of a FIFO topic; none where it tells of more than the arrays have room for."""
    told = table["samples"].astype(np.int64)
    return np.where((told >= 0) & (told <= room), told, 0)


def sample_intervals(told: Array, since: Array, count: NDArray[np.int64]) -> Array:
    """The sensor's intervals (n,) in us between samples: those it tells, else what its batches need for them.

    ``since`` (n,) us the batch before. Batches can be lost, so samples may be closer than those logged would be,
    not further apart; and none are closer than a sensor can give.
    """
    needed = since[1:][count[1:] > 0] / count[1:][count[1:] > 0]
    typical = float(np.median(needed)) if len(needed) else 0.0
    with np.errstate(invalid="ignore"):
        believed = (told * physics.RAW_HZ >= 1e6) & (told <= DECIMATED * max(typical, 0.0))
    return np.where(believed, told, max(typical, 0.0))


def vehicle_imu(builder: LogBuilder) -> list[ImuCandidate]:
    """``vehicle_imu``: calibrated increments of every unit, with their own integration times."""
    messages, found = builder.messages, []
    for i in messages.instances("vehicle_imu"):
        table = messages["vehicle_imu", i]
        dt = table["delta_angle_dt"].astype(np.float64) * 1e-6
        dt_v = table["delta_velocity_dt"].astype(np.float64) * 1e-6
        good = (dt > 0) & (dt < 1.0) & (dt_v > 0) & (dt_v < 1.0)
        if not good.any():
            continue
        t = stamps(table, "timestamp_sample" if "timestamp_sample" in table else "timestamp")[good]
        found.append(
            ImuCandidate(
                i,
                1,
                t,
                columns(table, "delta_angle")[good] / dt[good, None],
                columns(table, "delta_velocity")[good] / dt_v[good, None],
                f"vehicle_imu:{i}",
                "interval",
                filtered="none",
                device=str(int(table["gyro_device_id"][0])),
                acc_device=str(device(table, "accel_device_id")) if "accel_device_id" in table else None,
                dt=dt[good],
                usable=not decimated(t, dt[good]),
            )
        )
        rows, rate = table.rows(good), found[-1].gyro
        found[-1].problems += gyro_mask_problem(builder, f"vehicle_imu:{i}", rows, "delta_angle_clipping", rate)
        if not found[-1].usable:
            found[-1].problems.append(thinned(f"vehicle_imu:{i}", t, dt[good]))
        found[-1].usable &= found[-1].rate >= FAST_HZ
        found[-1].temperature = status_temperature(builder, i, t)
    return found


def status_temperature(builder: LogBuilder, unit: int, t: Stamps) -> Array | None:
    """Gyro temperature of a unit at the stamps ``t``, from the slow ``vehicle_imu_status``."""
    table = builder.messages.tables.get(("vehicle_imu_status", unit))
    if table is None or "temperature_gyro" not in table or len(table) < 2:
        return None
    at, celsius = stamps(table), table["temperature_gyro"].astype(np.float64)
    return np.interp(t, at, celsius) if (np.diff(at) > 0).all() and np.isfinite(celsius).all() else None


def sensor_combined(builder: LogBuilder, selected: int) -> list[ImuCandidate]:
    """``sensor_combined``: means of the voted unit over ``gyro_integral_dt``, calibrated, body frame."""
    table = builder.messages.tables.get(("sensor_combined", 0))
    if table is None or "gyro_rad" not in table or "accelerometer_m_s2" not in table:
        return []
    t, dt = stamps(table), integral_dt(table)
    acc = columns(table, "accelerometer_m_s2")
    if "accelerometer_timestamp_relative" in table:  # 0x7fffffff: no accelerometer sample yet
        acc[table["accelerometer_timestamp_relative"] == 0x7FFFFFFF] = np.nan
    lossy = decimated(t, dt)
    found = ImuCandidate(
        selected,
        2,
        t,
        columns(table, "gyro_rad"),
        acc,
        "sensor_combined",
        "interval",
        filtered="none",
        usable=not lossy,
        acc_device=voted_accelerometer(builder),
        temperature=status_temperature(builder, selected, t),
        note="holds the unit that the autopilot's voter chose",
    )
    found.problems += gyro_mask_problem(builder, "sensor_combined", table, "gyro_clipping", found.gyro)
    if lossy:
        found.problems.append(thinned("sensor_combined", t, dt))
    return [found]


def integral_dt(table: Table) -> Array:
    """Integration times (n,) in s: a float column holds seconds (1.5, 1.6dev), an integer one microseconds."""
    if "gyro_integral_dt" not in table:
        return np.full(len(table), np.nan)
    stored = table["gyro_integral_dt"]
    return stored.astype(np.float64) * (1.0 if stored.dtype.kind == "f" else 1e-6)


def decimated(t: Stamps, dt: Array) -> bool:
    """Whether samples between the logged ones are missing: stamps far wider apart than each sample covers."""
    with np.errstate(invalid="ignore"):
        covered = dt[np.isfinite(dt) & (dt > 0)]
    if len(t) < 3 or len(covered) == 0:
        return False
    return float(np.median(np.diff(t))) * 1e-6 > DECIMATED * float(np.median(covered))


def thinned(source: str, t: Stamps, dt: Array) -> Problem:
    """What is wrong with a :func:`decimated` source."""
    text = (
        f"{source}: the logger kept one sample per {np.median(np.diff(t)) / 1000:.0f} ms although each "
        f"covers {np.median(dt) * 1000:.1f} ms; the rotation between them is lost."
    )
    return Problem("imu_decimated", "warning", text)


def filtered(builder: LogBuilder, values: dict[str, float], selected: int) -> list[ImuCandidate]:
    """``vehicle_angular_velocity`` with ``vehicle_acceleration``: after the control filters, a last resort."""
    gyro_table = builder.messages.tables.get(("vehicle_angular_velocity", 0))
    acc_table = builder.messages.tables.get(("vehicle_acceleration", 0))
    if gyro_table is None or acc_table is None:
        return []
    t, t_acc = (stamps(x, "timestamp_sample") for x in (gyro_table, acc_table))
    gyro_cut, acc_cut = values.get("IMU_GYRO_CUTOFF", 0.0), values.get("IMU_ACCEL_CUTOFF", 0.0)
    found = ImuCandidate(
        selected,
        3,
        t,
        columns(gyro_table, "xyz"),
        onto(t, t_acc, columns(acc_table, "xyz")),
        "vehicle_angular_velocity",
        "instant",
        filtered=f"low-pass {gyro_cut:.0f} Hz and notches" if gyro_cut > 0 else "for control, cutoff unknown",
        gyro_delay=low_pass_delay(gyro_cut),
        acc_delay=low_pass_delay(acc_cut),
        acc_source="vehicle_acceleration",
        note="filtered for control: later and smoother than the sensor",
    )
    found = complete(found)
    return [found] if found.rate >= FAST_HZ / 2 else []


def raw(builder: LogBuilder, values: dict[str, float]) -> list[ImuCandidate]:
    """``sensor_gyro`` with ``sensor_accel`` of every unit: the driver's samples, calibrated by parameters."""
    messages, found = builder.messages, []
    for i in messages.instances("sensor_gyro"):
        gyro_table, acc_table = messages["sensor_gyro", i], messages.tables.get(("sensor_accel", i))
        if acc_table is None or "x" not in gyro_table or "x" not in acc_table:
            continue
        column = "timestamp_sample" if "timestamp_sample" in gyro_table else "timestamp"
        t, t_acc = stamps(gyro_table, column), stamps(acc_table, column if column in acc_table else "timestamp")
        gyro, known = calibrate("GYRO", values, device(gyro_table), columns(gyro_table, "x", "y", "z"))
        acc, known_acc = calibrate("ACC", values, device(acc_table), columns(acc_table, "x", "y", "z"))
        one = ImuCandidate(
            i,
            4,
            t,
            gyro,
            onto(t, t_acc, acc),
            f"sensor_gyro:{i}",
            "instant",
            calibrated=known and known_acc,
            filtered="driver",
            device=str(device(gyro_table)),
            acc_source=f"sensor_accel:{i}",
            acc_device=str(device(acc_table)),
        )
        one = complete(one)
        if one.rate >= FAST_HZ:
            found.append(one)
    return found


def voted_accelerometer(builder: LogBuilder) -> str | None:
    """Device id of the accelerometer inside ``sensor_combined``; None where it changed, or the log does not tell."""
    for name in ("sensor_selection", "estimator_selector_status"):
        table = builder.messages.tables.get((name, 0))
        if table is not None and "accel_device_id" in table and len(table):
            ids = np.unique(table["accel_device_id"])
            return str(int(ids[0])) if len(ids) == 1 and ids[0] else None
    return None


def device(table: Table, column: str = "device_id") -> int:
    """The device id that most records of a topic carry, 0 if it has none."""
    if column not in table or len(table) == 0:
        return 0
    ids: NDArray[Any] = table[column]
    known, count = np.unique(ids, return_counts=True)
    return int(known[np.argmax(count)])


def unit_of_device(builder: LogBuilder, device_id: int) -> int | None:
    """The instance of ``vehicle_imu`` (or its status) whose gyro has this device id."""
    return units_of_devices(builder, {device_id}).get(device_id)


def units_of_devices(builder: LogBuilder, wanted: set[int]) -> dict[int, int]:
    """:func:`unit_of_device` of many devices that are not 0; those that no message tells of are absent."""
    found: dict[int, int] = {}
    for name in ("vehicle_imu", "vehicle_imu_status"):
        for i in builder.messages.instances(name):
            found.setdefault(int(builder.messages[name, i]["gyro_device_id"][-1]), i)
    if not wanted <= {0, *found}:
        for i in builder.messages.instances("sensor_gyro"):
            found.setdefault(device(builder.messages["sensor_gyro", i]), i)
    return {i: unit for i, unit in found.items() if i and i in wanted}


def selected_units(builder: LogBuilder) -> tuple[Stamps, list[int], str]:
    """When which unit flew (stamps, units, source), from the estimator selector or the sensor voter."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = builder.messages.tables.get((name, 0))
        if table is None or "gyro_device_id" not in table:
            continue
        t, units = [], []
        known = units_of_devices(builder, {int(i) for i in table["gyro_device_id"].tolist()})
        for at, device_id in zip(stamps(table).tolist(), table["gyro_device_id"].tolist(), strict=True):
            unit = known.get(int(device_id))
            if unit is not None:
                t.append(at)
                units.append(unit)
        if units:
            return np.array(t, np.int64), units, name
    return np.zeros(0, np.int64), [], ""
