"""Find the calibration that a log's sensors flew with, and apply another one.

Parameters are taken at the first arming, or shortly after the log's begin. CalibrationUnknownError is raised for other
firmware, values that changed in flight, and parameters of another boot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from attlog.core import rotation
from attlog.core.earth import TESLA_PER_MILLIGAUSS
from attlog.core.sorting import median
from attlog.flight import calibration
from attlog.flight.calibration import Calibration, CalibrationUnknownError
from attlog.flight.model import Array, FlightLog, Imu, Mag, Problem, Stream
from attlog.flight.vehicle import version_number

# Parameter changes at the start of a log that begins armed are logged up to 0.2 s later.
BOOT_CHANGES_S = 1.0
# Arming is logged once or twice a second, and learned parameters are saved at disarming.
STATUS_LAG_S = 2.0
# Prefixes of parameters that take part in calibration.
CALIBRATION_PREFIXES = ("COMPASS_", "INS", "AHRS_ORIENTATION", "CAL_", "SENS_BOARD_")
MIN_RAW_VALUES = 5
# Largest scatter between the logged field and the corrected raw values (25 mG): they are sampled some 10 ms apart.
MAX_SCATTER_T = 2.5e-6
# Standard error of a median per median deviation of normal noise (1.4826 times 1.2533); largest error of a bias (5 mG).
MEDIAN_SIGMA_FACTOR, MAX_BIAS_SIGMA_T = 1.86, 5e-7
# PX4 versions since which calibrations are found by device id, and a bias learned before arming is subtracted.
PX4_BY_SLOT_VERSION, PX4_LEARNS_VERSION = (1, 12), (1, 13)


def armed_span(log: FlightLog) -> tuple[float, float]:
    """Return the times in s of first arming and last disarming, the whole log if unknown."""
    armed = log.state.armed
    if armed is None or not any(armed.value):
        return BOOT_CHANGES_S, log.seconds
    first = next(float(t) for t, on in zip(armed.t, armed.value, strict=True) if on)
    last = log.seconds if armed.value[-1] else float(armed.t[-1])
    return max(first, BOOT_CHANGES_S), max(last, BOOT_CHANGES_S)


def flown_parameters(log: FlightLog) -> dict[str, float]:
    """Return the logged calibration parameters at the first arming, without those added from a file."""
    at = armed_span(log)[0]
    own = (
        name
        for name in log.parameters.lines
        if name.startswith(CALIBRATION_PREFIXES) and name not in log.parameters.filled
    )
    return {name: float(value) for name in own if (value := log.parameters.lines[name].at(at)) is not None}


def _changed_parameters(log: FlightLog, names: tuple[str, ...], until: float) -> list[str]:
    """Select the parameters that change between the first arming and ``until`` s."""
    begin = armed_span(log)[0]
    lines = {
        name: log.parameters.lines[name]
        for name in names
        if name in log.parameters.lines and len(log.parameters.lines[name].value) > 1
    }
    return [name for name, line in lines.items() if ((line.t > begin) & (line.t < until)).any()]


def flown_compass(log: FlightLog, mag: Mag, read: dict[str, float] | None = None) -> Calibration:
    """Return the calibration of a compass by the flown parameters, or by ``read``.

    CalibrationUnknownError gives the reason. With ``read`` changes in flight and logged offsets are not checked.
    """
    used = flown_parameters(log) if read is None else read
    firmware = _known_firmware(log, "compass")
    if firmware == "ArduPilot":
        found = calibration.ardupilot_compass(used, mag.index)
        if read is None:
            _check_logged_offsets(log, mag, found)
    else:
        found = calibration.px4_compass(used, _device_number(log, mag.device))
    if read is None:
        _check_unchanged(log, found)
    return found


def flown_accelerometer(log: FlightLog, imu: Imu, read: dict[str, float] | None = None) -> Calibration:
    """Return the calibration of an accelerometer by the flown parameters, or by ``read``.

    CalibrationUnknownError gives the reason.
    """
    used = flown_parameters(log) if read is None else read
    if _known_firmware(log, "accelerometer") == "ArduPilot":
        found = calibration.ardupilot_accelerometer(used, imu.index, log.firmware.version)
    else:
        found = calibration.px4_accelerometer(used, _device_number(log, imu.acc_device))
    if read is None:
        _check_unchanged(log, found)
    return found


def flown_gyro(log: FlightLog, imu: Imu, read: dict[str, float] | None = None) -> Calibration:
    """Return the calibration of a gyro by the flown parameters, or by ``read``.

    CalibrationUnknownError gives the reason.
    """
    used = flown_parameters(log) if read is None else read
    if _known_firmware(log, "gyro") == "ArduPilot":
        return calibration.ardupilot_gyro(used, imu.index, log.firmware.version)
    # Gyro and accelerometer of one chip have one device id.
    return calibration.px4_gyro(used, _device_number(log, imu.device or imu.acc_device))


def flown_mounting(log: FlightLog, mag: Mag) -> calibration.Mounting:
    """Return the mounting of a compass by the parameters at the first arming; none where it is unknown."""
    used = flown_parameters(log)
    try:
        if log.firmware.name == "ArduPilot":
            return calibration.ardupilot_mounting(used, mag.index)
        return calibration.px4_mounting(used, _device_number(log, mag.device))
    except CalibrationUnknownError:
        return calibration.Mounting()


def flown_motor_type(log: FlightLog, mag: Mag, power: str) -> dict[str, float]:
    """Return the parameters that select ``power`` (current or throttle) for motor compensation of a compass.

    CalibrationUnknownError gives the reason.
    """
    if log.firmware.name == "ArduPilot":
        return calibration.ardupilot_motor_type(flown_parameters(log), mag.index, power)
    return calibration.px4_motor_type(flown_parameters(log), _device_number(log, mag.device), power)


def changed_sensor_order(log: FlightLog, found: Calibration) -> list[str]:
    """Return the parameters of sensor order or mounting that were changed after the first arming."""
    return _changed_parameters(log, found.fixed, np.inf)


def learned_compass_bias(log: FlightLog, mag: Mag, found: Calibration) -> Array:
    """Return the field (3,) T that the firmware added to a compass beside its parameters.

    PX4 subtracts a bias that it learned before arming; the result is its negative. Zero for firmware that learns none.
    CalibrationUnknownError gives the reason if it cannot be estimated.
    """
    if log.firmware.name != "PX4" or mag.field.source.startswith("sensor_mag"):
        return np.zeros(3)
    if (0, 0) < version_number(log.firmware.version) < PX4_LEARNS_VERSION:
        return np.zeros(3)
    if mag.raw is None:
        why = (
            "The firmware may have learnt a bias before arming, which only raw values show: set bit 6 of SDLOG_PROFILE."
        )
        raise CalibrationUnknownError(why)
    begin, end = armed_span(log)
    t, field = mag.field.t_best, mag.field.x
    known = rotation.finite_rows(field)
    at = mag.raw.t_best
    use = (at >= begin) & (at <= end)
    if known.sum() < MIN_RAW_VALUES or use.sum() < MIN_RAW_VALUES:
        raise CalibrationUnknownError(f"Fewer than {MIN_RAW_VALUES} raw values of the compass are logged in flight.")
    use &= (at >= t[known][0]) & (at <= t[known][-1])
    logged = np.column_stack([np.interp(at[use], t[known], axis[known]) for axis in field.T])
    motor = motor_power(log, found.motor_power, at[use]) if found.correction.motor.any() else 0.0
    beside = logged - found.correction.body(mag.raw.x[use], motor)
    bias: Array = median(beside, axis=0)
    scatter = median(np.abs(beside - bias), axis=0)
    if len(beside) < MIN_RAW_VALUES or (scatter > MAX_SCATTER_T).any():
        raise CalibrationUnknownError("The raw values, corrected by the parameters, are not those of the compass.")
    if (MEDIAN_SIGMA_FACTOR * scatter / np.sqrt(len(beside)) > MAX_BIAS_SIGMA_T).any():
        raise CalibrationUnknownError("Too few raw values are logged: set bit 6 of SDLOG_PROFILE.")
    return bias


def motor_power(log: FlightLog, kind: str, t: Array) -> Array:
    """Interpolate the motors' current in A or throttle (n, 1) to ``t`` (n,) s.

    CalibrationUnknownError if it is not logged.
    """
    if kind == "current":
        stream = log.power.battery
        x = None if stream is None or stream.x.shape[1] < 2 else stream.x[:, 1]
    else:
        stream = log.power.throttle
        x = None if stream is None else stream.x[:, 0]
    known = None if x is None else np.isfinite(x)
    if stream is None or x is None or known is None or not known.any():
        raise CalibrationUnknownError(f"The log holds no {kind or 'power'} of the motors.")
    return np.interp(t, stream.t[known], x[known])[:, None]


def _known_firmware(log: FlightLog, what: str) -> str:
    """Return the firmware's name; raise CalibrationUnknownError if its correction is unknown."""
    name = log.firmware.name
    if log.format in ("tlog", "mavlink"):
        raise CalibrationUnknownError(
            "Telemetry does not hold what the firmware corrected: use the autopilot's own log."
        )
    if log.format not in ("ulog", "dataflash", "dataflash_text") or name not in ("PX4", "ArduPilot"):
        raise CalibrationUnknownError(f"How this firmware calibrates its {what} is not known.")
    if name == "PX4" and (0, 0) < version_number(log.firmware.version) < PX4_BY_SLOT_VERSION:
        raise CalibrationUnknownError("Before version 1.12 calibrations were not found by device.")
    return name


def _device_number(log: FlightLog, device: str | None) -> int:
    if not device or not device.isdecimal() or device == "0":
        raise CalibrationUnknownError("The log does not hold the sensor's device id.")
    return int(device)


def _check_unchanged(log: FlightLog, found: Calibration) -> None:
    """Raise CalibrationUnknownError if a parameter of the calibration changes in flight."""
    moved = _changed_parameters(log, found.names, armed_span(log)[1] - STATUS_LAG_S)
    if moved:
        raise CalibrationUnknownError(f"{moved[0]} was changed during the flight.")


def _check_logged_offsets(log: FlightLog, mag: Mag, found: Calibration) -> None:
    """Raise CalibrationUnknownError if the logged offsets differ from the parameters.

    ArduPilot logs offsets truncated to whole mG.
    """
    if mag.offsets is None or not len(mag.offsets.t):
        raise CalibrationUnknownError(f"{mag.field.source} does not hold the offsets that flew.")
    begin, end = armed_span(log)
    before = mag.offsets.t <= end
    flew = np.round((mag.offsets.x[before] if before.any() else mag.offsets.x)[-1] / TESLA_PER_MILLIGAUSS)
    if ((mag.offsets.t > begin) & (mag.offsets.t < end - STATUS_LAG_S)).any():
        raise CalibrationUnknownError(f"The offsets of {mag.field.source} changed during the flight.")
    held = found.correction.offset / TESLA_PER_MILLIGAUSS
    if (np.trunc(held + np.copysign(1e-3, held)) != flew).any():
        sizes = [", ".join(f"{x:.0f}" for x in three) for three in (flew, held)]
        raise CalibrationUnknownError(
            f"{mag.field.source} flew with offsets {sizes[0]} mG, the parameters say {sizes[1]}: those of another boot."
        )


# --- correction by a file ----------------------------------------------------------------------------------------
#
# Logged values are converted to raw values by the flown parameters, and corrected again by those of the file. Onboard
# results, such as the attitude, stay as logged.

COMPASS_PARAMETERS = re.compile(
    r"COMPASS_(ORIENT|OFS|DIA|ODI|SCALE|MOT).*|CAL_MAG\d_(.(OFF|SCALE|ODIAG|COMP)|ROT)|CAL_MAG_COMP_TYP"
)
# Parameters of accelerometer calibration.
ACCELEROMETER_PARAMETERS = re.compile(r"INS\d?_ACC\d?(OFFS|SCAL)_.|CAL_ACC\d_.(OFF|SCALE)")
# Most parameters of a sensor that a message names.
MAX_SHOWN = 3

Known = Callable[[dict[str, float] | None], Calibration]
Bias = Callable[[Calibration], Array]


@dataclass(frozen=True, slots=True)
class Recorrection:
    """Change of a sensor's calibration by the parameters ``changed``.

    ``bias`` (3,): learned beside the old parameters, and removed with them. ``turn`` (3, 3): rotates raw values where
    the mounting changes.
    """

    log: FlightLog
    old: Calibration
    new: Calibration
    bias: Array
    changed: list[str]
    turn: Array = field(default_factory=lambda: np.eye(3))

    def corrected(self, t: Array, x: Array) -> Array:
        """Return logged values ``x`` (n, 3) at ``t`` s as the new parameters correct them."""
        before, after = (
            motor_power(self.log, each.motor_power, t) if each.correction.motor.any() else 0.0
            for each in (self.old, self.new)
        )
        raw = self.old.correction.raw(x - self.bias, before)
        return self.new.correction.body(raw @ self.turn.T, after)


def changed_parameters(log: FlightLog, given: Mapping[str, float]) -> dict[str, float]:
    """Return the calibration parameters of ``given`` that differ from the flown ones."""
    flew = flown_parameters(log)
    return {n: v for n, v in given.items() if n in flew and not math.isclose(v, flew[n], rel_tol=1e-6, abs_tol=1e-9)}


def compass_recorrection(log: FlightLog, mag: Mag, differ: Mapping[str, float]) -> Recorrection | None:
    """Return the change of a compass's calibration and mounting, None where ``differ`` leaves it."""
    known, bias = partial(flown_compass, log, mag), partial(learned_compass_bias, log, mag)
    others = {name: value for name, value in differ.items() if not name.startswith("COMPASS_ORIENT")}
    found, mounting = _recorrection(log, others, known, bias), flown_mounting(log, mag)
    if mounting.parameter not in differ or mounting.parameter in others:
        return found
    old, new = (calibration.mounting_matrix(number) for number in (mounting.number, differ[mounting.parameter]))
    if old is None or new is None:
        raise CalibrationUnknownError(f"{mounting.parameter} is one of custom angles.")
    if found is None:
        found = Recorrection(log, known(None), known(None), np.zeros(3), [])
    return replace(found, turn=new @ old.T, changed=[mounting.parameter, *found.changed])


def accelerometer_recorrection(log: FlightLog, imu: Imu, differ: Mapping[str, float]) -> Recorrection | None:
    """Return the change of an accelerometer's calibration, None where ``differ`` leaves it."""
    return _recorrection(log, differ, partial(flown_accelerometer, log, imu))


def gyro_recorrection(log: FlightLog, imu: Imu, differ: Mapping[str, float]) -> Recorrection | None:
    """Return the change of a gyro's calibration, None where ``differ`` leaves it."""
    return _recorrection(log, differ, partial(flown_gyro, log, imu))


def _recorrection(
    log: FlightLog, differ: Mapping[str, float], known: Known, bias: Bias = lambda _: np.zeros(3)
) -> Recorrection | None:
    old = known(None)
    changed = [name for name in differ if name in old.names]
    if not changed:
        return None
    if turned := [name for name in differ if name in old.fixed]:
        raise CalibrationUnknownError(f"{turned[0]} differs too: which sensor is meant, or its axes, is not known.")
    return Recorrection(log, old, known({**flown_parameters(log), **differ}), bias(old), changed)


def recorrect(log: FlightLog, file: str, given: Mapping[str, float]) -> set[str]:
    """Correct the log's sensors as the firmware would have by the parameters ``given`` in a ``file``.

    Returns the names of the parameters with an effect. Each sensor is reported in the log's problems.
    """
    differ, used = changed_parameters(log, given), set()
    if any(COMPASS_PARAMETERS.fullmatch(name) for name in differ):
        for mag in log.mags:
            used |= _recorrect_stream(log, file, mag.field, differ, partial(compass_recorrection, log, mag, differ))
    if any(ACCELEROMETER_PARAMETERS.fullmatch(name) for name in differ):
        for imu in log.imus:
            find = partial(accelerometer_recorrection, log, imu, differ)
            used |= _recorrect_stream(log, file, imu.acc, differ, find)
    return used


def calibrates(names: Iterable[str]) -> bool:
    """Return whether any of the parameters calibrates a compass or an accelerometer."""
    return any(COMPASS_PARAMETERS.fullmatch(name) or ACCELEROMETER_PARAMETERS.fullmatch(name) for name in names)


def recorrected_units(
    log: FlightLog, file: str, given: Mapping[str, float], imu: Imu, mag: Mag | None
) -> tuple[Imu, Mag | None]:
    """Return copies of an IMU and a compass corrected by :func:`recorrect`; the log is unchanged."""
    imus, mags = [replace(imu, acc=replace(imu.acc))], [] if mag is None else [replace(mag, field=replace(mag.field))]
    if not recorrect(replace(log, imus=imus, mags=mags, problems=[]), file, given):
        return imu, mag
    return imus[0], mags[0] if mags else None


def _recorrect_stream(
    log: FlightLog, file: str, stream: Stream, differ: Mapping[str, float], find: Callable[[], Recorrection | None]
) -> set[str]:
    """Correct a sensor's ``stream`` in place by the parameters ``differ``; return those with an effect."""
    try:
        found = find()
        if found is None:
            return set()
        stream.x = found.corrected(stream.t_best, stream.x)
    except CalibrationUnknownError as why:
        text = f"{stream.source} is not corrected by the calibration of {file}. {why}"
        log.problems.append(Problem("calibration_not_applied", "note", text))
        return set()
    changes = changes_text(log, found.changed, differ)
    text = f"{stream.source} is corrected by {changes} of {file}. The onboard attitude is as it flew."
    log.problems.append(Problem("calibration_applied", "note", text))
    return set(found.changed)


def changes_text(log: FlightLog, changed: Sequence[str], differ: Mapping[str, float]) -> str:
    """List changed parameters with both values: ``COMPASS_OFS_X 12 (was 5)``."""
    flew = flown_parameters(log)
    each = [f"{name} {differ[name]:.6g} (was {flew[name]:.6g})" for name in changed[:MAX_SHOWN]]
    return ", ".join(each) + (f" and {len(changed) - MAX_SHOWN} more" if len(changed) > MAX_SHOWN else "")
