"""ArduPilot's EKF3, the filter that flew, run again on what it was given on board

State: attitude, velocity, position, gyro and accelerometer bias, earth and body magnetic field, wind; 23 errors, the
attitude's about earth axes.

    theta' = theta - R dt dbg        v' = v - [R f dt]x theta - R dt dba        p' = p + dt v
    K = P H' / (H P H' + R)          x <- x - K e          q <- exp(-K_theta e) * q

GNSS, compass, barometer and airspeed are fused late, at the horizon of the longest delay; an output predictor carries
the attitude to now. Parameters are the log's own; those set here are laid over them. The filter starts from the states
that the log holds, or from gravity where the log begins before the filter. It runs on ArduPilot logs alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from attlog.core.errors import UsageError
from attlog.estimators.ekf3 import parameters as ekf3
from attlog.estimators.ekf3.parameters import TABLE, full_name
from attlog.estimators.interface import LogInfo, Parameter

SOURCE = "ArduPilot libraries/AP_NavEKF3 (3.6 to 4.8), facts and equations"
NEEDS = {"gyro", "acc"}
PARAMETERS = tuple(
    Parameter(
        full_name(p.name), float(p.default), p.unit, float(p.low), float(p.high), p.meaning, "ArduPilot parameters"
    )
    for p in TABLE.values()
)


ALIASES = {name: full_name(short) for name, short in ekf3.ALIASES.items()}
NOT_OFFERED = ekf3.NOT_OFFERED


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float]:
    """Return the parameters that the vehicle flew with, where they lie in the documented range."""
    known = {own: params[name] for name, own in ALIASES.items() if name in params}
    known |= {full_name(name): params[full_name(name)] for name in TABLE if full_name(name) in params}
    ranges = {p.name: (p.low, p.high) for p in PARAMETERS}
    return {name: float(v) for name, v in known.items() if ranges[name][0] <= v <= ranges[name][1]}


def run(*_: Any) -> NoReturn:
    """Refuse arrays: the filter needs what the log holds beside its samples."""
    raise UsageError("ap_ekf3 runs on an ArduPilot log, not on arrays: attlog analyze LOG.bin --estimators ap_ekf3")
