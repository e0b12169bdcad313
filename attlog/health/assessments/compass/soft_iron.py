"""Does iron around a compass stretch the field? In words only: a flight shows it too roughly to be set.

Horizontally ``m = (1 + s) u + a (u_x, -u_y) + b (u_y, u_x) + w (u_y, -u_x) + o``: s scale, w turn, o offset; a and b
are the ellipse that soft iron makes of a circle. They swing the heading by hypot(a, b) rad, twice in a full turn.
"""

from __future__ import annotations

import math

import numpy as np

from attlog.health.assessments.compass.fitting import HUBER, STANDARD_ERRORS
from attlog.health.assessments.compass.study import CompassStudy
from attlog.health.assessments.model import Assessment, unknown
from attlog.health.fits.regression import fit

SOFT_IRON = "soft_iron"
OFF, SIGMAS = 0.1, 4.0
"""A tenth swings the heading by 6 deg."""
FLOOR = 0.015
"""What attitude errors make of a sound compass; with errors of the fit alone 22 of 39 sound ones are accused."""
LEAST_TURN_DEG = 60.0
"""Directions of the field that the flight saw, from the 5th to the 95th percentile about their mean."""
LIMIT = f"ok up to {100 * OFF:.0f} % or {SIGMAS:.0f} sigma"
WORDS = "A flight shows soft iron too roughly to set it: calibrate the compass on the ground, in all directions."


def assessed(study: CompassStudy) -> Assessment:
    """The ellipse that the horizontal field draws in the axes of one compass."""
    samples = study.samples
    t, u, m = samples.t[samples.air], samples.expected[samples.air], samples.measured[samples.air]
    x, y = u[:, 0], u[:, 1]
    turned = _seen_deg(x, y)
    if turned < LEAST_TURN_DEG:
        why = f"The flight turns by {turned:.0f} deg: soft iron needs {LEAST_TURN_DEG:.0f} deg."
        return unknown(samples.source, SOFT_IRON, why, LIMIT)
    one, none = np.ones(len(t)), np.zeros(len(t))
    columns = np.stack([np.column_stack([x, x, y, y, one, none]), np.column_stack([y, -y, x, -x, none, one])], axis=1)
    found = fit(t, columns, m[:, :2] - u[:, :2], huber=HUBER)
    if found is None:
        return unknown(samples.source, SOFT_IRON, f"The flight does not show the soft iron of {samples.source}.", LIMIT)
    size = math.hypot(found.x[1], found.x[2])
    sigma = math.hypot(STANDARD_ERRORS * float(found.sigma[1:3].max()), FLOOR)
    if SIGMAS * sigma > 2.0 * OFF and size <= SIGMAS * sigma:
        why = f"Soft iron of {samples.source} is known to {196 * sigma:.0f} % only: the flight turns too little."
        return unknown(samples.source, SOFT_IRON, why, LIMIT)
    off = size > max(OFF, SIGMAS * sigma)
    return Assessment(
        samples.source,
        SOFT_IRON,
        "warning" if off else "ok",
        f"Soft iron stretches the field of {samples.source} by {100 * size:.1f} ± {196 * sigma:.1f} %.",
        round(100.0 * size, 1),
        "%",
        (round(max(100.0 * size - 196.0 * sigma, 0.0), 1), round(100.0 * size + 196.0 * sigma, 1)),
        n=len(t),
        seconds=round(samples.seconds, 1),
        threshold=LIMIT,
        why_no_setting=WORDS if off else "",
        evidence=[f"The heading swings by {math.degrees(size):.1f} deg, twice in each turn."],
    )


def _seen_deg(x: np.ndarray, y: np.ndarray) -> float:
    """How far the horizontal field (n,) turns in body axes, deg."""
    angle = np.arctan2(y, x)
    middle = np.angle(np.mean(np.exp(1j * angle)))
    low, high = np.quantile((angle - middle + np.pi) % (2.0 * np.pi), [0.05, 0.95])
    return float(np.degrees(high - low))
