"""How far an answer is from perfect, and below which difference two are the same."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.answer import Answer
from attlog.metrics.ranking import best as ranking
from attlog.metrics.statistics.units import UnitValues, ids_of


def answer(value: float, ci95: tuple[float, float] | None = None, **more: float) -> Answer:
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
    assert ranking.distance(answer(value, ci95), better) == pytest.approx(wanted)


def test_the_largest_of_all_floors_counts_and_what_the_gyro_hides() -> None:
    bare = answer(1.0), answer(2.0)
    assert ranking.floor(*bare) == 0.0
    for name in ("floor", "counts_as_zero_below"):
        for k in range(2):
            pair = [answer(1.0, floor=0.1), answer(2.0, floor=0.1)]
            setattr(pair[k], name, 0.3)
            assert ranking.floor(*pair) == 0.3
    share = answer(-3.0, gyro_share=4.0), answer(9.0, gyro_share=1.0)
    assert ranking.floor(*share) == pytest.approx(np.hypot(3.0, 4.0) - 3.0)
    assert ranking.floor(*share[::-1]) == pytest.approx(2.0)


def of_units(ids: list[int], value: float = 1.0) -> Answer:
    found = answer(value)
    found.units = UnitValues("log_variance", ids_of(ids), np.arange(len(ids), dtype=float))
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
    assert ranking.common_units({"a": answer(1.0)}) == ([], pytest.approx(np.zeros(0)))


def test_a_restricted_answer_has_its_share_of_time_and_says_how_many_units_were_left_out() -> None:
    one = of_units(list(range(10)))
    one.seconds = 50.0
    ranking._restrict(one, ids_of([2, 4]))
    assert (one.n, one.seconds, one.detail["units_left_out"]) == (2, 10.0, 8)
    assert one.value == pytest.approx(np.exp(0.5 * 3.0))


def test_pairs_are_ordered_by_the_shown_values_and_ties_within_the_floor_fall_out() -> None:
    answers = {"a": answer(3.0), "b": answer(1.0), "c": answer(1.0), "d": answer(1.2, floor=0.3)}
    couples = [("a", "b"), ("b", "a"), ("b", "c"), ("b", "d"), ("a", "d")]
    assert ranking._in_order(couples, answers, "low") == [("b", "a"), ("b", "a"), ("d", "a")]
    assert ranking._in_order(couples, answers, "low", ordered=True) == [("b", "a")]
    assert ranking._in_order(couples[:1], answers, "high") == [("a", "b")]
