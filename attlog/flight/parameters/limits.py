"""Which values can the parameters have that attlog computes with?

A parameter is a float in a log like any other: damage makes a declination of 1e39 deg or
a filter at 1e-38 Hz of it, whose delay would be longer than the universe is old. Limits
are those of the firmware's own parameter tables or of the quantity, whichever is wider.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from attlog.flight.model import Problem
from attlog.flight.physics import Quantity
from attlog.formats.base import Messages, ParamChange

CUTOFF = Quantity("cutoff frequency", 1.0, 10_000.0, "Hz", "no filter of an autopilot is slower or faster; 0 is none")
_TURN = Quantity("angle", -360.0, 360.0, "deg", "one turn")
_GAIN = Quantity("gain", 0.0, 100.0, "", "the firmware's own largest is 10")

LIMITS: tuple[tuple[str, Quantity], ...] = (
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
"""By the whole name. Parameters that are not here are shown and compared, not computed with."""
NAMED = 4
"""Of many parameters with impossible values, so many are named."""
_ALL = re.compile("|".join(f"({pattern.replace('(', '(?:')})" for pattern, _ in LIMITS))


def quantity_of(name: str) -> Quantity | None:
    """The limits of a parameter, None for one that attlog does not compute with."""
    found = _ALL.fullmatch(name)
    return None if found is None or found.lastindex is None else LIMITS[found.lastindex - 1][1]


def impossible(name: str, value: float) -> Quantity | None:
    """The limits that a value breaks, None where it is possible. A filter that is off (0 or less) is."""
    quantity = quantity_of(name)
    if quantity is None or (quantity is CUTOFF and -1.0 <= value <= 0.0):
        return None
    return None if quantity.low <= value <= quantity.high else quantity


def refuse(messages: Messages) -> list[Problem]:
    """Take impossible values out of a log's parameters; one problem for each quantity that had any."""
    limited = {name for name in {change.name for change in messages.params} if quantity_of(name) is not None}
    kept: list[ParamChange] = []
    wrong: dict[str, list[ParamChange]] = {}
    for change in messages.params:
        if change.name not in limited or impossible(change.name, change.value) is None:
            kept.append(change)
        else:
            wrong.setdefault(change.name, []).append(change)
    if wrong:
        messages.params[:] = kept
    alike: dict[Quantity, list[str]] = {}
    for name in wrong:
        quantity = quantity_of(name)
        assert quantity is not None
        alike.setdefault(quantity, []).append(name)
    return [_problem(quantity, names, wrong, kept) for quantity, names in alike.items()]


def _problem(
    quantity: Quantity, names: list[str], wrong: dict[str, list[ParamChange]], kept: Iterable[ParamChange]
) -> Problem:
    """One sentence for the parameters of a quantity that had impossible values."""
    changes = [change for name in names for change in wrong[name]]
    count = len(changes) + sum(change.name in names for change in kept)
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    who = f"Parameter {names[0]}" if len(names) == 1 else f"{len(names)} parameters ({', '.join(names[:NAMED])}{more})"
    many = f"{len(changes)} of {count} values, such as {changes[0].value:g}" if count > 1 else f"{changes[0].value:g}"
    text = f"{who}: left out {many}: the {quantity.name} lies "
    text += f"within {quantity.limits} ({quantity.why})."
    return Problem("values_out_of_range", "warning", text, offset=changes[0].offset, count=len(changes))
