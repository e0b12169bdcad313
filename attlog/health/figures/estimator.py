"""What did the onboard estimator reject, and when? Its own test ratios over time, one line for each aid."""

from __future__ import annotations

from attlog.health.assessments.model import HealthCase
from attlog.health.assessments.onboard import test_ratios
from attlog.health.figures.samples import end_of
from attlog.metrics.figures.trace import Trace

FEWEST = 10


def ratios(case: HealthCase) -> list[Trace]:
    """One trace for each aid that was used, up to the first crash; its largest values stay."""
    end = end_of(case.segments)
    found = []
    for one in test_ratios.series(case):
        own = one.t <= end
        if own.sum() >= FEWEST and one.ratio[own].any():
            found.append(Trace("ratios", "", one.t[own], {"ratio": one.ratio[own]}, one.aid))
    return found
