"""What metrics share of a case: computed once, for the right row, and gone with it."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.metrics import base
from attlog.metrics.base import Case, per_case, per_row, per_times
from attlog.metrics.evidence.common_bias import none
from attlog.reference.model import Row
from tests.metrics import flights


@pytest.fixture
def calls() -> list[str]:
    return []


def row(name: str) -> Row:
    t = np.arange(0.0, 1.0, 0.1)
    return flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), name)


def test_what_rows_share_is_computed_once_for_equal_spans(calls: list[str]) -> None:
    @per_case
    def total(case: Case, spans: list[tuple[float, float]], scale: float = 1.0) -> float:
        calls.append("total")
        return scale * sum(b - a for a, b in spans)

    case = flights.case([], [])
    assert [total(case, [(0.0, 1.0)]), total(case, [(0.0, 1.0)])] == [1.0, 1.0]
    assert len(calls) == 1
    assert total(case, [(0.0, 2.0)]) == 2.0
    assert total(case, [(0.0, 2.0)], scale=3.0) == 6.0
    assert total(flights.case([], []), [(0.0, 1.0)]) == 1.0
    assert len(calls) == 4


def test_rows_of_one_name_are_different_rows(calls: list[str]) -> None:
    """Two evaluations of one case may both hold a row ``mahony``."""

    @per_row
    def first(case: Case, row: Row, segment: slice) -> float:
        calls.append(row.name)
        return float(row.t[segment][0])

    a, b = row("mahony"), row("mahony")
    b.t = b.t + 5.0
    case = flights.case([a, b], [])
    assert [first(case, r, slice(0, 3)) for r in (a, b, a)] == [0.0, 5.0, 0.0]
    assert first(case, a, slice(2, 3)) == pytest.approx(0.2)
    assert len(calls) == 3


def test_functions_do_not_share_what_they_found() -> None:
    @per_case
    def one(case: Case) -> int:
        return 1

    @per_case
    def two(case: Case) -> int:
        return 2

    case = flights.case([], [])
    assert (one(case), two(case)) == (1, 2)


def test_what_was_found_for_a_row_goes_with_the_row() -> None:
    """A sweep evaluates thousands of rows on one case."""

    @per_row
    def size(case: Case, row: Row) -> int:
        return len(row.t)

    case, own = flights.case([], []), row("mahony")
    assert size(case, own) == 10
    assert len(case.of_row) == 1
    del own
    gc.collect()
    assert len(case.of_row) == 0


def test_what_rows_of_the_same_times_share_is_computed_once_for_each_array(calls: list[str]) -> None:
    @per_times
    def last(case: Case, t: np.ndarray, more: float = 0.0) -> float:
        calls.append("last")
        return float(t[-1]) + more

    case, t = flights.case([], []), np.arange(3.0)
    equal = t.copy()
    assert [last(case, t), last(case, t), last(case, t, more=1.0), last(case, equal)] == [2.0, 2.0, 3.0, 2.0]
    assert len(calls) == 3
    known = len(case.of_log)
    del equal
    gc.collect()
    assert len(case.of_log) == known - 1  # nothing is kept of an array that is gone


def test_the_bias_of_changed_samples_is_their_own_and_that_of_the_logs_units_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only where it was asked to be that at rest: a bias that was given stays what it is."""
    t = np.arange(3.0)
    stream = Stream(t, np.ones((3, 3)), "rad/s", "FRD", "IMU")
    unit, changed = Imu(0, stream, stream), Imu(0, stream, stream)
    case = flights.case([], [])
    case.log.imus = [unit]
    assert case.bias_of(unit).taken == "none"
    monkeypatch.setattr(base, "common_bias", lambda log, segments, imu, asked: "anew")
    for asked, of_changed in (("rest", "anew"), ("none", None)):
        known = replace(none(), asked=asked)
        case.gyro_bias = {0: known}
        assert case.bias_of(unit) is known
        assert case.bias_of(changed) == (of_changed or known)
