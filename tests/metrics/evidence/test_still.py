"""The rest that a filter is tried on holds the log's own samples, the magnetometer's among them."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Imu, Mag, Stream
from attlog.metrics.base import Case
from attlog.metrics.evidence import still
from attlog.reference.model import Row
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 60.0, 0.01)
FIELD_T = np.arange(0.003, 60.0, 0.1)


def resting(rest: tuple[float, float]) -> tuple[Case, Row]:
    """A log at rest from and to these times; its samples tell their own time."""
    row = flights.row(T, np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1)))
    case = flights.case([row], [Segment("continuous", 0, 60), Segment("rest.long", *rest)])
    of_time = [Stream(T, np.column_stack([T, T, T]), unit, "FRD", "imu") for unit in ("rad/s", "m/s^2")]
    case.log.imus, case.log.imu = [Imu(0, *of_time)], 0
    field = Stream(FIELD_T, np.column_stack([FIELD_T] * 3), "T", "FRD", "mag")
    case.log.mags, case.log.mag = [Mag(0, field)], 0
    return case, row


def test_every_field_of_the_rest_stands_at_the_first_sample_after_it() -> None:
    found = still.of_log(*resting((10.0, 30.0)), shortest=5.0, longest=60.0)
    assert found is not None
    assert found.mag is not None
    assert (found.t[0], found.t[-1]) == pytest.approx((10.0, 30.0), abs=0.011)
    at = np.flatnonzero(np.isfinite(found.mag[:, 0]))
    inside = FIELD_T[(FIELD_T >= found.t[0]) & (FIELD_T <= found.t[-1])]
    np.testing.assert_array_equal(found.mag[at, 0], inside)
    assert np.abs(found.t[at] - inside).max() <= 0.01
    np.testing.assert_allclose(found.acc[:, 0], found.t)


@pytest.mark.parametrize(("longest", "begin"), [(60.0, 10.0), (8.0, 22.0)])
def test_the_end_of_a_long_rest_is_taken(longest: float, begin: float) -> None:
    found = still.of_log(*resting((10.0, 30.0)), shortest=5.0, longest=longest)
    assert found is not None
    assert found.t[0] == pytest.approx(begin, abs=0.011)


@pytest.mark.parametrize(("seconds", "enough"), [(4.9, False), (5.1, True)])
def test_a_rest_that_is_too_short_is_none(seconds: float, enough: bool) -> None:
    case, row = resting((10.0, 10.0 + seconds))
    assert (still.of_log(case, row, shortest=5.0, longest=60.0) is not None) is enough
