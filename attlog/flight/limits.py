"""Physical limits of measured quantities and parameters.

Logs are damaged, and drivers, parameters and clocks go wrong: a height of 1e30 m is a good float. Every value that a
reader takes is compared with this table (:class:`~attlog.flight.builder.LogBuilder`), left out where it lies outside,
and counted. Limits are those of sensors, of the earth and of what flies, wide enough for any flight; ``attlog/health``
judges what is merely wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S, MAG_LIMIT_T
from attlog.flight.model import Problem
from attlog.formats.table import Messages, ParamChange

Array = NDArray[np.float64]


class Quantity(NamedTuple):
    """Physical range of a quantity, ``low`` to ``high`` in ``unit``, with its reason ``why``.

    ``minor``: values outside stand for unknown, or only describe the autopilot's own state.
    """

    name: str
    low: float
    high: float
    unit: str
    why: str
    minor: bool = False

    def outside(self, x: Array) -> NDArray[np.bool_]:
        """Mark the values of x (any shape) outside the range; NaN is not outside."""
        beyond: NDArray[np.bool_] = (x < self.low) | (x > self.high)
        return beyond

    @property
    def limits(self) -> str:
        """The range as text with its unit."""
        low, high = (f"{x:,.10g}".replace("-", "−") for x in (self.low, self.high))
        return f"{low} to {high} {self.unit}".rstrip()


def _symmetric(name: str, limit: float, unit: str, why: str) -> Quantity:
    return Quantity(name, -limit, limit, unit, why)


GYRO = _symmetric("gyro", GYRO_LIMIT_RAD_S, "rad/s", "no gyro of an autopilot measures beyond 4,000 deg/s")
ACC = _symmetric("accelerometer", ACC_LIMIT_M_S2, "m/s^2", "no accelerometer of an autopilot measures beyond 200 g")
FIELD = _symmetric("magnetic field", MAG_LIMIT_T, "T", "the earth's field is below 70 uT, and a compass ends near 5 mT")
TEMPERATURE = Quantity("sensor temperature", -100.0, 200.0, "degC", "no chip works there")

LATITUDE = _symmetric("GNSS latitude", 90.0, "deg", "poles")
LONGITUDE = _symmetric("GNSS longitude", 180.0, "deg", "date line")
HEIGHT = Quantity("GNSS height", -1_000.0, 100_000.0, "m", "the Dead Sea lies at −430 m, balloons burst below 54 km")
SPEED = _symmetric(
    "GNSS speed", 1_000.0, "m/s", "receivers stop at 515 m/s, and nothing with these autopilots is faster"
)
PLACE_ACCURACY = Quantity("GNSS position accuracy", 0.0, 1e5, "m", "worse is no position")
SPEED_ACCURACY = Quantity("GNSS speed accuracy", 0.0, 1e4, "m/s", "worse is no speed")
SATELLITES = Quantity("satellites", 0.0, 100.0, "", "no receiver uses more; 255 is unknown", minor=True)
HDOP = Quantity("horizontal dilution of precision", 0.1, 50.0, "", "99.99 and more stand for unknown", minor=True)
GNSS_YAW = _symmetric("GNSS heading", 2.0 * math.pi, "rad", "one turn")
ESTIMATED_YAW = _symmetric("estimated heading", 2.0 * math.pi, "rad", "one turn")

ESTIMATED_HEIGHT = _symmetric(
    "estimated height", 100_000.0, "m", "nothing with these autopilots climbs or dives so far"
)
ESTIMATED_SPEED = Quantity("estimated speed", 0.0, 1_000.0, "m/s", "no vehicle is faster")

BARO = Quantity("barometric height", -5_000.0, 100_000.0, "m", "pressures between 1 and 1,800 hPa")
RANGE = Quantity("distance to the ground", 0.0, 5_000.0, "m", "no rangefinder of an autopilot reaches further")
AIRSPEED = Quantity("airspeed", -100.0, 1_000.0, "m/s", "no pitot tube of an autopilot measures more")
STICK = _symmetric("stick", 1.5, "", "1 is full; calibration ends are exceeded by a tenth")
THROTTLE = _symmetric("throttle", 10.0, "", "1 is full")
SHARE_IN_USE = Quantity("processor load", 0.0, 1.0, "", "a processor has no more time and memory than all", minor=True)
RPM = _symmetric("rotor speed", 1e6, "rpm", "small motors reach 100,000, counted electrically 7 times that")
VOLTAGE = Quantity("battery voltage", 0.0, 1_000.0, "V", "no vehicle with these autopilots carries more")
CURRENT = _symmetric("battery current", 10_000.0, "A", "no battery of a vehicle gives more")
RATE_SETPOINT = _symmetric("rate set-point", 200.0, "rad/s", "twice what a gyro can measure")
ACC_BIAS = _symmetric("accelerometer bias", 10.0, "m/s^2", "estimators bound theirs far below 1 g")
GYRO_BIAS = _symmetric("gyro bias", 10.0, "rad/s", "estimators bound theirs below 0.5 rad/s")
VIBRATION = Quantity("vibration", 0.0, ACC_LIMIT_M_S2, "m/s^2", "no accelerometer measures more")
TEST_RATIO = Quantity("test ratio", 0.0, 1e6, "", "a thousand standard deviations, squared", minor=True)
QUATERNION_NORM = Quantity(
    "norm of the quaternion", 0.95, 1.05, "", "an attitude has norm 1; float16 and integers of 16 bits keep it to 0.001"
)
EULER_DEG = _symmetric("Euler angle", 720.0, "deg", "two turns, as estimators that do not wrap write them")

UTC_US = Quantity(
    "GNSS date",
    1_262_304_000_000_000,
    4_102_444_800_000_000,
    "us",
    "before 2010 no autopilot wrote such logs, and 2100 is not yet; a receiver whose week counter has turned over is "
    "1,024 weeks behind",
)

# Highest plausible rates of raw gyro samples (real: 32 kHz), of a control loop's output (8 kHz), and of GNSS and
# battery (100 Hz). A higher rate shows stamps of another unit (ms read as us).
RAW_HZ, FUSED_HZ, AIDING_HZ = 40_000.0, 10_000.0, 500.0
# Highest rate of accelerometer samples, of which clipped ones are counted for each axis or once (real: 8 kHz).
CLIPPED_HZ = 8_000.0
# Records further from the first sample belong to another flight or have a false time; boats run for a day.
MAX_LOG_S = 3 * 86_400.0
# Fewest records from which a rate is computed.
ENOUGH_FOR_A_RATE = 20


# --- parameters that attlog computes with ------------------------------------------------------------------------
#
# Damaged logs hold a declination of 1e39 deg, or a filter at 1e-38 Hz. Limits are those of the firmware's parameter
# tables or of the quantity, whichever is wider.

CUTOFF = Quantity("cutoff frequency", 1.0, 10_000.0, "Hz", "no filter of an autopilot is slower or faster; 0 is none")
_TURN = Quantity("angle", -360.0, 360.0, "deg", "one turn")
_GAIN = Quantity("gain", 0.0, 100.0, "", "the firmware's own largest is 10")

# Pattern of the whole name, and limits. Other parameters are shown and compared, but not used in computations.
PARAMETER_LIMITS: tuple[tuple[str, Quantity], ...] = (
    (r"EKF2_MAG_DECL|ATT_MAG_DECL", Quantity("declination", -180.0, 180.0, "deg", "half a turn")),
    (r"COMPASS_DEC", Quantity("declination", -math.pi, math.pi, "rad", "half a turn")),
    (r"AHRS_TRIM_[XYZ]", Quantity("trim", -math.pi / 2, math.pi / 2, "rad", "the firmware keeps it below 0.175")),
    (r"INS_GYRO_FILTER|INS_ACCEL_FILTER|IMU_GYRO_CUTOFF|IMU_ACCEL_CUTOFF", CUTOFF),
    (r"CAL_GYRO\d_[XYZ]OFF", Quantity("gyro offset", -10.0, 10.0, "rad/s", "a gyro that is so far off is broken")),
    (r"CAL_ACC\d_[XYZ]OFF", Quantity("accelerometer offset", -100.0, 100.0, "m/s^2", "ten times gravity")),
    (r"CAL_MAG\d_[XYZ]OFF", Quantity("compass offset", -50.0, 50.0, "gauss", "a hundred times the earth's field")),
    (r"CAL_(ACC|MAG)\d_[XYZ](SCALE|ODIAG)", Quantity("scale", -20.0, 20.0, "", "calibrations change it by percents")),
    (r"CAL_(GYRO|ACC|MAG)\d_ROT", Quantity("rotation", -1.0, 200.0, "", "no mounting has such a number")),
    (r"SENS_BOARD_ROT", Quantity("rotation", -1.0, 200.0, "", "no mounting has such a number")),
    (r"CAL_MAG\d_(ROLL|PITCH|YAW)|SENS_BOARD_[XYZ]_OFF", _TURN),
    (r"(MOT_PWM|RC\d+)_(MIN|MAX)", Quantity("pulse", 0.0, 10_000.0, "us", "servos take 800 to 2,200")),
    (r"ATT_W_(ACC|MAG|GYRO_BIAS)|ATT_BIAS_MAX|AHRS_(RP|YAW)_P|AHRS_GPS_GAIN", _GAIN),
    (
        r"FRAME_CLASS|SYSID_SW_TYPE|RCMAP_THROTTLE|INS_RAW_LOG_OPT",
        Quantity("choice", -1.0, 65_535.0, "", "16 bits hold every choice of the firmware"),
    ),
    (r"SCHED_LOOP_RATE", Quantity("loop rate", 0.0, 32_000.0, "Hz", "no autopilot loops faster than a gyro samples")),
)
# Most parameters that a problem names.
MAX_NAMED = 4
_PARAMETER_PATTERN = re.compile("|".join(f"({pattern.replace('(', '(?:')})" for pattern, _ in PARAMETER_LIMITS))


def parameter_quantity(name: str) -> Quantity | None:
    """Return the limits of a parameter, None if attlog does not compute with it."""
    found = _PARAMETER_PATTERN.fullmatch(name)
    return None if found is None or found.lastindex is None else PARAMETER_LIMITS[found.lastindex - 1][1]


def broken_limits(name: str, value: float) -> Quantity | None:
    """Return the limits that a value violates, None if possible.

    Cutoff frequencies of 0 and -1 (disabled) are possible.
    """
    quantity = parameter_quantity(name)
    if quantity is None or (quantity is CUTOFF and -1.0 <= value <= 0.0):
        return None
    return None if quantity.low <= value <= quantity.high else quantity


def drop_impossible(messages: Messages) -> list[Problem]:
    """Remove impossible values from a log's parameters, and return a problem for each quantity."""
    limited = {name for name in {change.name for change in messages.params} if parameter_quantity(name) is not None}
    kept: list[ParamChange] = []
    wrong: dict[str, list[ParamChange]] = {}
    for change in messages.params:
        if change.name not in limited or broken_limits(change.name, change.value) is None:
            kept.append(change)
        else:
            wrong.setdefault(change.name, []).append(change)
    if wrong:
        messages.params[:] = kept
    alike: dict[Quantity, list[str]] = {}
    for name in wrong:
        quantity = parameter_quantity(name)
        assert quantity is not None
        alike.setdefault(quantity, []).append(name)
    return [_limit_problem(quantity, names, wrong, kept) for quantity, names in alike.items()]


def _limit_problem(
    quantity: Quantity, names: list[str], wrong: dict[str, list[ParamChange]], kept: Iterable[ParamChange]
) -> Problem:
    """Return the problem that reports impossible values of one quantity's parameters."""
    changes = [change for name in names for change in wrong[name]]
    count = len(changes) + sum(change.name in names for change in kept)
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    who = (
        f"Parameter {names[0]}"
        if len(names) == 1
        else f"{len(names)} parameters ({', '.join(names[:MAX_NAMED])}{more})"
    )
    many = f"{len(changes)} of {count} values, such as {changes[0].value:g}" if count > 1 else f"{changes[0].value:g}"
    text = f"{who}: left out {many}: the {quantity.name} lies "
    text += f"within {quantity.limits} ({quantity.why})."
    return Problem("values_out_of_range", "warning", text, offset=changes[0].offset, count=len(changes))


# --- parameters that attlog offers -------------------------------------------------------------------------------
#
# Documented ranges: ``@Range`` of ArduPilot, ``@min`` and ``@max`` of PX4. PX4 documents none for offsets: there it is
# what ArduPilot documents, or a few times the earth's field. Of several versions the narrowest counts.

# Pattern of the whole name, lowest and highest value.
DOCUMENTED_RANGES: tuple[tuple[str, float, float], ...] = (
    (r"COMPASS_OFS[23]?_[XYZ]", -400.0, 400.0),
    (r"COMPASS_MOT[23]?_[XYZ]", -1000.0, 1000.0),
    (r"COMPASS_MOTCT", 0.0, 2.0),
    (r"COMPASS_USE[23]?", 0.0, 1.0),
    (r"COMPASS_DEC", -3.142, 3.142),
    (r"INS_ACC[23]?OFFS_[XYZ]|INS[45]_ACCOFFS_[XYZ]", -3.5, 3.5),
    (r"INS_ACC[23]?SCAL_[XYZ]|INS[45]_ACCSCAL_[XYZ]", 0.8, 1.2),
    (r"INS_GYRO_FILTER|INS_ACCEL_FILTER", 0.0, 256.0),
    (r"INS_HNT(CH|C2)_ENABLE", 0.0, 1.0),
    (r"INS_HNT(CH|C2)_MODE", 0.0, 5.0),
    (r"INS_HNT(CH|C2)_FREQ", 10.0, 400.0),
    (r"INS_HNT(CH|C2)_BW", 5.0, 250.0),
    (r"INS_HNT(CH|C2)_ATT", 5.0, 50.0),
    (r"INS_HNT(CH|C2)_REF", 0.0, 1.0),
    (r"INS_HNT(CH|C2)_FM_RAT", 0.1, 1.0),
    (r"INS_HNT(CH|C2)_HMNCS", 0.0, 65_535.0),
    (r"INS_HNT(CH|C2)_OPTS", 0.0, 63.0),
    (r"INS_TCAL[123]_ENABLE", 0.0, 2.0),
    (r"GPS_DELAY_MS2?|GPS[12]_DELAY_MS|EK[23]_HGT_DELAY", 0.0, 250.0),
    (r"EK[23]_MAG_M_NSE", 0.01, 0.5),
    (r"EK[23]_VELN?E?D?_M_NSE", 0.05, 5.0),
    (r"EK[23]_POSNE_M_NSE", 0.1, 10.0),
    (r"EK2_ALT_M_NSE", 0.1, 10.0),
    (r"EK3_ALT_M_NSE", 0.1, 100.0),
    (r"EK[23]_EAS_M_NSE", 0.5, 5.0),
    (r"COMPASS_ORIENT[23]?", 0.0, 43.0),
    (r"CAL_MAG\d_ROT", -1.0, 40.0),
    (r"CAL_MAG\d_[XYZ]OFF", -2.0, 2.0),
    (r"CAL_MAG\d_[XYZ]COMP", -100.0, 100.0),
    (r"CAL_MAG_COMP_TYP", 0.0, 3.0),
    (r"CAL_MAG\d_PRIO", 0.0, 100.0),
    (r"CAL_ACC\d_[XYZ]OFF", -3.5, 3.5),
    (r"IMU_GYRO_NF\d?_FR(EQ|Q)", 0.0, 1000.0),
    (r"IMU_GYRO_NF\d?_BW", 0.0, 100.0),
    (r"IMU_GYRO_DNF_EN", 0.0, 3.0),
    (r"IMU_GYRO_DNF_BW", 5.0, 30.0),
    (r"IMU_GYRO_DNF_HMC", 1.0, 7.0),
    (r"IMU_GYRO_CUTOFF|IMU_ACCEL_CUTOFF", 0.0, 1000.0),
    (r"EKF2_(GPS|MAG|BARO|ASP|OF|RNG|EV)_DELAY|SENS_GPS\d_DELAY", 0.0, 300.0),
    (r"EKF2_MAG_NOISE", 0.001, 1.0),
    (r"EKF2_HEAD_NOISE", 0.01, 1.0),
    (r"EKF2_GPS_V_NOISE", 0.01, 5.0),
    (r"EKF2_GPS_P_NOISE", 0.01, 10.0),
    (r"EKF2_BARO_NOISE", 0.01, 15.0),
    (r"EKF2_EAS_NOISE", 0.5, 5.0),
)
# Integer parameters: type int32 in QGroundControl's parameter files.
INTEGER_PARAMETERS = re.compile(
    r"COMPASS_(ORIENT[23]?|MOTCT|USE[23]?|PRIO\d_ID)|INS_HNT(CH|C2)_(ENABLE|MODE|HMNCS|OPTS)|INS_TCAL\d_ENABLE"
    r"|GPS\d?_DELAY_MS2?|EK[23]_HGT_DELAY|CAL_MAG_COMP_TYP|CAL_(MAG|ACC|GYRO)\d_(PRIO|ROT|ID)|IMU_GYRO_DNF_(EN|HMC)"
)


def documented_range(name: str) -> tuple[float, float] | None:
    """Return the documented range of a parameter, None if attlog never proposes a value."""
    return next(((low, high) for pattern, low, high in DOCUMENTED_RANGES if re.fullmatch(pattern, name)), None)


def is_integer(name: str) -> bool:
    """Return whether a parameter holds a whole number."""
    return INTEGER_PARAMETERS.fullmatch(name) is not None
