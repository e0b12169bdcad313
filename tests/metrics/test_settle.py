"""What is measured is asked where it is wanted, once all rows have passed, and stands in its place of the table."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import pytest

from attlog import metrics
from attlog.base import rotation
from attlog.metrics.answer import Answer
from attlog.metrics.errors import rmse
from attlog.segments.model import Segment
from tests.metrics import flights

MEASURED = metrics.measured().METRICS[0].name
AFTER = metrics.questions()[metrics.QUESTIONS.index(metrics.MEASURED) + 1].METRICS[0].name
BEFORE = metrics.questions()[0].METRICS[0].name


def settled(monkeypatch: pytest.MonkeyPatch, cost: bool, only: Collection[str]) -> list[str]:
    """The metrics of a row, in order, after it was settled."""
    t = np.arange(0.0, 10.0, 0.01)
    row = flights.row(t, rotation.from_euler(0.0 * t, 0.0 * t, 0.0 * t))
    case = flights.case([row], [Segment("continuous", 0, 10)])
    decided: list[Any] = []
    monkeypatch.setattr(rmse, "decide", decided.append)
    monkeypatch.setattr(metrics.measured(), "compute", lambda case, row, window: {MEASURED: Answer(1.0)})
    table = {row.name: {"all": {BEFORE: Answer(2.0), AFTER: Answer(3.0)}}}
    metrics.settle(case, table, cost=cost, only=only)
    assert decided == [case]
    return list(table[row.name]["all"])


@pytest.mark.parametrize(
    ("cost", "only", "asked"),
    [
        (True, (), True),
        (False, (), False),
        (True, (MEASURED,), True),
        (True, (MEASURED.partition(".")[0], BEFORE), True),
        (True, (BEFORE,), False),
        (False, (MEASURED,), False),
    ],
)
def test_what_is_measured_is_asked_where_it_is_wanted(
    monkeypatch: pytest.MonkeyPatch, cost: bool, only: tuple[str, ...], asked: bool
) -> None:
    assert settled(monkeypatch, cost, only) == ([BEFORE, MEASURED, AFTER] if asked else [BEFORE, AFTER])
