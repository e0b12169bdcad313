"""Error-state Kalman filter with GNSS, barometer, magnetometer and rest, 39 states.

    q' = q x exp((gyr - b_g)(1 - s_g) dt),   v' = R (acc - b_a) + g,   p' = v
    aids: GNSS velocity and position (delay, lever arm, wander), height, field (I + S) R^T M + b_m, rest (v = 0)

Innovations are gated softly at 2.5 sigma and refused at 30; what is refused for long opens the covariance, and a field
that does not fit for a while opens the hard iron.

Attitudes are causal: each stands on samples up to its own time (a delayed aid acts when it came, and the gyro carries
the attitude from there). ``constants=log`` (default): noise levels, delays, prior spreads, scale factors (gyro, soft
iron) and the antenna's lever arm are constants of the sensors that the smoother finds in the log (of one above 400 s
in those 400 s that turn most), as a tuned vehicle has them; ``fixed``: the defaults, nothing of the future;
``calibrated``: also biases, hard iron and declination start where the smoother puts them, which no vehicle knows. Less
than 30 s of GNSS keeps the defaults.

Source: Sola2017 (error state, here with the error in earth axes).
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from attlog.estimators.aids import Aids
from attlog.estimators.base import Array, Estimate, Parameter
from attlog.estimators.filters.navigation import attitude, passes
from attlog.estimators.filters.navigation.layout import BG
from attlog.estimators.filters.navigation.measured import made_ready
from attlog.estimators.filters.navigation.settings import GATE, PRIORS, started

SOURCE = "Sola2017"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "baro", "at_rest"}
STATE = {"q": 4, "bias": 3}
PARAMETERS = (
    *PRIORS,
    GATE,
    Parameter(
        "constants",
        "log",
        "",
        0,
        1,
        "noise levels, delays and prior spreads: of the whole log, the defaults, or with biases and compass as well",
        "attlog; fixed looks at nothing to come",
        ("log", "fixed", "calibrated"),
    ),
)
PRESETS: dict[str, dict[str, float | str]] = {
    "fixed": {"constants": "fixed"},
    "calibrated": {"constants": "calibrated"},
}
BEGUN_WITH: dict[str, tuple[str, ...]] = {
    "log": ("soft", "scale", "arm"),
    "fixed": (),
    "calibrated": tuple(passes.CONSTANTS),
}
TOLD_S = 400.0
"""Of a longer log so much is looked at for the constants, where it turns most (measured: docs/smoother.md)."""
LEAST_GNSS_S = 30.0
"""Less tells no delay and no noise."""
MARGIN_S = 0.6
"""Aids act this much after they were true at least: rest is known half a second later."""


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]) -> Estimate:
    """The filtered attitude at ``t`` (n,) of one segment without gaps; ``mag`` has NaN rows where it has no sample."""
    clock = time.thread_time()
    fixes, constants = aids.velocity, params["constants"]
    looks = constants != "fixed" and fixes is not None and fixes.t[-1] - fixes.t[0] >= LEAST_GNSS_S
    inputs = made_ready(t, gyr, acc, mag, aids, np.deg2rad(float(params["declination"])), ahead=looks)
    del mag  # a long log's is large, and its means are in the inputs
    tuned, gate = started(params), float(params["soft_gate"])
    known = None
    if looks:
        solution = passes.solved(passes.telling(inputs, TOLD_S), tuned, gate, spread=False)
        tuned, known = passes.held(solution.next), solution.begin.x + solution.found.first
        del solution  # with what its passes stored
    found, begin, jumps = passes.causal(inputs, tuned, gate, known, BEGUN_WITH[str(constants)])
    bias = found.bias[attitude.node_before(found, len(t))]
    horizon = inputs.lag + MARGIN_S + max(tuned.gnss_delay, tuned.mag_delay, 0.0)
    q = attitude.predicted(inputs, found.q, bias, begin.x[BG : BG + 3], horizon)
    found.q, found.bias = found.q[:0].copy(), found.bias[:0].copy()  # in long logs copies add up
    tilt, heading = attitude.sigmas(inputs, found, found.variance)
    told = attitude.quality(inputs, found, tuned, tilt, heading)
    told |= attitude.quality_of_jumps(jumps)
    told["constants"] = str(constants) if looks or constants == "fixed" else "fixed"
    return Estimate(
        t=t,
        q=q,
        bias=bias,
        aux={"sigma_tilt": tilt, "sigma_heading": heading, **attitude.test_ratios(found, len(t))},
        quality=told,
        ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1),
    )
