"""What drives an ArduPilot vehicle: throttle, outputs to the motors, rotor speeds, battery."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.flight import gnss, limits
from attlog.flight.ardupilot.imu import RecordClock, unit_tables
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, Burst, Clipping, Gnss, Imu, OnboardVibration, Stream
from attlog.flight.timestamps import gps_time_us, read_stamps
from attlog.formats.table import Table

MOTOR_FUNCTIONS = (*range(33, 41), *range(82, 86))
"""SERVOn_FUNCTION of motors 1 to 12."""
MOTOR_COUNT = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8, "dodecarotor": 12}
"""How many of the first outputs are motors where no parameter tells."""


def throttle_stream(builder: LogBuilder, clock: RecordClock, family: str) -> Stream | None:
    """Throttle output 0 to 1; planes and rovers log percent, copters before 3.4 per mille."""
    for name in ("CTUN", "THR"):
        table = builder.messages.first(name)
        column = None if table is None else next((c for c in ("ThO", "ThrOut") if c in table), None)
        if table is None or column is None or clock.of_samples(table) is None:
            continue
        x = table.value(column)
        scale = 0.01 if family in ("plane", "rover") else (1e-3 if column == "ThrOut" else 1.0)
        return builder.stream(
            clock.of(table), x * scale, "1", f"{name}.{column}", within=limits.THROTTLE, allow_nan=True
        )
    return None


def motor_outputs(builder: LogBuilder, clock: RecordClock, vehicle: str, values: dict[str, float]) -> Stream | None:
    """Outputs to the motors of a multirotor (n, motors), 0 stopped to 1 full, by RCOU and its limits."""
    table = builder.messages.first("RCOU")
    if table is None or vehicle not in MOTOR_COUNT or clock.of_samples(table) is None:
        return None
    numbers = [n for n in range(1, 17) if values.get(f"SERVO{n}_FUNCTION") in MOTOR_FUNCTIONS]
    numbers = numbers or list(range(1, MOTOR_COUNT[vehicle] + 1))
    prefix = next((p for p in ("C", "Ch", "Chan") if f"{p}{numbers[0]}" in table), None)
    throttle_channel = int(values.get("RCMAP_THROTTLE", 3))
    low = values.get("MOT_PWM_MIN") or values.get(f"RC{throttle_channel}_MIN")
    high = values.get("MOT_PWM_MAX") or values.get(f"RC{throttle_channel}_MAX")
    if prefix is None or not low or not high or high - low < 100.0:
        return None
    names = [f"{prefix}{n}" for n in numbers if f"{prefix}{n}" in table]
    share = np.clip((columns(table, *names) - low) / (high - low), 0.0, 1.0)
    return builder.stream(clock.of(table), share, "1", "RCOU")


def rpm_stream(builder: LogBuilder, clock: RecordClock) -> Stream | None:
    """Rotor speeds (n, rotors) in rev/min: ESC telemetry by motor, else the RPM sensors."""
    messages = builder.messages
    motors = [t for t in (messages["ESC", i] for i in messages.instances("ESC")) if "RPM" in t and len(t) > 1]
    if motors:
        t = clock.of(motors[0])
        x = [np.interp(t, clock.of(m), m.value("RPM")) for m in motors]
        return builder.stream(t, np.column_stack(x), "rpm", "ESC", within=limits.RPM)
    table = messages.first("RPM")
    if table is None:
        return None
    names = [c for c in ("rpm1", "rpm2", "RPM1", "RPM2", "RPM") if c in table]
    return builder.stream(clock.of(table), columns(table, *names), "rpm", "RPM", within=limits.RPM) if names else None


def battery_stream(builder: LogBuilder, clock: RecordClock) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A; before 3.4 the log holds hundredths."""
    for name in ("BAT", "CURR"):
        table = builder.messages.first(name)
        if table is None or "Volt" not in table or "Curr" not in table or clock.of_samples(table) is None:
            continue
        x = columns(table, "Volt", "Curr")
        volts = x[np.isfinite(x[:, 0]), 0]
        if table.fields["Volt"].dtype.kind in "iu" or (len(volts) and np.median(np.abs(volts)) > 150.0):
            x = x * 0.01
        return builder.battery(clock.of(table), x, name)
    return None


# Satellite receivers of an ArduPilot log: as flown, and as given to the EKF for replay.
#
# GPA.SMS (boot time, ms) is ``last_message_time_ms``, from which the EKF subtracts GPS_DELAY_MS; GPS and GPA are
# written
# 10 to 50 ms later.


def read_receiver(builder: LogBuilder, clock: RecordClock, unit: int, table: Table) -> Gnss | None:
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
    h_acc, v_acc, s_acc = (nearest_accuracy(builder, clock, unit, t_us, c) for c in ("HAcc", "VAcc", "SAcc"))
    yaw = np.radians(table.value("Yaw")) if "Yaw" in table else None
    if yaw is not None:
        yaw = np.where(yaw == 0.0, np.nan, (yaw + np.pi) % (2 * np.pi) - np.pi)  # 0: the receiver has no heading
    return gnss.build_gnss(
        builder,
        unit,
        t_us,
        source,
        place=place,
        velocity=velocity,
        fix=table["Status"].astype(np.int64),
        accuracy=(h_acc, v_acc, s_acc),
        yaw=yaw,
        utc_us=receiver_utc_us(table),
        received_us=1e3 * nearest_accuracy(builder, clock, unit, t_us, "SMS"),
        reception={name: optional_column(table, column) for name, column in RECEPTION_COLUMNS.items()},
    )


RECEPTION_COLUMNS = {"satellites": "NSats", "hdop": "HDop"}


def optional_column(table: Table, column: str) -> Array:
    """A column (n,), NaN where the record has none."""
    return table.value(column).astype(np.float64) if column in table else np.full(len(table), np.nan)


def replay_receivers(builder: LogBuilder) -> list[Gnss]:
    """Receivers as LOG_REPLAY gave them to the EKF (RGPJ): 1e-7 deg, cm, m/s NED, boot time in ms."""
    found = []
    for unit, table in unit_tables(builder.messages, "RGPJ").items():
        t_us = read_stamps(table, "TS", 1000)
        place = columns(table, "Lat", "Lon", "Alt") * [1e-7, 1e-7, 1e-2]
        new = np.concatenate([[True], np.diff(t_us) != 0]) if len(t_us) else np.zeros(0, bool)
        told = new & (place[:, :2] != 0).any(axis=1)
        one = gnss.build_gnss(
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


def nearest_accuracy(builder: LogBuilder, clock: RecordClock, unit: int, t_us: np.ndarray, column: str) -> Array:
    """An accuracy from the GPA record that belongs to each GPS record (at most 0.5 s away), else NaN."""
    table = unit_tables(builder.messages, "GPA").get(unit)
    if table is None or column not in table or len(table) == 0:
        return np.full(len(t_us), np.nan)
    at = clock.of(table)
    order = np.argsort(at, kind="stable")
    at, x = at[order], table.value(column)[order]
    k = np.clip(np.searchsorted(at, t_us), 1, max(len(at) - 1, 1))
    k = np.minimum(k, len(at) - 1)
    k = np.where(np.abs(at[k - 1] - t_us) < np.abs(at[k] - t_us), k - 1, k)
    return np.where(np.abs(at[k] - t_us) <= 500_000, x[k], np.nan)


def receiver_utc_us(table: Table) -> np.ndarray | None:
    """Unix time in us from GPS week and milliseconds, 0 where the receiver did not know it; None without columns."""
    week = next((c for c in ("GWk", "Week") if c in table), None)
    ms = next((c for c in ("GMS", "TimeMS") if c in table), None)
    if week is None or ms is None:
        return None
    return gps_time_us(table[week].astype(np.int64), table[ms].astype(np.int64))


# What ArduPilot logs of vibration: VIBE at the sensor's full rate (levels, clipped samples), and bursts (ISBH, ISBD).
#
# ``Clip0`` to ``Clip2`` (3.4 to 4.0) count by unit in one record, ``Clip`` (4.1 on) in one record for each unit.
# Before
# 3.4 nothing tells, and the logged IMU at 25 Hz never reaches the limit. Bursts: ``BatchSampler.cpp`` of
# AP_InertialSensor; a header tells the sensor and the factor, up to 32 data records of 32 samples follow.

VIBE_COLUMNS = ("VibeX", "VibeY", "VibeZ")
MAX_BURSTS = 200
"""So many of each sensor are kept, evenly spread, so that the memory they take has a limit (5 MB)."""
MIN_BURST_SAMPLES = 256
"""A shorter rest of a burst of which records were lost resolves no peak."""
MAX_BURST_DELAY_US = 10_000_000
"""A burst is written within a second or two; a header that says otherwise has no time of measurement."""
POST_FILTER_BIT, PRE_AND_POST_BIT = 2, 4
"""Bits of INS_LOG_BAT_OPT: behind the filters; both, those behind them numbered after the last IMU."""
BURST_SENSORS: dict[int, Literal["gyro", "accelerometer"]] = {0: "accelerometer", 1: "gyro"}
"""ISBH.type."""


def vibration_stream(builder: LogBuilder, clock: RecordClock, imu: Imu | None) -> Stream | None:
    """VIBE (n, 3) in m/s^2 of the replayed unit; before 4.1 there is one record for all."""
    tables = unit_tables(builder.messages, "VIBE")
    table = tables.get(imu.index if imu is not None else 0, tables.get(0))
    if table is None or not all(c in table for c in VIBE_COLUMNS):
        return None
    x = columns(table, *VIBE_COLUMNS)
    return builder.stream(clock.of(table), x, "m/s^2", "VIBE", frame="FRD", within=limits.VIBRATION)


def vibration_levels(builder: LogBuilder, clock: RecordClock) -> list[OnboardVibration]:
    """The level of the worst axis of every unit that VIBE tells of; before 4.1 that is the primary one, here 0."""
    found = []
    own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # what is left out is told where the replayed unit is read
    for unit, table in unit_tables(builder.messages, "VIBE").items():
        if all(c in table for c in VIBE_COLUMNS):
            source = f"VIBE:{unit}" if "IMU" in table else "VIBE"
            stream = own.stream(
                clock.of(table), columns(table, *VIBE_COLUMNS), "m/s^2", source, within=limits.VIBRATION
            )
            if stream is not None:
                found.append(OnboardVibration(unit, "rest", source, stream.t, stream.x.max(axis=1)))
    return found


def clippings(builder: LogBuilder, clock: RecordClock) -> list[Clipping]:
    """New clipped samples of every unit over time."""
    found = []
    have = {imu for imu in unit_tables(builder.messages, "IMU")}
    for instance, table in unit_tables(builder.messages, "VIBE").items():
        if len(table) < 2:
            continue
        named = [(instance, "Clip")] if "Clip" in table else [(k, f"Clip{k}") for k in range(3)]
        for unit, column in named:
            if column in table and (column == "Clip" or unit in have):
                counter = table[column].astype(np.int64)
                new = np.maximum(np.diff(counter, prepend=counter[:1]), 0)
                source = f"VIBE:{unit}.Clip" if column == "Clip" else f"VIBE.{column}"
                found.append(Clipping("accelerometer", unit, source, builder.seconds(clock.of(table)), new, True))
    return found


def read_bursts(builder: LogBuilder, values: dict[str, float]) -> list[Burst]:
    """The batches of the sensors' raw samples, at most 200 of each sensor, in time order."""
    heads, data = builder.messages.first("ISBH"), builder.messages.first("ISBD")
    needed = ("N", "type", "instance", "mul", "SampleUS", "smp_rate")
    if heads is None or data is None or not all(c in heads for c in needed) or not all(c in data for c in "xyz"):
        return []
    number = heads["N"].astype(np.int64)
    of_head = np.searchsorted(heads.offsets, data.offsets) - 1
    mine = (of_head >= 0) & (data["N"].astype(np.int64) == number[np.maximum(of_head, 0)])
    rows = np.flatnonzero(mine)
    begin = np.searchsorted(of_head[rows], np.arange(len(heads)))
    end = np.searchsorted(of_head[rows], np.arange(len(heads)), side="right")
    imus = max(len(unit_tables(builder.messages, "IMU")), 1)
    options = int(values.get("INS_LOG_BAT_OPT", 0.0))
    found = []
    for k in _chosen_headers(heads):
        unit, filtered = int(heads["instance"][k]), bool(options & POST_FILTER_BIT)
        if options & PRE_AND_POST_BIT and unit >= imus:
            unit, filtered = unit - imus, True
        one = _read_burst(builder, heads, int(k), data.rows(rows[begin[k] : end[k]]), unit, filtered)
        found += [] if one is None else [one]
    return found


def _chosen_headers(heads: Table) -> NDArray[np.int64]:
    """Which headers to read, in file order: of each sensor as many as are kept, evenly spread."""
    kind = heads["type"].astype(np.int64) * 256 + heads["instance"].astype(np.int64)
    kept = []
    for one in np.unique(kind):
        k = np.flatnonzero(kind == one)
        kept.append(k[np.unique(np.linspace(0, len(k) - 1, MAX_BURSTS).round().astype(np.int64))])
    return np.sort(np.concatenate(kept)) if kept else np.zeros(0, np.int64)


def _read_burst(builder: LogBuilder, heads: Table, k: int, data: Table, unit: int, filtered: bool) -> Burst | None:
    """One burst up to the first record that is missing; None where that is too short or its header makes no sense."""
    sensor = BURST_SENSORS.get(int(heads["type"][k]))
    factor, rate = float(heads["mul"][k]), float(heads["smp_rate"][k])
    if sensor is None or factor <= 0 or not 100.0 <= rate <= limits.RAW_HZ:
        return None
    whole = data["seqno"].astype(np.int64) == np.arange(len(data)) if "seqno" in data else np.ones(len(data), bool)
    count = int(np.argmin(whole)) if not whole.all() else len(data)
    x = np.stack([data[axis][:count].reshape(-1) for axis in "xyz"], axis=-1).astype(np.float32) / np.float32(factor)
    at, sampled = int(heads["TimeUS"][k]) if "TimeUS" in heads else 0, int(heads["SampleUS"][k])
    stamp = sampled if abs(at - sampled) < MAX_BURST_DELAY_US or not at else at
    if len(x) < MIN_BURST_SAMPLES or not builder.is_near(stamp):
        return None
    t = float(builder.seconds(np.array(stamp)))
    return Burst(sensor, unit, t, rate, x, filtered, f"ISBD:{int(heads['instance'][k])}")
