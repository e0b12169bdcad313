"""Paired differences against closed forms, scipy and published numbers."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from scipy import stats

from attlog.compare.comparison import select_questions
from attlog.compare.filter_input import ConfiguredFilter
from attlog.compare.paired import (
    Difference,
    dersimonian_laird,
    estimate_difference,
    hartung_knapp,
    hodges_lehmann,
    paired,
    pool,
    pool_values,
)
from attlog.compare.run import answer_place
from attlog.compare.setting import parse_configuration
from attlog.metrics.metric import Answer, missing
from attlog.metrics.statistics import Kind, Summary, UnitValues
from attlog.pipeline import evaluate, prepare
from tests.conftest import SAMPLES


def mean_on(kind: Kind, ids: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> Summary:
    chosen = values[np.isin(ids, wanted)]
    if kind == "log_variance":
        return Summary(float(np.exp(0.5 * np.mean(chosen))), None)
    if kind == "mean_square":
        return Summary(float(np.sqrt(np.mean(chosen))), None)
    return Summary(float(np.median(chosen) if kind == "step_event" else np.mean(chosen)), None)


def answer(kind: Kind, values: np.ndarray, begin: int = 0) -> Answer:
    ids = 1000 * np.arange(begin, begin + len(values), dtype=np.int64)
    on = partial(mean_on, kind, ids, values)
    return Answer(on(ids).value, "deg", "all", len(values), units=UnitValues(kind, ids, values, on))


def compared(a: Answer, b: Answer, better: str = "low") -> Difference:
    found = paired(a, b, better)
    assert found.value is not None, found
    return found


RNG = np.random.default_rng(7)
NOISE = RNG.normal(0.0, 0.6, 12)
KINDS: dict[Kind, np.ndarray] = {
    "log_variance": NOISE,
    "mean_square": np.exp(NOISE),
    "slope_group": NOISE + 3.0,
    "lag_event": 12.0 + NOISE,
    "step_event": np.abs(NOISE) + 1.0,
}


@pytest.mark.parametrize("kind", KINDS)
def test_identical_configurations_differ_by_exactly_nothing(kind: Kind) -> None:
    found = compared(answer(kind, KINDS[kind]), answer(kind, KINDS[kind].copy()))
    even = found.even
    assert (found.value, found.ci95, found.p, found.direction) == (even, (even, even), 1.0, "same")


@pytest.mark.parametrize("kind", ["log_variance", "mean_square"])
def test_a_common_factor_comes_out_as_the_ratio_of_sizes(kind: Kind) -> None:
    values = KINDS[kind]
    second = values + np.log(0.25) if kind == "log_variance" else 0.25 * values
    found = compared(answer(kind, values), answer(kind, second))
    assert found.scale == "ratio"
    assert found.first is not None
    assert found.second is not None
    assert found.value == pytest.approx(0.5)
    assert found.second / found.first == pytest.approx(0.5)
    assert found.inverse().value == pytest.approx(2.0)
    assert found.direction == "better"


def test_a_difference_of_lags_is_students() -> None:
    a, b = 12.0 + NOISE, 14.0 + NOISE + RNG.normal(0.0, 0.3, 12)
    found = compared(answer("lag_event", a), answer("lag_event", b), "zero")
    wanted = stats.t.interval(0.95, 11, np.mean(b - a), stats.sem(b - a))
    assert found.ci95 == pytest.approx(wanted)
    assert found.direction == "worse"


def test_a_row_that_comes_early_is_compared_by_how_far_from_zero() -> None:
    found = compared(answer("lag_event", 12.0 + NOISE), answer("lag_event", -4.0 + NOISE[::-1]), "zero")
    assert found.value == pytest.approx(-8.0 - 2.0 * np.mean(NOISE))
    assert found.direction == "better"


def test_units_are_paired_by_their_times() -> None:
    """The second has lost its first four units; on the others it is the first to the last bit."""
    values = KINDS["log_variance"]
    found = compared(answer("log_variance", values), answer("log_variance", values[4:], begin=4))
    assert (found.n, found.direction) == (8, "same")


def test_too_few_common_units_tell_nothing_and_the_reason_says_how_many_are_needed() -> None:
    values = KINDS["lag_event"]
    found = paired(answer("lag_event", values), answer("lag_event", values, begin=10), "zero")
    assert found.reason == "2 units of evidence in common; 6 are needed"


def test_a_missing_answer_gives_its_own_reason() -> None:
    nothing = missing("no_events", "no movement", "ms", "all")
    assert paired(answer("lag_event", NOISE), nothing, "zero").reason == "no movement"


def test_hodges_and_lehmanns_interval_is_that_of_the_published_example() -> None:
    """Hollander & Wolfe, example 3.1 (Hamilton depression scale): 0.46, from 0.010 to 0.786."""
    before = np.array([1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30])
    after = np.array([0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29])
    value, ci95, _ = hodges_lehmann(before - after)
    assert value == pytest.approx(0.46)
    assert ci95 == pytest.approx((0.010, 0.786))


def test_the_signed_rank_interval_leaves_out_zero_just_where_the_test_refuses_it() -> None:
    rng = np.random.default_rng(11)
    for n in (6, 9, 15, 30):
        for shift in np.linspace(0.0, 1.5, 12):
            d = rng.normal(shift, 1.0, n)
            _, ci95, _ = hodges_lehmann(d)
            assert ci95 is not None
            assert (ci95[0] > 0.0 or ci95[1] < 0.0) == (stats.wilcoxon(d, method="exact").pvalue <= 0.05)


def test_values_without_units_are_told_apart_by_their_intervals() -> None:
    a, b = (Answer(v, "s", "all", ci95=(v - 1.0, v + 1.0)) for v in (5.0, 8.0))
    assert compared(a, b).direction == "worse"
    near = Answer(6.0, "s", "all", ci95=(5.0, 7.0))
    assert compared(a, near).direction == "not significant"


@pytest.mark.parametrize("coarse", [0, 1])
def test_a_difference_that_one_side_cannot_resolve_is_not_told(coarse: int) -> None:
    """2 ms on common events and 3 s without any are told, unless one of both answers resolves no more than that."""
    events = [answer("lag_event", 12.0 + NOISE), answer("lag_event", 14.0 + NOISE[::-1] / 9.0)]
    values = [Answer(v, "s", "all", ci95=(v - 1.0, v + 1.0)) for v in (5.0, 8.0)]
    for both, resolved in ((events, 5.0), (values, 3.5)):
        assert compared(*both, "zero").direction == "worse"
        both[coarse].floor = resolved
        assert compared(*both, "zero").direction == "not significant"


# Pooling over logs against published worked examples.


def test_hartung_and_knapps_interval_is_that_of_the_published_example() -> None:
    """IntHout, Ioannidis & Borm 2014 (BMC Med Res Methodol 14:25), first example, appendix 3, with its weights."""
    mean, error = hartung_knapp([-0.04, -0.07, -0.31, -1.36, -0.54], [24.0, 22.2, 21.3, 15.5, 17.0])
    assert mean == pytest.approx(-0.3938, abs=5e-5)
    assert error == pytest.approx(0.2254, abs=5e-5)
    half = stats.t.ppf(0.975, 4) * error
    assert (mean - half, mean + half) == pytest.approx((-1.0195, 0.2319), abs=2e-4)


def bcg() -> tuple[np.ndarray, np.ndarray]:
    """Log risk ratios and variances of 13 trials of a vaccine (Colditz et al. 1994)."""
    table = np.array(
        [
            [4, 119, 11, 128],
            [6, 300, 29, 274],
            [3, 228, 11, 209],
            [62, 13536, 248, 12619],
            [33, 5036, 47, 5761],
            [180, 1361, 372, 1079],
            [8, 2537, 10, 619],
            [505, 87886, 499, 87892],
            [29, 7470, 45, 7232],
            [17, 1699, 65, 1600],
            [186, 50448, 141, 27197],
            [5, 2493, 3, 2338],
            [27, 16886, 29, 17825],
        ],
        float,
    )
    a, b, c, d = table.T
    return np.log(a / (a + b) / (c / (c + d))), 1 / a - 1 / (a + b) + 1 / c - 1 / (c + d)


def test_tau_and_the_mean_are_dersimonian_and_lairds_of_the_published_example() -> None:
    """Viechtbauer 2010 (J Stat Softw 36(3)), the vaccine trials: tau^2 0.3088, I^2 92.12 %, mean -0.7141."""
    y, variance = bcg()
    tau2, i2 = dersimonian_laird(y, variance)
    assert tau2 == pytest.approx(0.3088, abs=5e-5)
    assert i2 == pytest.approx(92.12, abs=5e-3)
    found = pool_values(list(y), list(np.sqrt(variance)))
    assert found.value == pytest.approx(-0.7141, abs=5e-5)


def test_logs_that_agree_too_well_do_not_make_the_interval_narrower_than_their_own_errors() -> None:
    found = pool_values([0.1, 0.1001, 0.0999], [0.05, 0.05, 0.05])
    assert found.ci95 is not None
    assert 0.5 * (found.ci95[1] - found.ci95[0]) == pytest.approx(stats.t.ppf(0.975, 2) * 0.05 / np.sqrt(3), rel=1e-6)


def test_no_difference_on_any_log_is_none_at_all() -> None:
    found = pool_values([0.0, 0.0, 0.0], [0.1, 0.2, None])
    assert (found.value, found.ci95, found.p) == (0.0, (0.0, 0.0), 1.0)
    same = pool([Difference("ratio", 1.0, (1.0, 1.0))] * 3, "ratio")
    assert same is not None
    assert (same.value, same.ci95, same.direction, same.logs) == (1.0, (1.0, 1.0), "same", 3)


def test_one_log_keeps_its_own_interval() -> None:
    alone = Difference("difference", -0.2, (-0.3, -0.1), 0.001, 0.05, better=1)
    found = pool([alone, Difference("difference", reason="no steps")], "difference")
    assert found is not None
    assert (found.value, found.ci95, found.p, found.better) == (-0.2, (-0.3, -0.1), 0.001, 1)


def test_a_log_without_an_error_makes_all_weigh_the_same() -> None:
    y = [1.0, 2.0, 4.0]
    found = pool_values(y, [0.1, None, 0.2])
    wanted = stats.t.interval(0.95, 2, np.mean(y), stats.sem(y))
    assert found.ci95 == pytest.approx(wanted)
    assert found.p == pytest.approx(stats.ttest_1samp(y, 0.0).pvalue)


def test_the_pooled_interval_covers_the_mean_of_all_logs() -> None:
    """Unequal errors, true scatter: 95 % over 1000 draws of nine logs, between 93 and 98."""
    rng, inside = np.random.default_rng(5), 0
    for _ in range(1000):
        errors = rng.uniform(0.02, 0.2, 9)
        y = -0.3 + rng.normal(0.0, 0.1, 9) + rng.normal(0.0, 1.0, 9) * errors
        ci95 = pool_values(list(y), list(errors)).ci95
        assert ci95 is not None
        inside += ci95[0] <= -0.3 <= ci95[1]
    assert 930 <= inside <= 980


def test_an_error_of_zero_weighs_no_more_than_the_smallest_that_is_known() -> None:
    assert pool_values([-1.0, 0.4, 0.9], [0.0, 0.5, 0.8]) == pool_values([-1.0, 0.4, 0.9], [0.5, 0.5, 0.8])


# A paired interval of half a flight holds the difference of the other half (benchmarks/paired_intervals.py).

SPECS = ("mahony:kp=0.6", "mahony:kp=0.3", "mahony:kp=1.1", "madgwick", "vqf")


@pytest.mark.slow
def test_paired_intervals_hold_the_other_half_in_nine_of_ten() -> None:
    rng, held = np.random.default_rng(0), []
    for log in ("copter_steps_stabilize.bin", "px4_steps.ulg"):
        result = evaluate(prepare(SAMPLES / log), [ConfiguredFilter(parse_configuration(text)) for text in SPECS])
        rows = [row for row in result.estimators if row.kind == "replay" and row.status == "ok"]
        for question in select_questions():
            metric, window = answer_place(question, rows)
            answers = [row.metrics.get(window, {}).get(metric) for row in rows]
            units = [a.units for a in answers if a is not None and a.ranked and a.units is not None]
            for other in units[1:]:
                common = np.intersect1d(units[0].ids, other.ids)
                half = len(common) // 2
                for _ in range(10 if half >= 4 else 0):
                    drawn = rng.permutation(common)
                    one, two = (
                        estimate_difference(units[0], other, np.sort(ids))
                        for ids in (drawn[:half], drawn[half : 2 * half])
                    )
                    if one.ci95 is not None and two.ci95 is not None:
                        width = math.hypot(one.ci95[1] - one.value, two.ci95[1] - two.value)
                        held.append(abs(one.value - two.value) <= width)
    assert len(held) > 150
    assert 0.90 <= np.mean(held) <= 0.99
