"""Re-runs of the flown filter with changes, and what they change in its innovations.

Innovations are a filter's own prediction errors and need no reference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from attlog import estimators
from attlog.core.errors import UsageError
from attlog.estimators.interface import Estimator
from attlog.flight.model import Imu, Mag
from attlog.health.check import number_text
from attlog.metrics.metric import Answer, Case
from attlog.metrics.rerun import AID_GROUPS, compute_innovations
from attlog.metrics.statistics import student
from attlog.pipeline.onboard_rerun import rerun_row
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


class Trials(NamedTuple):
    """Re-runs of the flown filter of a log: as it flew (``row``), and with changes.

    ``before``: statistics of the innovations as it flew.
    """

    case: Case
    imu: Imu
    estimator: Estimator
    row: Track
    before: Mapping[str, Answer]

    @property
    def title(self) -> str:
        """The filter's name in sentences."""
        return FILTER_TITLES[self.estimator.name]

    def run(
        self, changes: Mapping[str, float], calibration: Mapping[str, float] | None = None, compass: Mag | None = None
    ) -> tuple[str, bool, Track]:
        """Run again with changed parameters of the filter, of its sensors, and another compass.

        Returns the changes of innovations in words, whether the filter predicts worse, and the re-run.
        """
        spec = estimators.EstimatorSpec(self.estimator, params=dict(changes))
        row = rerun_row(self.case, self.imu, spec, self.estimator.name, calibration, compass)[0]
        before, after = self.before, compute_innovations(self.case, row, "airborne")
        sizes = [_change(before, after, aid) for aid in AIDS if f"{RMS}.{aid}" in before and f"{RMS}.{aid}" in after]
        shown = "; ".join([text for text, _ in sizes if text][:MAX_SHOWN]) or "no innovation changes by 2 %"
        better, worse = (any(sign == wanted for _, sign in sizes) for wanted in (-1, 1))
        return shown, worse and not better, row


def trials_of(case: Case, imu: Imu, estimator: Estimator) -> Trials | None:
    """Run the flown filter again as it flew; None where it cannot be run or does not follow."""
    try:
        flown = rerun_row(case, imu, estimators.EstimatorSpec(estimator), estimator.name, study=True)[0]
    except UsageError:
        return None
    if flown.reproduction is None or not flown.reproduction.follows:
        return None
    return Trials(case, imu, estimator, flown, compute_innovations(case, flown, "airborne"))


def values_text(values: Mapping[str, float]) -> str:
    """Format parameters: ``EKF2_MAG_GATE 4.8, EKF2_MAG_NOISE 0.08``."""
    return ", ".join(f"{name} {number_text(value)}" for name, value in values.items())


def _change(before: Mapping[str, Answer], after: Mapping[str, Answer], aid: str) -> tuple[str, int]:
    """Describe the change of an aid's innovations, with its sign if significant.

    The text is empty and the sign 0 for a small change.
    """
    one, two = before[f"{RMS}.{aid}"], after[f"{RMS}.{aid}"]
    if not one.value or two.value is None or abs(two.value / one.value - 1.0) < MIN_CHANGE:
        return "", 0
    group, sizes = AID_GROUPS[aid], [_figures(x, 2) for x in (one.value, two.value)]
    if sizes[0] == sizes[1]:
        sizes = [_figures(x, 3) for x in (one.value, two.value)]
    text = f"{group.title} innovation {sizes[0]} to {sizes[1]} {group.unit}"
    ratios = [answers[f"{RATIO}.{aid}"].value for answers in (before, after)]
    if aid.startswith("compass") and all(ratios):
        text += f", ratio {ratios[0]:.2g} to {ratios[1]:.2g}"
    sign = _significant_sign(one, two)
    return text, sign if sign * (two.value - one.value) > 0.0 else 0


def _figures(value: float, digits: int) -> str:
    """Format a number with so many significant digits, whole from 100 on."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.{digits}g}"


def _significant_sign(one: Answer, two: Answer) -> int:
    """Return the sign of the mean log ratio of blocks' mean squares, 0 if not significant at 95 %.

    Ratios, because innovations of a manoeuvre outweigh those of all other blocks in a difference.
    """
    if one.units is None or two.units is None:
        return 0
    _, i, j = np.intersect1d(one.units.ids, two.units.ids, return_indices=True)
    before, after = one.units.values[i], two.units.values[j]
    use = (before > 0.0) & (after > 0.0)
    change, n = np.log(after[use] / before[use]), int(use.sum())
    if n < MIN_BLOCKS:
        return 0
    mean, half = float(np.mean(change)), student(0.975, n - 1) * float(np.std(change, ddof=1)) / math.sqrt(n)
    return int(np.sign(mean)) if abs(mean) > half else 0
