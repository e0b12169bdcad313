"""Sigmas and innovations that EKF3 logged, in the layout of its re-run, to draw beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.rerun import INNOVATION, attitude_variances

if TYPE_CHECKING:
    from attlog.flight.ardupilot.ekf3_inputs import Ekf3Inputs

Array = NDArray[np.float64]
# More records of the sigmas are thinned: each takes a fit.
MAX_RECORDS = 500


def logged_tables(inputs: Ekf3Inputs) -> dict[str, Array]:
    """Return tables with times (s since boot) in the first column: ``sigma`` with tilt and heading (rad), innovations.

    Innovations are named as in a re-run's ``aux``; aids that were never fused are left out.
    """
    found: dict[str, Array] = {}
    states = inputs.states
    if states is not None and len(states.t) and len(states.t_variances):
        every = max(len(states.t_variances) // MAX_RECORDS, 1)
        t, variances = states.t_variances[::every], states.variances[::every, :4]
        q = states.x[np.clip(np.searchsorted(states.t, t), 0, len(states.t) - 1), :4]
        fitted = np.array([attitude_variances(*one) for one in zip(q, variances, strict=True)]).reshape(-1, 2)
        found["sigma"] = np.column_stack([t, np.sqrt(np.maximum(fitted * (2.0, 1.0), 0.0))])
    for aid, values in inputs.innovations.items():
        if aid != "t" and np.any(np.nan_to_num(values) != 0.0):
            found[INNOVATION + aid] = np.column_stack([inputs.innovations["t"], values])
    return found
