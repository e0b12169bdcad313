"""What happened in a flight that a pilot would note: ground contacts and planted faults."""

from __future__ import annotations

import numpy as np

from attlog.simulate.flight import Truth
from attlog.simulate.scenario.scenario import Scenario

IMPACT_M_S = 2.0
"""A touch-down faster than this is an impact; landing gear is tested for less."""
BOUNCES_S = 1.5
"""Feet that touch again within this time are one touch-down."""


def events(scenario: Scenario, truth: Truth) -> list[tuple[float, str]]:
    """(t, what) in order: faults that begin, lift-off, touch-down with its speed."""
    found = [(f.t, f"fault: {f.part} {f.instance} {f.kind}") for f in scenario.fault]
    if scenario.motion is None:
        change = np.flatnonzero(truth.ground[1:] != truth.ground[:-1]) + 1
        last = -np.inf
        for k in change:
            t = float(truth.t[k])
            if truth.ground[k] and t - last > BOUNCES_S:
                speed = float(np.linalg.norm(truth.v[k - 1]))
                found.append((t, f"{'impact' if speed > IMPACT_M_S else 'touch-down'} at {speed:.1f} m/s"))
            elif not truth.ground[k] and not truth.ground[k : k + _samples(truth, BOUNCES_S)].any():
                found.append((t, "lift-off"))
            last = t
    return sorted(found)


def _samples(truth: Truth, seconds: float) -> int:
    """How many samples of the truth a time holds."""
    return int(seconds / (truth.t[1] - truth.t[0]))
