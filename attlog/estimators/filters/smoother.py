"""Fixed-interval smoother: every attitude from the whole log, and how sure it is.

    filter forward: attitude, velocity, position, biases, earth and body field, delays, lever arm (39 states)
    lam, Lam backward (modified Bryson-Frazier):  q_s = exp(-(P lam)_phi) q,   P_s = P - P Lam P

Five passes: each finds noise levels, delays and prior spreads from the log itself for the next, by the scores of the
disturbances; the last two are linearised along the pass before. Uses what there is of GNSS, barometer, magnetometer
and rest; without GNSS it is the model of ``mekf`` forth and back. What follows an impact is smoothed by itself, so that
a crash does not reach back. Looks ahead: it is a reference and not a filter that could fly.

Run twice, with and without the compass: a wrong one is left out where motion shows the heading, and where neither can
be trusted there is none (``pair.py``). ``quality["heading_from"]`` says which. Where the likelihood wants a jump of the
gyro bias the passes begin anew with one, which a faulty gyro needs (``navigation/passes/jumps.py``).

Without GNSS it is the model of ``mekf``, which expects the body not to fly away, with a backward pass (Rauch1965;
``inertial/backward.py``).

Source: Bierman1973 (backward pass), DeJongPenzer1998 (scores), Sola2017 (error state).
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from attlog.estimators.aids import Aids, Measurements
from attlog.estimators.base import Array, Estimate, Parameter
from attlog.estimators.filters import heading_checks, pair
from attlog.estimators.filters.navigation import attitude, passes
from attlog.estimators.filters.navigation.measured import Inputs, made_ready
from attlog.estimators.filters.navigation.settings import GATE, PRIORS, started

SOURCE = "Bierman1973; DeJongPenzer1998; Sola2017; Rauch1965"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "baro", "airspeed", "at_rest"}
STATE = {"q": 4, "bias": 3}
CAUSAL = False
PARAMETERS = (*PRIORS, GATE, Parameter("passes", 5, "", 1, 12, "passes over the log; one calibrates nothing", "attlog"))
PRESETS: dict[str, dict[str, float | str]] = {}


BEFORE_IMPACT_S = 0.2
LEAST_S = 5.0
"""A shorter part before an impact is no flight of its own."""


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]) -> Estimate:
    """The smoothed attitude at ``t`` (n,) of one segment without gaps; ``mag`` has NaN rows where it has no sample."""
    end = np.inf if aids.impact is None else aids.impact - BEFORE_IMPACT_S
    if not t[0] + LEAST_S < end <= t[-1]:
        return part(t, gyr, acc, mag, aids, params)
    k = int(np.searchsorted(t, end))
    cuts = [slice(0, k), slice(k, len(t))]
    before, after = (part(t[c], gyr[c], acc[c], mag[c], aids.between(t[c][0], t[c][-1]), params) for c in cuts)
    assert before.bias is not None
    assert after.bias is not None
    missing = np.full(len(after.t), np.nan)
    return replace(
        before,
        t=t,
        q=np.concatenate([before.q, after.q]),
        bias=np.concatenate([before.bias, after.bias]),
        aux={name: np.concatenate([x, after.aux.get(name, missing)]) for name, x in before.aux.items()},
        ns_per_update=(before.ns_per_update * k + after.ns_per_update * (len(t) - k)) / len(t),
    )


def part(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]) -> Estimate:
    """One part of a run, by itself: ``t`` (n,) s, ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` (n, 3), NaN where missing."""
    clock = time.thread_time()
    inputs = made_ready(t, gyr, acc, mag, aids, np.deg2rad(float(params["declination"])), ahead=True)
    if inputs.velocity is None and inputs.position is None:
        return inertial(inputs, mag, aids.airspeed)
    tuned, gate, count = started(params), float(params["soft_gate"]), int(params["passes"])
    if inputs.mag is None:
        stands = pair.alone(smoothed(inputs, passes.solved(inputs, tuned, gate, count)))
    else:
        with_compass, without = passes.solved_twice(inputs, tuned, gate, count)
        stands = pair.chosen(smoothed(inputs, with_compass), smoothed(replace(inputs, mag=None), without))
    if "gyro_jump_unmodelled" in stands.quality:
        stands = pair.without_heading(stands, "the gyro bias changes as no jump explains")
    stands = heading_checks.checked(stands, inputs)
    return replace(stands, ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1))


def smoothed(inputs: Inputs, solution: passes.Solution) -> Estimate:
    """One smoothed run with the aids that the inputs hold."""
    found = solution.found
    q, bias = attitude.smoothed_samples(found, inputs)
    tilt, heading = attitude.sigmas(inputs, found, found.spread, solution.jumps)
    told = attitude.quality(inputs, found, solution.tuned, tilt, heading) | attitude.quality_of_passes(solution)
    told |= attitude.quality_of_biases(inputs, solution, bias)
    return Estimate(
        t=inputs.t,
        q=attitude.at_stamps(inputs, q, bias),
        bias=bias,
        aux={"sigma_tilt": tilt, "sigma_heading": heading, **attitude.test_ratios(found, len(inputs.t))},
        quality=told,
        causal=False,
    )


def inertial(inputs: Inputs, mag: Array, airspeed: Measurements | None) -> Estimate:
    """Without GNSS: a body that does not fly away; ``mag`` (n, 3), NaN where missing, true ``airspeed`` in m/s.

    One run: the tilt is the same without the compass, and nothing else shows where north is.
    """
    from attlog.estimators.filters.inertial.backward import smooth

    found = smooth(inputs.t, inputs.gyr, inputs.acc, mag, airspeed=airspeed)
    assert found.bias is not None
    tilt, heading = found.aux["sigma_tilt"], found.aux["sigma_heading"]
    told = found.quality | attitude.own_sigma(tilt, heading) | attitude.lag_corrected(inputs)
    found = replace(found, q=attitude.at_stamps(inputs, found.q, found.bias), quality=told)
    return pair.without_heading(found, pair.NO_NORTH) if np.isnan(mag).all() else pair.by_compass(found)
