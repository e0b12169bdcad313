"""Noise levels, prior spreads and delays from the log itself.

Every scalar update has ``u^2 / D``, every disturbance ``lam^2 / Lam``, of mean one where the level is right (the score
of the likelihood, DeJongPenzer1998). Measurement noise takes the median, which faults do not reach; process noise
the mean of clipped squares over the flight. Prior spreads of what is constant (hard and soft iron, accelerometer bias)
follow from the smoothed values at the start: a well calibrated compass tightens, a bad one opens.

The delay state alone is biased where a flight hardly moves; the likelihood of a whole run with the delay held is not.
It is searched on a grid around the present value, wider while the best is at the edge, with a parabola at the end.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from attlog.core.sorting import median
from attlog.estimators.filters.navigation.inputs import (
    MIN_R,
    REST_MEAN_S,
    Inputs,
    NoiseLevels,
    PriorSpreads,
    RunningMean,
)
from attlog.estimators.filters.navigation.model import GROUPS, E
from attlog.estimators.filters.navigation.schedule import rest_times
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import StartState
from attlog.estimators.interface import Array

# Median of the square of a standard normal variable.
MEDIAN_OF_SQUARE = 0.4549
SOFT_COUNTS = 9.0
WIDE_CLIP, NARROW_CLIP = 50.0, 5.0
MIN_UPDATES, MIN_FLIGHT_S = 20, 10.0
FIXED_GROUP = 7
GYRO_RANGE, ACC_RANGE = (2e-5, 3e-2), (1e-3, 1.0)
# State rows, and the range of the random walk as parts of its start.
WALKS = {
    "gyro_walk": (E.bg, 3, 0.3, 10.0),
    "acc_walk": (E.ba, 3, 0.3, 10.0),
    "hard_walk": (E.hard, 3, 0.1, 30.0),
    "wander_walk": (E.wander, 3, 0.1, 3.0),
    "baro_walk": (E.baro, 1, 0.1, 5.0),
}
SPREADS = {
    "hard": (E.hard, 3, 0.004, 0.150),
    "soft": (E.soft, 6, 0.003, 0.05),
    "acc_bias": (E.ba, 3, 0.03, 0.5),
    "gyro_bias": (E.bg, 3, np.deg2rad(0.3), np.deg2rad(10.0)),
}
DECLINATION_RANGE = (np.deg2rad(0.6), np.deg2rad(3.0))
PRIOR_WEIGHT = 0.5
MIN_GYRO_NOISE, MIN_ACC_NOISE = 1e-4, 3e-3
WHITE_FACTOR = 1.5
PRIOR_DELAY_S, PRIOR_DELAY_SIGMA_S = 0.12, 0.08
MAX_DELAY_S, MAX_MAG_DELAY_S = 0.6, 0.15
MAX_STEPS = 4
# Fixes this near to the ends are left out of the search: all delays must see the same ones.
MARGIN_S = 0.7


def first_guess(inputs: Inputs, tuned: NoiseLevels) -> NoiseLevels:
    """Guess inertial noise from second differences of the samples, zero-rate noise from successive means at rest."""
    dt = float(median(inputs.dt[1:])) if len(inputs.dt) > 1 else 0.01
    levels = []
    for x in (inputs.gyr, inputs.acc):
        if len(x) < 8:
            levels.append(0.0)
            continue
        second = x[2:] - 2.0 * x[1:-1] + x[:-2]
        sd = median(np.abs(second), axis=0) / (0.6745 * np.sqrt(6.0))
        levels.append(float(np.sqrt(np.mean(sd**2) * dt)))
    gyro, acc = max(WHITE_FACTOR * levels[0], MIN_GYRO_NOISE), max(WHITE_FACTOR * levels[1], MIN_ACC_NOISE)
    r = tuned.r.copy()
    looks = rest_times(inputs)
    if len(looks) > 5:
        means = RunningMean(inputs.sensed_at, inputs.gyr).mean(looks - REST_MEAN_S, looks)
        spread = median(np.abs(np.diff(means, axis=0)), axis=0) / (0.6745 * np.sqrt(2.0))
        r[6] = max(float(np.sqrt(np.mean(spread**2))), MIN_R[6])
    return replace(tuned, gyro=gyro, acc=acc, acc_rest=max(2.0 * acc, MIN_ACC_NOISE), r=r)


def ratios(found: Pass) -> Array:
    """Return the median of u^2 / D of each group (8,), one where the noise is right; NaN with too few updates."""
    out = np.full(GROUPS, np.nan)
    score = np.where(found.soft == 1, np.maximum(found.score, SOFT_COUNTS), found.score)
    for g in range(GROUPS):
        mine = score[found.group == g]
        if len(mine) >= MIN_UPDATES:
            out[g] = float(median(mine)) / MEDIAN_OF_SQUARE
    return out


def calibrated(found: Pass, tuned: NoiseLevels, begun: NoiseLevels, flight_s: float, early: bool) -> NoiseLevels:
    """Calibrate the levels after one pass; ``begun`` are those of the first, ``early`` passes may move far."""
    clip = WIDE_CLIP if early else NARROW_CLIP
    r = tuned.r.copy()
    for g, ratio in enumerate(ratios(found)):
        if g != FIXED_GROUP and np.isfinite(ratio):
            r[g] = max(r[g] * np.sqrt(np.clip(ratio, 1.0 / clip, clip)), MIN_R[g])
    tuned = replace(tuned, r=r)
    if flight_s < MIN_FLIGHT_S:
        return tuned

    def step(row: int, count: int) -> float:
        expected = float(np.sum(found.scores[1, row : row + count]))
        ratio = float(np.sum(found.scores[0, row : row + count])) / expected if expected > 0.0 else 1.0
        return float(np.sqrt(np.clip(ratio, 1.0 / clip, clip)))

    values = {
        "gyro": float(np.clip(tuned.gyro * step(E.phi, 3), *GYRO_RANGE)),
        "acc": float(np.clip(tuned.acc * step(E.v, 3), *ACC_RANGE)),
    }
    for name, (row, count, low, high) in WALKS.items():
        start = float(getattr(begun, name))
        values[name] = float(np.clip(getattr(tuned, name) * step(row, count), low * start, high * start))
    return replace(tuned, **values)  # type: ignore[arg-type]


def prior_of(found: Pass, x: Array, prior: PriorSpreads, begun: PriorSpreads) -> PriorSpreads:
    """Estimate spreads of the constant parts by empirical Bayes; ``x`` (39,) is the state the pass began with."""
    values = {}
    for name, (row, count, low, high) in SPREADS.items():
        own = slice(row, row + count)
        if not np.any(found.first_spread[own] > 0.0):
            continue
        square = float(np.sum((x[own] + found.first[own]) ** 2 + np.maximum(found.first_spread[own], 0.0)))
        s0 = float(getattr(begun, name))
        values[name] = float(np.clip(np.sqrt((square + PRIOR_WEIGHT * s0**2) / (count + PRIOR_WEIGHT)), low, high))
    level = float(np.hypot(x[E.earth], x[E.earth + 1]))
    if level > 0.0:
        across = np.array([-x[E.earth + 1], x[E.earth]]) / level
        own = slice(E.earth, E.earth + 2)
        square = (
            float((across @ found.first[own]) ** 2 + across**2 @ np.maximum(found.first_spread[own], 0.0)) / level**2
        )
        square = (square + PRIOR_WEIGHT * begun.declination**2) / (1.0 + PRIOR_WEIGHT)
        values["declination"] = float(np.clip(np.sqrt(square), *DECLINATION_RANGE))
    return replace(prior, **values)


def delays_by_state(found: Pass, tuned: NoiseLevels) -> NoiseLevels:
    """Move delays by their smoothed states, each prior fixed (0.12 s for GNSS, 0 for the field)."""
    values: dict[str, Any] = {}
    for name, row, usual, sigma, most in (
        ("gnss_delay", E.gnss_delay, PRIOR_DELAY_S, tuned.prior.gnss_delay, MAX_DELAY_S),
        ("mag_delay", E.mag_delay, 0.0, tuned.prior.mag_delay, MAX_MAG_DELAY_S),
    ):
        spread = float(found.first_spread[row])
        if spread <= 0.0 or sigma <= 0.0:
            continue
        now = float(getattr(tuned, name)) - usual
        moved = now * (1.0 - min(spread / sigma**2, 1.0)) + float(found.first[row])
        values[name] = float(np.clip(usual + moved, -most, most))
    return replace(tuned, **values)


def delay_by_likelihood(
    runner: Runner, inputs: Inputs, tuned: NoiseLevels, begin: StartState, gate: float, step: float
) -> NoiseLevels:
    """Search the GNSS delay of the highest likelihood on a grid of ``step`` s, then on a parabola."""
    t = inputs.sensed_at
    inner = float(t[0]) + MARGIN_S, float(t[-1]) - MARGIN_S
    if inputs.velocity is None or inputs.velocity.between(*inner) is None:
        return tuned
    held = begin.copy()
    held.P[E.gnss_delay, :] = held.P[:, E.gnss_delay] = 0.0
    par = tuned.settings(inputs.gravity, gate)
    known: dict[int, float] = {}

    def value(k: int) -> float:
        if k not in known:
            tau = tuned.gnss_delay + k * step
            schedule = runner.timetable.scheduled(replace(tuned, gnss_delay=tau), within=inner)
            found = runner.forward(schedule, held, par)
            known[k] = found.likelihood - 0.5 * ((tau - PRIOR_DELAY_S) / PRIOR_DELAY_SIGMA_S) ** 2
        return known[k]

    best = max((-1, 0, 1), key=value)
    for _ in range(MAX_STEPS):
        beyond = max((best - 1, best, best + 1), key=value)
        if beyond == best:
            break
        best = beyond
    left, middle, right = value(best - 1), value(best), value(best + 1)
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    tau = tuned.gnss_delay + (best + float(np.clip(shift, -1.0, 1.0))) * step
    return replace(tuned, gnss_delay=float(np.clip(tau, -MAX_DELAY_S, MAX_DELAY_S)))
