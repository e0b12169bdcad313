"""Coverage, convergence and the log's own floor: answers of the whole log, not of its windows."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.errors import convergence
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 60.0, 0.02)


def answers(window: str, coverage: float | None = 80.0):
    level = rotation.from_euler(0 * T, 0 * T, 0.3)
    row = flights.row(T, rotation.from_euler(np.radians(1.0) + 0 * T, 0 * T, 0.3))
    case = flights.case([row], [Segment("continuous", 0, 60)], (T[::2], level[::2]), scoring_start=10.0)
    row.coverage_pct = coverage
    return convergence.compute(case, row, window)


def test_the_whole_log_has_them_all_and_a_window_none():
    assert set(answers("all")) == {m.name for m in convergence.METRICS}
    assert answers("rest") == answers("airborne") == {}


def test_coverage_is_the_rows_or_missing_where_nothing_counts():
    assert answers("all")["coverage_pct"].value == pytest.approx(80.0)
    assert answers("all", None)["coverage_pct"].code == "not_covered"


def test_the_floor_is_the_references_and_never_ranked():
    floor = answers("all")["replay_floor_deg"]
    assert floor.value is not None
    assert not floor.ranked
