"""What a run says of itself: what it was aided by, what calibration found, and whether to trust it."""

from __future__ import annotations

import numpy as np

from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.layout import KICKED, OPENED, SEEN, SOFTENED
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.passes import Solution
from attlog.estimators.filters.navigation.settings import LEAST_R, Tuned
from attlog.estimators.filters.navigation.solve import Pass

WORST_RATIO, MOST_SOFT_PCT, MOST_OPENINGS = 3.0, 40.0, 5
SURE_DEG = 1.0
"""A reference must be surer than this in tilt and in heading (root mean square over the run)."""


def quality(inputs: Inputs, found: Pass, tuned: Tuned, tilt: Array, heading: Array) -> dict[str, float | str]:
    """The words and numbers of one run; ``tilt``, ``heading`` (n,) its own sigmas in rad."""
    seen = float(found.memory[SEEN])
    told: dict[str, float | str] = {
        "aided_by": inputs.aided_by or "gravity",
        "openings": float(found.memory[OPENED]),
        "kicks": float(found.memory[KICKED]),
        "soft_gated_pct": 100.0 * float(found.memory[SOFTENED]) / seen if seen else 0.0,
        **own_sigma(tilt, heading),
        **lag_corrected(inputs),
        "likelihood": found.likelihood,
        "gyro_noise_dps_sqrt_hz": float(np.degrees(tuned.gyro)),
        "acc_noise_m_s2_sqrt_hz": float(tuned.acc),
    }
    if inputs.velocity is not None:
        told["gnss_delay_ms"] = 1e3 * tuned.gnss_delay
    if inputs.mag is not None:
        told["mag_delay_ms"] = 1e3 * tuned.mag_delay
    return told


def of_passes(solution: Solution) -> dict[str, float | str]:
    """What only a run with passes knows: how many, which was kept, the worst misfit of a noise level."""
    at_floor = solution.tuned.r <= np.array(LEAST_R) * 1.001
    known = np.where(at_floor, np.minimum(solution.ratios, 1.0), solution.ratios)
    known = known[:7][np.isfinite(known[:7])]
    return {
        "passes": float(solution.passes),
        "pass_kept": float(solution.kept + 1),
        "worst_ratio": float(np.max(known)) if len(known) else 0.0,
    }


def own_sigma(tilt: Array, heading: Array) -> dict[str, float | str]:
    """Root mean squares in deg of what a run says of its errors."""
    return {"sigma_tilt_deg": _rms_deg(tilt), "sigma_heading_deg": _rms_deg(heading)}


def lag_corrected(inputs: Inputs) -> dict[str, float | str]:
    """By how much the attitude was turned on so that it is not late by the IMU's low-pass."""
    return {"imu_lag_corrected_ms": 1e3 * inputs.lag}


def refusal(told: dict[str, float | str]) -> str:
    """Why a smoothed run is no reference; empty where it is one."""
    reasons = []
    for name, limit, text in (
        ("sigma_tilt_deg", SURE_DEG, "its own tilt sigma is {:.1f} deg"),
        ("sigma_heading_deg", SURE_DEG, "its own heading sigma is {:.1f} deg"),
        ("worst_ratio", WORST_RATIO, "an aid does not fit: residuals {:.1f} times the calibrated noise (squared)"),
        ("soft_gated_pct", MOST_SOFT_PCT, "{:.0f} % of the GNSS velocities do not fit"),
        ("openings", MOST_OPENINGS, "it lost an aid {:.0f} times"),
    ):
        value = told.get(name, 0.0)
        if isinstance(value, float) and value > limit:
            reasons.append(text.format(value))
    return "; ".join(reasons)


def _rms_deg(x: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(x * x)))) if len(x) else 0.0
