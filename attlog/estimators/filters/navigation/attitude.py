"""Results of a run: attitudes at the wanted times, their sigmas, quality numbers, reasons to refuse it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.estimators.filters.navigation import turns
from attlog.estimators.filters.navigation.inputs import MIN_R, Inputs, NoiseLevels
from attlog.estimators.filters.navigation.jumps import Jump
from attlog.estimators.filters.navigation.model import MEM, E
from attlog.estimators.filters.navigation.passes import Solution
from attlog.estimators.filters.navigation.solve import Pass
from attlog.estimators.interface import Array

# The model's own spread is that much too small (measured on flights with truth).
SIGMA_FACTOR = 1.2
MIN_TILT, MIN_HEADING = np.deg2rad(0.03), np.deg2rad(0.04)
MIN_TIME_S = 1.5e-3
WORST_RATIO, MAX_SOFT_PCT, MAX_OPENINGS = 3.0, 40.0, 5
# A reference must be surer than this in tilt and in heading (root mean square over the run).
SURE_DEG = 1.0
# Samples worked on at once: a long log must not take many times its size.
BLOCK = 50_000


def node_before(found: Pass, n: int) -> NDArray[np.int64]:
    """Return the node (n,) at or before each of n samples."""
    return np.maximum(np.searchsorted(found.schedule.node_at, np.arange(n), side="right") - 1, 0)


def smoothed_samples(found: Pass, inputs: Inputs) -> tuple[Array, Array]:
    """Return smoothed attitude (n, 4) and gyro bias (n, 3) of every sample.

    The filter's attitude, corrected by the smoothed error at the node before: corrections vary slowly, and the
    filter's own jumps cancel.
    """
    n = len(inputs.t)
    q, bias = np.empty((n, 4)), np.empty((n, 3))
    nodes, t = found.schedule.node_at, inputs.sensed_at
    for a in range(0, n, BLOCK):
        own = slice(a, min(a + BLOCK, n))
        k = np.maximum(np.searchsorted(nodes, np.arange(own.start, own.stop), side="right") - 1, 0)
        since = np.where(inputs.rest[own] == 1, 0.0, t[own] - t[nodes[k]])
        late = rotation.rotate(found.q[own], found.d[k, 3:6]) * since[:, None]
        turn = rotation.from_rotvec(found.d[k, 0:3] - late)
        q[own] = rotation.normalize(rotation.multiply(turn, found.q[own]))
        bias[own] = found.bias[k] + found.d[k, 3:6]
    return q, bias


def at_stamps(inputs: Inputs, q: Array, bias: Array) -> Array:
    """Return attitudes (n, 4) at the stamps from ``q`` (n, 4) at the times of sensing, which a low-pass makes earlier.

    They are turned by the gyro less ``bias`` (n, 3) rad/s.
    """
    if inputs.lag == 0.0:
        return q
    sensed, out = inputs.sensed_at, np.empty_like(q)
    last = len(sensed) - 1
    for a in range(0, len(q), BLOCK):
        own = slice(a, a + BLOCK)
        k = np.clip(np.searchsorted(sensed, inputs.t[own], side="right") - 1, 0, last)
        turn = (inputs.gyr[np.minimum(k + 1, last)] - bias[k]) * (inputs.t[own] - sensed[k])[:, None]
        out[own] = rotation.normalize(rotation.multiply(q[k], rotation.from_rotvec(turn)))
    return out


def sigmas(inputs: Inputs, found: Pass, spread: Array, jumps: Sequence[Jump] = ()) -> tuple[Array, Array]:
    """Return sigmas (n,) in rad of tilt and heading from variances (m, 3) of the attitude at the nodes.

    Within two sigma of the time of a jump of the gyro bias, what it turns in one sigma of it is added.
    """
    at = inputs.sensed_at[found.schedule.node_at]
    rate = np.sqrt(np.sum(inputs.gyr**2, axis=1)) * MIN_TIME_S
    three = [np.interp(inputs.t, at, np.maximum(spread[:, i], 0.0)) for i in range(3)]
    tilt = SIGMA_FACTOR**2 * (three[0] + three[1]) + MIN_TILT**2 + rate**2
    heading = SIGMA_FACTOR**2 * three[2] + MIN_HEADING**2 + rate**2
    for jump in jumps:
        near = np.flatnonzero(np.abs(inputs.sensed_at - jump.t) <= 2.0 * jump.t_sigma)
        turned = rotation.rotate(found.q[near], np.tile(jump.size * jump.t_sigma, (len(near), 1)))
        tilt[near] += np.sum(turned[:, :2] ** 2, axis=1)
        heading[near] += turned[:, 2] ** 2
    return np.sqrt(tilt), np.sqrt(heading)


def test_ratios(found: Pass, n: int) -> dict[str, Array]:
    """Return squared innovation over its gate (n,) of each aid, held from event to event; NaN before the first."""
    k = node_before(found, n)
    out = {}
    for i, name in enumerate(("velocity", "position", "baro", "mag")):
        column = found.ratio[:, i]
        known = np.isfinite(column)
        last = np.maximum.accumulate(np.where(known, np.arange(len(column)), -1))
        held = np.where(last >= 0, column[np.maximum(last, 0)], np.nan)
        if known.any():
            out[f"test_ratio_{name}"] = held[k]
    return out


def predicted(inputs: Inputs, q: Array, bias: Array, first_bias: Array, horizon: float) -> Array:
    """Return the causal attitude at each stamp: that of ``horizon`` s before, carried on by the gyro.

    ``q`` (n, 4), ``bias`` (n, 3) of the filter at every sample; ``first_bias`` (3,) what was known at the start.
    """
    n, sensed = len(inputs.t), inputs.sensed_at
    then = np.maximum(np.searchsorted(sensed, inputs.t - horizon, side="right") - 1, 0)
    out, ring = np.empty((n, 4)), np.empty((int(np.max(np.arange(n) - then)) + 1, turns.RING))
    turns.ahead(inputs.lag, then, inputs.motion, q, bias, first_bias.copy(), ring, out, np.empty(9))
    return out


def quality(inputs: Inputs, found: Pass, tuned: NoiseLevels, tilt: Array, heading: Array) -> dict[str, float | str]:
    """Return quality numbers of one run; ``tilt``, ``heading`` (n,) are its own sigmas in rad."""
    seen = float(found.memory[MEM.seen])
    numbers: dict[str, float | str] = {
        "aided_by": inputs.aided_by or "gravity",
        "openings": float(found.memory[MEM.opened]),
        "kicks": float(found.memory[MEM.kicked]),
        "soft_gated_pct": 100.0 * float(found.memory[MEM.softened]) / seen if seen else 0.0,
        **own_sigma(tilt, heading),
        **lag_corrected(inputs),
        "likelihood": found.likelihood,
        "gyro_noise_dps_sqrt_hz": float(np.degrees(tuned.gyro)),
        "acc_noise_m_s2_sqrt_hz": float(tuned.acc),
    }
    if inputs.velocity is not None:
        numbers["gnss_delay_ms"] = 1e3 * tuned.gnss_delay
    if inputs.mag is not None:
        numbers["mag_delay_ms"] = 1e3 * tuned.mag_delay
    return numbers


def quality_of_passes(solution: Solution) -> dict[str, float | str]:
    """Return quality numbers of passes: how many, which was kept, the worst misfit of a noise level."""
    at_floor = solution.tuned.r <= np.array(MIN_R) * 1.001
    known = np.where(at_floor, np.minimum(solution.ratios, 1.0), solution.ratios)
    known = known[:7][np.isfinite(known[:7])]
    return {
        "passes": float(solution.passes),
        "pass_kept": float(solution.kept + 1),
        "worst_ratio": float(np.max(known)) if len(known) else 0.0,
        **quality_of_jumps(solution.jumps),
        **({"gyro_jump_unmodelled": solution.unmodelled} if solution.unmodelled else {}),
    }


def quality_of_biases(inputs: Inputs, solution: Solution, gyro_bias: Array) -> dict[str, float | str]:
    """Return the biases of the sensors along x, y, z, and the model's own sigma as the run begins.

    Of the accelerometer [m/s^2] as the run begins, of the gyro [deg/s] the median of ``gyro_bias`` (n, 3) rad/s while
    the vehicle moves.
    """
    begin, found, moving = solution.begin, solution.found, inputs.rest == 0
    sigma = np.sqrt(np.maximum(found.first_spread, 0.0))
    acc = begin.x[E.ba : E.ba + 3] + found.first[E.ba : E.ba + 3]
    gyro = median(gyro_bias[moving] if moving.any() else gyro_bias, axis=0)
    numbers: dict[str, float | str] = {}
    for k, axis in enumerate("xyz"):
        numbers[f"acc_bias_{axis}_m_s2"], numbers[f"acc_bias_{axis}_sigma_m_s2"] = float(acc[k]), float(sigma[E.ba + k])
        numbers[f"gyro_bias_{axis}_dps"] = float(np.degrees(gyro[k]))
        numbers[f"gyro_bias_{axis}_sigma_dps"] = float(np.degrees(sigma[E.bg + k]))
    return numbers


def quality_of_jumps(jumps: Sequence[Jump]) -> dict[str, float | str]:
    """Return the number of jumps of the gyro bias; of the largest its time, axes and sigmas."""
    jumps = [jump for jump in jumps if jump.counts]
    if not jumps:
        return {"gyro_jumps": 0.0}
    jump = max(jumps, key=lambda one: one.rate)
    axes = zip("xyz", np.degrees(jump.size), np.degrees(jump.sigma), strict=True)
    numbers: dict[str, float | str] = {
        "gyro_jumps": float(len(jumps)),
        "gyro_jump_s": jump.t,
        "gyro_jump_s_sigma": jump.t_sigma,
        "gyro_jump_dps": float(np.degrees(jump.rate)),
    }
    for axis, size, sigma in axes:
        numbers[f"gyro_jump_{axis}_dps"], numbers[f"gyro_jump_{axis}_sigma_dps"] = float(size), float(sigma)
    return numbers


def own_sigma(tilt: Array, heading: Array) -> dict[str, float | str]:
    """Return the root mean squares in deg of the sigmas ``tilt`` and ``heading`` (n,) rad."""
    return {"sigma_tilt_deg": _rms_deg(tilt), "sigma_heading_deg": _rms_deg(heading)}


def lag_corrected(inputs: Inputs) -> dict[str, float | str]:
    """Return the time by which the attitude was turned on for the IMU's low-pass."""
    return {"imu_lag_corrected_ms": 1e3 * inputs.lag}


def refusal(numbers: dict[str, float | str]) -> str:
    """Return why a smoothed run is no reference; empty where it is one."""
    reasons = []
    heading = "its own heading sigma is {:.1f} deg"
    if numbers.get("heading_from") == "none":
        heading = f"no heading: {numbers['heading_why']}"
    for name, limit, text in (
        ("sigma_tilt_deg", SURE_DEG, "its own tilt sigma is {:.1f} deg"),
        ("sigma_heading_deg", SURE_DEG, heading),
        ("worst_ratio", WORST_RATIO, "an aid does not fit: residuals {:.1f} times the calibrated noise (squared)"),
        ("soft_gated_pct", MAX_SOFT_PCT, "{:.0f} % of the GNSS velocities do not fit"),
        ("openings", MAX_OPENINGS, "it lost an aid {:.0f} times"),
    ):
        value = numbers.get(name, 0.0)
        if isinstance(value, float) and value > limit:
            reasons.append(text.format(value))
    return "; ".join(reasons)


def _rms_deg(x: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(x * x)))) if len(x) else 0.0
