"""Does a row follow motion at all? A frozen filter is the quietest of all and must not win the noise table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.answer import Answer
from attlog.metrics.base import Case, per_row, per_times
from attlog.metrics.steps import events as steps
from attlog.metrics.steps import fits as step_fits
from attlog.metrics.steps.fit import solution as step_solution
from attlog.metrics.trials import still
from attlog.reference.model import Row
from attlog.segments import gaps

Array = NDArray[np.float64]

LOW, HIGH = 0.8, 1.2
MOVING_DPS = 5.0
MIN_SAMPLES = 20
"""The frozen-filter guard: docs/metrics.md, Noise."""


@dataclass(frozen=True, slots=True)
class MotionCheck:
    """Whether a row may be ranked for noise: its ``gain`` (1 = follows) and how it was found."""

    follows: bool
    gain: float | None
    how: str
    reason: str = ""


def _gains_of(t: Array, q_est: Array, ref: Array, segment: NDArray[np.int64]) -> Array:
    """Gains (4,) of an estimate's turning on that of the reference, (n - 1, 3) in rad from sample to sample.

    Body x, y, z and all axes together. Regression through the origin, over samples where the reference turns faster
    than 5 deg/s; steps between segments (gaps, resets) are cut out. NaN where fewer than 20 samples move.
    """
    dt = np.diff(t)
    limit = np.radians(MOVING_DPS) * dt
    fast = np.abs(ref[:, 0]) > limit
    for column in ref.T[1:]:
        fast |= np.abs(column) > limit
    at = np.flatnonzero(fast & (segment[1:] == segment[:-1]) & (dt > 0))
    est, ref = rotation.turns(q_est[at], q_est[at + 1]), ref[at]
    known = rotation.finite(est) & rotation.finite(ref)
    est, ref, limit = gaps.only(known, est, ref, limit[at])
    moving: NDArray[np.bool_] = np.asarray(np.abs(ref) > limit[:, None])
    gains, together = np.full(4, np.nan), np.ones(len(est), bool)
    for place, use, part in [*((k, moving[:, k], slice(k, k + 1)) for k in range(3)), (3, together, slice(None))]:
        if np.count_nonzero(use) >= MIN_SAMPLES:
            moved = np.where(use[:, None], ref[:, part], 0.0)
            gains[place] = float(np.sum(est[:, part] * moved)) / float(np.sum(moved * moved))
    return gains


@per_times
def _turns(case: Case, q: Array) -> Array:
    """What an attitude (n, 4) turns from sample to sample (n - 1, 3) rad; of the reference the same for all rows."""
    return rotation.increments(q)


@per_row
def verdict(case: Case, row: Row, axis: str) -> MotionCheck:
    """Whether a row follows motion about roll, pitch or heading: by its steps, else by regression, else by a probe.

    One gain of 0.8 to 1.2 is enough: acceleration bends real filters in steps (gain
    0.75), the probe then shows that they are not frozen.
    """
    found: list[str] = []
    for gain, how in _gains(case, row, ("roll", "pitch", "heading").index(axis)):
        if LOW <= gain <= HIGH:
            return MotionCheck(True, gain, how)
        found.append(f"{gain:.2f} {how}")
    if not found:
        return MotionCheck(False, None, "no motion", "did not move: nothing shows that this row follows motion")
    return MotionCheck(
        False, None, "all", f"does not follow motion: gain {', '.join(found)} ({LOW} to {HIGH} shows that it does)"
    )


def _gains(case: Case, row: Row, axis: int) -> Iterator[tuple[float, str]]:
    """The gains that are known of a row about one axis, the best evidence first."""
    step = step_fits.fits(case, row, "all").get(steps.AXES[axis])
    if step is not None and len(step.events) >= step_solution.MIN_EVENTS:
        yield step.plain_gain, f"in {len(step.events)} steps"
    regression = _regression(case, row)
    if np.isfinite(regression[axis]):
        yield float(regression[axis]), "by regression on the reference's rate"
    probed = still.gains(case, row)
    if probed is not None:
        yield float(probed[axis]), "in a probe at rest"


def unrank_frozen(case: Case, row: Row, axis: str, answer: Answer) -> Answer:
    """The answer, no longer ranked where the row does not follow motion about that axis: standing still is no merit."""
    if answer.value is not None and answer.ranked:
        found = verdict(case, row, axis)
        answer.ranked, answer.reason = found.follows, answer.reason if found.follows else found.reason
    return answer


@per_row
def _regression(case: Case, row: Row) -> Array:
    if row.errors is None or len(row.errors.t) < 2:
        return np.full(4, np.nan)
    e = row.errors
    return _gains_of(e.t, e.q_est, _turns(case, e.q_ref), e.segment)
