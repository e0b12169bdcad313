"""What would the compasses and accelerometers of a log have shown with a file's calibration?

The logged values go back to raw ones by the parameters that flew, and forward by those of the file. What flew on them,
the onboard attitude above all, stays as it is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from attlog.flight.calibration import flown
from attlog.flight.calibration.correction import Calibration, CalibrationUnknownError
from attlog.flight.model import Array, FlightLog, Imu, Mag, Problem, Stream

COMPASS = re.compile(r"COMPASS_(OFS|DIA|ODI|SCALE|MOT).*|CAL_MAG\d_.(OFF|SCALE|ODIAG|COMP)|CAL_MAG_COMP_TYP")
ACCELEROMETER = re.compile(r"INS\d?_ACC\d?(OFFS|SCAL)_.|CAL_ACC\d_.(OFF|SCALE)")
"""Parameters that calibrate one of them."""
SHOWN = 3
"""So many parameters of a sensor are named."""

Known = Callable[[dict[str, float] | None], Calibration]
Bias = Callable[[Calibration], Array]


def recorrect(log: FlightLog, file: str, given: Mapping[str, float]) -> set[str]:
    """Correct the log's sensors as the firmware would have by the parameters ``given`` in a ``file``.

    Names of those that did something; the log's problems say of each sensor what was done, or why nothing was.
    """
    flew, used = flown.values(log), set()
    differ = {name: value for name, value in given.items() if name in flew and not _same(value, flew[name])}
    if any(COMPASS.fullmatch(name) for name in differ):
        for mag in log.mags:
            known, bias = partial(flown.compass, log, mag), partial(flown.learnt_bias, log, mag)
            used |= _recorrected(log, file, mag.field, differ, known, bias)
    if any(ACCELEROMETER.fullmatch(name) for name in differ):
        for imu in log.imus:
            used |= _recorrected(log, file, imu.acc, differ, partial(flown.accelerometer, log, imu), _nothing)
    return used


def calibrates(names: Iterable[str]) -> bool:
    """Whether any of the parameters calibrates a compass or an accelerometer."""
    return any(COMPASS.fullmatch(name) or ACCELEROMETER.fullmatch(name) for name in names)


def units_with(
    log: FlightLog, file: str, given: Mapping[str, float], imu: Imu, mag: Mag | None
) -> tuple[Imu, Mag | None]:
    """An IMU and a compass of a log as :func:`recorrect` makes them; the log's own stay as they are."""
    imus, mags = [replace(imu, acc=replace(imu.acc))], [] if mag is None else [replace(mag, field=replace(mag.field))]
    if not recorrect(replace(log, imus=imus, mags=mags, problems=[]), file, given):
        return imu, mag
    return imus[0], mags[0] if mags else None


def _same(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-9)


def _nothing(_: Calibration) -> Array:
    return np.zeros(3)


def _recorrected(
    log: FlightLog, file: str, stream: Stream, differ: Mapping[str, float], known: Known, bias: Bias
) -> set[str]:
    """Correct one sensor's ``stream`` in place by what is ``differ``ent in a file; the parameters that did it."""
    flew = flown.values(log)
    try:
        old = known(None)
        changed = [name for name in differ if name in old.names]
        if not changed:
            return set()
        if turned := [name for name in differ if name in old.fixed]:
            raise CalibrationUnknownError(f"{turned[0]} differs too: which sensor is meant, or its axes, is not known.")
        new = known({**flew, **differ})
        before, after = (
            flown.power(log, each.motor_power, stream.t_best) if each.correction.motor.any() else 0.0
            for each in (old, new)
        )
        # What the firmware had learnt beside the old parameters goes with them.
        stream.x = new.correction.body(old.correction.raw(stream.x - bias(old), before), after)
    except CalibrationUnknownError as why:
        text = f"{stream.source} is not corrected by the calibration of {file}. {why}"
        log.problems.append(Problem("calibration_not_applied", "note", text))
        return set()
    each = [f"{name} {differ[name]:.6g} (was {flew[name]:.6g})" for name in changed[:SHOWN]]
    more = f" and {len(changed) - SHOWN} more" if len(changed) > SHOWN else ""
    text = f"{stream.source} is corrected by {', '.join(each)}{more} of {file}. The onboard attitude is as it flew."
    log.problems.append(Problem("calibration_applied", "note", text))
    return set(changed)
