"""What did the onboard estimator reject, and when? Its own test ratios over time, one line for each aid."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Array
from attlog.health.assessments.model import HealthCase
from attlog.health.figures.samples import MOST, end_of, highest
from attlog.metrics.figures.trace import Trace

FEWEST = 10


def ratios(case: HealthCase) -> list[Trace]:
    """One trace for each aid that was tested, thinned by its maxima; a ratio of 0 throughout is of none."""
    end = end_of(case.segments)
    found = [of_arrays(test.aid, test.t, test.ratio, end) for test in case.log.innovation_tests]
    return [trace for trace in found if len(trace.t) >= FEWEST and trace.columns["ratio"].max() > 0]


def of_arrays(aid: str, t: Array, ratio: Array, end: float = np.inf) -> Trace:
    """The trace of ratios (n,) at ``t`` (n,) s up to ``end``: the largest of each window where there are many."""
    own = t <= end
    t, ratio = t[own], ratio[own]
    if np.count_nonzero(np.isfinite(ratio)) > MOST:
        t, ratio = highest(t, ratio, [(float(t[0]), float(t[-1]))], 0.0)
    good = np.isfinite(ratio)
    return Trace("ratios", "", t[good], {"ratio": ratio[good]}, aid)
