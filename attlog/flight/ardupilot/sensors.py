"""Read the sensors of ArduPilot logs beside the IMU, and what drives the vehicle.

GPA.SMS (boot time, ms) is ``last_message_time_ms``, from which the EKF subtracts GPS_DELAY_MS; GPS and GPA are written
10 to 50 ms later.

VIBE measures at the sensor's full rate. ``Clip0`` to ``Clip2`` (3.4 to 4.0) count by unit in one record, ``Clip``
(4.1 on) in one record for each unit; before 3.4 nothing counts. Bursts (ISBH, ISBD; ``BatchSampler.cpp`` of
AP_InertialSensor): a header with sensor and factor, then up to 32 data records of 32 samples.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core.earth import TESLA_PER_MILLIGAUSS
from attlog.core.sorting import median, unique
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.ardupilot.imu import DataflashBuilder, own_time, replay_frame_stamps, source_name
from attlog.flight.builder import columns, optional_column
from attlog.flight.calibration import compass_device
from attlog.flight.compass import build_mag
from attlog.flight.gnss import build_gnss
from attlog.flight.model import Array, Burst, Clipping, Gnss, Imu, Mag, OnboardVibration, Stream
from attlog.flight.timestamps import gps_time_us, read_stamps
from attlog.formats.table import Table

# Overflow of 32-bit microseconds.
_WRAP_US = 2**32

# --- magnetometers ----------------------------------------------------------------------------------------------


def magnetometers(builder: DataflashBuilder) -> list[Mag]:
    """Return every compass: MAG (mGa, body frame) with offsets and motor compensation applied by the firmware."""
    found = []
    for unit, table in builder.units("MAG").items():
        if "MagX" not in table or own_time(table) is None:
            continue
        t, source = builder.stamps(table), source_name(table, unit)
        field = columns(table, "MagX", "MagY", "MagZ")
        offsets = columns(table, "OfsX", "OfsY", "OfsZ") if "OfsX" in table else None
        if offsets is not None and shows_only_offsets(field, offsets):
            text = f"{source}: every value equals the compass offsets, so the compass itself measures nothing; "
            builder.problem("mag_only_offsets", "warning", text + "it is not used.", source=source)
            field = np.zeros_like(field)
        sampled = t - (t - table["S"].astype(np.int64)) % _WRAP_US if "S" in table else None
        enabled = builder.values.get("COMPASS_USE" + ("" if unit == 0 else str(unit + 1)), 1.0) != 0
        device = compass_device(builder.values, unit)
        mag = build_mag(
            builder, unit, t, field * TESLA_PER_MILLIGAUSS, source, t_sample_us=sampled, device=device, enabled=enabled
        )
        if mag is not None:
            if offsets is not None:
                new = np.concatenate([np.ones(min(len(t), 1), bool), np.diff(offsets, axis=0).any(axis=1)])
                mag.offsets = builder.quiet().stream(t[new], offsets[new] * TESLA_PER_MILLIGAUSS, "T", source)
            found.append(mag)
    return found or replay_magnetometers(builder)


def replay_magnetometers(builder: DataflashBuilder) -> list[Mag]:
    """Return compasses as received by the EKF (RMGI of LOG_REPLAY, mGa, body frame), at their update times."""
    found = []
    frames = builder.messages.first("RFRH")
    for unit, table in builder.units("RMGI").items():
        if frames is None or "FX" not in table or "LU" not in table:
            continue
        t = replay_frame_stamps(frames, table)
        updated = t - (t - table["LU"].astype(np.int64)) % _WRAP_US
        field = columns(table, "FX", "FY", "FZ") * TESLA_PER_MILLIGAUSS
        new = np.concatenate([[True], np.diff(updated) != 0]) if len(t) else np.zeros(0, bool)
        use = bool("UFY" not in table or (table["UFY"] != 0).any())
        mag = build_mag(builder, unit, updated[new], field[new], f"RMGI:{unit}", enabled=use)
        found += [mag] if mag is not None else []
    return found


def shows_only_offsets(field: Array, offsets: Array) -> bool:
    """Return whether the field equals the compass offsets, as with a constant raw field of zero."""
    measured = field.any(axis=1)
    if not measured.any() or not offsets.any():
        return False
    return bool((np.abs(field - offsets)[measured] <= 1.0).all())


def primary_compass(builder: DataflashBuilder) -> int | None:
    """Return the index of the preferred compass: COMPASS_PRIMARY, or since 4.1 the first by priority."""
    primary, mags = builder.values.get("COMPASS_PRIMARY"), builder.log.mags
    if primary is not None:
        return int(primary)
    return mags[0].index if mags else None


# --- GNSS -------------------------------------------------------------------------------------------------------

RECEPTION_COLUMNS = {"satellites": "NSats", "hdop": "HDop"}
# Longest time between a GPS record and its GPA record.
MAX_ACCURACY_AGE_US = 500_000


def receivers(builder: DataflashBuilder) -> list[Gnss]:
    """Return the receivers by GPS records, else by RGPJ records of LOG_REPLAY."""
    every = [
        builder.read_optional("GPS", partial(read_receiver, builder, unit, table), None)
        for unit, table in builder.units("GPS").items()
    ]
    found = [receiver for receiver in every if receiver is not None]
    return found or builder.read_optional("RGPJ", partial(replay_receivers, builder), [])


def read_receiver(builder: DataflashBuilder, unit: int, table: Table) -> Gnss | None:
    """Read a receiver from GPS with accuracies of GPA; velocity from ground speed, course and vertical speed."""
    if not all(c in table for c in ("Lat", "Lng", "Spd", "GCrs", "Status")):
        return None
    t_us = builder.stamps(table)
    speed, course = table.value("Spd"), np.radians(table.value("GCrs"))
    down = optional_column(table, "VZ")
    h_acc, v_acc, s_acc = (nearest_accuracy(builder, unit, t_us, c) for c in ("HAcc", "VAcc", "SAcc"))
    yaw = np.radians(table.value("Yaw")) if "Yaw" in table else None
    if yaw is not None:
        yaw = np.where(yaw == 0.0, np.nan, (yaw + np.pi) % (2 * np.pi) - np.pi)  # 0: the receiver has no heading
    return build_gnss(
        builder,
        unit,
        t_us,
        f"GPS:{unit}",
        place=np.column_stack([table.value("Lat"), table.value("Lng"), optional_column(table, "Alt")]),
        velocity=np.column_stack([speed * np.cos(course), speed * np.sin(course), down]),
        fix=table["Status"].astype(np.int64),
        accuracy=(h_acc, v_acc, s_acc),
        yaw=yaw,
        utc_us=receiver_utc_us(table),
        received_us=1e3 * nearest_accuracy(builder, unit, t_us, "SMS"),
        reception={name: optional_column(table, column) for name, column in RECEPTION_COLUMNS.items()},
    )


def replay_receivers(builder: DataflashBuilder) -> list[Gnss]:
    """Read receivers as received by the EKF (RGPJ of LOG_REPLAY: 1e-7 deg, cm, m/s, boot time in ms)."""
    found = []
    for unit, table in builder.units("RGPJ").items():
        t_us = read_stamps(table, "TS", 1000)
        place = columns(table, "Lat", "Lon", "Alt") * [1e-7, 1e-7, 1e-2]
        new = np.concatenate([[True], np.diff(t_us) != 0]) if len(t_us) else np.zeros(0, bool)
        new &= (place[:, :2] != 0).any(axis=1)
        one = build_gnss(
            builder,
            unit,
            t_us[new],
            f"RGPJ:{unit}",
            place=place[new],
            velocity=columns(table, "VX", "VY", "VZ")[new],
            fix=np.full(int(new.sum()), 3),
            accuracy=(table.value("HA")[new], table.value("VA")[new], table.value("SA")[new]),
        )
        found += [] if one is None else [one]
    return found


def nearest_accuracy(builder: DataflashBuilder, unit: int, t_us: Stamps, column: str) -> Array:
    """Return a column of the GPA record nearest to each stamp, NaN beyond MAX_ACCURACY_AGE_US."""
    table = builder.units("GPA").get(unit)
    if table is None or column not in table or len(table) == 0:
        return np.full(len(t_us), np.nan)
    at = builder.stamps(table)
    order = np.argsort(at, kind="stable")
    at, x = at[order], table.value(column)[order]
    k = np.clip(np.searchsorted(at, t_us), 1, max(len(at) - 1, 1))
    k = np.minimum(k, len(at) - 1)
    k = np.where(np.abs(at[k - 1] - t_us) < np.abs(at[k] - t_us), k - 1, k)
    return np.where(np.abs(at[k] - t_us) <= MAX_ACCURACY_AGE_US, x[k], np.nan)


def receiver_utc_us(table: Table) -> NDArray[np.int64] | None:
    """Return Unix time in us from GPS week and milliseconds, 0 if unset; None without the columns."""
    week = next((c for c in ("GWk", "Week") if c in table), None)
    ms = next((c for c in ("GMS", "TimeMS") if c in table), None)
    if week is None or ms is None:
        return None
    return gps_time_us(table[week].astype(np.int64), table[ms].astype(np.int64))


# --- height and airspeed ----------------------------------------------------------------------------------------

# RFND.Orient of a rangefinder that looks at the ground, RFND.Stat of a reading within its range.
DOWNWARD_ORIENTATION, GOOD_RANGE_STATUS = 25, 4
# Standard atmosphere: pressure at sea level; relative density is relative pressure to this power.
SEA_LEVEL_PA, DENSITY_EXPONENT = 101_325.0, 0.81


def baro_streams(builder: DataflashBuilder) -> list[Stream]:
    """Return barometric altitudes in m above the take-off pressure: BARO.Alt, in 3.2 and older CTUN.BarAlt."""
    tables = builder.units("BARO")
    control = None if tables else builder.sampled("CTUN", "BarAlt")
    if control is not None:
        one = builder.column_stream(control, ("BarAlt",), "m", "CTUN.BarAlt", limits.BARO)
        return [] if one is None else [one]
    for extra in (2, 3):
        table = builder.messages.first(f"BAR{extra}")
        if table is not None:
            tables.setdefault(extra - 1, table)
    every = [
        builder.column_stream(table, ("Alt",), "m", f"BARO:{unit}", limits.BARO)
        for unit, table in sorted(tables.items())
    ]
    return [stream for stream in every if stream is not None]


def rangefinder_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the distance (n, 1) in m of the downward rangefinder (RFND, else CTUN) within its range."""
    for name, distances in (("RFND", ("Dist", "Dist1")), ("CTUN", ("SAlt", "SonAlt"))):
        for table in builder.units(name).values():
            column = next((c for c in distances if c in table), None)
            if column is None or builder.clock.of_samples(table) is None:
                continue
            x = table.value(column).astype(np.float64)
            good = np.isfinite(x) & (x > 0)
            if "Stat" in table:
                good &= table["Stat"] == GOOD_RANGE_STATUS
            orientation = next((c for c in ("Orient", "Orient1") if c in table), None)
            if orientation is not None:
                good &= table[orientation] == DOWNWARD_ORIENTATION
            if np.count_nonzero(good) > 1:
                stamps, source = builder.stamps(table)[good], f"{name}.{column}"
                return builder.quiet().stream(stamps, x[good], "m", source, within=limits.RANGE)
    return None


def airspeed_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the true airspeed in m/s of the primary sensor while healthy and in use.

    ARSP logs equivalent airspeed; density follows from the barometer.
    """
    tables = builder.units("ARSP")
    primary = next((int(t["Pri"][-1]) for t in tables.values() if "Pri" in t and len(t)), 0)
    table = tables.get(primary, next(iter(tables.values()), None))
    if table is None or "Airspeed" not in table or builder.clock.of_samples(table) is None:
        return None
    t, x = builder.stamps(table), table.value("Airspeed").astype(np.float64)
    good = np.ones(len(t), bool)
    for flag in ("H", "U"):
        good &= table[flag] > 0 if flag in table else True
    baro = builder.units("BARO").get(0)
    if baro is not None and "Press" in baro and builder.clock.of_samples(baro) is not None:
        pressure = np.interp(t, builder.stamps(baro), baro.value("Press").astype(np.float64))
        relative = np.where(pressure > 0.0, pressure, SEA_LEVEL_PA) / SEA_LEVEL_PA
        x = x * relative ** (-0.5 * DENSITY_EXPONENT)
    return builder.stream(t[good], x[good], "m/s", "ARSP", within=limits.AIRSPEED)


# --- drive ------------------------------------------------------------------------------------------------------

# SERVOn_FUNCTION of motors 1 to 12.
MOTOR_FUNCTIONS = (*range(33, 41), *range(82, 86))
# Number of motor outputs, counted from the first, if SERVOn_FUNCTION is not logged.
MOTOR_COUNT = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8, "dodecarotor": 12}
# Least plausible range of pulses in us.
MIN_PULSE_RANGE_US = 100.0
# A median voltage above this is in units of 0.01 V.
MAX_VOLTS = 150.0
# Columns of set-points and measured rates in RATE, since 4.0 and before.
RATE_COLUMNS = ((("RDes", "PDes", "YDes"), ("R", "P", "Y")), (("RllDes", "PitDes", "YawDes"), ("Rll", "Pit", "Yaw")))


def throttle_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the throttle output 0 to 1; planes and rovers log percent, copters before 3.4 per mille."""
    for name in ("CTUN", "THR"):
        table = builder.sampled(name)
        column = None if table is None else next((c for c in ("ThO", "ThrOut") if c in table), None)
        if table is None or column is None:
            continue
        scale = 0.01 if builder.family in ("plane", "rover") else (1e-3 if column == "ThrOut" else 1.0)
        return builder.column_stream(
            table, (column,), "1", f"{name}.{column}", limits.THROTTLE, scale=scale, allow_nan=True
        )
    return None


def motor_outputs(builder: DataflashBuilder) -> Stream | None:
    """Return a multirotor's motor outputs (n, motors), 0 stopped to 1 full, from RCOU and its pulse limits."""
    table, values, vehicle = builder.sampled("RCOU"), builder.values, builder.log.vehicle
    if table is None or vehicle not in MOTOR_COUNT:
        return None
    numbers = [n for n in range(1, 17) if values.get(f"SERVO{n}_FUNCTION") in MOTOR_FUNCTIONS]
    numbers = numbers or list(range(1, MOTOR_COUNT[vehicle] + 1))
    prefix = next((p for p in ("C", "Ch", "Chan") if f"{p}{numbers[0]}" in table), None)
    throttle_channel = int(values.get("RCMAP_THROTTLE", 3))
    low = values.get("MOT_PWM_MIN") or values.get(f"RC{throttle_channel}_MIN")
    high = values.get("MOT_PWM_MAX") or values.get(f"RC{throttle_channel}_MAX")
    if prefix is None or not low or not high or high - low < MIN_PULSE_RANGE_US:
        return None
    names = [f"{prefix}{n}" for n in numbers if f"{prefix}{n}" in table]
    share = np.clip((columns(table, *names) - low) / (high - low), 0.0, 1.0)
    return builder.stream(builder.stamps(table), share, "1", "RCOU")


def rpm_stream(builder: DataflashBuilder) -> Stream | None:
    """Return rotor speeds (n, rotors) in rev/min: ESC telemetry by motor, else the RPM sensors."""
    messages = builder.messages
    motors = [t for t in (messages["ESC", i] for i in messages.instances("ESC")) if "RPM" in t and len(t) > 1]
    if motors:
        t = builder.stamps(motors[0])
        x = [np.interp(t, builder.stamps(m), m.value("RPM")) for m in motors]
        return builder.stream(t, np.column_stack(x), "rpm", "ESC", within=limits.RPM)
    table = messages.first("RPM")
    names = () if table is None else tuple(c for c in ("rpm1", "rpm2", "RPM1", "RPM2", "RPM") if c in table)
    return builder.column_stream(table, names, "rpm", "RPM", limits.RPM) if names else None


def battery_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the battery (n, 2), voltage in V and current in A; before 3.4 logged in hundredths."""
    for name in ("BAT", "CURR"):
        table = builder.sampled(name, "Volt", "Curr")
        if table is None:
            continue
        x = columns(table, "Volt", "Curr")
        volts = x[np.isfinite(x[:, 0]), 0]
        if table.fields["Volt"].dtype.kind in "iu" or (len(volts) and median(np.abs(volts)) > MAX_VOLTS):
            x = x * 0.01
        return builder.battery_stream(builder.stamps(table), x, name)
    return None


def loop_stream(builder: DataflashBuilder) -> Stream | None:
    """Return long main loops, all main loops and the longest in s (n, 3), from PM."""
    table = builder.sampled("PM", "NLon", "MaxT")
    total = None if table is None else next((name for name in ("NLoop", "NL") if name in table), None)
    if table is None or total is None:
        return None
    x = np.column_stack([np.asarray(table[name], np.float64) for name in ("NLon", total, "MaxT")]) * (1.0, 1.0, 1e-6)
    return builder.quiet().stream(builder.stamps(table), x, "1, 1, s", "PM")


def processor_load(builder: DataflashBuilder) -> Stream | None:
    """Return the processor's load (n, 1), 0 to 1, from PM; None where it is always 0, as in the simulator."""
    table = builder.sampled("PM", "Load")
    if table is None or not np.any(table["Load"]):
        return None
    load = np.asarray(table["Load"], np.float64) * 1e-3  # logged in per mille
    return builder.quiet().stream(builder.stamps(table), load, "1", "PM", within=limits.SHARE_IN_USE)


def rate_setpoint_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the body rate set-point in rad/s.

    RATE is in deg/s since 3.4 and in 0.01 deg/s before, under equal column names. The unit is found by comparing its
    measured rate with the gyro.
    """
    table, imu = builder.messages.first("RATE"), builder.log.replay_imu
    for commanded, measured in RATE_COLUMNS:
        if table is None or not all(c in table for c in (*commanded, *measured)):
            continue
        scale = np.pi / 180.0
        if imu is not None and are_hundredths(builder.seconds(builder.stamps(table)), columns(table, *measured), imu):
            scale *= 0.01
        return builder.column_stream(table, commanded, "rad/s", "RATE", limits.RATE_SETPOINT, scale=scale, frame="FRD")
    return None


def are_hundredths(t: Array, measured: Array, imu: Imu) -> bool:
    """Return whether measured rates (n, 3) read as deg/s are ten times those of the gyro."""
    gyro = np.column_stack([np.interp(t, imu.gyro.t, imu.gyro.x[:, k]) for k in range(3)])
    known = measured[np.isfinite(measured)]
    if len(known) == 0:
        return False
    spread = median(np.abs(np.radians(known))), median(np.abs(gyro))
    return bool(spread[0] > 10.0 * spread[1] and spread[1] > 0)


# --- vibration --------------------------------------------------------------------------------------------------

VIBE_COLUMNS = ("VibeX", "VibeY", "VibeZ")
# Most bursts read of each sensor, evenly spread (5 MB of memory).
MAX_BURSTS = 200
# Fewest samples of a truncated burst: shorter ones resolve no peak.
MIN_BURST_SAMPLES = 256
# Longest time from measurement to logging of a burst; beyond, the header's stamp replaces SampleUS.
MAX_BURST_DELAY_US = 10_000_000
# Bits of INS_LOG_BAT_OPT: filtered samples; raw and filtered samples, the latter with instances after the last IMU.
POST_FILTER_BIT, PRE_AND_POST_BIT = 2, 4
# Sensors by ISBH.type.
BURST_SENSORS: dict[int, Literal["gyro", "accelerometer"]] = {0: "accelerometer", 1: "gyro"}
HEADER_COLUMNS = ("N", "type", "instance", "mul", "SampleUS", "smp_rate")


def vibration_stream(builder: DataflashBuilder) -> Stream | None:
    """Return VIBE (n, 3) in m/s^2 of the replayed unit; before 4.1 there is one record for all units."""
    imu, tables = builder.log.replay_imu, builder.units("VIBE")
    table = tables.get(imu.index if imu is not None else 0, tables.get(0))
    return builder.column_stream(table, VIBE_COLUMNS, "m/s^2", "VIBE", limits.VIBRATION, frame="FRD")


def vibration_levels(builder: DataflashBuilder) -> list[OnboardVibration]:
    """Return the vibration level of every unit's worst axis; before 4.1 only of the primary one, as unit 0."""
    found = []
    own = builder.quiet()  # problems are reported by vibration_stream
    for unit, table in builder.units("VIBE").items():
        source = f"VIBE:{unit}" if "IMU" in table else "VIBE"
        stream = own.column_stream(table, VIBE_COLUMNS, "m/s^2", source, limits.VIBRATION)
        if stream is not None:
            found.append(OnboardVibration(unit, "rest", source, stream.t, stream.x.max(axis=1)))
    return found


def clippings(builder: DataflashBuilder) -> list[Clipping]:
    """Return the clipped samples of every unit, counted between records."""
    found, have = [], set(builder.units("IMU"))
    for instance, table in builder.units("VIBE").items():
        if len(table) < 2:
            continue
        named = [(instance, "Clip")] if "Clip" in table else [(k, f"Clip{k}") for k in range(3)]
        for unit, column in named:
            if column in table and (column == "Clip" or unit in have):
                source = f"VIBE:{unit}.Clip" if column == "Clip" else f"VIBE.{column}"
                found.append(builder.clipping("accelerometer", unit, source, table, column))
    return found


def read_bursts(builder: DataflashBuilder) -> list[Burst]:
    """Read the batches of raw sensor samples, at most MAX_BURSTS of each sensor, in file order."""
    heads, data = builder.messages.first("ISBH"), builder.messages.first("ISBD")
    if (
        heads is None
        or data is None
        or not all(c in heads for c in HEADER_COLUMNS)
        or not all(c in data for c in "xyz")
    ):
        return []
    number = heads["N"].astype(np.int64)
    of_head = np.searchsorted(heads.offsets, data.offsets) - 1
    mine = (of_head >= 0) & (data["N"].astype(np.int64) == number[np.maximum(of_head, 0)])
    rows = np.flatnonzero(mine)
    begin = np.searchsorted(of_head[rows], np.arange(len(heads)))
    end = np.searchsorted(of_head[rows], np.arange(len(heads)), side="right")
    imus, options = max(len(builder.units("IMU")), 1), int(builder.values.get("INS_LOG_BAT_OPT", 0.0))
    found = []
    for k in _chosen_headers(heads):
        unit, filtered = int(heads["instance"][k]), bool(options & POST_FILTER_BIT)
        if options & PRE_AND_POST_BIT and unit >= imus:
            unit, filtered = unit - imus, True
        one = _read_burst(builder, heads, int(k), data.rows(rows[begin[k] : end[k]]), unit, filtered)
        found += [] if one is None else [one]
    return found


def _chosen_headers(heads: Table) -> NDArray[np.int64]:
    """Return the indices of the headers to read, evenly spread over each sensor's."""
    kind = heads["type"].astype(np.int64) * 256 + heads["instance"].astype(np.int64)
    kept = []
    for one in unique(kind):
        k = np.flatnonzero(kind == one)
        kept.append(k[unique(np.linspace(0, len(k) - 1, MAX_BURSTS).round().astype(np.int64))])
    return np.sort(np.concatenate(kept)) if kept else np.zeros(0, np.int64)


def _read_burst(
    builder: DataflashBuilder, heads: Table, k: int, data: Table, unit: int, filtered: bool
) -> Burst | None:
    """Read a burst up to its first missing record, None if too short or its header is damaged."""
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
