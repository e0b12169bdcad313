"""PX4's EKF2, the filter that flew, run again on what it was given on board

State: attitude, velocity, position, gyro and accelerometer bias, earth and body magnetic field, wind; 23 errors, the
attitude's about earth axes.

    theta' = theta - R dt dbg        v' = v - [R f dt]x theta - R dt dba        p' = p + dt v
    K = P H' / (H P H' + R)          x <- x - K e          q <- exp(-K_theta e) * q

GNSS, magnetometer, barometer and airspeed are fused late, at the horizon of the longest delay; an output predictor
carries the attitude to now. Parameters are the log's own; those set here are laid over them. The filter starts from the
states that the log holds, or from gravity where the log begins at switch-on. It runs on PX4 logs alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from attlog.core.errors import UsageError
from attlog.estimators.ekf2 import parameters as ekf2
from attlog.estimators.ekf2.parameters import PREFIX, TABLE
from attlog.estimators.interface import LogInfo, Parameter

SOURCE = "PX4 src/modules/ekf2 and PX4-ECL EKF (1.8 to 1.18), facts and equations"
NEEDS = {"gyro", "acc"}
PARAMETERS = tuple(
    Parameter(
        PREFIX + p.name, float(p.default), p.unit, float(p.low), float(p.high), p.meaning, "PX4 parameter reference"
    )
    for p in TABLE.values()
)


ALIASES = {name: PREFIX + short for name, short in ekf2.ALIASES.items()}
NOT_OFFERED = ekf2.NOT_OFFERED


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float]:
    """Return the parameters that the vehicle flew with, where they lie in the documented range."""
    known = {own: params[name] for name, own in ALIASES.items() if name in params}
    known |= {PREFIX + name: params[PREFIX + name] for name in TABLE if PREFIX + name in params}
    ranges = {p.name: (p.low, p.high) for p in PARAMETERS}
    return {name: float(v) for name, v in known.items() if ranges[name][0] <= v <= ranges[name][1]}


def run(*_: Any) -> NoReturn:
    """Refuse arrays: the filter needs what the log holds beside its samples."""
    raise UsageError("px4_ekf2 runs on a PX4 log, not on arrays: attlog analyze LOG.ulg --estimators default,px4_ekf2")
