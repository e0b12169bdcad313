"""What happened in a flight that a pilot would note: ground contacts and planted faults."""

from __future__ import annotations

import numpy as np

from attlog.simulate.flight import Truth
from attlog.simulate.scenario import Scenario

IMPACT_M_S = 2.0
"""A touch-down faster than this is an impact; landing gear is tested for less."""


def events(scenario: Scenario, truth: Truth) -> list[tuple[float, str]]:
    """(t, what) in order: faults that begin, lift-off, touch-down with its speed."""
    found = [(f.t, f"fault: {f.part} {f.instance} {f.kind}") for f in scenario.fault]
    if scenario.motion is None:
        change = np.flatnonzero(truth.ground[1:] != truth.ground[:-1]) + 1
        for k in change:
            t = float(truth.t[k])
            if not truth.ground[k]:
                found.append((t, "lift-off"))
            else:
                speed = float(np.linalg.norm(truth.v[k - 1]))
                found.append((t, f"{'impact' if speed > IMPACT_M_S else 'touch-down'} at {speed:.1f} m/s"))
    return sorted(found)
