"""How far is a compass off, in uT along the body's axes, and how wrong may that number be in all?

``m = R' h + o``: m logged (corrected) field, R attitude, h the earth's field, o the residual offset. The error of o is
that of the fit and of all that the fit cannot see: heading and tilt of the attitude, the model of the earth's field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from attlog.health.assessments.compass.samples import FieldSamples, Mask
from attlog.health.assessments.model import Array
from attlog.health.fits.regression import fit

HUBER = 2.5
"""Residuals beyond so many robust deviations are weighted down (measured on 98 compasses)."""
STANDARD_ERRORS = 1.5
"""Standard errors clustered by few blocks are too small by about this."""
TILT = math.radians(0.8)
"""Tilt error of a smoothed attitude: it turns the vertical field into the horizontal, and back."""
SIZE = 0.01
"""Error of the model's field in size."""
FLOOR_UT = 0.3
"""What remains of compass and model however long the flight: 3 mG."""
SIGMAS, LEAST_UT = 4.0, 1.5
"""An offset counts above four total errors and 15 mG: no false one on 39 untouched simulated flights; with four
standard errors of the fit 29."""


@dataclass(frozen=True, slots=True)
class OffsetFit:
    """What a compass reads too much, ``offset`` (3,) uT in body axes, with its total error ``sigma`` (3,).

    ``left_ut``: the residuals' root mean square; ``n`` samples in ``blocks`` of 5 s.
    """

    offset: Array
    sigma: Array
    left_ut: float
    n: int
    blocks: int

    @property
    def size(self) -> float:
        """Its length, uT."""
        return float(np.sqrt(np.sum(self.offset**2)))

    @property
    def size_ci95(self) -> tuple[float, float]:
        """The 95 % interval of its length, uT."""
        along = self.offset / max(self.size, 1e-9)
        half = 1.96 * float(np.sqrt(np.sum((along * self.sigma) ** 2)))
        return max(self.size - half, 0.0), self.size + half

    @property
    def counts(self) -> bool:
        """Whether an axis is off beyond doubt, and by enough."""
        return bool(np.any(np.abs(self.offset) > np.maximum(SIGMAS * self.sigma, LEAST_UT)))


def offset_of(t: Array, error: Array, sigma_heading: Array, earth: Array) -> OffsetFit | None:
    """The offset that samples at ``t`` (n,) s show; None without any.

    ``error`` (n, 3) uT is what the compass reads more than the earth's field ``earth`` (3,) uT NED, ``sigma_heading``
    (n,) rad one sigma of the attitude's heading.
    """
    if len(t) < 2:
        return None
    found = fit(t, np.broadcast_to(np.eye(3), (len(t), 3, 3)), error, huber=HUBER)
    if found is None:
        return None
    left = error - found.x
    heading = float(np.sqrt(np.mean(sigma_heading**2)))
    sigma = total_error(found.sigma, heading, earth)
    return OffsetFit(found.x, sigma, float(np.sqrt(np.mean(np.sum(left**2, axis=1)))), len(t), found.blocks)


def of_samples(samples: FieldSamples, use: Mask) -> OffsetFit | None:
    """:func:`offset_of` of some of the samples."""
    return offset_of(samples.t[use], samples.error[use], samples.sigma_heading[use], samples.earth)


def total_error(standard: Array, sigma_heading: float, earth: Array) -> Array:
    """One sigma (3,) uT of an offset in body axes of a vehicle that is mostly level.

    ``standard`` (3,) uT are the errors of the fit, ``sigma_heading`` rad that of the heading; ``earth`` (3,) uT NED.
    """
    level, down = math.hypot(earth[0], earth[1]), abs(float(earth[2]))
    across = math.hypot(sigma_heading * level, TILT * down)
    along = math.hypot(TILT * level, SIZE * math.hypot(level, down))
    sigma: Array = np.sqrt((STANDARD_ERRORS * standard) ** 2 + np.array([across, across, along]) ** 2 + FLOOR_UT**2)
    return sigma
