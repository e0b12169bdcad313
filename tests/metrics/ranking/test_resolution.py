"""What leaves more open than anybody needs to be told is no answer."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.answer import Answer
from attlog.metrics.base import Metric
from attlog.metrics.drift import slope as drift
from attlog.metrics.ranking import best as ranking
from attlog.metrics.ranking.resolution import CODE, withhold
from attlog.metrics.statistics.units import Summary, UnitValues

DRIFT = "drift_air_deg_per_min.onboard"


def answer(low, high, unit="deg/min", n=5, seconds=34.0):
    return Answer(0.5 * (low + high), unit, "airborne", n, seconds, (low, high))


@pytest.mark.parametrize(
    ("metric", "better", "low", "high", "tells"),
    [
        (DRIFT, "zero", -408.0, 187.0, False),
        (DRIFT, "zero", -59.0, 59.9, True),
        (DRIFT, "zero", 3.0, 505.0, True),  # which way it drifts is told
        ("drift_rest_deg_per_min", "zero", -143.8, 268.0, False),
        ("lag_ms", "zero", -3.0, 49.0, True),
        ("lag_yaw_ms", "zero", -3.0, 51.0, False),
        ("step_gain_roll", "one", -1.2, 3.6, False),
        ("step_gain_roll", "one", 0.8, 1.1, True),
        ("step_error_pct.0.5s", "zero", -26.0, 101.0, False),
        ("noise_roll_deg", "low", 0.0003, 0.2, True),  # quiet, however unsure how quiet
        ("noise_roll_deg", "low", 0.04, 4.7, False),
        ("noise_roll_deg", "low", 2.0, 4.7, True),
        ("inclination_rmse_deg", "low", 0.1, 90.0, True),  # it describes the flight
    ],
)
def test_what_is_not_told_apart_from_perfect_and_may_lie_beyond_what_is_known_anyway_is_withheld(
    metric, better, low, high, tells
):
    found = answer(low, high)
    assert withhold(metric, better, found) is not tells
    assert (found.value is not None) is tells
    assert found.ranked is tells
    assert tells or (found.code == CODE and found.detail["withheld"]["ci95"] == [low, high])


def test_the_reason_tells_a_record_that_is_too_short_from_one_that_is_too_noisy():
    short, noisy = answer(-90.0, 60.0), answer(-900.0, 60.0)
    withhold(DRIFT, "zero", short)
    withhold(DRIFT, "zero", noisy)
    assert short.reason.startswith("34 s are too short to show even the 60 deg/min")
    assert short.reason.endswith("; about 80 s are needed")  # 34 x 1.5^2
    assert noisy.reason.startswith("34 s are too noisy to show even the 60 deg/min")
    few = answer(-60.0, 20.0, "ms", n=4)
    withhold("lag_ms", "zero", few)
    assert few.reason.startswith("4 quick movements are too few to show even a lag of 50 ms")
    assert few.reason.endswith("; about 6 are needed")


def test_rests_that_disagree_keep_their_range():
    t = np.arange(0.0, 60.0, 1.0)
    rests = [drift.slope(drift.HeadingBlocks(t, k * t, np.zeros(len(t), np.int64))) for k in (0.0, 2.0)]
    found = drift.answer(drift.together(rests), "all", "rest")
    assert found.disagree == pytest.approx((0.0, 120.0))
    assert not withhold("drift_rest_deg_per_min", "zero", found)


def test_a_row_that_tells_nothing_on_the_time_that_it_shares_with_others_is_not_ranked():
    def row(wide):
        ids = np.arange(8)
        units = UnitValues("slope_group", ids, np.zeros(8), lambda wanted: Summary(0.0, (-wide, wide)))
        return Answer(0.0, "deg/min", "all", 8, 80.0, (-1.0, 1.0), units=units)

    table = {"a": row(1.0), "b": row(1.0), "c": row(500.0)}
    table["b"].units = UnitValues("slope_group", np.arange(7), np.zeros(7), lambda wanted: Summary(0.0, (-1.0, 1.0)))

    class Row:
        kind, is_reference, status, coverage_pct = "replay", False, "ok", None

        def __init__(self, name):
            self.name = name

    metric = Metric(DRIFT, "", "deg/min", "zero", (), "")
    found = ranking.rank({n: {"all": {DRIFT: a}} for n, a in table.items()}, [Row(n) for n in table], {DRIFT: metric})
    assert found.ranked["all"][DRIFT] == ["a", "b"]
    assert table["c"].value is None
    assert table["a"].value == 0.0
