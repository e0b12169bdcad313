"""ArduPilot DataFlash logs (binary and text) as a FlightLog, from 3.1 to 4.7.

Records are told apart by their columns: early logs have no version, and branches
carry any.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from attlog.core.timestamps import Stamps
from attlog.flight import compass, limits, parameters, remedies
from attlog.flight import imu as inertial
from attlog.flight.advice import ArduPilotLogging
from attlog.flight.ardupilot import estimator, sensors, vehicle
from attlog.flight.ardupilot import imu as imus
from attlog.flight.ardupilot.imu import RecordClock, own_time, unit_tables
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration import MILLIGAUSS, compass_device
from attlog.flight.model import Array, Firmware, FlightLog, Imu, Mag, Stream
from attlog.flight.px4.reader import utc_offset
from attlog.flight.timestamps import valid_stamp
from attlog.formats.table import Messages

# Everything of an ArduPilot log that is neither inertial, magnetic nor an attitude, put into its FlightLog.

DECLINATION_PARAMETERS = {"COMPASS_DEC": math.degrees(1.0)}
"""The parameter of the declination and its factor to degrees."""
TRIM_PARAMETERS = ("AHRS_TRIM_X", "AHRS_TRIM_Y")


def read_trim(log: FlightLog) -> Array | None:
    """AHRS_TRIM as a rotation vector (3,) in rad; None where the log does not hold it."""
    x, y = (log.param(name) for name in TRIM_PARAMETERS)
    if x is None or y is None or not (math.isfinite(x) and math.isfinite(y)):
        return None
    return np.array([x, y, 0.0])


def fill_streams(builder: LogBuilder, clock: RecordClock, log: FlightLog, values: dict[str, float]) -> None:
    """Add states, aids and texts to the log."""
    messages = builder.messages
    family = builder.attempt("The vehicle", lambda: vehicle.detect_family(messages, values), "")
    imu = None if log.imu is None else log.imus[log.imu]
    log.vehicle = builder.attempt("The vehicle", lambda: vehicle.vehicle_type(messages, values, family), "unknown")
    log.simulated = "SIM" in messages.names() or any(n.startswith("SIM_") for n in values)
    log.state.armed = builder.attempt("Arming", lambda: vehicle.armed_line(builder, clock), None)
    log.state.landed = builder.attempt("Landing", lambda: vehicle.landed_line(builder, clock, log.state.armed), None)
    log.state.mode = builder.attempt("The flight mode", lambda: vehicle.mode_line(builder, clock, family), None)
    log.setpoints.rates = builder.attempt("The rate set-point", lambda: rate_setpoint_stream(builder, clock, imu), None)
    for unit, table in unit_tables(messages, "GPS").items():
        one = builder.attempt("GPS", partial(sensors.read_receiver, builder, clock, unit, table), None)
        log.gnss += [] if one is None else [one]
    if not log.gnss:
        log.gnss = builder.attempt("RGPJ", lambda: sensors.replay_receivers(builder), [])
    log.utc_offset = builder.attempt("The date", lambda: utc_offset(log.gnss), None)
    log.baro = builder.attempt("BARO", lambda: baro_streams(builder, clock), [])
    log.rangefinder = builder.attempt("The rangefinder", lambda: rangefinder_stream(builder, clock), None)
    log.airspeed = builder.attempt("ARSP", lambda: airspeed_stream(builder, clock), None)
    log.power.throttle = builder.attempt("Throttle", lambda: sensors.throttle_stream(builder, clock, family), None)
    log.power.motors = builder.attempt(
        "Motor outputs", lambda: sensors.motor_outputs(builder, clock, log.vehicle, values), None
    )
    log.power.rpm = builder.attempt("Rotor speed", lambda: sensors.rpm_stream(builder, clock), None)
    log.power.battery = builder.attempt("The battery", lambda: sensors.battery_stream(builder, clock), None)
    log.estimator.acc_bias = builder.attempt("XKF2", lambda: acc_bias_stream(builder, clock), None)
    log.estimator.gyro_bias = builder.attempt(
        "The onboard gyro bias", lambda: estimator.gyro_bias_stream(builder, clock, values, imu), None
    )
    log.vibration.level = builder.attempt("VIBE", lambda: sensors.vibration_stream(builder, clock, imu), None)
    log.vibration.levels = builder.attempt("VIBE", lambda: sensors.vibration_levels(builder, clock), [])
    log.vibration.bursts = builder.attempt("ISBH and ISBD", lambda: sensors.read_bursts(builder, values), [])
    log.estimator.yaw = builder.attempt(
        "The yaw estimator", lambda: estimator.yaw_estimator_stream(builder, clock, values), None
    )
    log.vibration.clippings = builder.attempt("Clipping", lambda: sensors.clippings(builder, clock), [])
    log.estimator.innovation_tests = builder.attempt(
        "Test ratios", lambda: estimator.innovation_tests(builder, clock, values), []
    )
    log.estimator.lane = builder.attempt(
        "The EKF's core", lambda: estimator.primary_core_line(builder, clock, values), None
    )
    builder.attempt("ERR and EV", lambda: vehicle.report_events(builder, clock), None)
    compass = 0 if log.mag is None else log.mags[log.mag].index
    log.remedies = builder.attempt("Remedies", lambda: remedies.ardupilot_remedies(values, compass), log.remedies)
    log.compass_switches = remedies.compass_switches(values)
    log.compass_first = remedies.compass_first(values)
    log.texts = builder.attempt("Texts", lambda: builder.texts(lambda offset: int(clock.at(np.array([offset]))[0])), [])


def rate_setpoint_stream(builder: LogBuilder, clock: RecordClock, imu: Imu | None) -> Stream | None:
    """The body rate set-point in rad/s.

    RATE holds deg/s since 3.4 and hundredths of it before, in columns of the same
    name: the measured rate beside the set-point, against the gyro, tells which.
    """
    table = builder.messages.first("RATE")
    if table is None:
        return None
    for wanted, measured in (
        (("RDes", "PDes", "YDes"), ("R", "P", "Y")),
        (("RllDes", "PitDes", "YawDes"), ("Rll", "Pit", "Yaw")),
    ):
        if not all(c in table for c in (*wanted, *measured)):
            continue
        t = clock.of(table)
        scale = np.pi / 180.0
        if imu is not None and hundredths(builder.seconds(t), columns(table, *measured), imu):
            scale *= 0.01
        return builder.stream(
            t, columns(table, *wanted) * scale, "rad/s", "RATE", frame="FRD", within=limits.RATE_SETPOINT
        )
    return None


def hundredths(t: Array, measured: Array, imu: Imu) -> bool:
    """Whether measured rates (n, 3) fit the gyro better as 0.01 deg/s than as deg/s."""
    gyro = np.column_stack([np.interp(t, imu.gyro.t, imu.gyro.x[:, k]) for k in range(3)])
    known = measured[np.isfinite(measured)]
    if len(known) == 0:
        return False
    spread = np.median(np.abs(np.radians(known))), np.median(np.abs(gyro))
    return bool(spread[0] > 10.0 * spread[1] and spread[1] > 0)


def baro_streams(builder: LogBuilder, clock: RecordClock) -> list[Stream]:
    """Barometric altitude in m above the take-off pressure: BARO.Alt, in 3.2 and older CTUN.BarAlt."""
    tables = unit_tables(builder.messages, "BARO")
    control = builder.messages.first("CTUN")
    if not tables and control is not None and "BarAlt" in control and (t := clock.of_samples(control)) is not None:
        one = builder.stream(t, control.value("BarAlt"), "m", "CTUN.BarAlt", within=limits.BARO)
        return [] if one is None else [one]
    for extra in (2, 3):
        table = builder.messages.first(f"BAR{extra}")
        if table is not None:
            tables.setdefault(extra - 1, table)
    found = [
        builder.stream(clock.of(t), t.value("Alt"), "m", f"BARO:{unit}", within=limits.BARO)
        for unit, t in sorted(tables.items())
        if "Alt" in t
    ]
    return [f for f in found if f is not None]


DOWNWARD_ORIENTATION, GOOD_RANGE_STATUS = 25, 4
"""RFND.Orient of a rangefinder that looks at the ground, RFND.Stat of a reading within its range."""


def rangefinder_stream(builder: LogBuilder, clock: RecordClock) -> Stream | None:
    """Distance (n, 1) in m of the downward rangefinder (RFND, else CTUN), readings out of range left out."""
    for name, columns_of in (("RFND", ("Dist", "Dist1")), ("CTUN", ("SAlt", "SonAlt"))):
        for table in unit_tables(builder.messages, name).values():
            column = next((c for c in columns_of if c in table), None)
            if column is None or clock.of_samples(table) is None:
                continue
            x = table.value(column).astype(np.float64)
            good = np.isfinite(x) & (x > 0)
            if "Stat" in table:
                good &= table["Stat"] == GOOD_RANGE_STATUS
            orient = next((c for c in ("Orient", "Orient1") if c in table), None)
            if orient is not None:
                good &= table[orient] == DOWNWARD_ORIENTATION
            if np.count_nonzero(good) > 1:
                own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # nothing to report of what only tells flight
                return own.stream(clock.of(table)[good], x[good], "m", f"{name}.{column}", within=limits.RANGE)
    return None


SEA_LEVEL_PA, DENSITY_EXPONENT = 101_325.0, 0.81
"""Standard atmosphere: pressure at sea level, and (density) = (pressure)^0.81, both relative to sea level."""


def airspeed_stream(builder: LogBuilder, clock: RecordClock) -> Stream | None:
    """True airspeed in m/s of the primary sensor while it is sound and in use; ARSP tells the equivalent one."""
    tables = unit_tables(builder.messages, "ARSP")
    primary = next((int(t["Pri"][-1]) for t in tables.values() if "Pri" in t and len(t)), 0)
    table = tables.get(primary, next(iter(tables.values()), None))
    if table is None or "Airspeed" not in table or clock.of_samples(table) is None:
        return None
    t, x = clock.of(table), table.value("Airspeed").astype(np.float64)
    good = np.ones(len(t), bool)
    for flag in ("H", "U"):
        good &= table[flag] > 0 if flag in table else True
    baro = unit_tables(builder.messages, "BARO").get(0)
    if baro is not None and "Press" in baro and clock.of_samples(baro) is not None:
        pressure = np.interp(t, clock.of(baro), baro.value("Press").astype(np.float64))
        thin = np.where(pressure > 0.0, pressure, SEA_LEVEL_PA) / SEA_LEVEL_PA
        x = x * thin ** (-0.5 * DENSITY_EXPONENT)
    return builder.stream(t[good], x[good], "m/s", "ARSP", within=limits.AIRSPEED)


def acc_bias_stream(builder: LogBuilder, clock: RecordClock) -> Stream | None:
    """Accelerometer bias (n, 3) in m/s^2 of EKF3's primary core (XKF2 of XKF4.PI; the first where that is unknown)."""
    status = builder.messages.first("XKF4")
    core = int(np.median(status["PI"])) if status is not None and "PI" in status and len(status) else 0
    table = unit_tables(builder.messages, "XKF2").get(core)
    if table is None or not all(c in table for c in ("AX", "AY", "AZ")):
        return None
    return builder.stream(
        clock.of(table), columns(table, "AX", "AY", "AZ"), "m/s^2", "XKF2", frame="FRD", within=limits.ACC_BIAS
    )


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """The flight in an ArduPilot log; ``imu`` and ``mag`` ask for a unit instead of the one that flew."""
    builder = LogBuilder(messages)
    clock = RecordClock(messages)
    values = parameters.boot_values(messages.params)
    _report_clock(builder, clock)
    chosen = inertial.best_per_unit(builder, imus.imu_candidates(builder, clock, messages.params))
    core = _core_that_flew(builder, clock, values, [c.index for c in chosen])
    flew = builder.attempt("The primary EKF core", lambda: inertial.longest_held(core.t_us, core.units), None)
    why = f"it fed the primary EKF core ({core.family}F4.PI)"
    if flew is None and chosen:
        flew, why = chosen[0].index, "the first; the log does not say which is primary"
    firmware = builder.attempt("The firmware", lambda: vehicle.read_firmware(messages), Firmware("ArduPilot"))
    family_of_vehicle = builder.attempt("The vehicle", lambda: vehicle.detect_family(messages, values), "")
    logging = ArduPilotLogging(family_of_vehicle, firmware.version, values)
    position = inertial.choose_imu(builder, chosen, flew, why, imu, logging)
    begin = builder.attempt("The first time stamp", lambda: first_stamp(builder, clock, chosen, position), 0)
    builder.t0_us = valid_stamp(begin)

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware, "")
    log.logging = logging
    log.imus = [inertial.build_imu(builder, c) for c in chosen]
    log.imu = position
    log.imu_that_flew = builder.attempt(
        "The primary EKF core", lambda: builder.time_line(core.t_us, core.units, f"{core.family}F4.PI"), None
    )
    flying = None if position is None else log.imus[position]
    log.mags = builder.attempt("MAG", lambda: magnetometers(builder, clock, values), [])
    log.mag = builder.attempt(
        "The compass",
        lambda: compass.choose_mag(
            builder, log.mags, flying, primary_compass(values, log.mags), "the primary compass", mag, logging
        ),
        None,
    )
    _fill_attitudes(log, builder, clock, core)
    log.parameters.lines = builder.attempt(
        "PARM", lambda: parameters.parameter_lines(builder, messages.params, "PARM"), {}
    )
    log.parameters.defaults = parameters.logged_defaults(messages.params)
    log.parameters.declination, log.parameters.declination_source = parameters.declination(log, DECLINATION_PARAMETERS)
    log.parameters.trim, log.parameters.trim_source = read_trim(log), ", ".join(TRIM_PARAMETERS)
    fill_streams(builder, clock, log, values)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def _report_clock(builder: LogBuilder, clock: RecordClock) -> None:
    """What early logs lack: a time in any record, or in any but those of GPS."""
    if not clock.known:
        builder.problem(
            "no_clock",
            "error",
            "No record of this log carries a time stamp, as in ArduPilot 3.0 and older: nothing in it can be replayed.",
        )
    elif clock.interpolates:
        builder.problem(
            "clock_between_gps",
            "note",
            "Only GPS records carry a time, as in ArduPilot 3.1 and older: others are placed between them, to 0.2 s.",
        )


@dataclass(frozen=True, slots=True)
class PrimaryCore:
    """The EKF cores that flew: ``family`` of their messages (XK, NK), ``lanes`` from ``t_us`` (n,) on, and the
    ``units`` of the IMU that each runs on."""

    family: str
    t_us: Stamps
    lanes: list[int]
    units: list[int]


def _core_that_flew(builder: LogBuilder, clock: RecordClock, values: dict[str, float], have: list[int]) -> PrimaryCore:
    """The primary core over time, in a log that has the IMU units ``have``."""
    ekf = values.get("AHRS_EKF_TYPE")
    nothing: tuple[str, Stamps, list[int]] = ("", np.zeros(0, np.int64), [])
    family, t_us, lanes = builder.attempt(
        "The primary EKF core", lambda: imus.primary_core(builder.messages, clock, ekf), nothing
    )
    mask = values.get("EK3_IMU_MASK" if family == "XK" else "EK2_IMU_MASK")
    unit = {core: imus.unit_of_core(core, mask, have) for core in set(lanes)}
    return PrimaryCore(family, t_us, lanes, [unit[core] for core in lanes])


def _fill_attitudes(log: FlightLog, builder: LogBuilder, clock: RecordClock, core: PrimaryCore) -> None:
    """The attitudes of the log, the one that flew among them, the truth and the set-points."""
    resets = builder.attempt("Resets", lambda: estimator.reset_times(builder, clock, core.t_us, core.lanes), [])
    log.attitudes = estimator.attitudes(builder, clock, resets)
    log.onboard = estimator.onboard_source(log.attitudes, core.family, core.lanes[-1] if core.lanes else None)
    if log.onboard == "ANG":
        builder.choices["onboard"] = "ANG holds the values of ATT at loop rate"
    elif log.onboard not in (None, "ATT"):
        builder.choices["onboard"] = "the log holds neither ATT nor ANG"
    log.truth = builder.attempt("SIM", lambda: estimator.simulated_attitude(builder, clock), None)
    log.poses = builder.attempt("VISP", lambda: estimator.vision_poses(builder, clock), {})
    log.setpoints.attitude = builder.attempt(
        "Set-points", lambda: estimator.attitude_setpoint(builder, clock, log.onboard), None
    )


def first_stamp(
    builder: LogBuilder, clock: RecordClock, chosen: list[inertial.ImuCandidate], position: int | None
) -> int:
    """The boot time in us that becomes t = 0: the replayed IMU's first sample, else the first sample of anything."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    for name in ("ATT", "AHR2", "GPS", "CTUN"):
        table = builder.messages.first(name)
        own = None if table is None else clock.of_samples(table)
        if own is not None and len(own):
            return int(np.median(own[:5]))
    return 0


def magnetometers(builder: LogBuilder, clock: RecordClock, values: dict[str, float]) -> list[Mag]:
    """Every compass: MAG, offsets and motor compensation already applied by the firmware (mGa, body frame)."""
    found = []
    for unit, table in unit_tables(builder.messages, "MAG").items():
        if "MagX" not in table or own_time(table) is None:
            continue
        t = clock.of(table)
        field = columns(table, "MagX", "MagY", "MagZ")
        source = imus.source_name(table, unit)
        offsets = columns(table, "OfsX", "OfsY", "OfsZ") if "OfsX" in table else None
        if offsets is not None and shows_only_offsets(field, offsets):
            builder.problem(
                "mag_only_offsets",
                "warning",
                f"{source}: every value equals the compass offsets, so the compass itself measures nothing; "
                "it is not used.",
            )
            field = np.zeros_like(field)
        sampled = t - (t - table["S"].astype(np.int64)) % 2**32 if "S" in table else None  # S: us, 32 bits
        use = values.get("COMPASS_USE" + ("" if unit == 0 else str(unit + 1)), 1.0)
        device = compass_device(values, unit)
        mag = compass.build_mag(
            builder, unit, t, field * MILLIGAUSS, source, t_sample_us=sampled, device=device, enabled=use != 0
        )
        if mag is not None:
            mag.offsets = None if offsets is None else applied_offsets(builder, t, offsets * MILLIGAUSS, source)
            found.append(mag)
    return found or replay_magnetometers(builder)


def applied_offsets(builder: LogBuilder, t_us: Stamps, offsets_t: np.ndarray, source: str) -> Stream | None:
    """The offsets (k, 3) in tesla that the records name, at the first of them and at each change."""
    new = np.concatenate([[True], np.diff(offsets_t, axis=0).any(axis=1)]) if len(t_us) else np.zeros(0, bool)
    return LogBuilder(builder.messages, t0_us=builder.t0_us).stream(t_us[new], offsets_t[new], "T", source)


def replay_magnetometers(builder: LogBuilder) -> list[Mag]:
    """Compasses as LOG_REPLAY gave them to the EKF (RMGI, mGa, body frame), at their own 32-bit microseconds."""
    found = []
    frames = builder.messages.first("RFRH")
    for unit, table in unit_tables(builder.messages, "RMGI").items():
        if frames is None or "FX" not in table or "LU" not in table:
            continue
        t = imus.replay_frame_stamps(frames, table)
        updated = t - (t - table["LU"].astype(np.int64)) % 2**32
        field = columns(table, "FX", "FY", "FZ") * MILLIGAUSS
        new = np.concatenate([[True], np.diff(updated) != 0]) if len(t) else np.zeros(0, bool)
        use = bool("UFY" not in table or (table["UFY"] != 0).any())
        mag = compass.build_mag(builder, unit, updated[new], field[new], f"RMGI:{unit}", enabled=use)
        found += [mag] if mag is not None else []
    return found


def shows_only_offsets(field: np.ndarray, offsets: np.ndarray) -> bool:
    """Whether a compass shows nothing but its own offsets: a raw field of zero that never changes."""
    measured = field.any(axis=1)
    if not measured.any() or not offsets.any():
        return False
    return bool((np.abs(field - offsets)[measured] <= 1.0).all())


def primary_compass(values: dict[str, float], mags: list[Mag]) -> int | None:
    """Index of the compass that the firmware prefers: COMPASS_PRIMARY before 4.1, the first (by priority) since."""
    primary = values.get("COMPASS_PRIMARY")
    if primary is not None:
        return int(primary)
    return mags[0].index if mags else None
