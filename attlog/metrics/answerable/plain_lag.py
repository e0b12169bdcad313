"""Does the reference plainly turn as the gyro does in steps? Then their lag can be measured, without the fit.

The fit of the lag (:mod:`attlog.metrics.steps.fits`) also tells aiding, misalignment and intervals. It takes compiled
loops, and to load them costs more than all that ``attlog info`` does with a log. Here two rates about each event's axis
are compared at the delay of their largest correlation, which is enough where the answer is clear.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case
from attlog.metrics.evidence.phases import why_no_errors
from attlog.metrics.steps.fit.groups import MARGIN_S, SPAN_S, STRIDE_S, axis_of
from attlog.metrics.steps.fit.solution import MIN_EVENTS
from attlog.metrics.steps.fit.turning import SummedTurning, around
from attlog.metrics.steps.fits import COARSE_S, RANGE_S, events_in, reference_turning, timing, why_no_events
from attlog.metrics.steps.lag import input_delay, sample_step
from attlog.reference.model import Row

Array = NDArray[np.float64]


MOST_GAIN_ERROR, MOST_DISTORTION = 0.03, 0.08
"""Half of what :mod:`attlog.metrics.steps.lag` allows: between the two the fit decides."""
FINE = 5


def plainly(case: Case, row: Row, window: str) -> int | None:
    """How many events of a window the reference follows as the row does, some time apart; None where the fit decides.

    ``row``: the gyro alone.
    """
    if why_no_errors(case, row) is not None or why_no_events(case, row, window) is not None:
        return None
    ref, track = reference_turning(case), SummedTurning(row.t, row.q, row.segment, timing(case, row.t))
    span = max(2, round(SPAN_S / ref.step))
    x: list[Array] = []
    y: list[Array] = []
    at: list[Array] = []
    fast_t: list[Array] = []
    for event, a, b in zip(
        (events := events_in(case, row, window)), around(track, events, MARGIN_S), around(ref, events, 0.0), strict=True
    ):
        axis = None if a is None or b is None else axis_of(ref, event)
        if axis is None or a is None or b is None or b.stop - b.start <= span:
            continue
        offset = STRIDE_S * len(at) - event.begin
        fast_t.append(track.t[a] + offset)
        y.append((track.turned[a] - track.turned[a.start]) @ axis)
        at.append(ref.t[b] + offset)
        x.append((ref.turned[b] - ref.turned[b.start]) @ axis)
    if len(at) < MIN_EVENTS:
        return None
    rates = Rates(at, x, np.concatenate(fast_t), np.concatenate(y), span)
    delay = rates.best()
    gain, distortion = rates.compared(delay)
    lag, earliest = delay - input_delay(case, row), -0.5 * sample_step(case, row)
    early = case.reference.kind != "onboard" and lag < 0.5 * earliest
    edge = abs(delay) > RANGE_S - COARSE_S
    clear = abs(gain - 1.0) <= MOST_GAIN_ERROR and distortion <= MOST_DISTORTION and not early and not edge
    return len(at) if clear else None


class Rates:
    """The turning ``x`` of the reference at ``at``, event by event, and ``y`` of the row at ``t`` on one time axis."""

    def __init__(self, at: list[Array], x: list[Array], t: Array, y: Array, span: int) -> None:
        self.begin = np.concatenate([k[:-span] for k in at])
        self.end = np.concatenate([k[span:] for k in at])
        self.first = np.cumsum([0, *(len(k) - span for k in at)])
        self.t, self.y = t, y
        self.x = self._centred((np.concatenate([k[span:] - k[:-span] for k in x])) / (self.end - self.begin))

    def best(self) -> float:
        """The delay (s) of the row with the largest correlation: on a grid, a finer one, and between its points."""
        coarse = np.arange(-RANGE_S, RANGE_S + 1e-9, COARSE_S)
        middle = coarse[int(np.argmax([self._correlation(d) for d in coarse]))]
        step = COARSE_S / FINE
        fine = middle + step * np.arange(-FINE, FINE + 1)
        found = [self._correlation(d) for d in fine]
        k = min(max(int(np.argmax(found)), 1), len(fine) - 2)
        before, here, after = found[k - 1 : k + 2]
        bend = before - 2.0 * here + after
        return float(fine[k] + (0.5 * step * (before - after) / bend if bend < 0 else 0.0))

    def compared(self, delay: float) -> tuple[float, float]:
        """Gain of the row against the reference, and what that leaves of its rate, as a share of the reference's."""
        row, power = self._row(delay), float(self.x @ self.x)
        if power <= 0.0:
            return 0.0, np.inf
        gain = float(row @ self.x) / power
        left = row - gain * self.x
        return gain, float(np.sqrt(left @ left / power))

    def _correlation(self, delay: float) -> float:
        row = self._row(delay)
        size = float(np.sqrt((row @ row) * (self.x @ self.x)))
        return float(row @ self.x) / size if size > 0.0 else 0.0

    def _row(self, delay: float) -> Array:
        """The row's rate, so much later."""
        turned = np.interp(self.end + delay, self.t, self.y) - np.interp(self.begin + delay, self.t, self.y)
        return self._centred(turned / (self.end - self.begin))

    def _centred(self, rate: Array) -> Array:
        counts = np.diff(self.first)
        return np.asarray(rate - np.repeat(np.add.reduceat(rate, self.first[:-1]) / counts, counts))
