"""How closely EKF2 and EKF3 run again follow what flew, and whether planted faults are found.

``python benchmarks/rerun.py LOG ...`` prints a row a log: firmware, logged rates of IMU, field and GNSS, aids, how it
started, differences of tilt and heading to the onboard attitude in the air as median / 95 % in deg, in which mode a
parameter is studied, re-run over logged sigmas, CPU per 100 s. Medians of the sigmas' ratios end the table.

``python benchmarks/rerun.py --planted LOG ...`` (simulated PX4 flights with truth) prints a row a flight: RMS error
against truth, re-run minus onboard; median difference of the gyro bias; the delays, compass offset and noises that the
innovations give back after they were planted; how the effect of a parameter on a log that is thinned to 2 Hz of field
and GNSS correlates with that on the full one; the difference to onboard with half the IMU's rate.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.estimators.ekf2.logged import logged_tables
from attlog.estimators.rerun import Rerun
from attlog.pipeline import onboard_rerun
from attlog.pipeline.onboard_rerun import flown_filter, inputs_of, reproduction, run_again

Array = NDArray[np.float64]
# First seconds after a start, which are not compared.
SETTLING_S = 20.0
SIGMAS = ("tilt", "yaw", "v", "bg_xy", "bg_z", "ba")


def sigma_ratios(found: Rerun, inputs: Any) -> Array:
    """Return medians of re-run over logged sigmas, NaN where none is logged: of :data:`SIGMAS`, of EKF3 all but tilt
    and yaw, and there of the first accelerometer axis' variance in place of ``ba``."""
    ratios = np.full(len(SIGMAS), np.nan)
    if inputs.states is None:
        return ratios
    var = found.states
    if "era" in found.facts:
        late = found.facts["era"] > 2
        t, first = inputs.states.t, 3 if late else 4
        logged = inputs.states.covariances[:, first : first + 12].copy()
        logged[:, 6:] /= 1.0 if late else found.facts["step_s"] ** 2
        ours = [var["velocity_variance"], var["velocity_variance"], var["gyro_bias_variance"], var["acc_bias_variance"]]
        columns = ([0, 1], [6, 7], [8], [9, 10, 11])
        own = ([0, 1], [0, 1], [2], [0, 1, 2])
        ours[0] = var["velocity_variance"]
        pairs = [(ours[0], own[0]), (ours[2], own[1]), (ours[2], own[2]), (ours[3], own[3])]
        names: Sequence[int] = (2, 3, 4, 5)
    else:
        t, logged = inputs.states.t_variances, inputs.states.variances
        scaled = var["gyro_bias_variance"] * found.facts["step_s"] ** 2
        columns, pairs = ([4, 5], [10, 11], [12]), [(var["velocity_variance"], [0, 1]), (scaled, [0, 1]), (scaled, [2])]
        names = (2, 3, 4)
    for name, column, (ours_of, axes) in zip(names, columns, pairs, strict=True):
        ratios[name] = ratio(found, t, ours_of[:, axes].sum(axis=1), logged[:, column].sum(axis=1))
    if "era" in found.facts:
        table = logged_tables(inputs)["sigma"]
        attitude = var["attitude_variance"]
        ratios[0] = ratio(found, table[:, 0], attitude[:, :2].sum(axis=1), table[:, 1] ** 2)
        ratios[1] = ratio(found, table[:, 0], attitude[:, 2], table[:, 2] ** 2)
    return ratios
