"""Small logs of either firmware with parameters, compasses and accelerometers, and the firmwares' own corrections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Firmware, FlightLog, Imu, Mag, Stream, TimeLine

Array = NDArray[np.float64]
T = np.arange(0.0, 60.0, 0.1)
MG, GAUSS = 1e-7, 1e-4
OLD = {
    "COMPASS_OFS_X": 12.4, "COMPASS_OFS_Y": -80.6, "COMPASS_OFS_Z": 33.0,
    "COMPASS_DIA_X": 1.04, "COMPASS_DIA_Y": 0.97, "COMPASS_DIA_Z": 1.01,
    "COMPASS_ODI_X": 0.03, "COMPASS_ODI_Y": -0.02, "COMPASS_ODI_Z": 0.05,
    "COMPASS_SCALE": 1.1, "COMPASS_MOTCT": 0.0, "COMPASS_DEV_ID": 97539.0, "COMPASS_PRIO1_ID": 97539.0,
    "COMPASS_MOT_X": 0.0, "COMPASS_MOT_Y": 0.0, "COMPASS_MOT_Z": 0.0, "AHRS_ORIENTATION": 0.0,
    "COMPASS_OFS2_X": 1.0, "COMPASS_OFS2_Y": 2.0, "COMPASS_OFS2_Z": 3.0, "COMPASS_DEV_ID2": 131874.0,
    "COMPASS_MOT2_X": 0.0, "COMPASS_MOT2_Y": 0.0, "COMPASS_MOT2_Z": 0.0, "COMPASS_PRIO2_ID": 131874.0,
}  # fmt: skip


def raw_field(seed: int = 1) -> Array:
    """Raw values (n, 3) T of a compass that turns."""
    angle = 0.2 * T[:, None] + np.array([0.0, -np.pi / 2, 0.7])
    return 3e-5 * np.cos(angle) + 1e-6 * np.random.default_rng(seed).normal(size=(len(T), 3))


def amperes() -> Array:
    """The current (n,) A of a hover between standing still."""
    return np.where((T > 10) & (T < 50), 20.0 + 5.0 * np.sin(T), 0.5)


def ardupilot_field(raw: Array, values: Mapping[str, float], n: str = "", power: Array | float = 0.0) -> Array:
    """AP_Compass_Backend.cpp, correct_field: offsets, scale, matrix, then motors; mG as the firmware computes."""
    out = np.empty_like(raw)
    p = np.broadcast_to(np.asarray(power), len(raw))
    for k, (x, y, z) in enumerate(raw / MG):
        x, y, z = (v + values[f"COMPASS_OFS{n}_{a}"] for v, a in zip((x, y, z), "XYZ", strict=True))
        scale = values.get(f"COMPASS_SCALE{n}", 0.0)
        if 1 / 1.5 <= scale <= 1.5:
            x, y, z = scale * x, scale * y, scale * z
        dx, dy, dz = (values.get(f"COMPASS_DIA{n}_{a}", 1.0) for a in "XYZ")
        ox, oy, oz = (values.get(f"COMPASS_ODI{n}_{a}", 0.0) for a in "XYZ")
        field = (dx * x + ox * y + oy * z, ox * x + dy * y + oz * z, oy * x + oz * y + dz * z)
        motor = [values.get(f"COMPASS_MOT{n}_{a}", 0.0) * p[k] for a in "XYZ"]
        out[k] = [f + (m if values.get("COMPASS_MOTCT") else 0.0) for f, m in zip(field, motor, strict=True)]
    return out * MG


def ardupilot(values: Mapping[str, float], version: str = "Copter 4.5.7", index: int = 0, n: str = "") -> FlightLog:
    """A log of one compass, logged as ``index``, whose parameters stand in the slot with the suffix ``n``."""
    log = _log("dataflash", Firmware("ArduPilot", version), values)
    flew = [float(np.trunc(values[f"COMPASS_OFS{n}_{a}"])) * MG for a in "XYZ"]
    applied = Stream(T[:1], np.array([flew]), "T", "", f"MAG:{index}")
    field = ardupilot_field(raw_field(), values, n, amperes())
    log.mags = [Mag(index, Stream(T, field, "T", "FRD", f"MAG:{index}"), device="97539", offsets=applied)]
    return log


def px4(values: Mapping[str, float], field: Array, raw: Array | None, version: str = "1.14.3") -> FlightLog:
    """A log of one compass with the device id 42."""
    log = _log("ulog", Firmware("PX4", version), values)
    beside = None if raw is None else Stream(T[::4], raw[::4], "T", "", "sensor_mag:0")
    log.mags = [Mag(0, Stream(T, field, "T", "FRD", "vehicle_magnetometer:0"), device="42", raw=beside)]
    return log


def _log(kind: str, firmware: Firmware, values: Mapping[str, float]) -> FlightLog:
    log = FlightLog(Path("made.log"), kind, 0, 0, firmware, "")
    log.parameters.lines = {name: TimeLine(np.zeros(1), [float(v)], "PARM") for name, v in values.items()}
    log.seconds = float(T[-1])
    log.state.armed = TimeLine(np.array([0.0, 9.0, 51.0]), [False, True, False], "")
    log.power.battery = Stream(T, np.column_stack([np.full(len(T), 12.0), amperes()]), "V, A", "", "BAT")
    still = Stream(T, np.zeros((len(T), 3)), "rad/s", "FRD", "IMU:0")
    force = Stream(T, np.tile([0.3, -0.2, -9.8], (len(T), 1)), "m/s^2", "FRD", "IMU:0")
    log.imus = [Imu(0, still, force, acc_device="7")]
    return log
