from itertools import combinations

import numpy as np
import pytest

from attlog.metrics import definitions, rank
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Metric
from attlog.metrics.ranking import best as ranking
from attlog.metrics.statistics import pairs
from attlog.metrics.statistics.units import Summary, UnitValues, ids_of
from tests.metrics import flights


def answer(value, low, high, ranked=True, **more):
    return Answer(value, "deg", "all", 10, 10.0, (low, high), "", ranked=ranked, **more)


def by_units(sigmas, first=0, **more):
    """An answer on windows of 5 s with the given typical deviations."""
    ids, values = ids_of(5.0 * np.arange(first, first + len(sigmas))), 2 * np.log(np.asarray(sigmas, float))

    def on(wanted):
        value = float(np.exp(np.mean(values[np.isin(ids, wanted)]) / 2))
        return Summary(value, (0.9 * value, 1.1 * value))

    whole = on(ids)
    units = UnitValues("log_variance", ids, values, on)
    return Answer(whole.value, "deg", "hover", len(ids), 5.0 * len(ids), whole.ci95, "", units=units, **more)


def test_rows_whose_intervals_lie_apart_are_told_apart():
    column = {"a": answer(1.0, 0.9, 1.1), "b": answer(1.3, 1.2, 1.4), "c": answer(1.15, 1.05, 1.25)}
    assert ranking.family(column, "low").best == ["a", "c"]
    assert ranking.family(column, "low").significant == [("a", "b")]


def test_differences_below_the_floor_are_ties():
    column = {"a": answer(0.001, 0.0009, 0.0011, floor=0.005), "b": answer(0.004, 0.0039, 0.0041, floor=0.005)}
    assert ranking.family(column, "low").best == ["a", "b"]
    fine = {"a": by_units([0.001] * 20), "b": by_units([0.004] * 20)}
    assert ranking.family(fine, "low").best == ["a"]
    coarse = {name: by_units([s] * 20, floor=0.005) for name, s in (("a", 0.001), ("b", 0.004))}
    assert ranking.family(coarse, "low").best == ["a", "b"]


@pytest.mark.parametrize("bound", ["floor", "counts_as_zero_below"])
@pytest.mark.parametrize("coarse", ["a", "b"])
def test_the_coarser_of_two_rows_sets_what_is_a_tie(coarse, bound):
    """Rows may come at other rates and with other steps: one that resolves 0.005 deg ties with any within that."""
    by_intervals = {"a": answer(0.001, 0.0009, 0.0011), "b": answer(0.004, 0.0039, 0.0041)}
    for column in (by_intervals, {"a": by_units([0.001] * 20), "b": by_units([0.004] * 20)}):
        assert ranking.family(column, "low").best == ["a"]
        setattr(column[coarse], bound, 0.005)
        assert ranking.family(column, "low").best == ["a", "b"]


def test_zero_is_best_from_both_sides_and_an_interval_across_zero_ties():
    column = {"late": answer(4.0, 3.0, 5.0), "early": answer(-2.0, -2.5, -1.5), "zero": answer(0.5, -0.5, 1.6)}
    assert set(ranking.family(column, "zero").best) == {"zero", "early"}
    assert ranking.family({k: column[k] for k in ("late", "early")}, "zero").best == ["early"]


def test_lags_that_differ_by_less_than_half_a_sample_are_ties():
    column = {
        "a": answer(0.1, 0.05, 0.15, counts_as_zero_below=2.5),
        "b": answer(1.9, 1.8, 2.0, counts_as_zero_below=2.5),
        "c": answer(9.0, 8.9, 9.1, counts_as_zero_below=2.5),
    }
    found = ranking.family(column, "zero")
    assert (found.best, found.worst) == (["a", "b"], ["c"])


def test_gain_is_best_at_one_and_of_coverage_more_is_better():
    assert ranking.family({"a": answer(1.2, 1.15, 1.25), "b": answer(0.98, 0.97, 0.99)}, "one").best == ["b"]
    assert ranking.family({"half": answer(50.0, 49, 51), "whole": answer(99.0, 98, 100)}, "high").best == ["whole"]
    assert definitions()["coverage_pct"].better == "high"


def test_pairs_share_their_windows_so_a_common_gust_hides_no_difference():
    """Both rows are four times as noisy in half of the windows: their intervals overlap, their differences do not."""
    gusts = np.tile([1.0, 4.0], 6)
    column = {"a": by_units(0.1 * gusts), "b": by_units(0.2 * gusts)}
    assert ranking.family(column, "low").significant == [("a", "b")]


def test_the_worst_is_one_row_that_is_better_than_nobody():
    three = {"a": by_units([1.0] * 8), "b": by_units([3.0] * 8), "c": by_units([9.0] * 8)}
    assert ranking.family(three, "low").worst == ["c"]
    two_last = three | {"d": by_units([9.1] * 8)}
    assert ranking.family(two_last, "low").worst == []
    assert ranking.family({"a": three["a"], "e": by_units([1.01] * 8)}, "low").worst == []


def test_ranked_values_are_those_of_the_common_windows():
    calm, gust = [1.0] * 6, [5.0] * 2
    column = {"whole": by_units(calm + gust), "calm only": by_units(calm)}
    found = ranking.family(column, "low")
    assert found.significant == []
    assert column["whole"].value == pytest.approx(1.0)
    assert (column["whole"].n, column["whole"].seconds) == (6, 30.0)
    assert column["whole"].ci95 == pytest.approx((0.9, 1.1))


def test_rows_with_less_than_half_of_the_windows_are_not_compared():
    column = {"a": by_units([1.0] * 10), "b": by_units([2.0] * 9), "short": by_units([0.1] * 4)}
    assert ranking.family(column, "low").rows == ["a", "b"]
    assert column["a"].n == 9


def test_rows_without_common_windows_are_not_compared():
    column = {"a": by_units([1.0] * 5), "b": by_units([2.0] * 5), "later": by_units([0.1] * 5, first=50)}
    assert len(ranking.family(column, "low").rows) < 3


def marks(table, rows):
    return rank({name: {"hover": columns} for name, columns in table.items()}, rows)


def rows_named(*names):
    t = np.arange(3.0)
    return [flights.row(t, np.tile([1.0, 0, 0, 0], (3, 1)), name) for name in names]


def test_best_and_worst_are_marked_and_everybody_alike_is_no_mark():
    rows = rows_named("a", "b", "c")
    sigmas = {"a": 1.0, "b": 3.0, "c": 9.0}
    told = marks({n: {"noise_tilt_deg": by_units([s] * 8)} for n, s in sigmas.items()}, rows)
    assert (told.best, told.worst) == ({"hover": {"noise_tilt_deg": ["a"]}}, {"hover": {"noise_tilt_deg": ["c"]}})
    alike = marks({n: {"noise_tilt_deg": by_units([1.0] * 8)} for n in sigmas}, rows)
    assert (alike.best, alike.worst) == ({}, {})
    assert alike.ranked == {"hover": {"noise_tilt_deg": ["a", "b", "c"]}}


def test_a_single_row_is_not_better_than_anybody():
    bent = missing("not_a_pure_delay", "acceleration", "deg", "all")
    found = marks({"a": {"lag_ms": answer(1.0, 0.9, 1.1)}, "b": {"lag_ms": bent}}, rows_named("a", "b"))
    assert (found.best, found.worst) == ({}, {})


def test_median_and_p95_take_the_marks_of_their_rmse_where_their_own_order_agrees():
    def columns(rmse, median, p95):
        found = by_units([rmse] * 8)
        return {
            "inclination_rmse_deg": found,
            "inclination_median_deg": answer(median, 0, 9),
            "inclination_p95_deg": answer(p95, 0, 9),
        }

    found = marks({"a": columns(1.0, 0.9, 3.5), "b": columns(3.0, 2.0, 3.4)}, rows_named("a", "b"))
    assert found.best["hover"] == {"inclination_rmse_deg": ["a"], "inclination_median_deg": ["a"]}


def test_every_decided_column_names_a_column_that_is_there():
    known = definitions()
    decided = [m for m in known.values() if m.decided_by]
    assert decided
    assert all(isinstance(known[m.decided_by], Metric) for m in decided)


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
    rows = rows_named("good", "fair", "spoiled")
    for key, value in spoiled.items():
        setattr(rows[2], key, value)
    values = {"good": answer(1.0, 0.9, 1.1), "fair": answer(2.0, 1.9, 2.1), "spoiled": answer(0.1, 0.09, 0.11)}
    table = {name: {"hover": {"hover_jitter_deg": a}} for name, a in values.items()}
    found = rank(table, rows)
    assert found.best == {"hover": {"hover_jitter_deg": ["good"]}}
    assert found.ranked == {"hover": {"hover_jitter_deg": ["good", "fair"]}}


def test_rows_that_share_two_movements_are_not_compared_and_keep_their_own_values():
    def lag(first):
        ids, values = ids_of(10.0 * np.arange(first, first + 4)), np.array([20.0, 21.0, 20.5, 20.2]) + 10 * first
        units = UnitValues("lag_event", ids, values, lambda wanted: Summary(0.0, (0.0, 0.0)))
        return Answer(float(np.mean(values)), "ms", "airborne", 4, 8.0, (19.0, 21.0), "", units=units)

    column = {"a": lag(0), "b": lag(2)}
    found = ranking.family(column, "zero")
    assert (found.rows, found.significant) == (["a", "b"], [])
    assert (column["a"].n, column["b"].n) == (4, 4)


def test_all_couples_are_compared_as_each_alone(monkeypatch):
    """In blocks or at once, and rows of another kind of unit with nobody."""
    monkeypatch.setattr(ranking, "AT_ONCE", 2)
    rng = np.random.default_rng(3)
    ids = ids_of(np.arange(8.0))
    for kind in pairs.NEEDED:
        rows = [UnitValues(kind, ids, rng.normal(0.3 * k, 1.0, 8) ** 2, None) for k in range(4)]
        rows.insert(2, UnitValues("lag_event" if kind != "lag_event" else "step_event", ids, rng.normal(size=8), None))
        alone = [pairs.p_value(a, b, ids) for a, b in combinations(rows, 2)]
        assert ranking._p_of_all(rows, ids).tolist() == pytest.approx(alone, rel=1e-12)
        assert [p == 1.0 for p in alone].count(True) >= 4
        assert min(alone) < 1.0


def test_noise_is_ordered_only_where_its_variance_exceeds_the_others_by_more_than_the_gyros_own():
    """0.004 and 0.008 deg are added to a wander of 0.02: nobody can tell who is noisier in the end; of 0.03 one can."""
    column = {name: by_units([s] * 20, gyro_share=0.02) for name, s in (("a", 0.004), ("b", 0.008), ("c", 0.03))}
    found = ranking.family(column, "low")
    assert found.best == ["a", "b"]
    assert set(found.significant) == {("a", "c"), ("b", "c")}
    loud = {name: by_units([s] * 20, gyro_share=0.2) for name, s in (("a", 0.5), ("b", 0.6))}
    assert ranking.family(loud, "low").best == ["a"]  # the difference is smaller, that of the variances larger
