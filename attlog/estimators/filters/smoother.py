"""Fixed-interval smoother: every attitude from the whole log, and how sure it is.

    filter forward: attitude, velocity, position, biases, earth and body field, delays, lever arm (39 states)
    lam, Lam backward (modified Bryson-Frazier):  q_s = exp(-(P lam)_phi) q,   P_s = P - P Lam P

Five passes: each finds noise levels, delays and prior spreads from the log itself for the next, by the scores of the
disturbances; the last two are linearised along the pass before. Uses what there is of GNSS, barometer, magnetometer
and rest; without GNSS it is the model of ``mekf`` forth and back. What follows an impact is smoothed by itself, so that
a crash does not reach back. Looks ahead: it is a reference and not a filter that could fly.

Run twice, with and without the compass: a wrong one is left out where motion shows the heading, and where neither can
be trusted there is none. ``quality["heading_from"]`` says which. Where the likelihood wants a jump of the
gyro bias the passes begin anew with one, which a faulty gyro needs (``navigation/jumps.py``).

Without GNSS it is the model of ``mekf``, which expects the body not to fly away, with a backward pass (Rauch1965;
``inertial/backward.py``).

Source: Bierman1973 (backward pass), DeJongPenzer1998 (scores), Sola2017 (error state).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import quantile
from attlog.estimators.aids import Aids, Measurements
from attlog.estimators.evidence import HeadingOffset, heading_offset
from attlog.estimators.filters.navigation import attitude, passes
from attlog.estimators.filters.navigation.attitude import SURE_DEG, own_sigma, refusal
from attlog.estimators.filters.navigation.inputs import GATE, PRIORS, Inputs, prepare_inputs, started
from attlog.estimators.filters.navigation.jumps import BIAS_CHANGED_DPS, bias_change_dps
from attlog.estimators.interface import Array, Estimate, Parameter

# Which of two smoothed runs is kept, with the compass or without it, and what its heading is from.
#
# A compass that is turned or offset misleads a smoother that stays sure of itself, in tilt as well. A run without it
# finds heading from motion, surely where the vehicle moved by steps, turns or wind. With
#
#     Dz = rms of (heading with - heading without) / joint sigma
#
# ======================= ============ =======================================================================
# run without the compass Dz           what is kept
# ======================= ============ =======================================================================
# sure                    up to 2      the run with it: heading from ``both`` (above 1 if the field fits it)
# sure                    above        the run without it: ``motion``
# not sure                up to 1      the run with it if that is sure: ``compass``, which nothing confirms
# not sure                above 1      the run with it, without its heading: ``none``
# ======================= ============ =======================================================================
#
# Sigmas hold the difference of the runs, sigma = hypot(own, difference): of the heading where both are sure of it and
# Dz is up to 2, of the tilt unless the compass is beyond doubt the one that errs.

HeadingFrom = Literal["both", "compass", "motion", "none"]
# Joint sigmas between two headings of which one shares every sensor with the other. Up to the first no compass is
# suspect. Up to the second, the 95 % limit, it is open which run errs: sound compasses reach 1.3, and a gyro scale of
# 3 % or an accelerometer bias mislead the run without compass. Then the one with it counts if the field fits it.
AGREEING_SIGMAS, SUSPECT_SIGMAS = 1.0, 2.0
# Of a field that fits, so many test ratios (squared innovation over the gate) are below 1: sound compasses have 0.4 to
# 0.7 there, turned by 5 deg or more and offset by 100 mG 0.7 to 100.
FITTING_PCT = 95.0
# Samples that are compared: smoothed attitudes differ slowly, and a long run's copies are large.
COMPARED = 20_000
# What a run by motion alone says of its heading (rad) where that is too unsure for a reference; pi if contradicted.
OWN_HEADING = "own_sigma_heading"
NO_NORTH = "neither GNSS nor a compass shows north"


def without_compass_twin(run: Estimate) -> Estimate:
    """Return the run of a log without a compass: heading from motion where its sigma allows, else none."""
    if own_deg(run) <= SURE_DEG:
        return _with_heading(run, "motion")
    unsure = without_heading(run, "no compass, and motion does not show it")
    return replace(unsure, aux=unsure.aux | {OWN_HEADING: run.aux["sigma_heading"]})


def by_compass(run: Estimate) -> Estimate:
    """Return a run without GNSS, whose compass nothing confirms."""
    return _with_heading(run, "compass")


def choose_heading(with_compass: Estimate, without: Estimate) -> Estimate:
    """Choose between two runs over the same samples; note what its heading is from."""
    differ = differences(with_compass, without)
    disagreement = rms(differ[1] / _joint_sigma(with_compass, without, "sigma_heading"))
    tilt, heading = (rms(x) for x in differ)
    agree = disagreement <= AGREEING_SIGMAS
    quality: dict[str, float | str] = {"compass_disagreement": disagreement}
    if own_deg(without) <= SURE_DEG:
        agree |= disagreement <= SUSPECT_SIGMAS and field_fits(with_compass)
        chosen = with_compass if agree else without
        chosen = _widened(chosen, tilt, heading) if disagreement <= SUSPECT_SIGMAS else chosen
        return _with_heading(chosen, "both" if agree else "motion", quality)
    chosen = _widened(with_compass, tilt, 0.0)
    if agree and own_deg(with_compass) <= SURE_DEG:
        return _with_heading(chosen, "compass", quality)
    why = "neither compass nor motion is sure of it"
    if not agree:
        why = f"compass and motion differ by {math.degrees(heading):.0f} deg, and motion is not sure of it"
    return without_heading(chosen, why, quality)


def field_fits(run: Estimate) -> bool:
    """Return whether a run's compass fits it: nearly all test ratios of the field below 1."""
    ratio = run.aux.get("test_ratio_mag", np.zeros(0))
    ratio = ratio[np.isfinite(ratio)]
    return not len(ratio) or bool(quantile(ratio, FITTING_PCT / 100) < 1.0)


def without_heading(run: Estimate, why: str, quality: Mapping[str, float | str] | None = None) -> Estimate:
    """Return the run without a heading; ``why`` completes "no heading: "."""
    unknown = np.full(len(run.t), np.pi)
    quality = {**(quality or {}), "heading_why": why, "sigma_heading_deg": 180.0}
    run = replace(run, aux=run.aux | {"sigma_heading": unknown, OWN_HEADING: unknown})
    return _with_heading(run, "none", quality)


def differences(a: Estimate, b: Estimate) -> tuple[Array, Array]:
    """Return tilt and signed heading (k,) in rad of one run against another over the same samples, thinned."""
    e = rotation.earth_error(_thinned(a.q), _thinned(b.q))
    return rotation.tilt_angle(e), rotation.heading_angle(e)


def rms(x: Array) -> float:
    """Return the root mean square, 0 without values."""
    return float(np.sqrt(np.mean(x * x))) if len(x) else 0.0


def own_deg(run: Estimate, name: str = "sigma_heading") -> float:
    """Return the RMS in deg of a run's own sigma; infinite for NaN."""
    own = math.degrees(rms(run.aux[name]))
    return own if math.isfinite(own) else math.inf


def _joint_sigma(a: Estimate, b: Estimate, name: str) -> Array:
    joint: Array = np.hypot(_thinned(a.aux[name]), _thinned(b.aux[name]))
    return joint


def _thinned(x: Array) -> Array:
    return x[:: max(1, len(x) // COMPARED)]


def _widened(run: Estimate, tilt: float, heading: float) -> Estimate:
    """Widen the run's sigmas by the difference (rad, RMS) to the run without the compass."""
    sigmas = {
        name: np.hypot(run.aux[name], difference)
        for name, difference in (("sigma_tilt", tilt), ("sigma_heading", heading))
    }
    return replace(run, aux=run.aux | sigmas, quality=run.quality | own_sigma(*sigmas.values()))


def _with_heading(run: Estimate, found: HeadingFrom, quality: Mapping[str, float | str] | None = None) -> Estimate:
    """Note in the run's quality what its heading is from."""
    quality = run.quality | {"heading_from": found, **(quality or {})}
    return replace(run, quality=quality | {"refused": refusal(quality)})


# Checks of a smoothed heading by GNSS acceleration and the gyro at rest, without a filter's model.
#
# A gyro whose bias jumps turns the heading of every run alike, with the compass or without it, and both stay sure.

# A heading that is off by more than this by GNSS acceleration, in deg and in joint sigmas, is dropped.
MIN_HEADING_OFFSET_DEG, MAX_HEADING_SIGMAS = 3.0, 3.0

# A heading by motion alone that is no reference still judges a compass up to this sigma: it is checked as well.
MAX_USEFUL_SIGMA_DEG = 5.0


def check_heading(run: Estimate, inputs: Inputs) -> Estimate:
    """Drop the run's heading where something contradicts it; note the offset by GNSS in its quality."""
    own = own_deg(run, OWN_HEADING if OWN_HEADING in run.aux else "sigma_heading")
    if run.quality["heading_from"] == "none" and own > MAX_USEFUL_SIGMA_DEG:
        return run
    offset = heading_offset_by_gnss(run, inputs)
    quality: dict[str, float | str] = {}
    if offset is not None and offset.known:
        quality = {"heading_gnss_deg": offset.offset_deg, "heading_gnss_sigma_deg": offset.sigma_deg}
        run.quality.update(quality)
        if abs(offset.offset_deg) > max(MIN_HEADING_OFFSET_DEG, MAX_HEADING_SIGMAS * math.hypot(offset.sigma_deg, own)):
            return without_heading(run, f"GNSS acceleration shows it {abs(offset.offset_deg):.0f} deg off")
    changed = 0.0 if "gyro_jump_s" in run.quality else bias_change_dps(inputs)
    if changed > BIAS_CHANGED_DPS:
        return without_heading(run, f"the gyro's bias at rest changed by {changed:.1f} deg/s")
    return run


def heading_offset_by_gnss(run: Estimate, inputs: Inputs) -> HeadingOffset | None:
    """Return the run's heading offset by GNSS acceleration; None without GNSS velocity."""
    fixes = inputs.velocity
    if fixes is None:
        return None
    return heading_offset(inputs.t, inputs.acc, run.q, fixes.t, fixes.x)


SOURCE = "Bierman1973; DeJongPenzer1998; Sola2017; Rauch1965"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "baro", "airspeed", "at_rest"}
STATE = {"q": 4, "bias": 3}
CAUSAL = False
PARAMETERS = (*PRIORS, GATE, Parameter("passes", 5, "", 1, 12, "passes over the log; one calibrates nothing", "attlog"))
PRESETS: dict[str, dict[str, float | str]] = {}


BEFORE_IMPACT_S = 0.2
# A shorter part before an impact is no flight of its own.
MIN_S = 5.0


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]) -> Estimate:
    """Smooth one segment without gaps: the attitude at ``t`` (n,); ``mag`` has NaN rows where it has no sample."""
    end = np.inf if aids.impact is None else aids.impact - BEFORE_IMPACT_S
    if not t[0] + MIN_S < end <= t[-1]:
        return smooth_part(t, gyr, acc, mag, aids, params)
    k = int(np.searchsorted(t, end))
    cuts = [slice(0, k), slice(k, len(t))]
    before, after = (smooth_part(t[c], gyr[c], acc[c], mag[c], aids.between(t[c][0], t[c][-1]), params) for c in cuts)
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


def smooth_part(
    t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, params: Mapping[str, float | str]
) -> Estimate:
    """Smooth one part of a run: ``t`` (n,) s, ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` (n, 3), NaN where missing."""
    clock = time.thread_time()
    inputs = prepare_inputs(t, gyr, acc, mag, aids, np.deg2rad(float(params["declination"])), ahead=True)
    if inputs.velocity is None and inputs.position is None:
        return inertial(inputs, mag, aids.airspeed)
    tuned, gate, count = started(params), float(params["soft_gate"]), int(params["passes"])
    if inputs.mag is None:
        chosen = without_compass_twin(smoothed(inputs, passes.solved_without_compass(inputs, tuned, gate, count)))
    else:
        with_compass, without = passes.solved_twice(inputs, tuned, gate, count)
        chosen = choose_heading(smoothed(inputs, with_compass), smoothed(replace(inputs, mag=None), without))
    if "gyro_jump_unmodelled" in chosen.quality:
        chosen = without_heading(chosen, "the gyro bias changes as no jump explains")
    chosen = check_heading(chosen, inputs)
    return replace(chosen, ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1))


def smoothed(inputs: Inputs, solution: passes.Solution) -> Estimate:
    """Return one smoothed run with the aids of the inputs."""
    found = solution.found
    q, bias = attitude.smoothed_samples(found, inputs)
    tilt, heading = attitude.sigmas(inputs, found, found.spread, solution.jumps)
    quality = attitude.quality(inputs, found, solution.tuned, tilt, heading) | attitude.quality_of_passes(solution)
    quality |= attitude.quality_of_biases(inputs, solution, bias)
    return Estimate(
        t=inputs.t,
        q=attitude.at_stamps(inputs, q, bias),
        bias=bias,
        aux={"sigma_tilt": tilt, "sigma_heading": heading, **attitude.test_ratios(found, len(inputs.t))},
        quality=quality,
        causal=False,
    )


def inertial(inputs: Inputs, mag: Array, airspeed: Measurements | None) -> Estimate:
    """Smooth without GNSS: a body that does not fly away; ``mag`` (n, 3), NaN where missing, true ``airspeed`` in m/s.

    One run: the tilt is the same without the compass, and nothing else shows where north is.
    """
    from attlog.estimators.filters.inertial.backward import smooth

    found = smooth(inputs.t, inputs.gyr, inputs.acc, mag, airspeed=airspeed)
    assert found.bias is not None
    tilt, heading = found.aux["sigma_tilt"], found.aux["sigma_heading"]
    quality = found.quality | attitude.own_sigma(tilt, heading) | attitude.lag_corrected(inputs)
    found = replace(found, q=attitude.at_stamps(inputs, found.q, found.bias), quality=quality)
    return without_heading(found, NO_NORTH) if np.isnan(mag).all() else by_compass(found)
