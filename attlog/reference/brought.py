"""A truth that the user brought: what it says of its own alignment and noise, and whose north it has."""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.truth import Angles, TruthFit
from attlog.reference.model import AlignmentStep, Reference

NO_NORTH = "nobody knows the north of {name}: each row is turned to it by its own mean heading"
OPTION = "--truth"


def adopt(reference: Reference, fit: TruthFit) -> None:
    """Give a reference made of a brought truth its sigma and its north."""
    n = len(reference.t)
    reference.fit = fit
    reference.sigma_tilt_deg = np.full(n, fit.sigma_tilt_deg)
    reference.sigma_heading_deg = np.full(n, fit.sigma_heading_deg)
    if fit.north == "nobody":
        reference.heading_by, reference.heading_why = "relative", NO_NORTH.format(name=fit.name)


def steps(fit: TruthFit) -> list[AlignmentStep]:
    """What was done to it, with value and sigma: clock, axes, noise."""
    clock = f"added to its times, sigma {1e3 * fit.offset_sigma_s:.2g} ms; "
    clock += f"rates correlate by {fit.correlation:.3f} over {fit.seconds:.0f} s, {fit.n} samples"
    drift = f"sigma {fit.drift_sigma_ppm:.1f} ppm"
    if fit.drift_ppm == 0.0:
        drift += ": no different from none"
    north = {
        "file": "its own north is kept",
        "gnss": "its north is from GNSS motion",
        "nobody": "its north is unknown: only changes of heading are compared",
    }[fit.north]
    noise = f"tilt {fit.sigma_tilt_deg:.2f}, heading {fit.sigma_heading_deg:.2f} deg (one sigma); part of each interval"
    return [
        _step("truth_clock", clock, fit.offset_s, "s"),
        _step("truth_drift", drift, fit.drift_ppm, "ppm", fit.drift_ppm != 0.0),
        _step("truth_body", f"{_turn(fit.body_deg)} to forward, right, down; read {fit.reading}", _size(fit.body_deg)),
        _step("truth_world", f"{_turn(fit.world_deg)} to north, east, down; {north}", _size(fit.world_deg)),
        _step("truth_residual", "RMS of its angular rates less the gyro's", fit.residual_dps, "deg/s"),
        _step("own_sigma", noise, fit.sigma_tilt_deg),
    ]


def _step(name: str, text: str, value: float, unit: str = "deg", applied: bool = True) -> AlignmentStep:
    return AlignmentStep(name, text, value, unit, "the truth", applied, OPTION)


def _turn(angles: Angles) -> str:
    return "roll {:.1f}, pitch {:.1f}, yaw {:.1f} deg".format(*angles)


def _size(angles: Angles) -> float:
    """The angle in deg of a turn by roll, pitch and yaw."""
    return float(np.degrees(rotation.total_angle(rotation.from_euler(*np.radians(angles)))))
