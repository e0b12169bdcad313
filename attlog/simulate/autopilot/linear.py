"""The attitude loop as transfer functions: what it should do, from gains, rotor lag and inertia alone.

For one axis and small angles, with authority A (rad/s^2 per unit of torque), rotor lag T and the loop's delay d:

    P(s) = A e^(-ds) / (T s + 1) / s                                   torque -> rate
    F(s) = kp + ki/s + kd s / (s/w_d + 1)                              rate -> torque (fed back)
    C(s) = kp + ki/s,   Co(s) = 4.5 + 0.35/s                           inner and outer PI
    L(s) = P (F + C Co / s)                                            the loop, cut at the rotors
    angle / set-point = (P C Co / s) / (1 + L)

The delay is a Pade fraction of second order where a step is wanted and exact where margins are. A thing of
numpy alone, so that tests and the page of Huang's paper share it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.simulate.autopilot.controller import Gains

Array = NDArray[np.floating[Any]]
Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, slots=True)
class LoopAxis:
    """One axis of the loop: ``authority`` rad/s^2 per unit torque, ``lag`` of the rotors s, ``delay`` s, its gains.

    ``delay``: half a period of holding the output (1.25 ms at 400 Hz), and what sensors and computing take.
    """

    authority: float
    lag: float
    gains: Gains
    index: int = 0
    delay: float = 0.00125

    @property
    def rate_feedback(self) -> tuple[Array, Array]:
        """F(s): numerator and denominator, coefficients (k,) from the highest power."""
        g, i = self.gains, self.index
        corner = 1.0 / (2.0 * math.pi * g.derivative_hz)
        low_pass = np.array([corner, 1.0])
        slope = np.array([g.rate_kd[i], 0.0, 0.0])
        return np.polyadd(np.polymul([g.rate_kp[i], g.rate_ki[i]], low_pass), slope), np.polymul([1.0, 0.0], low_pass)

    @property
    def forward(self) -> tuple[Array, Array]:
        """C(s) Co(s): numerator and denominator, coefficients (k,) from the highest power."""
        g, i = self.gains, self.index
        return np.polymul([g.rate_kp[i], g.rate_ki[i]], [g.angle_kp[i], g.angle_ki[i]]), np.array([1.0, 0.0, 0.0])

    def loop(self, omega: ArrayLike) -> Complex:
        """L(j omega), cut at the rotors; ``omega`` (n,) rad/s."""
        s = 1j * np.asarray(omega, np.float64)
        plant = self.authority * np.exp(-self.delay * s) / (self.lag * s + 1.0) / s
        inner, outer = _at(self.rate_feedback, s), _at(self.forward, s) / s
        found: Complex = plant * (inner + outer)
        return found

    def closed(self) -> tuple[Array, Array]:
        """Numerator and denominator (k,) of angle / set-point, the delay as a Pade fraction."""
        d = self.delay
        ahead, behind = np.array([d * d / 12.0, -d / 2.0, 1.0]), np.array([d * d / 12.0, d / 2.0, 1.0])
        plant_num = self.authority * ahead
        plant_den = np.polymul(np.polymul([self.lag, 1.0], [1.0, 0.0]), behind)
        (f_num, f_den), (c_num, c_den) = self.rate_feedback, self.forward
        c_den = np.polymul(c_den, [1.0, 0.0])
        both = np.polyadd(np.polymul(f_num, c_den), np.polymul(c_num, f_den))
        num = np.polymul(np.polymul(plant_num, c_num), f_den)
        den = np.polyadd(np.polymul(plant_den, np.polymul(f_den, c_den)), np.polymul(plant_num, both))
        # F and C share integrators, which stand in both.
        while abs(num[-1]) < 1e-12 and abs(den[-1]) < 1e-12:
            num, den = num[:-1], den[:-1]
        return num, den

    def step(self, t: ArrayLike) -> Array:
        """The angle (n,) at times ``t`` (n,) after a unit step of the set-point: a sum over the poles."""
        num, den = self.closed()
        poles = np.roots(den)
        residues = np.polyval(num, poles) / (np.polyval(np.polyder(den), poles) * poles)
        t = np.asarray(t, np.float64)
        parts = residues[None, :] * np.exp(np.outer(t, poles))
        rest = float(np.polyval(num, 0.0) / np.polyval(den, 0.0))
        return np.where(t > 0.0, rest + parts.sum(axis=1).real, 0.0)

    def response(self, omega: float) -> complex:
        """angle / set-point at ``omega`` rad/s, the delay exact."""
        s = np.array([1j * omega])
        plant = self.authority * np.exp(-self.delay * s) / (self.lag * s + 1.0) / s
        return complex((plant * _at(self.forward, s) / s / (1.0 + self.loop([omega])))[0])


@dataclass(frozen=True, slots=True)
class Margins:
    """How far the loop is from instability: ``gain`` (factor), ``phase_deg`` and ``delay_s``, at rad/s."""

    gain: float
    gain_at: float
    phase_deg: float
    phase_at: float

    @property
    def delay_s(self) -> float:
        """The additional delay that the phase margin allows."""
        return math.radians(self.phase_deg) / self.phase_at


def margins(axis: LoopAxis) -> Margins:
    """Gain margin above the highest crossing of -180 deg, phase margin at the highest crossing of 1."""
    omega = np.geomspace(0.1, 3000.0, 60000)
    loop = axis.loop(omega)
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    phase -= 2.0 * np.pi * np.round((phase[-1] - np.angle(loop[-1])) / (2.0 * np.pi))
    phase = phase - 2.0 * np.pi * np.ceil((phase[len(phase) // 2] - 0.0) / (2.0 * np.pi))
    unity = int(np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))[-1])
    turned = int(np.flatnonzero((phase[:-1] >= -np.pi) & (phase[1:] < -np.pi) & (omega[1:] > omega[unity]))[0])
    return Margins(
        float(1.0 / size[turned]), float(omega[turned]), float(np.degrees(np.pi + phase[unity])), float(omega[unity])
    )


def rise_and_overshoot(t: Array, y: Array) -> tuple[float, float]:
    """Time from 10 to 90 % of a unit step ``y`` (n,) at ``t`` (n,) s, in s, and the largest excess over 1."""
    a, b = (float(np.interp(level, np.maximum.accumulate(y), t)) for level in (0.1, 0.9))
    return b - a, float(y.max() - 1.0)


def _at(fraction: tuple[Array, Array], s: Complex) -> Complex:
    """A fraction of polynomials at s."""
    value: Complex = np.polyval(fraction[0], s) / np.polyval(fraction[1], s)
    return value
