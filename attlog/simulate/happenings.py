"""What happened in a flight that a pilot would note: ground contacts, overturns, faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from attlog.base import rotation
from attlog.simulate.flight import ImuStream, Truth
from attlog.simulate.scenario.scenario import Scenario

IMPACT_M_S = 2.0
"""A touch-down faster than this is an impact; landing gear is tested for less."""
OVER_DEG, UPRIGHT_DEG = 90.0, 30.0
BOUNCES_S = 1.5
"""Feet that touch again within this time are one touch-down."""


def events(scenario: Scenario, truth: Truth, imus: Sequence[ImuStream] = ()) -> list[tuple[float, str]]:
    """(t, what) in order: faults that begin, lift-off, touch-down with its speed, overturns, who carries it, and from
    when to when accelerometers were at the end of their range in flight."""
    found = [(f.t, f"fault: {f.part} {f.instance} {f.kind}") for f in scenario.fault]
    if scenario.command or scenario.motion is None:
        carried = scenario.motion.after_s if scenario.motion is not None else None
        found += [] if carried is None else [(carried, "carried by hand")]
        end = len(truth.t) if carried is None else int(np.searchsorted(truth.t, carried))
        found += _contacts(truth, end) + _overturns(truth, end)
        found += [x for imu in imus for x in _at_the_limit(truth, imu)]
    return sorted(found)


def _contacts(truth: Truth, end: int) -> list[tuple[float, str]]:
    """Lift-offs and touch-downs before a row of the truth."""
    found: list[tuple[float, str]] = []
    last = -np.inf
    for k in np.flatnonzero(truth.ground[1:end] != truth.ground[: end - 1]) + 1:
        t = float(truth.t[k])
        if truth.ground[k] and t - last > BOUNCES_S:
            speed = float(np.linalg.norm(truth.v[k - 1]))
            found.append((t, f"{'impact' if speed > IMPACT_M_S else 'touch-down'} at {speed:.1f} m/s"))
        elif not truth.ground[k] and not truth.ground[k : k + _samples(truth, BOUNCES_S)].any():
            found.append((t, "lift-off"))
        last = t
    return found


def _overturns(truth: Truth, end: int) -> list[tuple[float, str]]:
    """When the tilt first passed 90 deg, once until it stands upright again."""
    tilt = np.degrees(rotation.inclination_angle(truth.q[:end]))
    found: list[tuple[float, str]] = []
    over = False
    for k in np.flatnonzero((tilt > OVER_DEG) | (tilt < UPRIGHT_DEG)):
        if tilt[k] > OVER_DEG and not over:
            found.append((float(truth.t[k]), "overturn"))
        over = bool(tilt[k] > OVER_DEG)
    return found


def _at_the_limit(truth: Truth, imu: ImuStream) -> list[tuple[float, str]]:
    """From when to when samples of an accelerometer were at the end of its range in the air."""
    row = np.clip(np.searchsorted(truth.t, imu.t_sample), 0, len(truth.t) - 1)
    t = imu.t_sample[(imu.clipped[:, 1] > 0) & ~truth.ground[row]]
    if not len(t):
        return []
    name = f"accelerometer {imu.instance} at the end of its range"
    return [(float(t[0]), f"{name}, first"), (float(t[-1]), f"{name}, last")]


def _samples(truth: Truth, seconds: float) -> int:
    """How many samples of the truth a time holds."""
    return int(seconds / (truth.t[1] - truth.t[0]))
