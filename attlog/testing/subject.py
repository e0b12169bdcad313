"""What the checks look at: one estimator with its settings, and how far it is from the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.estimators import Aids, Estimate, Estimator, EstimatorSpec, Measurements, estimate, parse
from attlog.testing.motion import Motion

Array = NDArray[np.float64]


FIXES = np.arange(0.003, 300.0, 0.2)
IN_PLACE = Aids(velocity=Measurements(FIXES, np.zeros((len(FIXES), 3)), np.full(len(FIXES), 0.1)))
"""What a filter is given that needs GNSS: a receiver that stays where it is."""


class CheckFailed(AssertionError):
    """An estimator does not keep the contract; the message says what was expected and what happened."""


def require(condition: Any, message: str) -> None:
    """CheckFailed with ``message`` unless the condition holds."""
    if not bool(condition):
        raise CheckFailed(message)


@dataclass(frozen=True, slots=True)
class Subject:
    """The estimator under test, as a row with preset and settings."""

    row: EstimatorSpec

    @classmethod
    def of(cls, name: str | EstimatorSpec | Estimator) -> Subject:
        """From ``NAME[@PRESET][:k=v,...]``, ``FILE.py``, a row or an estimator; errors as in ``parse``."""
        if isinstance(name, Estimator):
            return cls(EstimatorSpec(name))
        return cls(name if isinstance(name, EstimatorSpec) else parse(name))

    @property
    def estimator(self) -> Estimator:
        return self.row.estimator

    @property
    def uses_mag(self) -> bool:
        return "mag" in self.estimator.uses

    @property
    def uses_acc(self) -> bool:
        return "acc" in self.estimator.uses

    @property
    def corrects_tilt(self) -> bool:
        """Whether it goes on looking at gravity after the start: it cannot run without."""
        return "acc" in self.estimator.needs

    @property
    def corrects_heading(self) -> bool:
        """Whether it goes on looking at the field after the start."""
        return self.corrects_tilt and self.uses_mag

    @property
    def needs_gnss(self) -> bool:
        return "gnss" in self.estimator.needs

    @property
    def steps(self) -> bool:
        """Whether it takes samples one by one (and a start attitude), not whole runs."""
        return self.estimator.step is not None

    def run(self, m: Motion, **options: Any) -> Estimate:
        """The estimate on a motion's sensors, with the magnetometer if it is used."""
        return self.on(m.t, m.gyr, m.acc, m.mag if self.uses_mag else None, **options)

    def on(self, t: Any, gyr: Any, acc: Any, mag: Any = None, **options: Any) -> Estimate:
        """The estimate on samples, with fixes for a filter that needs them."""
        if self.needs_gnss:
            options.setdefault("aids", IN_PLACE)
        return estimate(self.row, t, gyr, acc, mag, **options)


def inclination_deg(q: Array, truth: Array) -> Array:
    """Tilt errors (n,) in deg."""
    return np.rad2deg(rotation.inclination_angle(rotation.error(q, truth)))


def heading_deg(q: Array, truth: Array) -> Array:
    """Heading errors (n,) in deg, signed."""
    return np.rad2deg(rotation.heading_angle(rotation.error(q, truth)))


def total_deg(q: Array, truth: Array) -> Array:
    """Total errors (n,) in deg."""
    return np.rad2deg(rotation.total_angle(rotation.error(q, truth)))


def require_attitudes(e: Estimate, t: Array | None = None) -> None:
    """CheckFailed unless the estimate holds finite unit quaternions (and stands at the times ``t``)."""
    require(e.q.shape == (len(e.t), 4), f"attitudes have shape {e.q.shape} for {len(e.t)} times")
    require(np.isfinite(e.q).all(), f"{int((~np.isfinite(e.q).all(axis=1)).sum())} attitudes are not finite")
    off = np.abs(np.sqrt(np.sum(e.q**2, axis=1)) - 1.0)
    require(off.max(initial=0.0) < 1e-6, f"quaternions are not of unit length: off by {off.max(initial=0.0):.2g}")
    if t is not None:
        require(np.array_equal(e.t, t), f"{len(e.t)} attitudes for {len(t)} good samples, or at other times")
