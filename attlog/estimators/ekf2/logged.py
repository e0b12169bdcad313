"""Sigmas and innovations that EKF2 logged, in the layout of its re-run, to draw beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.ekf2.parameters import era_of
from attlog.estimators.ekf2.state import ERA_D
from attlog.estimators.rerun import INNOVATION, attitude_variances

if TYPE_CHECKING:
    from attlog.flight.px4.ekf2_inputs import Ekf2Inputs

Array = NDArray[np.float64]
# More records of the sigmas are thinned: up to 1.14 each takes a fit.
MAX_RECORDS = 500


def logged_tables(inputs: Ekf2Inputs) -> dict[str, Array]:
    """Return tables with times (s since boot) in the first column: ``sigma`` with tilt and heading (rad), innovations.

    Innovations are named as in a re-run's ``aux``; aids that were never fused are left out.
    """
    found = {}
    if inputs.states is not None:
        every = max(len(inputs.states.t) // MAX_RECORDS, 1)
        q, variances = inputs.states.states[::every, :4], inputs.states.covariances[::every, :4]
        found["sigma"] = np.column_stack([inputs.states.t[::every], _sigmas(q, variances, era_of(inputs.version))])
    for aid, values in inputs.innovations.items():
        if aid != "t" and np.any(np.nan_to_num(values) != 0.0):
            found[INNOVATION + aid] = np.column_stack([inputs.innovations["t"], values])
    return found


def _sigmas(q: Array, variances: Array, era: int) -> Array:
    """Return tilt and heading sigma (n, 2) in rad; up to 1.14 of the four variances of the quaternion."""
    if era == ERA_D:
        both = np.column_stack([variances[:, 0] + variances[:, 1], variances[:, 2]])
    else:
        fitted = np.array([attitude_variances(*row) for row in zip(q, variances, strict=True)]).reshape(-1, 2)
        both = fitted * (2.0, 1.0)
    return np.sqrt(np.maximum(both, 0.0))
