"""Numbers of many seeds, and what their interval says about a claim."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from attlog.reproduce import judge
from attlog.reproduce.paper import PaperNumber, Verdict

VALUES = list(np.random.default_rng(1).normal(3.0, 0.5, 20))
OTHERS = list(np.random.default_rng(2).normal(4.0, 0.5, 20))


def test_a_mean_has_students_interval() -> None:
    found = judge.mean("spread", VALUES, "deg")
    ends = stats.t.interval(0.95, 19, np.mean(VALUES), stats.sem(VALUES))
    assert (found.value, *found.ci95) == pytest.approx((np.mean(VALUES), *ends))
    assert found.n == 20


def test_seeds_without_a_number_are_not_counted() -> None:
    found = judge.mean("rise", [*VALUES, math.nan], "s")
    assert found == judge.mean("rise", VALUES, "s")
    assert judge.mean("rise", [math.nan], "s") == PaperNumber("rise", None, "s", None, 0)


def test_a_ratio_is_paired_and_has_the_interval_of_its_logarithm() -> None:
    found = judge.ratio("spread", VALUES, OTHERS)
    logs = np.log(np.array(VALUES) / np.array(OTHERS))
    ends = stats.t.interval(0.95, 19, logs.mean(), stats.sem(logs))
    assert (found.value, *found.ci95) == pytest.approx(tuple(np.exp([logs.mean(), *ends])))
    inverse = judge.ratio("spread", OTHERS, VALUES)
    assert inverse.value == pytest.approx(1 / found.value)


def test_equal_runs_have_a_ratio_of_one_without_width() -> None:
    assert judge.ratio("spread", VALUES, VALUES) == PaperNumber("spread", 1.0, "ratio", (1.0, 1.0), 20)


def test_a_difference_of_pairs_knows_nothing_of_what_both_share() -> None:
    shared = np.linspace(-100.0, 100.0, 20)
    found = judge.difference("lag", list(np.array(VALUES) + shared), list(shared), "ms")
    assert found.ci95 == pytest.approx(judge.mean("lag", VALUES, "ms").ci95)


@pytest.mark.parametrize("hits", [0, 7, 20])
def test_a_share_has_wilsons_interval(hits: int) -> None:
    found = judge.share("hovers", [k < hits for k in range(20)])
    ends = stats.binomtest(hits, 20).proportion_ci(method="wilson")
    assert (found.value, *found.ci95) == pytest.approx((5.0 * hits, 100 * ends.low, 100 * ends.high), abs=1e-4)


@pytest.mark.parametrize(
    ("ends", "smaller", "larger"),
    [
        ((0.5, 0.9), "holds", "does not hold"),
        ((1.1, 1.9), "does not hold", "holds"),
        ((0.9, 1.1), "cannot be judged", "cannot be judged"),
        ((1.0, 1.0), "does not hold", "does not hold"),
        (None, "cannot be judged", "cannot be judged"),
    ],
)
def test_a_claim_about_a_size_needs_the_whole_interval(ends: tuple[float, float] | None, smaller: str, larger: str):
    number = PaperNumber("ratio", 1.0, "ratio", ends, 20)
    assert judge.below(number, 1.0) == smaller
    assert judge.above(number, 1.0) == larger


@pytest.mark.parametrize(
    ("parts", "whole"),
    [
        (["holds", "holds"], "holds"),
        (["holds", "does not hold"], "holds in part"),
        (["holds", "cannot be judged"], "holds in part"),
        (["does not hold", "cannot be judged"], "does not hold"),
        (["does not hold", "does not hold"], "does not hold"),
        (["cannot be judged"], "cannot be judged"),
        (["holds in part", "does not hold"], "holds in part"),
    ],
)
def test_parts_make_a_whole(parts: list[judge.Verdict], whole: str) -> None:
    assert judge.together(parts) == whole


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        (["holds", "holds"], "holds"),
        (["holds", "does not hold"], "holds in part"),
        (["cannot be judged", "holds"], "holds in part"),
        (["cannot be judged", "does not hold"], "cannot be judged"),
        (["does not hold", "does not hold"], "does not hold"),
    ],
)
def test_readings_of_what_is_not_printed_refute_a_claim_only_all_together(verdicts: list[Verdict], said: str) -> None:
    assert judge.alternatives(verdicts) == said
