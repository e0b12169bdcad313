"""Error-state Kalman filter with GNSS, barometer, magnetometer and rest, 39 states.

    q' = q x exp((gyr - b_g)(1 - s_g) dt),   v' = R (acc - b_a) + g,   p' = v
    aids: GNSS velocity and position (delay, lever arm, wander), height, field (I + S) R^T M + b_m, rest (v = 0)

Innovations are gated softly at 2.5 sigma and refused at 30; what is refused for long opens the covariance, and a field
that does not fit for a while opens the hard iron. Without GNSS it is ``mekf``.

Each attitude rests on samples up to its own time (a delayed aid acts when it came, and the gyro carries the attitude
from there). ``constants`` says where noise levels, delays and prior spreads come from:

    past (default)     estimated on the way from the past (``navigation/passes.py``)
    fixed              the defaults
    whole_log          of all of the log, as a tuned vehicle has them, with scale factors (gyro, soft iron) and the
                       antenna's lever arm: knows what comes
    whole_log_biases   also biases, hard iron and declination start where the smoother puts them: knows what comes

The last two keep the defaults where GNSS lasts for less than 30 s.

Source: Sola2017 (error state, here with the error in earth axes).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from attlog.estimators.aids import Aids
from attlog.estimators.filters.navigation import attitude, passes
from attlog.estimators.filters.navigation.inputs import GATE, PRIORS, Inputs, prepare_inputs, started
from attlog.estimators.filters.navigation.model import E
from attlog.estimators.interface import Array, Estimate, choice

SOURCE = "Sola2017"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "baro", "airspeed", "at_rest"}
WITHOUT_GNSS = "mekf"
STATE = {"q": 4, "bias": 3}
# Which constants of the sensors a run begins with, by where they come from.
KNOWN: dict[str, tuple[str, ...]] = {
    "past": (),
    "fixed": (),
    "whole_log": ("soft", "scale", "arm"),
    "whole_log_biases": tuple(passes.CONSTANTS),
}
AHEAD = frozenset({"whole_log", "whole_log_biases"})
PARAMETERS = (
    *PRIORS,
    GATE,
    choice("constants", tuple(KNOWN), "where noise levels, delays, scales come from", "attlog; whole_log looks ahead"),
)
PRESETS: dict[str, dict[str, float | str]] = {
    name: {"constants": name} for name in ("fixed", "whole_log", "whole_log_biases")
}
# A shorter GNSS shows neither delay nor noise.
MIN_GNSS_S = 30.0
# Aids act this much after they were true at least: rest is known half a second later.
MARGIN_S = 0.6


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]) -> Estimate:
    """Filter one segment without gaps: the attitude at ``t`` (n,); ``mag`` has NaN rows where it has no sample."""
    clock = time.thread_time()
    fixes, constants = aids.velocity, str(params["constants"])
    if constants in AHEAD and (fixes is None or fixes.t[-1] - fixes.t[0] < MIN_GNSS_S):
        constants = "fixed"
    ahead = constants in AHEAD
    inputs = prepare_inputs(t, gyr, acc, mag, aids, np.deg2rad(float(params["declination"])), ahead=ahead)
    del mag  # a long log's is large, and its means are in the inputs
    begun, gate = started(params), float(params["soft_gate"])
    found, learnt = [], None
    for a, b in passes.learning_stages(inputs) if constants == "past" else [(0, len(t))]:
        known = passes.Constants(begun)
        if ahead:
            known = passes.constants_of_log(inputs, begun, gate)
        elif a > 0:
            past = inputs.part(0, a)
            learnt = passes.levels_of_past(past, begun, gate, learnt)
            known = passes.Constants(passes.trusted(learnt, begun, past))
        stage = inputs if b == len(t) else inputs.part(0, b)
        found.append(filtered(stage, a, known, gate, KNOWN[constants]))
    numbers = found[-1].quality | {"constants": constants}
    if constants == "past":
        numbers["constants_learnt"] = float(len(found) - 1)
    spent = 1e9 * (time.thread_time() - clock) / max(len(t), 1)
    return replace(joined(found), t=t, quality=numbers, ns_per_update=spent, causal=not ahead)


def filtered(inputs: Inputs, begin: int, known: passes.Constants, gate: float, names: Sequence[str]) -> Estimate:
    """Run once with known constants, those of ``names`` from the start on; return attitudes from ``begin`` on."""
    n = len(inputs.t)
    found, start, jumps = passes.run_causal(inputs, known.levels, gate, known.state, names)
    bias = found.bias[attitude.node_before(found, n)]
    horizon = inputs.lag + MARGIN_S + max(known.levels.gnss_delay, known.levels.mag_delay, 0.0)
    q = attitude.predicted(inputs, found.q, bias, start.x[E.bg : E.bg + 3], horizon)
    found.q, found.bias = found.q[:0].copy(), found.bias[:0].copy()  # in long logs copies add up
    tilt, heading = attitude.sigmas(inputs, found, found.variance)
    numbers = attitude.quality(inputs, found, known.levels, tilt[begin:], heading[begin:])
    numbers |= attitude.quality_of_jumps(jumps)
    aux = {"sigma_tilt": tilt, "sigma_heading": heading, **attitude.test_ratios(found, n)}
    own = slice(begin, n)
    return Estimate(inputs.t[own], q[own], bias[own], {name: x[own] for name, x in aux.items()}, quality=numbers)


def joined(stages: Sequence[Estimate]) -> Estimate:
    """Join the parts of a run; outputs of an aid are NaN before its first sample."""
    if len(stages) == 1:
        return stages[0]
    names = dict.fromkeys(name for one in stages for name in one.aux)
    aux = {n: np.concatenate([one.aux.get(n, np.full(len(one.t), np.nan)) for one in stages]) for n in names}
    biases = [one.bias for one in stages if one.bias is not None]
    q = np.concatenate([one.q for one in stages])
    return replace(stages[-1], q=q, bias=np.concatenate(biases), aux=aux)
