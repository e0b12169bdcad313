import numpy as np
import pytest

from attlog.metrics import best, definitions
from attlog.metrics.answer import Answer, missing
from attlog.metrics.ranking import leaders
from tests.metrics import flights


def answer(value, low, high, ranked=True, **more):
    return Answer(value, "deg", "all", 10, 10.0, (low, high), "", ranked=ranked, **more)


def test_a_separated_interval_wins_alone_and_overlapping_ones_share():
    column = {"a": answer(1.0, 0.9, 1.1), "b": answer(1.3, 1.2, 1.4), "c": answer(1.15, 1.05, 1.25)}
    assert leaders(column, "low") == ["a", "c"]
    assert leaders({"a": column["a"], "b": column["b"]}, "low") == ["a"]


def test_differences_below_the_floor_are_ties():
    column = {"a": answer(0.001, 0.0009, 0.0011, floor=0.005), "b": answer(0.004, 0.0039, 0.0041, floor=0.005)}
    assert leaders(column, "low") == ["a", "b"]


def test_zero_is_best_from_both_sides_and_an_interval_across_zero_ties():
    column = {"late": answer(4.0, 3.0, 5.0), "early": answer(-2.0, -2.5, -1.5), "zero": answer(0.5, -0.5, 1.5)}
    assert set(leaders(column, "zero")) == {"zero", "early"}
    assert leaders({k: column[k] for k in ("late", "early")}, "zero") == ["early"]


def test_a_lag_below_half_a_sample_counts_as_zero():
    column = {
        "a": answer(0.1, 0.05, 0.15, counts_as_zero_below=2.5),
        "b": answer(1.9, 1.8, 2.0, counts_as_zero_below=2.5),
        "c": answer(9.0, 8.9, 9.1, counts_as_zero_below=2.5),
    }
    assert leaders(column, "zero") == ["a", "b"]


def test_the_shape_of_a_lag_must_be_separated_too():
    column = {"a": answer(5.0, 4.9, 5.1, resolution=0.0), "b": answer(8.0, 7.9, 8.1, resolution=4.0)}
    assert leaders(column, "zero") == ["a", "b"]


def test_gain_is_best_at_one():
    assert leaders({"a": answer(1.2, 1.15, 1.25), "b": answer(0.98, 0.97, 0.99)}, "one") == ["b"]


def test_of_coverage_more_is_better():
    column = {"half": answer(50.0, 49.0, 51.0), "whole": answer(99.0, 98.0, 100.0)}
    assert leaders(column, "high") == ["whole"]
    assert definitions()["coverage_pct"].better == "high"


def test_a_single_row_is_not_better_than_anybody():
    assert (
        leaders({"a": answer(1.0, 0.9, 1.1), "b": missing("not_a_pure_delay", "acceleration", "deg", "all")}, "low")
        == []
    )


@pytest.mark.parametrize(
    "spoiled",
    [
        {"kind": "onboard"},
        {"status": "diverged"},
        {"status": "not_converged"},
        {"coverage_pct": 40.0},
        {"is_reference": True},
    ],
)
def test_rows_that_may_not_be_best_never_are(spoiled):
    t = np.arange(3.0)
    q = np.tile([1.0, 0, 0, 0], (3, 1))
    rows = [flights.row(t, q, name) for name in ("good", "fair", "spoiled")]
    for key, value in spoiled.items():
        setattr(rows[2], key, value)
    values = {"good": answer(1.0, 0.9, 1.1), "fair": answer(2.0, 1.9, 2.1), "spoiled": answer(0.1, 0.09, 0.11)}
    table = {name: {"all": {"total_rmse_deg": a}} for name, a in values.items()}
    assert best(table, rows) == {"all": {"total_rmse_deg": ["good"]}}
