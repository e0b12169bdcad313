"""How far an answer is from perfect, and below which difference two are the same."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.estimators import get
from attlog.metrics import definitions, drift, rank, ranking, statistics
from attlog.metrics.metric import Answer, missing
from attlog.metrics.ranking import TOO_UNCERTAIN, DuplicateSearch, withdraw_uncertain
from attlog.metrics.statistics import Summary, UnitValues, make_ids
from tests.metrics import flights
from tests.metrics.flights import row


def answer(value, low, high, ranked=True, **more):
    return Answer(value, "deg", "all", 10, 10.0, (low, high), "", ranked=ranked, **more)


def by_units(sigmas, first=0, **more):
    """An answer on windows of 5 s with the given typical deviations."""
    ids, values = make_ids(5.0 * np.arange(first, first + len(sigmas))), 2 * np.log(np.asarray(sigmas, float))

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


@pytest.mark.parametrize("bound", ["floor", "counts_as_zero_below"])
@pytest.mark.parametrize("coarse", ["a", "b"])
def test_the_coarser_of_two_rows_sets_what_is_a_tie(coarse, bound):
    """Rows may come at other rates and with other steps: one that resolves 0.005 deg ties with any within that."""
    by_intervals = {"a": answer(0.001, 0.0009, 0.0011), "b": answer(0.004, 0.0039, 0.0041)}
    for column in (by_intervals, {"a": by_units([0.001] * 20), "b": by_units([0.004] * 20)}):
        assert ranking.family(column, "low").best == ["a"]
        setattr(column[coarse], bound, 0.005)
        assert ranking.family(column, "low").best == ["a", "b"]


def test_pairs_share_their_windows_so_a_common_gust_hides_no_difference():
    """Both rows are four times as noisy in half of the windows: their intervals overlap, their differences do not."""
    gusts = np.tile([1.0, 4.0], 6)
    column = {"a": by_units(0.1 * gusts), "b": by_units(0.2 * gusts)}
    assert ranking.family(column, "low").significant == [("a", "b")]


def test_noise_of_one_window_is_shown_and_ranks_nobody():
    once = {"a": by_units([0.002]), "b": by_units([0.13])}
    assert ranking.family(once, "low").rows == []
    twice = {"a": by_units([0.002, 0.0021]), "b": by_units([0.13, 0.14])}
    assert ranking.family(twice, "low").best == ["a"]


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


def test_a_percentile_takes_the_marks_of_its_rmse_where_its_own_order_agrees():
    def columns(rmse, p95):
        return {"tilt_rmse_deg": by_units([rmse] * 8), "tilt_p95_deg": answer(p95, 0, 9)}

    for p95, best in ((4.0, ["a"]), (3.4, None)):
        found = marks({"a": columns(1.0, 3.5), "b": columns(3.0, p95)}, rows_named("a", "b"))
        assert found.best["hover"]["tilt_rmse_deg"] == ["a"]
        assert found.best["hover"].get("tilt_p95_deg") == best


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
    table = {name: {"hover": {"allan_bias_deg_per_h": a}} for name, a in values.items()}
    found = rank(table, rows)
    assert found.best == {"hover": {"allan_bias_deg_per_h": ["good"]}}
    assert found.ranked == {"hover": {"allan_bias_deg_per_h": ["good", "fair"]}}


def test_rows_that_share_two_movements_are_not_compared_and_keep_their_own_values():
    def lag(first):
        ids, values = make_ids(10.0 * np.arange(first, first + 4)), np.array([20.0, 21.0, 20.5, 20.2]) + 10 * first
        units = UnitValues("lag_event", ids, values, lambda wanted: Summary(0.0, (0.0, 0.0)))
        return Answer(float(np.mean(values)), "ms", "airborne", 4, 8.0, (19.0, 21.0), "", units=units)

    column = {"a": lag(0), "b": lag(2)}
    found = ranking.family(column, "zero")
    assert (found.rows, found.significant) == (["a", "b"], [])
    assert (column["a"].n, column["b"].n) == (4, 4)


def test_all_couples_are_compared_as_each_alone(monkeypatch):
    """In blocks or at once, and rows of another kind of unit with nobody."""
    monkeypatch.setattr(ranking, "MAX_COUPLES", 2)
    rng = np.random.default_rng(3)
    ids = make_ids(np.arange(8.0))
    for kind in statistics.NEEDED:
        rows = [UnitValues(kind, ids, rng.normal(0.3 * k, 1.0, 8) ** 2, None) for k in range(4)]
        rows.insert(2, UnitValues("lag_event" if kind != "lag_event" else "step_event", ids, rng.normal(size=8), None))
        alone = [statistics.p_value(a, b, ids) for a, b in combinations(rows, 2)]
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


def distance_answer(value: float, ci95: tuple[float, float] | None = None, **more: float) -> Answer:
    return Answer(value, "deg", "all", 10, 10.0, ci95, "", **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "ci95", "better", "wanted"),
    [
        (3.0, (2.0, 5.0), "low", (2.0, 3.0, 5.0)),
        (3.0, (2.0, 5.0), "high", (-5.0, -3.0, -2.0)),
        (3.0, None, "low", (3.0, 3.0, 3.0)),
        (3.0, (3.5, 5.0), "low", (3.0, 3.0, 5.0)),
        (-3.0, (-4.0, -1.0), "zero", (1.0, 3.0, 4.0)),
        (3.0, (-1.0, 9.0), "zero", (0.0, 3.0, 9.0)),
        (-3.0, (-9.0, 1.0), "zero", (0.0, 3.0, 9.0)),
        (0.7, (0.6, 0.9), "one", (0.1, 0.3, 0.4)),
        (1.5, (1.2, 1.7), "one", (0.2, 0.5, 0.7)),
        (1.5, (0.8, 2.2), "one", (0.0, 0.5, 1.2)),
    ],
)
def test_an_answer_is_as_far_from_perfect_as_its_kind_says(
    value: float, ci95: tuple[float, float] | None, better: str, wanted: tuple[float, float, float]
) -> None:
    assert ranking.distance(distance_answer(value, ci95), better) == pytest.approx(wanted)


def of_units(ids: list[int], value: float = 1.0) -> Answer:
    found = distance_answer(value)
    found.units = UnitValues("log_variance", make_ids(ids), np.arange(len(ids), dtype=float))
    return found


def test_the_least_covered_row_goes_until_half_of_the_units_of_the_best_are_common() -> None:
    answers = {
        "whole": of_units(list(range(10))),
        "first": of_units(list(range(6))),
        "last": of_units(list(range(3, 10))),
        "few": of_units(list(range(4))),
    }
    rows, common = ranking.common_units(answers)
    assert rows == ["whole", "last"]
    assert common.tolist() == [1000 * k for k in range(3, 10)]
    assert ranking.common_units({"a": distance_answer(1.0)}) == ([], pytest.approx(np.zeros(0)))


# What leaves more open than anybody would assume is no answer.

DRIFT = "drift_air_deg_per_min.onboard"


def resolved_answer(low, high, unit="deg/min", n=5, seconds=34.0):
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
        ("tilt_rmse_deg", 0.1, 90.0, True),  # it describes the flight
    ],
)
def test_what_may_be_perfect_and_may_lie_beyond_what_is_known_anyway_is_withheld(metric, low, high, resolves):
    found = resolved_answer(low, high)
    assert withdraw_uncertain(definitions()[metric], found) is not resolves
    assert (found.value is not None) is resolves
    assert found.ranked is resolves
    assert resolves or found.code == TOO_UNCERTAIN


def test_the_reason_tells_a_record_that_is_too_short_from_one_that_is_too_noisy():
    short, noisy = resolved_answer(-90.0, 60.0), resolved_answer(-900.0, 60.0)
    withdraw_uncertain(definitions()[DRIFT], short)
    withdraw_uncertain(definitions()[DRIFT], noisy)
    assert short.reason.startswith("34 s are too short to show even 60 deg/min")
    assert short.reason.endswith("; about 80 s are needed")  # 34 x 1.5^2
    assert noisy.reason.startswith("34 s are too noisy to show even 60 deg/min")
    few = resolved_answer(-60.0, 20.0, "ms", n=4)
    withdraw_uncertain(definitions()["lag_ms"], few)
    assert few.reason.startswith("4 steps are too few to show even a lag of 50 ms")
    assert few.reason.endswith("; about 6 are needed")


def test_rests_that_disagree_keep_their_range():
    t = np.arange(0.0, 60.0, 1.0)
    rests = [drift.fit_drift(drift.HeadingBlocks(t, k * t, np.zeros(len(t), np.int64))) for k in (0.0, 2.0)]
    found = drift.drift_answer(drift.pool_drifts(rests), "all", "rest")
    assert found.disagree == pytest.approx((0.0, 120.0))
    assert not withdraw_uncertain(definitions()["drift_rest_deg_per_min"], found)


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


# Rows that are one filter twice are found by their attitudes and by what their files declare.

T = np.arange(0.0, 10.0, 0.01)
Q = rotation.from_euler(0.2 * np.sin(T), 0.1 * np.cos(T), 0.05 * T)


def equal_rows(rows):
    search = DuplicateSearch(lambda row: row)
    for one in rows:
        search.add(one)
    return search.found()


def made(name, q=Q, **fields):
    return row(T, q, name, estimator=name.partition(":")[0], **fields)


def turned(deg, where=slice(None)):
    q = Q.copy()
    q[where] = rotation.turn_about_down(q[where], np.radians(deg))
    return q


def test_equal_attitudes_are_told_and_nearly_equal_ones_are_not():
    (group,) = equal_rows([made("a"), made("b", turned(1e-8)), made("c", turned(1e-3)), made("d", turned(1.0, 777))])
    assert (group.rows, group.by) == (["a", "b"], "attitudes")
    assert group.apart_deg == pytest.approx(1e-8, rel=0.5)


def test_an_earlier_row_is_wanted_again_only_where_another_looks_the_same() -> None:
    first, asked = made("a"), []

    def again(whole):
        asked.append(whole.name)
        return made("a")

    likeness = DuplicateSearch(again)
    for one in (first, made("b", turned(1e-3)), made("c", turned(1e-8)), made("d", turned(1.0, 778))):
        likeness.add(one)
        one.release()
    assert asked == ["a", "a"]
    (group,) = likeness.found()
    assert group.rows == ["a", "c"]


def test_rows_at_other_times_onboard_rows_and_failed_rows_are_not_compared():
    short = row(T[:-1], Q[:-1], "short")
    onboard, failed = made("onboard"), made("failed", status="failed")
    onboard.kind = "onboard"
    assert equal_rows([made("a"), short, onboard, failed]) == []


def test_a_declared_equation_is_told_between_filters_with_what_differs():
    one = made("one", equation="Paper 3", parameters={"kp": 0.5, "ki": 0.1, "own": 1.0})
    two = made("two", turned(2.0), equation="Paper 3", parameters={"kp": 0.6, "ki": 0.1})
    other = made("other", turned(3.0), equation="Paper 4")
    (group,) = equal_rows([one, two, other])
    assert (group.rows, group.by, group.source) == (["one", "two"], "equation", "Paper 3")
    assert group.differ == {"kp": [0.5, 0.6]}


def test_one_filter_with_two_gains_shares_its_equation_with_itself_without_a_word():
    assert equal_rows([made("one", equation="Paper 3"), made("one:kp=2", turned(2.0), equation="Paper 3")]) == []


def test_what_the_files_declare_is_true():
    """Equal parameters give equal attitudes in all files of an equation, to the error of integration."""
    from attlog.testing import swing

    names = [n for n in ("complementary", "mahony", "mahony_dcm") if get(n).equation == get("mahony").equation]
    assert len(names) == 3
    m = swing(20.0)
    found = [attlog.estimate(n, *m.sensors, kp=0.5, ki=0.01, mag_gain=0.5).q for n in names]
    for q in found[1:]:
        assert np.degrees(rotation.total_angle(rotation.earth_error(q, found[0]))).max() < 1e-3


@pytest.mark.slow
def test_page_terminal_and_json_say_it(attlog, samples, tmp_path):
    import json

    same_gains = "complementary:kp=0.3,ki=0.005,mag_gain=0.5"
    rows = f"{same_gains},variable_integral,mahony,gyro"
    run = attlog("analyze", samples / "copter_yaw_turns.bin", "-o", tmp_path, "--estimators", rows, "--json", "-v")
    groups = {group["by"]: group for group in json.loads(run.out)["alike"]}
    assert groups["attitudes"]["rows"] == [same_gains, "variable_integral"]
    assert groups["equation"]["rows"] == [same_gains, "mahony"]
    same = "Complementary (kp 0.3 ki 0.005 mag_gain 0.5) and Variable integral give the same attitudes in this log"
    assert same in " ".join(run.err.split())
    assert "and Mahony share one equation (Mahony2008 32) and differ in kp (0.3, 0.45)" in " ".join(run.err.split())
    assert same in (tmp_path / "copter_yaw_turns.bin.html").read_text(encoding="utf-8")


def test_equal_attitudes_of_two_imus_are_not_one_filter():
    one, other, same = made("one"), made("other"), made("same")
    one.imu = same.imu = object()
    other.imu = object()
    (group,) = equal_rows([one, other, same])
    assert group.rows == ["one", "same"]
