"""Paired differences against closed forms, scipy and published numbers."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy import stats  # type: ignore[import-untyped]

from attlog.compare.differences.paired import PairedDifference, hodges_lehmann, paired
from attlog.metrics.answer import Answer, missing
from attlog.metrics.statistics.units import Kind, Summary, UnitValues


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


def compared(a: Answer, b: Answer, better: str = "low") -> PairedDifference:
    found = paired(a, b, better)
    assert isinstance(found, PairedDifference), found
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
    assert (found.value, found.ci95, found.p, found.direction) == (0.0, (0.0, 0.0), 1.0, "same")


@pytest.mark.parametrize("kind", ["log_variance", "mean_square"])
def test_a_common_factor_comes_out_as_the_logarithm_of_the_ratio_of_sizes(kind: Kind) -> None:
    values = KINDS[kind]
    second = values + np.log(0.25) if kind == "log_variance" else 0.25 * values
    found = compared(answer(kind, values), answer(kind, second))
    assert found.scale == "ratio"
    assert found.value == pytest.approx(np.log(0.5))
    assert found.second / found.first == pytest.approx(0.5)
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
    assert found == "2 units of evidence in common; 6 are needed"


def test_a_missing_answer_gives_its_own_reason() -> None:
    assert paired(answer("lag_event", NOISE), missing("no_events", "no movement", "ms", "all"), "zero") == "no movement"


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
