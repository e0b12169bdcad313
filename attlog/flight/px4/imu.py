"""Inertial data of PX4 logs, best source first (docs/flight.md).

FIFO topics > ``vehicle_imu`` > ``sensor_combined`` > ``vehicle_angular_velocity``
with ``vehicle_acceleration`` > raw ``sensor_gyro`` with ``sensor_accel``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration import px4_calibrate
from attlog.flight.imu import (
    MAX_REFUSED_SHARE,
    ImuCandidate,
    drop_unpaired,
    low_pass_delay,
    resample_vectors,
    validate_candidates,
)
from attlog.flight.model import Array, Clipping, Problem
from attlog.flight.timestamps import read_stamps
from attlog.formats.table import Table

# Which PX4 counts of samples at the end of a sensor's range mean what they say, by field and version.
#
# ``vehicle_imu_status`` counts every sample of every unit (1.11 on; the gyro's from 1.14), from any number on.
# ``sensor_combined.accelerometer_clipping`` (1.11 on) is a mask of three bits for the selected unit alone.
# ``sensor_combined.gyro_clipping`` and ``vehicle_imu.delta_angle_clipping`` are unset memory in 1.13 beta and in 10
# of 11
# logs of 1.14: they count from 1.15 on, where no value is above the mask, and where a counter of
# ``vehicle_imu_status``
# moved or the gyro was near its range.
# ``sensor_accel.clip_counter`` holds 1 where the others hold thousands, and is not read.

GYRO_MASK_RELEASE = 1 << 24 | 15 << 16
"""The first ``ver_sw_release`` whose gyro masks are set."""
MAX_CLIPPING_MASK = 7
NEAR_RANGE_RAD_S = 0.8 * np.radians(2000.0)
"""Of the usual range, 2,000 deg/s: slower turns clip nothing."""


def clippings(builder: LogBuilder) -> list[Clipping]:
    """New clipped samples over time: the counters of every unit, then the masks of the selected one."""
    found = []
    for unit in builder.messages.instances("vehicle_imu_status"):
        table = builder.messages["vehicle_imu_status", unit]
        for sensor, column in (("accelerometer", "accel_clipping"), ("gyro", "gyro_clipping")):
            if column in table and len(table) > 1:
                counter = table[column].astype(np.int64).reshape(len(table), -1)
                new = np.maximum(np.diff(counter, axis=0, prepend=counter[:1]), 0).sum(axis=1)
                found.append(_clipping(builder, table, sensor, unit, new, True, column))
    table_of_one = builder.messages.tables.get(("sensor_combined", 0))
    column = "accelerometer_clipping"
    if table_of_one is not None and column in table_of_one and len(table_of_one):
        new = (table_of_one[column] > 0).astype(np.int64)
        found.append(_clipping(builder, table_of_one, "accelerometer", None, new, False, column))
    return found


def _clipping(
    builder: LogBuilder, table: Table, sensor: str, unit: int | None, new: NDArray[np.int64], whole: bool, column: str
) -> Clipping:
    source = f"{table.name}:{table.instance}.{column}" if whole else f"{table.name}.{column}"
    return Clipping(sensor, unit, source, builder.seconds(read_stamps(table, "timestamp")), new, whole)


def gyro_mask_problem(
    builder: LogBuilder, source: str, table: Table, column: str, rate: NDArray[np.float64]
) -> list[Problem]:
    """What the masks say of the gyro at the end of its range, a problem or none; ``rate`` (n, 3) rad/s beside them."""
    release: Any = builder.messages.info.get("ver_sw_release")
    if column not in table or not isinstance(release, (int, np.integer)) or int(release) < GYRO_MASK_RELEASE:
        return []
    mask = table[column].astype(np.int64)
    if not mask.any() or mask.max() > MAX_CLIPPING_MASK:
        return []
    counted = any(c.sensor == "gyro" and c.whole and c.new.any() for c in clippings(builder))
    if not counted and not np.nanmax(np.abs(rate), initial=0.0) > NEAR_RANGE_RAD_S:
        return []
    count = int(np.count_nonzero(mask))
    text = f"{source}: the gyro was at the end of its range in {count} samples ({column})."
    cause = "A blow, vibration, or a range that is set too small."
    return [Problem("gyro_clipped", "warning", text, count=count, cause=cause)]


MIN_FAST_HZ = 100.0
DECIMATION_FACTOR = 1.5
"""Stamps further apart than this many integration times: the logger dropped samples between."""


def topic_stamps(table: Table, column: str = "timestamp") -> Stamps:
    """The stamps (n,) in us as int64."""
    return read_stamps(table, column)


def sample_stamps(table: Table) -> Stamps | None:
    """The times of measurement (n,) of a topic in us, None where it has none."""
    return topic_stamps(table, "timestamp_sample") if "timestamp_sample" in table else None


def imu_candidates(builder: LogBuilder, values: dict[str, float], selected: int) -> list[ImuCandidate]:
    """Every inertial source of the log; ``selected`` is the unit whose data ``sensor_combined`` holds."""
    sources: dict[str, Callable[[], list[ImuCandidate]]] = {
        "sensor_gyro_fifo": lambda: fifo_candidates(builder, values),
        "vehicle_imu": lambda: vehicle_imu_candidates(builder),
        "sensor_combined": lambda: sensor_combined_candidates(builder, selected),
        "vehicle_angular_velocity": lambda: filtered_candidates(builder, values, selected),
        "sensor_gyro": lambda: raw_candidates(builder, values),
    }
    found = [c for name, source in sources.items() for c in builder.attempt(name, source, [])]
    return validate_candidates(builder, found)


def fifo_candidates(builder: LogBuilder, values: dict[str, float]) -> list[ImuCandidate]:
    """``sensor_gyro_fifo``: every sample of the sensor; acceleration from ``sensor_accel_fifo``, else the voted one."""
    messages, found = builder.messages, []
    for i in messages.instances("sensor_gyro_fifo"):
        table = messages["sensor_gyro_fifo", i]
        own = topic_device(table)
        accelerometer = fifo_acceleration(builder, values, i)
        if accelerometer is None:
            continue
        t_acc, acc, known_acc, source, acc_device = accelerometer
        t, gyro = unpack_fifo(table)
        gyro, known = px4_calibrate("GYRO", values, own, gyro)
        unit = unit_of_device(builder, own)
        one = ImuCandidate(
            i if unit is None else unit,
            0,
            t,
            gyro,
            resample_vectors(t, t_acc, acc),
            f"sensor_gyro_fifo:{i}",
            "interval",
            calibrated=known and known_acc,
            filtered="none",
            device=str(own),
            acc_source=source,
            acc_device=acc_device,
        )
        damaged = oversized_batches(table)
        one.problems += damaged
        one.usable = all(p.count <= MAX_REFUSED_SHARE * len(table) for p in damaged)
        found.append(drop_unpaired(one))
    return found


def oversized_batches(table: Table) -> list[Problem]:
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
        acc, known = px4_calibrate("ACC", values, topic_device(table), raw_acc)
        return t, acc, known, f"sensor_accel_fifo:{table.instance}", str(topic_device(table))
    voted = messages.first("sensor_combined")
    if voted is None or "accelerometer_m_s2" not in voted:
        return None
    acc = columns(voted, "accelerometer_m_s2")
    return topic_stamps(voted), acc, True, "sensor_combined", voted_accelerometer(builder)


def unpack_fifo(table: Table) -> tuple[Stamps, Array]:
    """Stamps (m,) in us and samples (m, 3) in SI of a FIFO topic, one row per sensor sample.

    The batch's stamp is that of its last sample. The samples are spread evenly since
    the batch before, so that jitter of the stamps moves no rotation; after a lost
    batch the sensor's own interval ``dt`` counts.
    """
    x = np.stack([table[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    scale = table["scale"].astype(np.float64)
    count = sample_counts(table, x.shape[1])
    end = topic_stamps(table, "timestamp_sample")
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
        believed = (told * limits.RAW_HZ >= 1e6) & (told <= DECIMATION_FACTOR * max(typical, 0.0))
    return np.where(believed, told, max(typical, 0.0))


def vehicle_imu_candidates(builder: LogBuilder) -> list[ImuCandidate]:
    """``vehicle_imu``: calibrated increments of every unit, with their own integration times."""
    messages, found = builder.messages, []
    for i in messages.instances("vehicle_imu"):
        table = messages["vehicle_imu", i]
        dt = table["delta_angle_dt"].astype(np.float64) * 1e-6
        dt_v = table["delta_velocity_dt"].astype(np.float64) * 1e-6
        good = (dt > 0) & (dt < 1.0) & (dt_v > 0) & (dt_v < 1.0)
        if not good.any():
            continue
        t = topic_stamps(table, "timestamp_sample" if "timestamp_sample" in table else "timestamp")[good]
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
                acc_device=str(topic_device(table, "accel_device_id")) if "accel_device_id" in table else None,
                dt=dt[good],
                usable=not is_decimated(t, dt[good]),
            )
        )
        rows, rate = table.rows(good), found[-1].gyro
        found[-1].problems += gyro_mask_problem(builder, f"vehicle_imu:{i}", rows, "delta_angle_clipping", rate)
        if not found[-1].usable:
            found[-1].problems.append(decimation_problem(f"vehicle_imu:{i}", t, dt[good]))
        found[-1].usable &= found[-1].rate >= MIN_FAST_HZ
        found[-1].temperature = status_temperature(builder, i, t)
    return found


def status_temperature(builder: LogBuilder, unit: int, t: Stamps) -> Array | None:
    """Gyro temperature of a unit at the stamps ``t``, from the slow ``vehicle_imu_status``."""
    table = builder.messages.tables.get(("vehicle_imu_status", unit))
    if table is None or "temperature_gyro" not in table or len(table) < 2:
        return None
    at, celsius = topic_stamps(table), table["temperature_gyro"].astype(np.float64)
    return np.interp(t, at, celsius) if (np.diff(at) > 0).all() and np.isfinite(celsius).all() else None


def sensor_combined_candidates(builder: LogBuilder, selected: int) -> list[ImuCandidate]:
    """``sensor_combined``: means of the voted unit over ``gyro_integral_dt``, calibrated, body frame."""
    table = builder.messages.tables.get(("sensor_combined", 0))
    if table is None or "gyro_rad" not in table or "accelerometer_m_s2" not in table:
        return []
    t, dt = topic_stamps(table), integration_times(table)
    acc = columns(table, "accelerometer_m_s2")
    if "accelerometer_timestamp_relative" in table:  # 0x7fffffff: no accelerometer sample yet
        acc[table["accelerometer_timestamp_relative"] == 0x7FFFFFFF] = np.nan
    lossy = is_decimated(t, dt)
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
        found.problems.append(decimation_problem("sensor_combined", t, dt))
    return [found]


def integration_times(table: Table) -> Array:
    """Integration times (n,) in s: a float column holds seconds (1.5, 1.6dev), an integer one microseconds."""
    if "gyro_integral_dt" not in table:
        return np.full(len(table), np.nan)
    stored = table["gyro_integral_dt"]
    return stored.astype(np.float64) * (1.0 if stored.dtype.kind == "f" else 1e-6)


def is_decimated(t: Stamps, dt: Array) -> bool:
    """Whether samples between the logged ones are missing: stamps far wider apart than each sample covers."""
    with np.errstate(invalid="ignore"):
        covered = dt[np.isfinite(dt) & (dt > 0)]
    if len(t) < 3 or len(covered) == 0:
        return False
    return float(np.median(np.diff(t))) * 1e-6 > DECIMATION_FACTOR * float(np.median(covered))


def decimation_problem(source: str, t: Stamps, dt: Array) -> Problem:
    """What is wrong with a :func:`decimated` source."""
    text = (
        f"{source}: the logger kept one sample per {np.median(np.diff(t)) / 1000:.0f} ms although each "
        f"covers {np.median(dt) * 1000:.1f} ms; the rotation between them is lost."
    )
    return Problem("imu_decimated", "warning", text)


def filtered_candidates(builder: LogBuilder, values: dict[str, float], selected: int) -> list[ImuCandidate]:
    """``vehicle_angular_velocity`` with ``vehicle_acceleration``: after the control filters, a last resort."""
    gyro_table = builder.messages.tables.get(("vehicle_angular_velocity", 0))
    acc_table = builder.messages.tables.get(("vehicle_acceleration", 0))
    if gyro_table is None or acc_table is None:
        return []
    t, t_acc = (topic_stamps(x, "timestamp_sample") for x in (gyro_table, acc_table))
    gyro_cut, acc_cut = values.get("IMU_GYRO_CUTOFF", 0.0), values.get("IMU_ACCEL_CUTOFF", 0.0)
    found = ImuCandidate(
        selected,
        3,
        t,
        columns(gyro_table, "xyz"),
        resample_vectors(t, t_acc, columns(acc_table, "xyz")),
        "vehicle_angular_velocity",
        "instant",
        filtered=f"low-pass {gyro_cut:.0f} Hz and notches" if gyro_cut > 0 else "for control, cutoff unknown",
        gyro_delay=low_pass_delay(gyro_cut),
        acc_delay=low_pass_delay(acc_cut),
        acc_source="vehicle_acceleration",
        note="filtered for control: later and smoother than the sensor",
    )
    found = drop_unpaired(found)
    return [found] if found.rate >= MIN_FAST_HZ / 2 else []


def raw_candidates(builder: LogBuilder, values: dict[str, float]) -> list[ImuCandidate]:
    """``sensor_gyro`` with ``sensor_accel`` of every unit: the driver's samples, calibrated by parameters."""
    messages, found = builder.messages, []
    for i in messages.instances("sensor_gyro"):
        gyro_table, acc_table = messages["sensor_gyro", i], messages.tables.get(("sensor_accel", i))
        if acc_table is None or "x" not in gyro_table or "x" not in acc_table:
            continue
        column = "timestamp_sample" if "timestamp_sample" in gyro_table else "timestamp"
        t, t_acc = (
            topic_stamps(gyro_table, column),
            topic_stamps(acc_table, column if column in acc_table else "timestamp"),
        )
        gyro, known = px4_calibrate("GYRO", values, topic_device(gyro_table), columns(gyro_table, "x", "y", "z"))
        acc, known_acc = px4_calibrate("ACC", values, topic_device(acc_table), columns(acc_table, "x", "y", "z"))
        one = ImuCandidate(
            i,
            4,
            t,
            gyro,
            resample_vectors(t, t_acc, acc),
            f"sensor_gyro:{i}",
            "instant",
            calibrated=known and known_acc,
            filtered="driver",
            device=str(topic_device(gyro_table)),
            acc_source=f"sensor_accel:{i}",
            acc_device=str(topic_device(acc_table)),
        )
        one = drop_unpaired(one)
        if one.rate >= MIN_FAST_HZ:
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


def topic_device(table: Table, column: str = "device_id") -> int:
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
            found.setdefault(topic_device(builder.messages["sensor_gyro", i]), i)
    return {i: unit for i, unit in found.items() if i and i in wanted}


def selected_units(builder: LogBuilder) -> tuple[Stamps, list[int], str]:
    """When which unit flew (stamps, units, source), from the estimator selector or the sensor voter."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = builder.messages.tables.get((name, 0))
        if table is None or "gyro_device_id" not in table:
            continue
        t, units = [], []
        known = units_of_devices(builder, {int(i) for i in table["gyro_device_id"].tolist()})
        for at, device_id in zip(topic_stamps(table).tolist(), table["gyro_device_id"].tolist(), strict=True):
            unit = known.get(int(device_id))
            if unit is not None:
                t.append(at)
                units.append(unit)
        if units:
            return np.array(t, np.int64), units, name
    return np.zeros(0, np.int64), [], ""
