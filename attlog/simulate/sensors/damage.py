"""Planted faults at work on samples of three columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.fault import PlantedFault
from attlog.simulate.physics.streams import generator

Array = NDArray[np.float64]


def acting(fault: PlantedFault, t: Array) -> NDArray[np.bool_]:
    """At which of the times (n,) s a fault acts."""
    end = np.inf if fault.seconds is None else fault.t + fault.seconds
    mask: NDArray[np.bool_] = (t >= fault.t) & (t < end)
    return mask


def silent(faults: list[PlantedFault], t: Array) -> NDArray[np.bool_]:
    """Which samples at ``t`` (n,) s a fault keeps from being sent."""
    gone = np.zeros(len(t), bool)
    for fault in faults:
        if fault.kind == "silent":
            gone |= acting(fault, t)
    return gone


def damaged(faults: list[PlantedFault], t: Array, x: Array, last: Array, seed: int = 0) -> Array:
    """Samples ``x`` (n, k) at ``t`` (n,) s with the faults that act then; ``last`` (k,) is the sample before them.

    Random faults draw by the sample's time, so that samples one by one and all at once give the same.
    """
    x = x.copy()
    for number, fault in enumerate(faults):
        now = np.flatnonzero(acting(fault, t))
        if not len(now):
            continue
        k = x.shape[1]
        if fault.kind == "stuck":
            x[now] = x[now[0] - 1] if now[0] > 0 else last
        elif fault.kind == "zero":
            x[now] = 0.0
        elif fault.kind == "offset":
            x[now] += np.array(fault.value[:k])
        elif fault.kind == "scale":
            x[now] *= fault.factor
        elif fault.kind == "flipped":
            x[now, : min(k, 2)] *= -1.0
        elif fault.kind in ("noise", "spikes"):
            for i in now:
                random = generator(seed, "fault", number, fault.part, round(float(t[i]) * 1e6))
                drawn = random.standard_normal(k)
                if fault.kind == "noise" or random.random() * 100.0 < fault.share_pct:
                    x[i] += fault.size * (drawn if fault.kind == "noise" else drawn / np.linalg.norm(drawn))
    return x
