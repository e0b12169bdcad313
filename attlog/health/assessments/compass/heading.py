"""What would a correction do to the compass's heading, on the half of the flight that it was not fitted to?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.health.assessments.compass.samples import FieldSamples, Mask
from attlog.health.assessments.model import Array

IMPROVES, BETTER_DEG, GOOD_DEG = 0.3, 1.0, 12.0
"""A correction is offered where the heading of the other half improves by 30 % and 1 deg to below 12 deg."""


@dataclass(frozen=True, slots=True)
class HeadingProof:
    """RMS in deg of the compass's heading error ``before`` and ``after`` a correction that was fitted elsewhere."""

    before: float
    after: float

    @property
    def holds(self) -> bool:
        """Whether the correction helps beyond doubt."""
        least = max(IMPROVES * self.before, BETTER_DEG)
        return self.before - self.after >= least and self.after < GOOD_DEG

    @property
    def sentence(self) -> str:
        """The proof in words."""
        return f"Heading error on the half not fitted: {self.before:.1f} deg before, {self.after:.1f} deg after."


def heading_error(q: Array, field: Array, earth: Array) -> Array:
    """Heading error (n,) in rad of a tilt-compensated compass, against the heading of attitudes ``q`` (n, 4).

    ``field`` (n, 3) in body axes and the earth's ``earth`` (3,), north-east-down, in the same unit.
    """
    seen = rotation.rotate(q, field)
    # A field that is seen turned to the east (clockwise) makes the heading read too little.
    return -rotation.wrap(np.arctan2(seen[:, 1], seen[:, 0]) - math.atan2(earth[1], earth[0]))


def rms_deg(angle: Array) -> float:
    """Root mean square in deg of angles (n,) in rad."""
    return math.degrees(float(np.sqrt(np.mean(angle**2)))) if len(angle) else float("nan")


def halves(samples: FieldSamples) -> tuple[Mask, Mask]:
    """The samples in the air of the first and of the second half of the flight."""
    where = np.flatnonzero(samples.air)
    first, second = np.zeros(len(samples.t), bool), np.zeros(len(samples.t), bool)
    first[where[: len(where) // 2]] = True
    second[where[len(where) // 2 :]] = True
    return first, second


def crossed(samples: FieldSamples, parts: tuple[Mask, Mask], wrong: tuple[Array, Array]) -> HeadingProof:
    """The heading before and after: each of two ``parts`` of the flight corrected by what was fitted in the other.

    ``wrong``: what the compass reads too much (n, 3) uT at every sample, by the first and by the second part.
    """
    before, after = [], []
    for part, other in zip(parts, reversed(wrong), strict=True):
        q, field = samples.q[part], samples.measured[part]
        before.append(heading_error(q, field, samples.earth))
        after.append(heading_error(q, field - other[part], samples.earth))
    return HeadingProof(rms_deg(np.concatenate(before)), rms_deg(np.concatenate(after)))
