"""Test proposed settings by running the onboard filter again with them.

The flown filter runs again with the new values: its own parameters (delays, noises, sources), sensors calibrated by
them (offsets, motor field), or another compass. A setting that makes an aid's innovations significantly larger, and
none smaller, is not offered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from attlog import estimators
from attlog.core.errors import UsageError
from attlog.estimators.interface import Estimator
from attlog.flight.recalibration import calibrates
from attlog.health import Check
from attlog.metrics.metric import Case
from attlog.pipeline.onboard_rerun import flown_filter
from attlog.pipeline.rejected_aids import explain_rejection
from attlog.pipeline.trials import Trials, trials_of, values_text


def prove_settings(case: Case, checks: list[Check]) -> list[Check]:
    """Add innovations before and after to each check with settings; drop harmful settings.

    Rejected aids get what accepts their samples. Checks without settings of the filter, and checks of logs that cannot
    be run again, are returned unchanged.
    """
    name, imu = flown_filter(case.log), case.log.replay_imu
    if not name or imu is None:
        return checks
    estimator = estimators.get(name)
    concerned = [_is_concerned(check, estimator) for check in checks]
    trials = trials_of(case, imu, estimator) if any(concerned) else None
    if trials is None:
        return checks
    proven = []
    for check, tried in zip(checks, concerned, strict=True):
        try:
            proven.append(_proven(trials, check, checks) if tried else check)
        except UsageError:  # a parameter that the re-run of this version does not take
            proven.append(check)
    return proven


def _is_concerned(check: Check, estimator: Estimator) -> bool:
    """Return whether a check of a sensor in use offers inputs of the filter, or reports a rejected aid."""
    names, known = [s.name for s in check.settings], {p.name for p in estimator.parameters} | set(estimator.aliases)
    offered = not known.isdisjoint(names) or calibrates(names) or check.other_compass
    rejected = check.question == "innovations" and check.is_trouble and check.t is not None
    return check.in_use and bool(offered or rejected)


def _proven(trials: Trials, check: Check, checks: Sequence[Check]) -> Check:
    """Return a check with the re-run of what it offers, else of its rejected aid."""
    known = {p.name for p in trials.estimator.parameters}
    own = {trials.estimator.aliases.get(s.name, s.name): s.new for s in check.settings}
    mag = next((m for m in trials.case.log.mags if m.field.source == check.other_compass), None)
    same = (c.settings for c in checks if c.question == check.question and c.sensor == check.other_compass)
    offered = check.settings if mag is None else next((settings for settings in same if settings), [])
    calibration = {s.name: s.new for s in offered if calibrates([s.name])}
    words = values_text({s.name: s.new for s in offered})
    if mag is not None:
        shown, worse, _ = trials.run({}, calibration, mag)
        words = f"the samples of {check.other_compass}{f' and {words}' if words else ''}"
    elif check.settings and set(own) <= known:
        shown, worse, _ = trials.run(own)
    elif calibration and len(calibration) == len(check.settings):
        shown, worse, _ = trials.run({}, calibration)
    else:
        return replace(check, evidence=[*check.evidence, *explain_rejection(trials, check, checks)])
    if worse:
        why = f"Not offered: run again with {words}, {trials.title} predicts worse: {shown}."
        return replace(check, settings=[], action="", why_no_setting=why, other_compass="")
    return replace(check, evidence=[*check.evidence, f"{trials.title} run again with {words}: {shown}."])
