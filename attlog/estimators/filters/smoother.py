"""Fixed-interval smoother: every attitude from the whole log, and how sure it is.

    filter forward: attitude, velocity, position, biases, earth and body field, delays, lever arm (39 states)
    lam, Lam backward (modified Bryson-Frazier):  q_s = exp(-(P lam)_phi) q,   P_s = P - P Lam P

Five passes: each finds noise levels, delays and prior spreads from the log itself for the next, by the scores of the
disturbances; the last two are linearised along the pass before. Uses what there is of GNSS, barometer, magnetometer
and rest. Looks ahead: it is a reference and not a filter that could fly.

Without GNSS it is the model of ``mekf``, which expects the body not to fly away, with a backward pass (Rauch1965;
``inertial/backward.py``).

Source: Bierman1973 (backward pass), DeJongPenzer1998 (scores), Sola2017 (error state).
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from attlog.estimators.aids import Aids
from attlog.estimators.base import Array, Estimate, Parameter
from attlog.estimators.filters.inertial import backward
from attlog.estimators.filters.navigation import attitude, passes, quality
from attlog.estimators.filters.navigation.measured import made_ready
from attlog.estimators.filters.navigation.options import PRIORS, SOFT
from attlog.estimators.filters.navigation.settings import started

SOURCE = "Bierman1973; DeJongPenzer1998; Sola2017; Rauch1965"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "baro", "at_rest"}
STATE = {"q": 4, "bias": 3}
CAUSAL = False
PARAMETERS = (
    *PRIORS,
    SOFT,
    Parameter("passes", 5, "", 1, 12, "passes over the log; one calibrates nothing", "attlog"),
)
PRESETS: dict[str, dict[str, float | str]] = {}


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]) -> Estimate:
    """The smoothed attitude at ``t`` (n,) of one segment without gaps; ``mag`` has NaN rows where it has no sample."""
    clock = time.thread_time()
    if aids.velocity is None and aids.position is None:
        # Without GNSS nothing holds a position: the model that expects the body not to fly away.
        still = backward.smooth(t, gyr, acc, mag)
        return replace(still, quality=still.quality | {"refused": quality.refusal(still.quality)})
    inputs = made_ready(t, gyr, acc, mag, aids, np.deg2rad(float(params["declination"])), ahead=True)
    solution = passes.solved(inputs, started(params), float(params["soft_gate"]), int(params["passes"]))
    found = solution.found
    q, bias = attitude.smoothed_samples(found, inputs)
    tilt, heading = attitude.sigmas(inputs, found, found.spread)
    told = quality.quality(inputs, found, solution.tuned, tilt, heading) | quality.of_passes(solution)
    told["refused"] = quality.refusal(told)
    return Estimate(
        t=t,
        q=attitude.at_stamps(inputs, q, bias),
        bias=bias,
        aux={"sigma_tilt": tilt, "sigma_heading": heading, **attitude.test_ratios(found, len(t))},
        quality=told,
        ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1),
        causal=False,
    )
