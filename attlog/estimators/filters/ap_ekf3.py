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

from typing import Any, NoReturn

from attlog.core.errors import UsageError
from attlog.estimators.ekf3.parameters import TABLE

SOURCE = "ArduPilot libraries/AP_NavEKF3 (3.6 to 4.8), facts and equations"
NEEDS = {"gyro", "acc"}
PARAMETERS = TABLE.declared
ALIASES, NOT_OFFERED = TABLE.renamed, TABLE.not_offered
from_log = TABLE.flown


def run(*_: Any) -> NoReturn:
    """Refuse arrays: the filter needs what the log holds beside its samples."""
    raise UsageError("ap_ekf3 runs on an ArduPilot log, not on arrays: attlog analyze LOG.bin --estimators ap_ekf3")
