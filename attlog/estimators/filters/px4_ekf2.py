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

from typing import Any, NoReturn

from attlog.core.errors import UsageError
from attlog.estimators.ekf2.parameters import TABLE

SOURCE = "PX4 src/modules/ekf2 and PX4-ECL EKF (1.8 to 1.18), facts and equations"
NEEDS = {"gyro", "acc"}
PARAMETERS = TABLE.declared
ALIASES, NOT_OFFERED = TABLE.renamed, TABLE.not_offered
from_log = TABLE.flown


def run(*_: Any) -> NoReturn:
    """Refuse arrays: the filter needs what the log holds beside its samples."""
    raise UsageError("px4_ekf2 runs on a PX4 log, not on arrays: attlog analyze LOG.ulg --estimators default,px4_ekf2")
