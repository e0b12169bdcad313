"""Read the inertial data and the clipping counters of PX4 logs.

Inertial sources, best first (docs/flight.md): FIFO topics, ``vehicle_imu``, ``sensor_combined``,
``vehicle_angular_velocity`` with ``vehicle_acceleration``, raw ``sensor_gyro`` with ``sensor_accel``.

``vehicle_imu_status`` counts clipped samples of every unit (1.11 on; of the gyro from 1.14).
``sensor_combined.accelerometer_clipping`` (1.11 on) is a mask of three bits of the selected unit.
``sensor_combined.gyro_clipping`` and ``vehicle_imu.delta_angle_clipping`` are unset memory in 1.13 beta and in 10 of 11
logs of 1.14: they count from 1.15 on, where no value is above the mask, and where a counter of ``vehicle_imu_status``
moved or the gyro was near its range. ``sensor_accel.clip_counter`` holds 1 where the others hold thousands, and is not
read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.sorting import median, unique
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration import px4_calibrate
from attlog.flight.imu import (
    MAX_REFUSED_SHARE,
    FlownUnits,
    ImuCandidate,
    drop_unpaired,
    low_pass_delay,
    read_candidates,
    resample_vectors,
)
from attlog.flight.model import Array, Clipping, Problem
from attlog.flight.parameters import boot_values
from attlog.flight.timestamps import read_stamps
from attlog.formats.table import Table

# Lowest rate in Hz of ``vehicle_imu`` and raw topics; half of it for the control topics.
MIN_FAST_HZ = 100.0
# Interval between samples, in integration times, above which the logger decimated them.
DECIMATION_FACTOR = 1.5
# Largest deviation of the interval between FIFO batches from the expected one, as a share of it.
MAX_BATCH_JITTER = 0.5
# ``accelerometer_timestamp_relative`` without an accelerometer sample.
NO_ACC_SAMPLE = 0x7FFFFFFF

# First ``ver_sw_release`` with valid gyro masks (1.15), and their largest value.
GYRO_MASK_RELEASE, MAX_CLIPPING_MASK = 1 << 24 | 15 << 16, 7
# 80 % of the usual range of 2,000 deg/s: slower rates do not clip.
NEAR_RANGE_RAD_S = 0.8 * np.radians(2000.0)


@dataclass(slots=True)
class TopicBuilder(LogBuilder):
    """Builder of a flight log from PX4 topics; ``values``: parameters at boot."""

    values: dict[str, float] = field(init=False)

    def __post_init__(self) -> None:
        LogBuilder.__post_init__(self)
        self.values = boot_values(self.messages.params)

    def topics(self, name: str) -> dict[int, Table]:
        """Return the tables of a topic by instance."""
        return {i: self.messages[name, i] for i in self.messages.instances(name)}


def sample_stamps(table: Table) -> Stamps | None:
    """Return the times of measurement (n,) of a topic in us, None if not logged."""
    return read_stamps(table, "timestamp_sample") if "timestamp_sample" in table else None


# --- devices ----------------------------------------------------------------------------------------------------


def topic_device(table: Table, column: str = "device_id") -> int:
    """Return the most frequent device id of a topic, 0 without one."""
    if column not in table or len(table) == 0:
        return 0
    ids: NDArray[Any] = table[column]
    known, count = np.unique(ids, return_counts=True)
    return int(known[np.argmax(count)])


def units_of_devices(builder: TopicBuilder, wanted: set[int]) -> dict[int, int]:
    """Return the IMU instance of each wanted gyro device id, except 0.

    By ``vehicle_imu`` or its status, else by ``sensor_gyro``.
    """
    found: dict[int, int] = {}
    for name in ("vehicle_imu", "vehicle_imu_status"):
        for i, table in builder.topics(name).items():
            found.setdefault(int(table["gyro_device_id"][-1]), i)
    if not wanted <= {0, *found}:
        for i, table in builder.topics("sensor_gyro").items():
            found.setdefault(topic_device(table), i)
    return {device: unit for device, unit in found.items() if device and device in wanted}


def flown_units(builder: TopicBuilder) -> FlownUnits:
    """Return the units that flew, by the estimator selector or the sensor voter."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = builder.table(name)
        if table is None or "gyro_device_id" not in table:
            continue
        devices = [int(device) for device in table["gyro_device_id"].tolist()]
        known = units_of_devices(builder, set(devices))
        stamps = builder.stamps(table).tolist()
        named = [(t, known[device]) for t, device in zip(stamps, devices, strict=True) if device in known]
        if named:
            return FlownUnits(np.array([t for t, _ in named], np.int64), [unit for _, unit in named], name)
    return FlownUnits()


def voted_accelerometer(builder: TopicBuilder) -> str | None:
    """Return the device id of the accelerometer in ``sensor_combined``, None if it changed or is not logged."""
    for name in ("sensor_selection", "estimator_selector_status"):
        table = builder.table(name)
        if table is not None and "accel_device_id" in table and len(table):
            ids = unique(table["accel_device_id"])
            return str(int(ids[0])) if len(ids) == 1 and ids[0] else None
    return None


# --- inertial sources -------------------------------------------------------------------------------------------


def imu_candidates(builder: TopicBuilder, selected: int) -> list[ImuCandidate]:
    """Return every inertial source of the log; ``selected``: the unit in ``sensor_combined``."""
    return read_candidates(
        builder,
        (
            ("sensor_gyro_fifo", partial(fifo_candidates, builder)),
            ("vehicle_imu", partial(vehicle_imu_candidates, builder)),
            ("sensor_combined", partial(sensor_combined_candidates, builder, selected)),
            ("vehicle_angular_velocity", partial(filtered_candidates, builder, selected)),
            ("sensor_gyro", partial(raw_candidates, builder)),
        ),
    )


def fifo_candidates(builder: TopicBuilder) -> list[ImuCandidate]:
    """Read ``sensor_gyro_fifo``: all gyro samples, with ``sensor_accel_fifo`` or the accelerometer in use."""
    found = []
    for i, table in builder.topics("sensor_gyro_fifo").items():
        device = topic_device(table)
        accelerometer = fifo_acceleration(builder, i)
        if accelerometer is None:
            continue
        t_acc, acc, known_acc, source, acc_device = accelerometer
        t, gyro = unpack_fifo(table)
        gyro, known = px4_calibrate("GYRO", builder.values, device, gyro)
        unit = units_of_devices(builder, {device}).get(device, i)
        acc = resample_vectors(t, t_acc, acc)
        one = ImuCandidate(unit, 0, t, gyro, acc, f"sensor_gyro_fifo:{i}", "interval", known and known_acc, "none")
        one.fastest_hz = limits.RAW_HZ
        one.device, one.acc_source, one.acc_device = str(device), source, acc_device
        damaged = oversized_batches(table)
        one.problems += damaged
        one.usable = all(p.count <= MAX_REFUSED_SHARE * len(table) for p in damaged)
        found.append(drop_unpaired(one))
    return found


def oversized_batches(table: Table) -> list[Problem]:
    """Return the problem of FIFO batches with a sample count above their size, if any."""
    size = table["x"].shape[1]
    count = int(np.count_nonzero(table["samples"].astype(np.int64) > size))
    if not count:
        return []
    text = f"{table.name}:{table.instance}: left out {count:,} of {len(table):,} batches, which tell of more samples "
    return [Problem("values_out_of_range", "warning", f"{text}than the {size} that they have room for.", count=count)]


def fifo_acceleration(builder: TopicBuilder, unit: int) -> tuple[Stamps, Array, bool, str, str | None] | None:
    """Return the acceleration to a gyro FIFO: stamps, body-frame values, calibrated, source and device."""
    topics = builder.topics("sensor_accel_fifo")
    if topics:
        table = topics.get(unit, next(iter(topics.values())))
        device = topic_device(table)
        t, raw = unpack_fifo(table)
        acc, known = px4_calibrate("ACC", builder.values, device, raw)
        return t, acc, known, f"sensor_accel_fifo:{table.instance}", str(device)
    voted = builder.messages.first("sensor_combined")
    if voted is None or "accelerometer_m_s2" not in voted:
        return None
    acc = columns(voted, "accelerometer_m_s2")
    return builder.stamps(voted), acc, True, "sensor_combined", voted_accelerometer(builder)


def unpack_fifo(table: Table) -> tuple[Stamps, Array]:
    """Return stamps (m,) in us and samples (m, 3) in SI of a FIFO topic.

    A batch's stamp is that of its last sample. Its samples are spread evenly over the time since the batch before, so
    that stamp jitter changes no rotation. Behind a lost batch the sensor's interval ``dt`` is used.
    """
    x = np.stack([table[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    scale = table["scale"].astype(np.float64)
    logged = table["samples"].astype(np.int64)
    count = np.where((logged >= 0) & (logged <= x.shape[1]), logged, 0)
    end = read_stamps(table, "timestamp_sample")
    since = np.diff(end, prepend=end[:1]).astype(np.float64)
    own = sample_intervals(table["dt"].astype(np.float64), since, count)
    expected = own * count
    near = np.abs(since - expected) < MAX_BATCH_JITTER * expected
    dt = np.where(near, since / np.maximum(count, 1), own)
    column = np.arange(x.shape[1])
    valid = column[None, :] < count[:, None]
    age = (count[:, None] - 1 - column[None, :]) * dt[:, None]
    t = end[:, None] - np.round(age).astype(np.int64)
    return t[valid], (x * scale[:, None, None])[valid]


def sample_intervals(logged: Array, since: Array, count: NDArray[np.int64]) -> Array:
    """Return the sample intervals (n,) in us: the logged ones if plausible, else the median of the batches.

    ``since`` (n,): us since the batch before. Lost batches lengthen the median, so a logged interval may be shorter,
    but not shorter than a sensor's fastest.
    """
    needed = since[1:][count[1:] > 0] / count[1:][count[1:] > 0]
    typical = max(float(median(needed)) if len(needed) else 0.0, 0.0)
    with np.errstate(invalid="ignore"):
        possible = (logged * limits.RAW_HZ >= 1e6) & (logged <= DECIMATION_FACTOR * typical)
    return np.where(possible, logged, typical)


def vehicle_imu_candidates(builder: TopicBuilder) -> list[ImuCandidate]:
    """Read ``vehicle_imu``: calibrated increments of every unit, with their integration times."""
    found = []
    for i, table in builder.topics("vehicle_imu").items():
        dt = table["delta_angle_dt"].astype(np.float64) * 1e-6
        dt_v = table["delta_velocity_dt"].astype(np.float64) * 1e-6
        good = (dt > 0) & (dt < 1.0) & (dt_v > 0) & (dt_v < 1.0)
        if not good.any():
            continue
        source, table, dt, dt_v = f"vehicle_imu:{i}", table.rows(good), dt[good], dt_v[good]
        t = read_stamps(table, "timestamp_sample" if "timestamp_sample" in table else "timestamp")
        gyro, acc = columns(table, "delta_angle") / dt[:, None], columns(table, "delta_velocity") / dt_v[:, None]
        one = ImuCandidate(i, 1, t, gyro, acc, source, "interval", filtered="none", dt=dt)
        one.device = str(int(table["gyro_device_id"][0]))
        one.acc_device = str(topic_device(table, "accel_device_id")) if "accel_device_id" in table else None
        one.temperature = status_temperature(builder, i, t)
        one.problems += gyro_mask_problem(builder, source, table, "delta_angle_clipping", gyro)
        decimated = decimation_problem(source, t, dt)
        one.problems += decimated
        one.usable = not decimated and one.rate >= MIN_FAST_HZ
        found.append(one)
    return found


def status_temperature(builder: TopicBuilder, unit: int, t: Stamps) -> Array | None:
    """Interpolate a unit's gyro temperature from ``vehicle_imu_status`` to stamps, None if not usable."""
    table = builder.table("vehicle_imu_status", unit)
    if table is None or "temperature_gyro" not in table or len(table) < 2:
        return None
    at, celsius = builder.stamps(table), table["temperature_gyro"].astype(np.float64)
    return np.interp(t, at, celsius) if (np.diff(at) > 0).all() and np.isfinite(celsius).all() else None


def sensor_combined_candidates(builder: TopicBuilder, selected: int) -> list[ImuCandidate]:
    """Read ``sensor_combined``: means of the selected unit over ``gyro_integral_dt``, calibrated, body frame."""
    table = builder.table("sensor_combined")
    if table is None or "gyro_rad" not in table or "accelerometer_m_s2" not in table:
        return []
    t, dt = builder.stamps(table), integration_times(table)
    acc = columns(table, "accelerometer_m_s2")
    if "accelerometer_timestamp_relative" in table:
        acc[table["accelerometer_timestamp_relative"] == NO_ACC_SAMPLE] = np.nan
    one = ImuCandidate(selected, 2, t, columns(table, "gyro_rad"), acc, "sensor_combined", "interval", filtered="none")
    one.acc_device, one.temperature = voted_accelerometer(builder), status_temperature(builder, selected, t)
    one.note = "holds the unit that the autopilot's voter chose"
    one.problems += gyro_mask_problem(builder, "sensor_combined", table, "gyro_clipping", one.gyro)
    decimated = decimation_problem("sensor_combined", t, dt)
    one.problems += decimated
    one.usable = not decimated
    return [one]


def integration_times(table: Table) -> Array:
    """Return integration times (n,) in s; logged as float in seconds (1.5, 1.6dev) or as integer in us."""
    if "gyro_integral_dt" not in table:
        return np.full(len(table), np.nan)
    stored = table["gyro_integral_dt"]
    return stored.astype(np.float64) * (1.0 if stored.dtype.kind == "f" else 1e-6)


def decimation_problem(source: str, t: Stamps, dt: Array) -> list[Problem]:
    """Return the problem of a source that is logged more slowly than its samples cover (``dt`` s), if any."""
    with np.errstate(invalid="ignore"):
        covered = dt[np.isfinite(dt) & (dt > 0)]
    if len(t) < 3 or len(covered) == 0:
        return []
    apart_ms, covered_ms = float(median(np.diff(t))) / 1000, 1000 * float(median(covered))
    if apart_ms <= DECIMATION_FACTOR * covered_ms:
        return []
    text = f"{source}: the logger kept one sample per {apart_ms:.0f} ms although each covers {covered_ms:.1f} ms; "
    return [Problem("imu_decimated", "warning", f"{text}the rotation between them is lost.", source=source)]


def filtered_candidates(builder: TopicBuilder, selected: int) -> list[ImuCandidate]:
    """Read ``vehicle_angular_velocity`` with ``vehicle_acceleration``, which are filtered for control."""
    gyro_table, acc_table = builder.table("vehicle_angular_velocity"), builder.table("vehicle_acceleration")
    if gyro_table is None or acc_table is None:
        return []
    t, t_acc = (read_stamps(x, "timestamp_sample") for x in (gyro_table, acc_table))
    gyro_cut, acc_cut = builder.values.get("IMU_GYRO_CUTOFF", 0.0), builder.values.get("IMU_ACCEL_CUTOFF", 0.0)
    acc = resample_vectors(t, t_acc, columns(acc_table, "xyz"))
    one = ImuCandidate(selected, 3, t, columns(gyro_table, "xyz"), acc, "vehicle_angular_velocity", "instant")
    one.filtered = f"low-pass {gyro_cut:.0f} Hz and notches" if gyro_cut > 0 else "for control, cutoff unknown"
    one.gyro_delay, one.acc_delay = low_pass_delay(gyro_cut), low_pass_delay(acc_cut)
    one.acc_source = "vehicle_acceleration"
    one.note = "filtered for control: later and smoother than the sensor"
    one = drop_unpaired(one)
    return [one] if one.rate >= MIN_FAST_HZ / 2 else []


def raw_candidates(builder: TopicBuilder) -> list[ImuCandidate]:
    """Read ``sensor_gyro`` with ``sensor_accel`` of every unit: driver samples, calibrated by parameters."""
    found = []
    for i, gyro_table in builder.topics("sensor_gyro").items():
        acc_table = builder.table("sensor_accel", i)
        if acc_table is None or "x" not in gyro_table or "x" not in acc_table:
            continue
        column = "timestamp_sample" if "timestamp_sample" in gyro_table else "timestamp"
        t = read_stamps(gyro_table, column)
        t_acc = read_stamps(acc_table, column if column in acc_table else "timestamp")
        device, acc_device = topic_device(gyro_table), topic_device(acc_table)
        gyro, known = px4_calibrate("GYRO", builder.values, device, columns(gyro_table, "x", "y", "z"))
        acc, known_acc = px4_calibrate("ACC", builder.values, acc_device, columns(acc_table, "x", "y", "z"))
        acc = resample_vectors(t, t_acc, acc)
        one = ImuCandidate(i, 4, t, gyro, acc, f"sensor_gyro:{i}", "instant", known and known_acc, "driver")
        one.device, one.acc_source, one.acc_device = str(device), f"sensor_accel:{i}", str(acc_device)
        one = drop_unpaired(one)
        if one.rate >= MIN_FAST_HZ:
            found.append(one)
    return found


# --- clipping ---------------------------------------------------------------------------------------------------


def clippings(builder: TopicBuilder) -> list[Clipping]:
    """Return clipped samples over time: by counters of every unit, and by the mask of the selected one."""
    found = []
    for unit, table in builder.topics("vehicle_imu_status").items():
        for sensor, column in (("accelerometer", "accel_clipping"), ("gyro", "gyro_clipping")):
            if column in table and len(table) > 1:
                source = f"{table.name}:{unit}.{column}"
                found.append(builder.clipping(sensor, unit, source, table, column))
    voted, column = builder.table("sensor_combined"), "accelerometer_clipping"
    if voted is not None and column in voted and len(voted):
        t, new = builder.seconds(builder.stamps(voted)), (voted[column] > 0).astype(np.int64)
        found.append(Clipping("accelerometer", None, f"{voted.name}.{column}", t, new, False))
    return found


def gyro_mask_problem(builder: TopicBuilder, source: str, table: Table, column: str, rate: Array) -> list[Problem]:
    """Return the problem of a clipped gyro by its mask, if any.

    The mask must be confirmed by a counter or a ``rate`` (n, 3) rad/s near the end of the range.
    """
    release: Any = builder.messages.info.get("ver_sw_release")
    if column not in table or not isinstance(release, (int, np.integer)) or int(release) < GYRO_MASK_RELEASE:
        return []
    mask = table[column].astype(np.int64)
    if not mask.any() or mask.max() > MAX_CLIPPING_MASK:
        return []
    flagged = any(c.sensor == "gyro" and c.whole and c.new.any() for c in clippings(builder))
    if not flagged and not np.nanmax(np.abs(rate), initial=0.0) > NEAR_RANGE_RAD_S:
        return []
    count = int(np.count_nonzero(mask))
    text = f"{source}: the gyro was at the end of its range in {counted(count, 'sample')} ({column})."
    cause = "An impact, vibration, or a range that is set too small."
    return [Problem("gyro_clipped", "warning", text, count=count, cause=cause)]
