"""Test proposed settings by running the onboard filter again with them.

The flown filter runs again with the new values. Its innovations are its own prediction errors and need no reference. A
setting that makes an aid's innovations significantly larger, and none smaller, is not offered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from attlog import estimators
from attlog.core.errors import UsageError
from attlog.estimators.ekf2 import parameters as ekf2
from attlog.estimators.ekf3 import parameters as ekf3
from attlog.estimators.interface import Estimator
from attlog.flight.model import Imu
from attlog.health import Check, Setting
from attlog.health.check import number_text
from attlog.metrics.innovations import AID_GROUPS, compute_innovations
from attlog.metrics.intervals import student
from attlog.metrics.metric import Answer, Case
from attlog.pipeline.onboard_rerun import flown_filter, rerun_row
from attlog.reference.model import Track

RMS, RATIO = "innovation_rms", "test_ratio_rms"
# Aids in sentences. GNSS comes first, because it is independent of the compass.
AIDS = ("gnss_velocity", "gnss_position", "compass_heading", "compass_field", "height")
# Smaller relative changes of an RMS are not reported.
MIN_CHANGE = 0.02
# Aids named in one sentence.
MAX_SHOWN = 3
MIN_BLOCKS = 3
FILTER_TITLES = {"px4_ekf2": "EKF2", "ap_ekf3": "EKF3"}
# Parameter names of other firmware versions.
ALIASES = {"px4_ekf2": ekf2.ALIASES, "ap_ekf3": ekf3.ALIASES}


def prove_settings(case: Case, checks: list[Check]) -> list[Check]:
    """Add innovations before and after to each check with settings; drop harmful settings.

    Checks without settings of the filter, and checks of logs that cannot be run again, are returned unchanged.
    """
    name, imu = flown_filter(case.log), case.log.replay_imu
    if not name or imu is None:
        return checks
    estimator = estimators.get(name)
    changes = [_changes(check, estimator) for check in checks]
    if not any(changed or _is_offset(check) for changed, check in zip(changes, checks, strict=True)):
        return checks
    try:
        flown = rerun_row(case, imu, estimators.EstimatorSpec(estimator), name)[0]
    except UsageError:
        return checks
    if flown.reproduction is None or not flown.reproduction.follows:
        return checks
    before = compute_innovations(case, flown, "airborne")
    return [
        _proven(case, imu, estimator, check, changed, before) if changed or _is_offset(check) else check
        for check, changed in zip(checks, changes, strict=True)
    ]


def _changes(check: Check, estimator: Estimator) -> dict[str, float]:
    """Return a check's settings by the filter's names, empty unless all are known."""
    known = {p.name for p in estimator.parameters}
    aliases = {name: p for name, short in ALIASES[estimator.name].items() for p in known if p.endswith(short)}
    wanted = {aliases.get(s.name, s.name): s.new for s in check.settings}
    return wanted if check.in_use and set(wanted) <= known else {}


def _is_offset(check: Check) -> bool:
    """Return whether a check proposes an offset of the compass in use."""
    return check.question == "compass_offset" and check.in_use and bool(check.settings) and len(check.vector) == 3


def _proven(
    case: Case, imu: Imu, estimator: Estimator, check: Check, changed: Mapping[str, float], before: Mapping[str, Answer]
) -> Check:
    field_error_ut = np.array(check.vector) if _is_offset(check) else None
    spec = estimators.EstimatorSpec(estimator, params=dict(changed))
    row: Track = rerun_row(case, imu, spec, estimator.name, field_error_ut)[0]
    after = compute_innovations(case, row, "airborne")
    sizes = [_change(before, after, aid) for aid in AIDS if f"{RMS}.{aid}" in before and f"{RMS}.{aid}" in after]
    shown = "; ".join([text for text, _ in sizes if text][:MAX_SHOWN]) or "no innovation changes by 2 %"
    title, tried = FILTER_TITLES[estimator.name], _values_text(check.settings) if changed else "this offset removed"
    better, worse = (any(sign == wanted for _, sign in sizes) for wanted in (-1, 1))
    if worse and not better:
        why = f"Not offered: run again with {tried}, {title} predicts worse: {shown}."
        return replace(check, settings=[], action="", why_no_setting=why)
    return replace(check, evidence=[*check.evidence, f"{title} run again with {tried}: {shown}."])


def _change(before: Mapping[str, Answer], after: Mapping[str, Answer], aid: str) -> tuple[str, int]:
    """Describe the change of an aid's innovations, with its sign if significant.

    The text is empty and the sign 0 for a small change.
    """
    one, two = before[f"{RMS}.{aid}"], after[f"{RMS}.{aid}"]
    if not one.value or two.value is None or abs(two.value / one.value - 1.0) < MIN_CHANGE:
        return "", 0
    group = AID_GROUPS[aid]
    text = f"{group.title} innovation {one.value:.2g} to {two.value:.2g} {group.unit}"
    ratios = [answers[f"{RATIO}.{aid}"].value for answers in (before, after)]
    if aid.startswith("compass") and all(ratios):
        text += f", ratio {ratios[0]:.2g} to {ratios[1]:.2g}"
    return text, _significant_sign(one, two)


def _values_text(settings: list[Setting]) -> str:
    return ", ".join(f"{s.name} {number_text(s.new)}" for s in settings)


def _significant_sign(one: Answer, two: Answer) -> int:
    """Return the sign of the paired difference of blocks, 0 if not significant."""
    if one.units is None or two.units is None:
        return 0
    _, i, j = np.intersect1d(one.units.ids, two.units.ids, return_indices=True)
    difference = two.units.values[j] - one.units.values[i]
    n = len(difference)
    if n < MIN_BLOCKS:
        return 0
    mean, half = float(np.mean(difference)), student(0.975, n - 1) * float(np.std(difference, ddof=1)) / math.sqrt(n)
    return int(np.sign(mean)) if abs(mean) > half else 0
