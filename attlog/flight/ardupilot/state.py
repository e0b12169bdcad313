"""Everything of an ArduPilot log that is neither inertial, magnetic nor an attitude."""

from __future__ import annotations

import math
import re
from functools import partial

import numpy as np

from attlog.flight import physics, receiver
from attlog.flight.ardupilot import events, gyro_bias, remedies
from attlog.flight.ardupilot.clock import Clock, own_time
from attlog.flight.ardupilot.imus import units
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, Firmware, FlightLog, Gnss, Imu, Stream, TimeLine
from attlog.flight.modes import ardupilot_mode
from attlog.flight.px4.state import utc_offset
from attlog.flight.timing import stamps_of
from attlog.flight.utc import gps_time_us
from attlog.formats.base import Messages, Table

BANNER = re.compile(
    r"(?:APM:|Ardu|APM|Antenna|\b)(Copter|Plane|Rover|rover2?|Sub|Tracker|Blimp)\s+"
    r"[Vv]?(\d[\w.\-]*)(?:\s*\(([0-9a-fA-F]+)\))?"
)
BOARD = re.compile(r"^(\S+) [0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}$")
DECLINATION = {"COMPASS_DEC": math.degrees(1.0)}
"""The parameter of the declination and its factor to degrees."""
TRIM = ("AHRS_TRIM_X", "AHRS_TRIM_Y")
FRAMES = {
    1: "quadrotor", 2: "hexarotor", 3: "octorotor", 4: "octorotor", 5: "hexarotor", 6: "helicopter", 7: "tricopter",
    8: "single rotor", 9: "coaxial helicopter", 11: "helicopter", 12: "dodecarotor", 13: "helicopter",
}  # fmt: skip
"""FRAME_CLASS of Copter."""
ARMED, DISARMED, LANDED, NOT_LANDED = 10, 11, 18, 28
"""Event ids of EV records (ArduPilot AP_Logger LogEvent). 17, LAND_COMPLETE_MAYBE, comes in flight: it lands nobody."""
MOTOR_FUNCTIONS = (*range(33, 41), *range(82, 86))
"""SERVOn_FUNCTION of motors 1 to 12."""
MOTORS = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8, "dodecarotor": 12}
"""How many of the first outputs are motors where no parameter tells."""
SOFTWARE = {0: "plane", 10: "copter", 20: "rover", 40: "sub"}
"""SYSID_SW_TYPE."""
FAMILY_RECORDS = (("copter", ("MOTB", "PSCD", "PSC")), ("plane", ("AETR", "TECS", "LAND")), ("rover", ("STER", "THR")))


def banner(messages: Messages) -> tuple[str, str, str]:
    """(family, version, git hash) from the firmware's message, empty strings where there is none."""
    texts = [t.text for t in messages.texts]
    texts += [str(v) for v in messages.info.values() if isinstance(v, str)]
    own = messages.info.get("VER")
    if isinstance(own, dict):
        texts.insert(0, str(own.get("FWS", "")))
    for line in messages.info.get("banner", ()) or ():
        texts.append(str(line))
    matches = [m for m in map(BANNER.search, texts) if m]
    if not matches:
        return "", "", ""
    best = next((m for m in matches if m[3]), matches[0])  # the one with a hash is the firmware's own
    family = best[1].lower()
    return ("rover" if family.startswith("rover") else family), best[2], best[3] or ""


def firmware(messages: Messages) -> Firmware:
    """Who wrote the log, as far as it tells; the version starts with the vehicle (``Copter 4.6.2``)."""
    family, version, git = banner(messages)
    board = next((m[1] for t in messages.texts if (m := BOARD.match(t.text.strip()))), "")
    return Firmware("ArduPilot", f"{family.capitalize()} {version}".strip(), git, board)


def family_of(messages: Messages, values: dict[str, float]) -> str:
    """The firmware family (copter, plane, rover, sub), empty if unknown: by message, parameters or records."""
    family = banner(messages)[0]
    if family:
        return family
    if values.get("SYSID_SW_TYPE") in SOFTWARE:
        return SOFTWARE[int(values["SYSID_SW_TYPE"])]
    names = set(messages.names())
    for known, records in FAMILY_RECORDS:
        if names & set(records):
            return known
    control = messages.first("CTUN")
    if control is not None and any(c in control for c in ("AngBst", "ABst", "ThrIn")):
        return "copter"
    return ""


def vehicle(messages: Messages, values: dict[str, float], family: str) -> str:
    """The kind of vehicle in words."""
    if family == "plane":
        return "VTOL" if values.get("Q_ENABLE", 0) > 0 else "fixed wing"
    if family == "rover":
        return "boat" if values.get("FRAME_CLASS") == 2 else "rover"
    if family == "sub":
        return "submarine"
    if family == "copter":
        if int(values.get("FRAME_CLASS", 0)) in FRAMES:
            return FRAMES[int(values["FRAME_CLASS"])]
        for text in messages.texts:
            match = re.search(r"[Ff]rame: (\w+)", text.text)
            for word, name in (("QUAD", "quadrotor"), ("HEXA", "hexarotor"), ("OCTA", "octorotor"), ("Y6", "hexarotor"),
                               ("TRI", "tricopter"), ("HELI", "helicopter")):  # fmt: skip
                if match and match[1].upper().startswith(word):
                    return name
        return "helicopter" if any(n.startswith("H_SV") for n in values) else "multirotor"
    return family or "unknown"


def trim(log: FlightLog) -> Array | None:
    """AHRS_TRIM as a rotation vector (3,) in rad; None where the log does not hold it."""
    x, y = (log.param(name) for name in TRIM)
    if x is None or y is None or not (math.isfinite(x) and math.isfinite(y)):
        return None
    return np.array([x, y, 0.0])


def fill(builder: LogBuilder, clock: Clock, log: FlightLog, values: dict[str, float]) -> None:
    """Add states, aids and texts to the log."""
    messages = builder.messages
    family = builder.attempt("The vehicle", lambda: family_of(messages, values), "")
    imu = None if log.imu is None else log.imus[log.imu]
    log.vehicle = builder.attempt("The vehicle", lambda: vehicle(messages, values, family), "unknown")
    log.simulated = "SIM" in messages.names() or any(n.startswith("SIM_") for n in values)
    log.armed = builder.attempt("Arming", lambda: armed(builder, clock), None)
    log.landed = builder.attempt("Landing", lambda: landed(builder, clock, log.armed), None)
    log.mode = builder.attempt("The flight mode", lambda: mode(builder, clock, family), None)
    log.rate_setpoints = builder.attempt("The rate set-point", lambda: rate_setpoints(builder, clock, imu), None)
    for unit, table in units(messages, "GPS").items():
        one = builder.attempt("GPS", partial(one_receiver, builder, clock, unit, table), None)
        log.gnss += [] if one is None else [one]
    if not log.gnss:
        log.gnss = builder.attempt("RGPJ", lambda: replay_receivers(builder), [])
    log.utc_offset = builder.attempt("The date", lambda: utc_offset(log.gnss), None)
    log.baro = builder.attempt("BARO", lambda: baro(builder, clock), [])
    log.airspeed = builder.attempt("ARSP", lambda: airspeed(builder, clock), None)
    log.throttle = builder.attempt("Throttle", lambda: throttle(builder, clock, family), None)
    log.motors = builder.attempt("Motor outputs", lambda: motors(builder, clock, log.vehicle, values), None)
    log.rpm = builder.attempt("Rotor speed", lambda: rpm(builder, clock), None)
    log.battery = builder.attempt("The battery", lambda: battery(builder, clock), None)
    log.acc_bias = builder.attempt("XKF2", lambda: acc_bias(builder, clock), None)
    log.onboard_gyro_bias = builder.attempt(
        "The onboard gyro bias", lambda: gyro_bias.gyro_bias(builder, clock, values, imu), None
    )
    log.onboard_vibration = builder.attempt("VIBE", lambda: vibration(builder, clock, imu), None)
    builder.attempt("ERR and EV", lambda: events.report(builder, clock), None)
    log.remedies = builder.attempt("Remedies", lambda: remedies.of(values), log.remedies)
    log.texts = builder.attempt("Texts", lambda: builder.texts(lambda offset: int(clock.at(np.array([offset]))[0])), [])


# --- state ------------------------------------------------------------------------------------------------------


def armed(builder: LogBuilder, clock: Clock) -> TimeLine | None:
    """Armed or not: ARM records (4.x), events 10 and 11, or STAT of planes."""
    messages = builder.messages
    arm = messages.first("ARM")
    if arm is not None and "ArmState" in arm:
        return with_start(builder, clock.of(arm), (arm["ArmState"] != 0).tolist(), "ARM")
    events = messages.first("EV")
    if events is not None and "Id" in events:
        ids = events["Id"].astype(np.int64)
        mine = (ids == ARMED) | (ids == DISARMED)
        if mine.any():
            return with_start(builder, clock.of(events)[mine], (ids[mine] == ARMED).tolist(), "EV")
    status = messages.first("STAT")
    if status is not None and "Armed" in status:
        return builder.time_line(clock.of(status), (status["Armed"] != 0).tolist(), "STAT")
    return None


def with_start(builder: LogBuilder, t_us: np.ndarray, values: list[bool], source: str) -> TimeLine | None:
    """A time line of events; before the first one the opposite held, from the log's first sample on."""
    line = builder.time_line(t_us, values, source)
    if line is not None and line.t[0] > 0:
        line.t = np.concatenate([[0.0], line.t])
        line.value = [not line.value[0], *line.value]
    return line


def landed(builder: LogBuilder, clock: Clock, arming: TimeLine | None) -> TimeLine | None:
    """On the ground or not: copter events 18 and 28, or STAT.isFlying of planes.

    Before the first event a disarmed vehicle stands on the ground.
    """
    messages = builder.messages
    events = messages.first("EV")
    if events is not None and "Id" in events:
        ids = events["Id"].astype(np.int64)
        mine = np.isin(ids, (LANDED, NOT_LANDED))
        if mine.any():
            line = with_start(builder, clock.of(events)[mine], (ids[mine] != NOT_LANDED).tolist(), "EV")
            if line is not None and arming is not None and not arming.at(float(line.t[0])) and not line.value[0]:
                line.value[0] = True
            return line
    status = messages.first("STAT")
    if status is not None and "isFlying" in status:
        return builder.time_line(clock.of(status), (status["isFlying"] == 0).tolist(), "STAT")
    return None


def mode(builder: LogBuilder, clock: Clock, family: str) -> TimeLine | None:
    """Flight modes by name; text logs hold the name, binary ones a number whose meaning depends on the family."""
    table = builder.messages.first("MODE")
    if table is None or "Mode" not in table:
        return None
    if table["Mode"].dtype.kind in "SU":
        names = [x.decode("latin-1") if isinstance(x, bytes) else str(x) for x in table["Mode"].tolist()]
        names = [
            ardupilot_mode(family, int(n)) if n.strip().isdigit() else n.strip().upper().replace(" ", "_")
            for n in names
        ]
    else:
        names = [ardupilot_mode(family, int(n)) for n in table["Mode"].tolist()]
    return builder.time_line(clock.of(table), names, "MODE")


def rate_setpoints(builder: LogBuilder, clock: Clock, imu: Imu | None) -> Stream | None:
    """The body rate set-point in rad/s.

    RATE holds deg/s since 3.4 and hundredths of it before, in columns of the same
    name: the measured rate beside the set-point, against the gyro, tells which.
    """
    table = builder.messages.first("RATE")
    if table is None:
        return None
    for wanted, measured in ((("RDes", "PDes", "YDes"), ("R", "P", "Y")),
                             (("RllDes", "PitDes", "YawDes"), ("Rll", "Pit", "Yaw"))):  # fmt: skip
        if not all(c in table for c in (*wanted, *measured)):
            continue
        t = clock.of(table)
        scale = np.pi / 180.0
        if imu is not None and hundredths(builder.seconds(t), columns(table, *measured), imu):
            scale *= 0.01
        return builder.stream(
            t, columns(table, *wanted) * scale, "rad/s", "RATE", frame="FRD", within=physics.RATE_SETPOINT
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


# --- aids -------------------------------------------------------------------------------------------------------


def one_receiver(builder: LogBuilder, clock: Clock, unit: int, table: Table) -> Gnss | None:
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
    h_acc, v_acc, s_acc = (accuracy(builder, clock, unit, t_us, c) for c in ("HAcc", "VAcc", "SAcc"))
    yaw = np.radians(table.value("Yaw")) if "Yaw" in table else None
    if yaw is not None:
        yaw = np.where(yaw == 0.0, np.nan, (yaw + np.pi) % (2 * np.pi) - np.pi)  # 0: the receiver has no heading
    return receiver.build(
        builder, unit, t_us, source, place=place, velocity=velocity, fix=table["Status"].astype(np.int64),
        accuracy=(h_acc, v_acc, s_acc), yaw=yaw, utc_us=utc_us(table),
    )  # fmt: skip


def replay_receivers(builder: LogBuilder) -> list[Gnss]:
    """Receivers as LOG_REPLAY gave them to the EKF (RGPJ): 1e-7 deg, cm, m/s NED, boot time in ms."""
    found = []
    for unit, table in units(builder.messages, "RGPJ").items():
        t_us = stamps_of(table, "TS", 1000)
        place = columns(table, "Lat", "Lon", "Alt") * [1e-7, 1e-7, 1e-2]
        new = np.concatenate([[True], np.diff(t_us) != 0]) if len(t_us) else np.zeros(0, bool)
        told = new & (place[:, :2] != 0).any(axis=1)
        one = receiver.build(
            builder, unit, t_us[told], f"RGPJ:{unit}", place=place[told],
            velocity=columns(table, "VX", "VY", "VZ")[told], fix=np.full(int(told.sum()), 3),
            accuracy=(table.value("HA")[told], table.value("VA")[told], table.value("SA")[told]),
        )  # fmt: skip
        found += [] if one is None else [one]
    return found


def accuracy(builder: LogBuilder, clock: Clock, unit: int, t_us: np.ndarray, column: str) -> Array:
    """An accuracy from the GPA record that belongs to each GPS record (at most 0.5 s away), else NaN."""
    table = units(builder.messages, "GPA").get(unit)
    if table is None or column not in table or len(table) == 0:
        return np.full(len(t_us), np.nan)
    at = clock.of(table)
    order = np.argsort(at, kind="stable")
    at, x = at[order], table.value(column)[order]
    k = np.clip(np.searchsorted(at, t_us), 1, max(len(at) - 1, 1))
    k = np.minimum(k, len(at) - 1)
    k = np.where(np.abs(at[k - 1] - t_us) < np.abs(at[k] - t_us), k - 1, k)
    return np.where(np.abs(at[k] - t_us) <= 500_000, x[k], np.nan)


def utc_us(table: Table) -> np.ndarray | None:
    """Unix time in us from GPS week and milliseconds, 0 where the receiver did not know it; None without columns."""
    week = next((c for c in ("GWk", "Week") if c in table), None)
    ms = next((c for c in ("GMS", "TimeMS") if c in table), None)
    if week is None or ms is None:
        return None
    return gps_time_us(table[week].astype(np.int64), table[ms].astype(np.int64))


def baro(builder: LogBuilder, clock: Clock) -> list[Stream]:
    """Barometric altitude in m above the take-off pressure (BARO.Alt)."""
    tables = units(builder.messages, "BARO")
    for extra in (2, 3):
        table = builder.messages.first(f"BAR{extra}")
        if table is not None:
            tables.setdefault(extra - 1, table)
    found = [
        builder.stream(clock.of(t), t.value("Alt"), "m", f"BARO:{unit}", within=physics.BARO)
        for unit, t in sorted(tables.items())
        if "Alt" in t
    ]
    return [f for f in found if f is not None]


def airspeed(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Airspeed of the sensor in m/s."""
    table = builder.messages.first("ARSP")
    if table is None or "Airspeed" not in table:
        return None
    return builder.stream(clock.of(table), table.value("Airspeed"), "m/s", "ARSP", within=physics.AIRSPEED)


def throttle(builder: LogBuilder, clock: Clock, family: str) -> Stream | None:
    """Throttle output 0 to 1; planes and rovers log percent, copters before 3.4 per mille."""
    for name in ("CTUN", "THR"):
        table = builder.messages.first(name)
        column = None if table is None else next((c for c in ("ThO", "ThrOut") if c in table), None)
        if table is None or column is None or own_time(table) is None:
            continue
        x = table.value(column)
        scale = 0.01 if family in ("plane", "rover") else (1e-3 if column == "ThrOut" else 1.0)
        return builder.stream(
            clock.of(table), x * scale, "1", f"{name}.{column}", within=physics.THROTTLE, allow_nan=True
        )
    return None


def motors(builder: LogBuilder, clock: Clock, vehicle: str, values: dict[str, float]) -> Stream | None:
    """Outputs to the motors of a multirotor (n, motors), 0 stopped to 1 full, by RCOU and its limits."""
    table = builder.messages.first("RCOU")
    if table is None or vehicle not in MOTORS or own_time(table) is None:
        return None
    numbers = [n for n in range(1, 17) if values.get(f"SERVO{n}_FUNCTION") in MOTOR_FUNCTIONS]
    numbers = numbers or list(range(1, MOTORS[vehicle] + 1))
    prefix = next((p for p in ("C", "Ch", "Chan") if f"{p}{numbers[0]}" in table), None)
    throttle_channel = int(values.get("RCMAP_THROTTLE", 3))
    low = values.get("MOT_PWM_MIN") or values.get(f"RC{throttle_channel}_MIN")
    high = values.get("MOT_PWM_MAX") or values.get(f"RC{throttle_channel}_MAX")
    if prefix is None or not low or not high or high - low < 100.0:
        return None
    names = [f"{prefix}{n}" for n in numbers if f"{prefix}{n}" in table]
    share = np.clip((columns(table, *names) - low) / (high - low), 0.0, 1.0)
    return builder.stream(clock.of(table), share, "1", "RCOU")


def rpm(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Rotor speeds (n, rotors) in rev/min: ESC telemetry by motor, else the RPM sensors."""
    messages = builder.messages
    motors = [t for t in (messages["ESC", i] for i in messages.instances("ESC")) if "RPM" in t and len(t) > 1]
    if motors:
        t = clock.of(motors[0])
        x = [np.interp(t, clock.of(m), m.value("RPM")) for m in motors]
        return builder.stream(t, np.column_stack(x), "rpm", "ESC", within=physics.RPM)
    table = messages.first("RPM")
    if table is None:
        return None
    names = [c for c in ("rpm1", "rpm2", "RPM1", "RPM2", "RPM") if c in table]
    return builder.stream(clock.of(table), columns(table, *names), "rpm", "RPM", within=physics.RPM) if names else None


def battery(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A; before 3.4 the log holds hundredths."""
    for name in ("BAT", "CURR"):
        table = builder.messages.first(name)
        if table is None or "Volt" not in table or "Curr" not in table or own_time(table) is None:
            continue
        x = columns(table, "Volt", "Curr")
        volts = x[np.isfinite(x[:, 0]), 0]
        if table.fields["Volt"].dtype.kind in "iu" or (len(volts) and np.median(np.abs(volts)) > 150.0):
            x = x * 0.01
        return builder.battery(clock.of(table), x, name)
    return None


def acc_bias(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Accelerometer bias (n, 3) in m/s^2 of EKF3's primary core (XKF2 of XKF4.PI; the first where that is unknown)."""
    status = builder.messages.first("XKF4")
    core = int(np.median(status["PI"])) if status is not None and "PI" in status and len(status) else 0
    table = units(builder.messages, "XKF2").get(core)
    if table is None or not all(c in table for c in ("AX", "AY", "AZ")):
        return None
    return builder.stream(
        clock.of(table), columns(table, "AX", "AY", "AZ"), "m/s^2", "XKF2", frame="FRD", within=physics.ACC_BIAS
    )


def vibration(builder: LogBuilder, clock: Clock, imu: Imu | None) -> Stream | None:
    """VIBE (n, 3) in m/s^2 of the replayed unit; before 4.1 there is one record for all."""
    tables = units(builder.messages, "VIBE")
    table = tables.get(imu.index if imu is not None else 0, tables.get(0))
    if table is None or not all(c in table for c in ("VibeX", "VibeY", "VibeZ")):
        return None
    x = columns(table, "VibeX", "VibeY", "VibeZ")
    return builder.stream(clock.of(table), x, "m/s^2", "VIBE", frame="FRD", within=physics.VIBRATION)
