"""Is the noise that the onboard estimator expects of an aid too small? A suggestion, where a sound flight shows it.

A ratio of 1 is ``gate`` standard deviations, so a filter that expects what happens has a median near 0.7 / gate: 0.13
for a gate of 5, 0.22 for 3. Medians far below are usual with both firmwares' defaults (0.01 to 0.1 on 30 sound
flights): they expect more noise than there is, on purpose, so that nothing is suggested. Above 0.5 the filter leans
on every fix and rejects the next gust; where nothing else is wrong the noise times (median x gate) is what happens.
"""

from __future__ import annotations

from attlog.flight.aiding import noise as parameters
from attlog.health.assessments.model import Assessment, HealthCase, Setting
from attlog.health.assessments.onboard.test_ratios import RatioSummary

HIGH, RARELY = 0.5, 0.01
LEAST_S = 60.0
"""A shorter flight suggests no noise."""
MOST = 3.0
"""At most so many times the old noise in one step."""
UNSOUND = ("heading by GNSS", "second source", "compass offset", "compass turn", "force axes", "force offset")
"""Checks that name another cause of large ratios."""


def suggest(case: HealthCase, one: RatioSummary, told: Assessment) -> None:
    """Add a larger noise to an assessment where the ratios of a sound flight stay high."""
    if one.interval[0] <= HIGH or one.above > RARELY * one.seconds or one.seconds < LEAST_S:
        return
    told.verdict = "warning"
    told.evidence.append(
        "Half of all innovations use up more than half of the gate: a gust or a turn is rejected next."
    )
    accused = [c.name for c in case.checks if c.verdict in ("warning", "fault") and _unsound(c.name)]
    if accused:
        told.why_no_setting = f"Something else is wrong first: {', '.join(accused[:3])}."
        return
    known = parameters.of_aid(case.log, one.aid, one.source)
    if known is None:
        told.why_no_setting = "The log does not hold the noise and the gate of this aid."
        return
    larger = min(one.median * known.gate, MOST)
    new = float(f"{min(max(known.old * larger, known.low), known.high):.2g}")
    if new <= known.old:
        told.why_no_setting = f"{known.name} is as large as it may be."
        return
    told.settings = [Setting(known.name, known.old, new)]
    told.action = f"A suggestion: {known.name} {known.old:g} expects less than happens; {new:g} fits this flight."


def _unsound(name: str) -> bool:
    return name in UNSOUND or name.startswith(("gyro", "vibration", "gravity", "field"))
