"""What leaves more open than anybody would assume is no answer."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics import definitions
from attlog.metrics.answer import Answer
from attlog.metrics.drift import slope as drift
from attlog.metrics.ranking import best as ranking
from attlog.metrics.ranking.resolution import CODE, withhold
from attlog.metrics.statistics.units import Summary, UnitValues

DRIFT = "drift_air_deg_per_min.onboard"


def answer(low, high, unit="deg/min", n=5, seconds=34.0):
    return Answer(0.5 * (low + high), unit, "airborne", n, seconds, (low, high))


@pytest.mark.parametrize(
    ("metric", "low", "high", "resolves"),
    [
        (DRIFT, -408.0, 187.0, False),
        (DRIFT, -59.0, 59.9, True),
        (DRIFT, 3.0, 505.0, True),  # which way it drifts is known
        ("drift_rest_deg_per_min", -143.8, 268.0, False),
        ("lag_ms", -3.0, 49.0, True),
        ("lag_yaw_ms", -3.0, 51.0, False),
        ("step_gain_roll", -1.2, 3.6, False),
        ("step_gain_roll", 0.8, 1.1, True),
        ("step_error_pct.0.5s", -26.0, 101.0, False),
        ("noise_roll_deg", 0.0003, 0.2, True),  # quiet, however unsure how quiet
        ("noise_roll_deg", 0.04, 4.7, False),
        ("noise_roll_deg", 2.0, 4.7, True),
        ("inclination_rmse_deg", 0.1, 90.0, True),  # it describes the flight
    ],
)
def test_what_may_be_perfect_and_may_lie_beyond_what_is_known_anyway_is_withheld(metric, low, high, resolves):
    found = answer(low, high)
    assert withhold(definitions()[metric], found) is not resolves
    assert (found.value is not None) is resolves
    assert found.ranked is resolves
    assert resolves or (found.code == CODE and found.detail["withheld"]["ci95"] == [low, high])


def test_the_reason_tells_a_record_that_is_too_short_from_one_that_is_too_noisy():
    short, noisy = answer(-90.0, 60.0), answer(-900.0, 60.0)
    withhold(definitions()[DRIFT], short)
    withhold(definitions()[DRIFT], noisy)
    assert short.reason.startswith("34 s are too short to show even 60 deg/min")
    assert short.reason.endswith("; about 80 s are needed")  # 34 x 1.5^2
    assert noisy.reason.startswith("34 s are too noisy to show even 60 deg/min")
    few = answer(-60.0, 20.0, "ms", n=4)
    withhold(definitions()["lag_ms"], few)
    assert few.reason.startswith("4 steps are too few to show even a lag of 50 ms")
    assert few.reason.endswith("; about 6 are needed")


def test_rests_that_disagree_keep_their_range():
    t = np.arange(0.0, 60.0, 1.0)
    rests = [drift.slope(drift.HeadingBlocks(t, k * t, np.zeros(len(t), np.int64))) for k in (0.0, 2.0)]
    found = drift.answer(drift.together(rests), "all", "rest")
    assert found.disagree == pytest.approx((0.0, 120.0))
    assert not withhold(definitions()["drift_rest_deg_per_min"], found)


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

    metric = definitions()[DRIFT]
    found = ranking.rank({n: {"all": {DRIFT: a}} for n, a in table.items()}, [Row(n) for n in table], {DRIFT: metric})
    assert found.ranked["all"][DRIFT] == ["a", "b"]
    assert table["c"].value is None
    assert table["a"].value == 0.0
