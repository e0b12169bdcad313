"""Read the inputs of one EKF3 core from a DataFlash log: samples and events, with its logged states.

Times are s since boot. Units are SI but for the magnetic field, which EKF3 keeps in gauss.
Records: ArduPilot ``libraries/AP_NavEKF3/LogStructure.h`` and ``AP_Logger/LogStructure.h``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.core.sorting import median, nanmedian
from attlog.flight.ardupilot.estimator import from_euler_deg, heading_and_sigma
from attlog.flight.ardupilot.imu import DataflashBuilder, primary_core, unit_of_core
from attlog.flight.builder import columns
from attlog.flight.imu import longest_held
from attlog.flight.model import FlightLog, Imu, TimeLine
from attlog.flight.vehicle import version_number
from attlog.formats.table import Table

Array = NDArray[np.float64]

# Lowest IMU rate of a re-run, which agrees to 0.3 deg at 20 Hz; below, motion between samples is lost.
MIN_IMU_RATE_HZ = 20.0
# Value of AHRS_EKF_TYPE with which EKF3 flies.
EKF3_TYPE = 3.0
# Bits of XKF4.SS (nav_filter_status): relative and absolute horizontal position.
RELATIVE_BIT, ABSOLUTE_BIT = 3, 4
# Share of records with relative aiding above which a re-run is refused.
MIN_AID_SHARE = 0.05
# Values of EK3_SRC1_YAW that the re-run models: none, compass, GSF.
MODELLED_YAW_SOURCES = (0, 1, 8)
# Lag of receivers in ms (AP_GPS): u-blox 5 and 6, later u-blox, other drivers, simulator.
UBLOX_OLD_LAG_MS, UBLOX_LAG_MS, OTHER_LAG_MS, SIMULATED_LAG_MS = 220.0, 120.0, 200.0, 100.0
# GPS_TYPE of u-blox drivers: automatic and u-blox.
UBLOX_TYPES = (1, 2)
# A motor output above this turns the motor (us).
MOTOR_TURNS_US = 1150.0
GAUSS_PER_MILLIGAUSS = 1e-3
# A copter that sinks slowly and hardly moves expects to touch down: m/s demanded and flown, demanded lean in ALT_HOLD.
SINK_DEMANDED_M_S, SINK_M_S, LEVEL_M_S, LEAN_DEG = 1.0, 0.6, 1.25, 7.5
# Records of a position controller that is on come closer than this.
CONTROLLED_S = 0.5
# Innovation columns of XKF3 by aid, with their factor to the units of the re-run.
INNOVATION_COLUMNS = {
    "velocity_n": ("IVN", 1.0),
    "velocity_e": ("IVE", 1.0),
    "velocity_d": ("IVD", 1.0),
    "position_n": ("IPN", 1.0),
    "position_e": ("IPE", 1.0),
    "baro_height": ("IPD", 1.0),
    "mag_x": ("IMX", GAUSS_PER_MILLIGAUSS),
    "mag_y": ("IMY", GAUSS_PER_MILLIGAUSS),
    "mag_z": ("IMZ", GAUSS_PER_MILLIGAUSS),
    "heading": ("IYAW", np.pi / 180.0),
    "airspeed": ("IVT", 1.0),
}
# Beginnings of a core's messages ("EKF3 IMU0 ...") and the events that they report.
EVENT_TEXTS = {
    "initialised": "initialised",
    "in-flight yaw alignment complete": "final_reset",
    "ground mag anomaly, yaw re-aligned": "anomaly_reset",
    "is using GPS": "gnss_on",
    "origin set": "origin",
}


@dataclass(slots=True)
class Ekf3States:
    """Logged states of a core ``x`` (n, 24), a row per XKF1 record.

    States are ordered as in :mod:`attlog.estimators.error_state`. Magnetic fields and wind come from the preceding XKF2
    record. ``variances`` (m, 24) at ``t_variances``: of the filter's states, with biases per filter step. ``status``:
    bits of XKF4.SS. ``mag_fusion`` (XKFS): 1 yaw, 2 three axes.
    """

    t: Array
    x: Array
    t_variances: Array
    variances: Array
    t_status: Array
    status: Array
    t_mag_fusion: Array
    mag_fusion: Array

    def attitude(self) -> tuple[Array, Array, Array]:
        """Return times, attitudes (n, 4) and the variances of their quaternions (n, 4)."""
        if not len(self.t):
            return np.zeros(0), np.zeros((0, 4)), np.zeros((0, 4))
        last = np.clip(np.searchsorted(self.t, self.t_variances), 0, len(self.t) - 1)
        return self.t_variances, self.x[last, :4], self.variances[:, :4]


@dataclass(slots=True)
class Ekf3Inputs:
    """Logged inputs of one EKF3 core.

    ``t``, ``gyro`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2: IMU records. ``gyro_late``, ``acc_late`` s: delay of the
    low-pass filters ahead of the logger; the EKF's own increments are not filtered. Aids are mappings of columns,
    empty if not logged. ``innovations``: from XKF3 by aid. ``events``: times by the names in :data:`EVENT_TEXTS`,
    and ``compass``: another one in use. ``other_mag``: samples of compasses while not in use. ``step_s``: filter step
    by XKT, None if not logged. ``antenna``: of GNSS from the IMU, m in body axes.
    """

    core: int
    unit: int
    t: Array
    gyro: Array
    acc: Array
    gyro_late: float
    acc_late: float
    intervals: bool
    mag: Mapping[str, Array]
    other_mag: Mapping[str, Array]
    gnss: Mapping[str, Array]
    baro: Mapping[str, Array]
    airspeed: Mapping[str, Array]
    gsf: Mapping[str, Array]
    armed: Mapping[str, Array]
    landed: Mapping[str, Array]
    touch_down: Mapping[str, Array]
    events: Mapping[str, Array]
    states: Ekf3States | None
    innovations: Mapping[str, Array]
    step_s: float | None
    gnss_lag_ms: float
    antenna: tuple[float, float, float]
    plane: bool
    params: dict[str, float] = field(default_factory=dict)
    version: tuple[int, int] = (0, 0)


def _seconds(builder: DataflashBuilder, table: Table) -> Array:
    return builder.stamps(table).astype(np.float64) * 1e-6


def _read(builder: DataflashBuilder, table: Table | None, names: Mapping[str, str]) -> dict[str, Array]:
    """Read columns of a table, renamed and sorted by time; missing columns are NaN."""
    if table is None or not len(table):
        return {"t": np.zeros(0)} | {short: np.zeros(0) for short in names}
    t = _seconds(builder, table)
    found = {short: table.value(long) if long in table else np.full(len(t), np.nan) for short, long in names.items()}
    order = np.argsort(t, kind="stable")
    return {"t": t[order]} | {name: x[order] for name, x in found.items()}


def _core_table(builder: DataflashBuilder, name: str, core: int) -> Table | None:
    """Return the table of a core; before 4.0 the second core wrote XKF6 to XKF9 and XKQ2."""
    found = builder.units(name)
    if core in found:
        return found[core]
    old = {"XKF1": "XKF6", "XKF2": "XKF7", "XKF3": "XKF8", "XKF4": "XKF9"}
    messages = builder.messages
    if name == "XKQ":
        return messages.first(f"XKQ{core + 1}")
    return messages.first(old[name]) if core == 1 and name in old else None


def _selected(
    builder: DataflashBuilder, name: str, choice: Mapping[str, Array], columns_: Mapping[str, str]
) -> dict[str, Array]:
    """Read a sensor's records, at each time of the unit in use by the core."""
    units = builder.units(name)
    if not units:
        return _read(builder, None, columns_)
    number = choice["unit"][np.isfinite(choice["unit"])] if len(choice["t"]) else np.zeros(0)
    used = sorted({int(u) for u in number if int(u) in units}) or [min(units)]
    parts = []
    for unit in used:
        part = _read(builder, units[unit], columns_)
        if len(used) > 1:
            at = np.maximum(np.searchsorted(choice["t"], part["t"], side="right") - 1, 0)
            part = {name: x[choice["unit"][at] == unit] for name, x in part.items()}
        parts.append(part)
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(joined["t"], kind="stable")
    return {name: x[order] for name, x in joined.items()}


def _compasses(builder: DataflashBuilder, choice: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return samples ``x`` in gauss with their ``unit``, of the compass in use and of those that may be used."""
    found, units = [], builder.units("MAG")
    known = np.isfinite(choice["unit"])
    t, unit = choice["t"][known], choice["unit"][known]
    for number, table in sorted(units.items()):
        part = _read(builder, table, {"x": "MagX", "y": "MagY", "z": "MagZ"})
        at = np.maximum(np.searchsorted(t, part["t"], side="right") - 1, 0)
        used = unit[at] == number if len(t) else np.full(len(at), number == min(units))
        may_be = builder.values.get("COMPASS_USE" + (str(number + 1) if number else ""), 1.0) > 0
        field = np.column_stack([part[axis] for axis in "xyz"]) * GAUSS_PER_MILLIGAUSS
        found.append((part["t"], field, np.full(len(at), float(number)), used, ~used & may_be))
    if not found:
        return ({"t": np.zeros(0), "x": np.zeros((0, 3)), "unit": np.zeros(0)},) * 2
    joined = [np.concatenate(columns) for columns in zip(*found, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    t, x, unit, used, other = (column[order] for column in joined)
    return tuple({"t": t[keep], "x": x[keep], "unit": unit[keep]} for keep in (used, other))  # type: ignore[return-value]


def _chosen(builder: DataflashBuilder, core: int, column: str, old: str = "") -> dict[str, Array]:
    """Return the sensor unit in use by a core over time (XKFS, before 4.1 XKF2)."""
    table = _core_table(builder, "XKFS", core)
    if table is not None and column in table:
        return _read(builder, table, {"unit": column})
    table = _core_table(builder, "XKF2", core)
    return _read(builder, table if table is not None and old and old in table else None, {"unit": old})


def _gnss(builder: DataflashBuilder, core: int) -> dict[str, Array]:
    choice = _chosen(builder, core, "GI")
    names = {
        "lat": "Lat", "lon": "Lng", "alt": "Alt", "speed": "Spd", "course": "GCrs", "vd": "VZ", "fix": "Status",
        "satellites": "NSats", "hdop": "HDop",
    }  # fmt: skip
    g = _selected(builder, "GPS", choice, names)
    a = _selected(builder, "GPA", choice, {"hacc": "HAcc", "vacc": "VAcc", "sacc": "SAcc", "sms": "SMS"})
    course = np.radians(g.pop("course"))
    speed = g.pop("speed")
    g |= {"vn": speed * np.cos(course), "ve": speed * np.sin(course)}
    near = np.clip(np.searchsorted(a["t"], g["t"]), 0, max(len(a["t"]) - 1, 0))
    for name in ("hacc", "vacc", "sacc", "sms"):
        g[name] = np.full(len(g["t"]), np.nan)
        if len(a["t"]):
            g[name] = np.where(np.abs(a["t"][near] - g["t"]) < 0.05, a[name][near], np.nan)
    sent = g.pop("sms") * 1e-3
    late = g["t"] - sent
    g["t_message"] = np.where((late > -0.02) & (late < 0.5), sent, g["t"])
    return g


def gnss_lag(builder: DataflashBuilder) -> float:
    """Return the receiver's lag in ms that the EKF compensates, by parameters or the driver's default."""
    values = builder.values
    for name in ("GPS1_DELAY_MS", "GPS_DELAY_MS"):
        if values.get(name, 0.0) > 0.0:
            return float(values[name])
    if builder.log.simulated:
        return float(values.get("SIM_GPS_LAG_MS", values.get("SIM_GPS1_LAG_MS", SIMULATED_LAG_MS)))
    if int(values.get("GPS1_TYPE", values.get("GPS_TYPE", 1))) not in UBLOX_TYPES:
        return OTHER_LAG_MS
    for text in builder.messages.texts:
        if found := re.search(r"u-blox 1 HW: ([0-9A-Fa-f]{8})", text.text):
            return UBLOX_OLD_LAG_MS if int(found[1], 16) >> 16 < 7 else UBLOX_LAG_MS
    return UBLOX_LAG_MS


def antenna_of(builder: DataflashBuilder, core: int, unit: int) -> tuple[float, float, float]:
    """Return the position of the GNSS antenna in use from the IMU in m, body axes, by parameters."""
    used = _chosen(builder, core, "GI")["unit"]
    number = int(nanmedian(used)) + 1 if np.isfinite(used).any() else 1
    arm = [
        builder.values.get(f"GPS{number}_POS_{axis}", builder.values.get(f"GPS_POS{number}_{axis}", 0.0))
        - builder.values.get(f"INS_POS{unit + 1}_{axis}", 0.0)
        for axis in "XYZ"
    ]
    return float(arm[0]), float(arm[1]), float(arm[2])


def _states(builder: DataflashBuilder, core: int, trim: Array | None) -> Ekf3States | None:
    first, second = _core_table(builder, "XKF1", core), _core_table(builder, "XKF2", core)
    if first is None or not len(first):
        return None
    t = _seconds(builder, first)
    x = np.full((len(t), 24), np.nan)
    quaternion = _core_table(builder, "XKQ", core)
    if quaternion is not None and len(quaternion):
        tq, q = _seconds(builder, quaternion), columns(quaternion, "Q1", "Q2", "Q3", "Q4")
        k = np.clip(np.searchsorted(tq, t), 0, len(tq) - 1)
        x[:, :4] = np.where(np.abs(tq[k] - t)[:, None] < 0.02, q[k], np.nan)
    missing = ~np.isfinite(x[:, 0])
    if missing.any():
        q, _ = from_euler_deg(columns(first, "Roll", "Pitch", "Yaw"))
        if trim is not None:
            q = rotation.multiply(q, rotation.from_rotvec(trim))
        x[missing, :4] = q[missing]
    x[:, 4:10] = columns(first, "VN", "VE", "VD", "PN", "PE", "PD")
    x[:, 10:13] = np.radians(columns(first, "GX", "GY", "GZ"))
    x[:, 13:] = 0.0
    if second is not None and len(second):
        k = np.maximum(np.searchsorted(_seconds(builder, second), t, side="right") - 1, 0)
        if "AX" in second:
            x[:, 13:16] = columns(second, "AX", "AY", "AZ")[k]
        x[:, 16:19] = columns(second, "MN", "ME", "MD")[k] * GAUSS_PER_MILLIGAUSS
        x[:, 19:22] = columns(second, "MX", "MY", "MZ")[k] * GAUSS_PER_MILLIGAUSS
        x[:, 22:24] = columns(second, "VWN", "VWE")[k]
    variances = [_core_table(builder, f"XKV{n}", core) for n in (1, 2)]
    tv, v = np.zeros(0), np.zeros((0, 24))
    if variances[0] is not None and variances[1] is not None:
        n = min(len(variances[0]), len(variances[1]))
        tv = _seconds(builder, variances[0])[:n]
        v = np.hstack(
            [columns(variances[h], *(f"V{i:02d}" for i in range(12 * h, 12 * h + 12)))[:n] for h in (0, 1)]  # type: ignore[arg-type]
        )
    status = _read(builder, _core_table(builder, "XKF4", core), {"status": "SS"})
    fusion = _read(builder, _core_table(builder, "XKFS", core), {"mode": "MAG_FUSION"})
    if not np.isfinite(fusion["mode"]).any():
        fusion = {"t": np.zeros(0), "mode": np.zeros(0)}
    good = np.isfinite(x).all(axis=1)
    return Ekf3States(t[good], x[good], tv, v, status["t"], status["status"], fusion["t"], fusion["mode"])


def _innovations(builder: DataflashBuilder, core: int) -> dict[str, Array]:
    table = _core_table(builder, "XKF3", core)
    found = _read(builder, table, {aid: column for aid, (column, _) in INNOVATION_COLUMNS.items()})
    return {name: x * INNOVATION_COLUMNS[name][1] if name in INNOVATION_COLUMNS else x for name, x in found.items()}


def _events(log: FlightLog, builder: DataflashBuilder, unit: int) -> dict[str, Array]:
    found: dict[str, list[float]] = {name: [] for name in EVENT_TEXTS.values()}
    for text in builder.messages.texts:
        match = re.match(r"EKF3 IMU(\d)(?: MAG\d)? (.*)", text.text)
        if match and int(match[1]) == unit and text.t_us is not None:
            for words, name in EVENT_TEXTS.items():
                if match[2].startswith(words):
                    found[name].append(text.t_us * 1e-6)
    return {name: np.array(times, np.float64) for name, times in found.items()}


def _line(line: TimeLine | None, t0: float) -> dict[str, Array]:
    if line is None:
        return {"t": np.zeros(0), "on": np.zeros(0)}
    return {"t": line.t + t0, "on": np.array([float(bool(v)) for v in line.value])}


def _armed(builder: DataflashBuilder, t0: float) -> dict[str, Array]:
    """Return arming over time, with an initial state before the first record.

    Initially armed are planes whose first record is a disarming, because their first outputs are servos, and other
    vehicles whose motors turn.
    """
    armed = _line(builder.log.state.armed, t0)
    outputs = builder.messages.first("RCOU")
    if not len(armed["t"]):
        return armed
    begin = False
    if outputs is not None and len(outputs) and "C1" in outputs:
        t = _seconds(builder, outputs)
        motors = np.column_stack([outputs.value(c) for c in ("C1", "C2", "C3", "C4") if c in outputs])
        before = motors[t < armed["t"][0]][:5]
        begin = len(before) > 0 and bool(median(before) > MOTOR_TURNS_US)
        if builder.family == "plane":
            begin = armed["on"][0] == 0.0
    return {"t": np.concatenate([[-np.inf], armed["t"]]), "on": np.concatenate([[float(begin)], armed["on"]])}


def _touch_down(builder: DataflashBuilder, core: int, gnss: Mapping[str, Array], t0: float) -> dict[str, Array]:
    """Return when the EKF expected a touch-down, by demands of the position controller."""
    sink = _read(builder, builder.messages.first("PSCD"), {"demand": "DVD", "rate": "VD"})
    t = sink["t"]
    if not len(t):
        return {"t": t, "on": t}
    slow = (sink["demand"] > 0.0) & ((sink["demand"] <= SINK_DEMANDED_M_S) | (np.abs(sink["rate"]) <= SINK_M_S))
    parts = [_read(builder, builder.messages.first(name), {"demand": f"TV{name[-1]}"}) for name in ("PSCN", "PSCE")]
    level = np.hypot(*(_latest(part["t"], part["demand"], t) for part in parts))
    moving = np.hypot(*(_latest(gnss["t"], gnss[name], t) for name in ("vn", "ve")))
    status = _read(builder, _core_table(builder, "XKF4", core), {"bits": "SS"})
    placed = np.nan_to_num(_latest(status["t"], status["bits"], t)).astype(np.int64) >> ABSOLUTE_BIT & 1 > 0
    lean = _read(builder, builder.messages.first("ATT"), {"roll": "DesRoll", "pitch": "DesPitch"})
    upright = np.cos(np.radians(lean["roll"])) * np.cos(np.radians(lean["pitch"])) > np.cos(np.radians(LEAN_DEG))
    mode = builder.log.state.mode
    holds = np.zeros(0) if mode is None else np.array([float(m == "ALT_HOLD") for m in mode.value])
    hold = holds[np.maximum(np.searchsorted(mode.t + t0, t, side="right") - 1, 0)] if mode is not None else 0.0
    level_hold = (hold > 0.0) & (_latest(lean["t"], upright.astype(np.float64), t) > 0.0)
    on = slow & (np.where(np.isfinite(level), level <= LEVEL_M_S, placed & (moving <= LEVEL_M_S)) | level_hold)
    ends = np.append(np.diff(t) > CONTROLLED_S, True)
    times, values = np.concatenate([t, t[ends] + CONTROLLED_S]), np.concatenate([on, np.zeros(ends.sum())])
    order = np.argsort(times, kind="stable")
    return {"t": times[order], "on": values[order].astype(np.float64)}


def _latest(t: Array, value: Array, at: Array) -> Array:
    """Return the last value at each time, NaN where it is older than a controller's interval."""
    if not len(t):
        return np.full(len(at), np.nan)
    k = np.searchsorted(t, at, side="right") - 1
    return np.where((k >= 0) & (at - t[np.maximum(k, 0)] <= CONTROLLED_S), value[np.maximum(k, 0)], np.nan)


def core_of(builder: DataflashBuilder, unit: int | None) -> int:
    """Return the core on IMU ``unit``, for None the core that was primary longest.

    UsageError if no core uses the unit.
    """
    _, t_us, lanes = primary_core(builder)
    cores = sorted(builder.units("XKF1")) or [0]
    if unit is not None:
        for core in cores:
            if unit_of_core(builder, "XK", core, cores) == unit:
                return core
        raise UsageError(f"EKF3 cannot be run again on IMU {unit}: no lane of it used that unit.")
    return longest_held(t_us, lanes) or 0


def read_inputs(builder: DataflashBuilder, unit: int | None = None) -> Ekf3Inputs:
    """Read the inputs of the core on IMU ``unit``, for None of the primary core.

    UsageError if EKF3 did not fly, its IMU is not logged or too slow, or an aid is not modelled.
    """
    log, values = builder.log, builder.values
    if not builder.units("XKF1"):
        if builder.units("NKF1"):
            raise UsageError(
                "EKF2 of ArduPilot flew: run again it differs by 0.9° tilt and 2.5° heading, so it is not offered."
            )
        raise UsageError("EKF3 cannot be run again: the log holds no XKF1 record.")
    if values.get("AHRS_EKF_TYPE", 3.0) != EKF3_TYPE:
        raise UsageError("EKF3 did not fly this log (AHRS_EKF_TYPE): there is nothing to compare its re-run with.")
    core = core_of(builder, unit)
    unit = unit_of_core(builder, "XK", core, sorted(builder.units("XKF1")))
    imu = _imu(log, unit)
    t0 = log.t0_us * 1e-6
    _check_aids(builder, core)
    timing = _read(builder, _core_table(builder, "XKT", core), {"count": "Cnt"})
    step_s = None
    if len(timing["t"]) > 2 and (timing["count"] > 0).all():
        step_s = float(median(np.diff(timing["t"]) / timing["count"][1:]))
    compass = _chosen(builder, core, "MI", "MI")
    mag, other_mag = _compasses(builder, compass)
    changes = compass["t"][1:][np.diff(compass["unit"]) != 0]
    baro = _selected(builder, "BARO", _chosen(builder, core, "BI"), {"alt": "Alt", "sms": "SMS"})
    sampled = baro.pop("sms") * 1e-3
    baro["t_sample"] = np.where(np.abs(baro["t"] - sampled) < 0.5, sampled, baro["t"])
    gsf_table = _core_table(builder, "XKY0", core)
    gsf = {"t": np.zeros(0), "yaw": np.zeros(0), "sigma": np.zeros(0)}
    if gsf_table is not None and len(gsf_table) and "YC" in gsf_table and "YCS" in gsf_table:
        yaw, sigma = heading_and_sigma(gsf_table)
        gsf = {"t": _seconds(builder, gsf_table), "yaw": yaw, "sigma": sigma}
    plane = builder.family == "plane"
    gnss = _gnss(builder, core)
    return Ekf3Inputs(
        core=core,
        unit=unit,
        t=imu.gyro.t + t0,
        gyro=imu.gyro.x,
        acc=imu.acc.x,
        gyro_late=imu.gyro.delay,
        acc_late=imu.acc.delay,
        intervals=imu.gyro.sampling == "interval",
        mag=mag,
        other_mag=other_mag,
        gnss=gnss,
        baro=baro,
        airspeed=_selected(builder, "ARSP", _chosen(builder, core, "AI"), {"eas": "Airspeed", "use": "U"}),
        gsf=gsf,
        armed=_armed(builder, t0),
        landed=_line(log.state.landed, t0),
        touch_down=_touch_down(builder, core, gnss, t0),
        events=_events(log, builder, unit) | {"compass": changes},
        states=_states(builder, core, log.parameters.trim),
        innovations=_innovations(builder, core),
        step_s=step_s,
        gnss_lag_ms=gnss_lag(builder),
        antenna=antenna_of(builder, core, unit),
        plane=plane,
        params=dict(values),
        version=version_number(log.firmware.version),
    )


def _imu(log: FlightLog, unit: int) -> Imu:
    """Return the IMU of a core. UsageError if not logged or too slow."""
    imu = next((one for one in log.imus if one.index == unit), None)
    if imu is None:
        raise UsageError(f"EKF3 cannot be run again: the log holds no samples of its IMU {unit}.")
    if imu.gyro.rate < MIN_IMU_RATE_HZ:
        raise UsageError(
            f"EKF3 cannot be run again: its IMU is logged at {imu.gyro.rate:.0f} Hz; {MIN_IMU_RATE_HZ:.0f} are needed."
        )
    return imu


def _check_aids(builder: DataflashBuilder, core: int) -> None:
    """Raise UsageError for flights on optical flow, external navigation or an unmodelled heading source."""
    status = _read(builder, _core_table(builder, "XKF4", core), {"bits": "SS"})["bits"]
    if len(status):
        bits = np.nan_to_num(status).astype(np.int64)
        relative = ((bits >> RELATIVE_BIT) & 1 > 0) & ((bits >> ABSOLUTE_BIT) & 1 == 0)
        if float(np.mean(relative)) > MIN_AID_SHARE:
            raise UsageError("EKF3 cannot be run again: it used optical flow or external navigation.")
    source = int(builder.values.get("EK3_SRC1_YAW", 1))
    if source not in MODELLED_YAW_SOURCES:
        name = {2: "the heading of two GNSS antennas", 3: "two antennas and compass", 6: "external navigation"}
        raise UsageError(f"EKF3 cannot be run again: its heading came from {name.get(source, f'source {source}')}.")
