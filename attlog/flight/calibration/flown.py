"""Which calibration did the sensors of a log fly with? Its parameters, checked against what the log says beside.

Parameters are those of the first arming, or shortly after the log's begin. What a log cannot show is refused with its
reason: another firmware, values that changed in flight, parameters of another boot.
"""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.advice import version_number
from attlog.flight.calibration import ardupilot, px4
from attlog.flight.calibration.correction import Calibration, CalibrationUnknownError
from attlog.flight.model import Array, FlightLog, Imu, Mag

SETTLED_S = 1.0
"""A log that begins armed may tell parameters that were changed at its start up to 0.2 s later."""
STATUS_LAG_S = 2.0
"""Arming is logged once or twice a second, and what a firmware learnt is saved the moment it disarms."""
NAMES = ("COMPASS_", "INS", "AHRS_ORIENTATION", "CAL_", "SENS_BOARD_")
"""How names of parameters begin that have to do with calibration."""
FEWEST = 5
SAME_T = 2.5e-6
"""A calibrated compass is its raw values corrected, to 25 mG: both are sampled some 10 ms apart in turns."""
OF_MEDIAN, PRECISE_T = 1.86, 5e-7
"""Standard error of a median from the median deviation of normal noise (1.4826 times 1.2533); known to 5 mG."""
BY_SLOT, LEARNS = (1, 12), (1, 13)
"""PX4 versions: since when calibrations are found by device, and when a bias is subtracted before arming."""


def span(log: FlightLog) -> tuple[float, float]:
    """First arming and last disarming in s; the whole log where it does not tell."""
    armed = log.armed
    if armed is None or not any(armed.value):
        return SETTLED_S, log.seconds
    first = next(float(t) for t, on in zip(armed.t, armed.value, strict=True) if on)
    last = log.seconds if armed.value[-1] else float(armed.t[-1])
    return max(first, SETTLED_S), max(last, SETTLED_S)


def values(log: FlightLog) -> dict[str, float]:
    """The parameters of calibration that flew, by name; those that only a given file holds are not among them."""
    at = span(log)[0]
    own = (name for name in log.params if name.startswith(NAMES) and name not in log.filled_params)
    return {name: float(value) for name in own if (value := log.params[name].at(at)) is not None}


def _changed(log: FlightLog, names: tuple[str, ...], until: float) -> list[str]:
    """Which parameters have another value at some time between the first arming and ``until`` s."""
    begin = span(log)[0]
    lines = {name: log.params[name] for name in names if name in log.params and len(log.params[name].value) > 1}
    return [name for name, line in lines.items() if ((line.t > begin) & (line.t < until)).any()]


def compass(log: FlightLog, mag: Mag, read: dict[str, float] | None = None) -> Calibration:
    """The calibration of a compass by the parameters that flew, or by others (``read``).

    CalibrationUnknownError says why it cannot be known.
    """
    used = values(log) if read is None else read
    firmware = _firmware(log, "compass")
    if firmware == "ArduPilot":
        found = ardupilot.compass(used, mag.index)
        if read is None:
            _agree(log, mag, found)
    else:
        found = px4.compass(used, _device(log, mag.device))
    if read is None:
        _steady(log, found)
    return found


def accelerometer(log: FlightLog, imu: Imu, read: dict[str, float] | None = None) -> Calibration:
    """The calibration of an accelerometer, as :func:`compass`."""
    used = values(log) if read is None else read
    if _firmware(log, "accelerometer") == "ArduPilot":
        found = ardupilot.accelerometer(used, imu.index, log.firmware.version)
    else:
        found = px4.accelerometer(used, _device(log, imu.acc_device))
    if read is None:
        _steady(log, found)
    return found


def motor_type(log: FlightLog, mag: Mag, power: str) -> dict[str, float]:
    """What to set so that a compass is compensated by ``power``. CalibrationUnknownError says why it cannot be."""
    if log.firmware.name == "ArduPilot":
        return ardupilot.compass_motor_type(values(log), mag.index, power)
    return px4.compass_motor_type(values(log), _device(log, mag.device), power)


def order_changed(log: FlightLog, found: Calibration) -> list[str]:
    """Parameters that say which sensor is which, or where it points, and were set after the flight began."""
    return _changed(log, found.fixed, np.inf)


def learnt_bias(log: FlightLog, mag: Mag, found: Calibration) -> Array:
    """What a compass (3,) T shows beside its parameters: the negative of a bias learnt before arming.

    CalibrationUnknownError says why it cannot be known.
    """
    if log.firmware.name != "PX4" or mag.field.source.startswith("sensor_mag"):
        return np.zeros(3)
    if (0, 0) < version_number(log.firmware.version) < LEARNS:
        return np.zeros(3)
    if mag.raw is None:
        why = (
            "The firmware may have learnt a bias before arming, which only raw values show: set bit 6 of SDLOG_PROFILE."
        )
        raise CalibrationUnknownError(why)
    begin, end = span(log)
    t, field = mag.field.t_best, mag.field.x
    known = rotation.finite(field)
    at = mag.raw.t_best
    use = (at >= begin) & (at <= end)
    if known.sum() < FEWEST or use.sum() < FEWEST:
        raise CalibrationUnknownError(f"Fewer than {FEWEST} raw values of the compass are logged in flight.")
    use &= (at >= t[known][0]) & (at <= t[known][-1])
    logged = np.column_stack([np.interp(at[use], t[known], axis[known]) for axis in field.T])
    motor = power(log, found.motor_power, at[use]) if found.correction.motor.any() else 0.0
    beside = logged - found.correction.body(mag.raw.x[use], motor)
    bias: Array = np.median(beside, axis=0)
    scatter = np.median(np.abs(beside - bias), axis=0)
    if len(beside) < FEWEST or (scatter > SAME_T).any():
        raise CalibrationUnknownError("The raw values, corrected by the parameters, are not those of the compass.")
    if (OF_MEDIAN * scatter / np.sqrt(len(beside)) > PRECISE_T).any():
        raise CalibrationUnknownError("Too few raw values are logged: set bit 6 of SDLOG_PROFILE.")
    return bias


def power(log: FlightLog, kind: str, t: Array) -> Array:
    """The motors' current in A or their throttle (n, 1) at ``t`` (n,) s. CalibrationUnknownError without."""
    if kind == "current":
        stream = log.battery
        x = None if stream is None or stream.x.shape[1] < 2 else stream.x[:, 1]
    else:
        stream = log.throttle
        x = None if stream is None else stream.x[:, 0]
    known = None if x is None else np.isfinite(x)
    if stream is None or x is None or known is None or not known.any():
        raise CalibrationUnknownError(f"The log holds no {kind or 'power'} of the motors.")
    return np.interp(t, stream.t[known], x[known])[:, None]


def _firmware(log: FlightLog, what: str) -> str:
    """Whose formula counts."""
    name = log.firmware.name
    if log.format in ("tlog", "mavlink"):
        raise CalibrationUnknownError(
            "Telemetry does not hold what the firmware corrected: use the autopilot's own log."
        )
    if log.format not in ("ulog", "dataflash", "dataflash_text") or name not in ("PX4", "ArduPilot"):
        raise CalibrationUnknownError(f"How this firmware calibrates its {what} is not known.")
    if name == "PX4" and (0, 0) < version_number(log.firmware.version) < BY_SLOT:
        raise CalibrationUnknownError("Before version 1.12 calibrations were not found by device.")
    return name


def _device(log: FlightLog, device: str | None) -> int:
    if not device or not device.isdecimal() or device == "0":
        raise CalibrationUnknownError("The log does not hold the sensor's device id.")
    return int(device)


def _steady(log: FlightLog, found: Calibration) -> None:
    """No parameter of it changes in flight."""
    moved = _changed(log, found.names, span(log)[1] - STATUS_LAG_S)
    if moved:
        raise CalibrationUnknownError(f"{moved[0]} was changed during the flight.")


def _agree(log: FlightLog, mag: Mag, found: Calibration) -> None:
    """The offsets that flew are those of the parameters, cut to whole mG as ArduPilot logs them."""
    if mag.offsets is None or not len(mag.offsets.t):
        raise CalibrationUnknownError(f"{mag.field.source} does not hold the offsets that flew.")
    begin, end = span(log)
    before = mag.offsets.t <= end
    flew = np.round((mag.offsets.x[before] if before.any() else mag.offsets.x)[-1] / ardupilot.MILLIGAUSS)
    if ((mag.offsets.t > begin) & (mag.offsets.t < end - STATUS_LAG_S)).any():
        raise CalibrationUnknownError(f"The offsets of {mag.field.source} changed during the flight.")
    held = found.correction.offset / ardupilot.MILLIGAUSS
    if (np.trunc(held + np.copysign(1e-3, held)) != flew).any():
        sizes = [", ".join(f"{x:.0f}" for x in three) for three in (flew, held)]
        raise CalibrationUnknownError(
            f"{mag.field.source} flew with offsets {sizes[0]} mG, the parameters say {sizes[1]}: those of another boot."
        )
