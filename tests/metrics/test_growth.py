"""What judges rows costs no more than the log is long: by counts, memory, and CPU time of two sizes side by side."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from attlog.flight.model import Attitude
from attlog.metrics import drift, gyro_bias, step_error, step_fit, step_products, step_turning
from attlog.reference import alignment
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.flights import motion, sampled

HZ = 100.0
SPANS = [(10.0 + k, 10.8 + k) for k in range(60)]
"""The same short spans in a short and in a long log."""
SHORT_S, LONG_S = 100.0, 10_000.0


def cost(work: Callable[[], object]) -> float:
    """CPU seconds, the least of some runs."""
    taken = []
    for _ in range(4):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return min(taken)


def row_of(seconds: float):
    """A filter at rest with a bias estimate."""
    t = np.arange(0.0, seconds, 1.0 / HZ)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return flights.row(t, q, bias=np.zeros((len(t), 3)))


def turned(seconds: float) -> Callable[[], object]:
    row = row_of(seconds)
    gyro, force = (row.t, row.bias), (row.t, row.bias + np.array([0.0, 0.0, -9.8]))
    return lambda: [gyro_bias.turned(gyro, [force], span) for span in SPANS]


def curves(seconds: float) -> Callable[[], object]:
    t, q = motion("steps", 60.0)
    seconds = min(seconds, 3000.0)
    more = np.arange(t[-1], seconds, t[1])[1:]
    t, q = np.concatenate([t, more]), np.concatenate([q, np.tile(q[-1], (len(more), 1))])
    row = flights.row(t[::2], q[::2])
    case = flights.case([row], [Segment("continuous", 0, seconds)], (t[::4], q[::4]))
    events = tuple(step_turning.reference_steps(case))
    assert len(events) > 20
    step_error.event_curves(case, row, events)  # what the log itself costs is found and kept

    def anew() -> object:
        case.of_row.clear()
        return step_error.event_curves(case, row, events)

    return anew


@pytest.mark.parametrize("of_log", [turned, curves], ids=lambda f: f.__name__)
def test_short_spans_cost_the_same_in_a_log_a_hundred_times_as_long(of_log):
    """A mask over the whole log for each span would cost a hundred times as much."""
    assert cost(of_log(LONG_S)) < 8 * cost(of_log(SHORT_S)) + 0.005


def test_leaving_out_each_event_solves_once_and_not_event_by_event(monkeypatch):
    solved = []
    real = np.linalg.solve
    monkeypatch.setattr(np.linalg, "solve", lambda a, b: (solved.append(1), real(a, b))[1])
    counts = []
    for seconds in (20.0, 100.0):
        t, q = motion("steps", seconds)
        row, ref = sampled(t, q, 100.0, 0.005), sampled(t, q, 50.0)
        columns = step_products.event_batches(row, ref, step_turning.find_steps(ref.t, ref.q, ref.segment), None)
        solved.clear()
        found = step_fit.fit(columns)["all"]
        counts.append((len(found.events), len(solved)))
    assert counts[1][0] > 4 * counts[0][0]
    assert counts[1][1] < counts[0][1] + 12  # an iteration more, not a solution for each event


def test_segments_of_an_onboard_row_are_found_once_and_not_for_each_rest(monkeypatch):
    t = np.arange(0.0, 200.0, 1.0 / HZ)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    row = flights.row(t, q, estimator="made")
    row.kind = "onboard"
    rests = [Segment("rest.short", *span) for span in SPANS[::2]]
    case = flights.case([row], [Segment("continuous", 0.0, 200.0), *rests])
    case.log.attitudes["made"] = Attitude(t, q, "made")
    found = []
    real = alignment.usable_samples
    monkeypatch.setattr(alignment, "usable_samples", lambda *a: (found.append(1), real(*a))[1])
    for span in SPANS[::2]:
        drift.rest_blocks(case, row, (span,))
    assert len(found) == 1
