"""How do raw values of a compass or an accelerometer become those in the log, and which offset would move them?

Every firmware's correction is ``y = matrix (x + offset) + motor p``: x raw, y in body axes as logged, p the power of
the motors (their current in A, or their throttle 0 to 1).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from attlog.flight.model import Array

SINGULAR = 1e-3
"""A calibration whose determinant is smaller folds the axes into a plane: it is damage."""


class CalibrationUnknownError(Exception):
    """Why the parameters that made a sensor's values cannot be named: one sentence."""


@dataclass(frozen=True, slots=True)
class Correction:
    """``matrix`` (3, 3), ``offset`` (3,) in the sensor's unit, ``motor`` (3,) in that unit per unit of power."""

    matrix: Array
    offset: Array
    motor: Array

    def __post_init__(self) -> None:
        known = all(np.isfinite(part).all() for part in (self.matrix, self.offset, self.motor))
        if not known or abs(float(np.linalg.det(self.matrix))) < SINGULAR:
            raise CalibrationUnknownError("The calibration in the parameters is no rotation with scales.")

    def body(self, raw: Array, power: Array | float = 0.0) -> Array:
        """Values (n, 3) in body axes of ``raw`` (n, 3) at ``power`` (n, 1)."""
        return (raw + self.offset) @ self.matrix.T + power * self.motor

    def raw(self, body: Array, power: Array | float = 0.0) -> Array:
        """Raw values (n, 3) of those in ``body`` axes: the inverse of :meth:`body`."""
        return (body - power * self.motor) @ np.linalg.inv(self.matrix).T - self.offset

    def offset_without(self, error: Array) -> Array:
        """The offset (3,) with which values would be lower by ``error`` (3,) in body axes."""
        return self.offset - np.linalg.solve(self.matrix, error)


@dataclass(frozen=True, slots=True)
class Calibration:
    """A sensor's correction with the parameters that hold it.

    ``offsets``: three names; the correction's offset is ``offset_unit`` times their values, negative where a firmware
    subtracts them. ``motors``: three names; the correction's motor is ``motor_matrix`` (3, 3) times their values while
    ``motor_power`` is what the firmware multiplies them with: "current", "throttle" or "" for nothing. ``names``: all
    parameters that enter. ``fixed``: parameters that say where the sensor points, or which one it is. ``units`` of the
    parameters by name, and their ``digits``: decimals beyond which no sensor shows a difference.
    """

    correction: Correction
    offsets: tuple[str, ...]
    offset_unit: float
    names: tuple[str, ...]
    fixed: tuple[str, ...]
    units: dict[str, str]
    digits: int
    motors: tuple[str, ...] = ()
    motor_matrix: Array | None = None
    motor_power: str = ""

    def offset_values(self, offset: Array) -> dict[str, float]:
        """The parameters that hold an ``offset`` (3,) of the correction, rounded."""
        return self._rounded(self.offsets, offset / self.offset_unit)

    def motor_values(self, motor: Array) -> dict[str, float]:
        """The parameters that hold what the correction adds per unit of power, ``motor`` (3,) in body axes."""
        if self.motor_matrix is None:
            return {}
        return self._rounded(self.motors, np.linalg.solve(self.motor_matrix, motor))

    def _rounded(self, names: tuple[str, ...], values: Iterable[float]) -> dict[str, float]:
        return {name: round(float(value), self.digits) for name, value in zip(names, values, strict=True)}
