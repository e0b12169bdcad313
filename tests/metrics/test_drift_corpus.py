"""On simulated flights: a drift that is told goes the way the error against truth goes, and a bound holds."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.drift import rest as drift_rest
from tests.metrics.test_corpus import trial_of

pytestmark = pytest.mark.slow

LOGS = ("ardupilot/copter_long.bin", "ardupilot/copter_static_hop.bin", "px4/px4_static.ulg", "px4/px4_long.ulg")


@pytest.mark.parametrize("name", LOGS)
def test_told_drifts_at_rest_have_the_sign_of_the_error_against_truth_and_bounds_hold(corpus, name):
    """The straight line through the error against truth over each usable rest, by numpy, is the outside answer."""
    case = trial_of(corpus / "sitl" / name, "gyro,mahony,madgwick,complementary")
    told = 0
    for row in (r for r in case.rows if r.kind == "replay"):
        answer = drift_rest.compute(case, row, "rest")["drift_rest_deg_per_min"]
        usable = [spans for _, spans in drift_rest.rests(case, row, "rest")]
        for record, spans in zip(answer.records, usable, strict=True):
            if record.value is None or record.ci95 is None:
                continue
            against, tilt = against_truth(case, row, spans[0])
            if tilt > 5.0:
                continue  # of an attitude that has tipped over, "heading" is a matter of definition
            if not record.ci95[0] <= 0.0 <= record.ci95[1]:
                told += 1
                assert np.sign(record.value) == np.sign(against), (row.name, record)
            assert abs(against) <= 1.05 * max(map(abs, record.ci95)) + 0.1, (row.name, record)
    assert told >= 1, "without a magnetometer every filter drifts"


def against_truth(case, row, span):
    """Least-squares slope in deg/min of the row's heading error over a span, and its largest tilt error."""
    t, q = case.log.truth.t, case.log.truth.q
    inside = (t >= span[0]) & (t <= span[1])
    e = rotation.error(rotation.slerp(row.t, row.q, t[inside]), q[inside])
    slope = np.polyfit(t[inside], np.unwrap(rotation.heading_angle(e)), 1)[0]
    return 60.0 * np.degrees(slope), np.degrees(rotation.inclination_angle(e)).max()
