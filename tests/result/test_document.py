"""Answers that a document tells once: which evidence is usual, what points where, and what does not fit."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from attlog.metrics.metric import Answer
from attlog.result.document import as_written, expanded, in_order, shorten, units

FIRST, SECOND = list(units())[:2]


def answer(value: float | None, metric: str = FIRST, window: str = "all", **more: Any) -> dict[str, Any]:
    return {"value": value, "unit": units()[metric], "window": window, "n": 3, "method": "means"} | more


def row(**windows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {"name": "made", "metrics": windows}


def document(rows: list[dict[str, Any]]) -> dict[str, Any]:
    rows = copy.deepcopy(rows)
    return {"log": 1} | shorten(rows) | {"estimators": rows}


def test_what_most_rows_have_is_usual_and_stands_in_none_of_them() -> None:
    rows = [row(all={FIRST: answer(v, n=n)}) for v, n in ((1.0, 7), (2.0, 3), (4.0, 3))]
    made = document(rows)
    assert made["usual"] == {"all": {FIRST: 1}}
    assert [r["metrics"]["all"][FIRST] for r in made["estimators"]] == [
        {"value": 1.0, "evidence": 0},
        {"value": 2.0},
        {"value": 4.0},
    ]
    assert made["evidence"] == [{"n": 7, "method": 0}, {"n": 3, "method": 0}]
    assert made["sentences"] == ["means"]
    assert "units" not in made
    assert "details" not in made
    assert expanded(made) == {"log": 1, "estimators": rows}


def test_of_equally_many_the_first_is_usual() -> None:
    made = document([row(all={FIRST: answer(1.0, n=9)}), row(all={FIRST: answer(1.0, n=2)})])
    assert made["usual"] == {"all": {FIRST: 0}}
    assert made["evidence"][0]["n"] == 9


def test_an_answer_of_an_earlier_window_is_told_by_that_windows_name() -> None:
    rows = [
        row(
            all={FIRST: answer(1.5), SECOND: answer(0.5, SECOND)},
            airborne={FIRST: answer(1.5, window="airborne"), SECOND: answer(0.7, SECOND, "airborne")},
            rest={FIRST: answer(1.5, window="rest")},
        )
    ]
    made = document(rows)
    assert made["usual"]["airborne"] == {FIRST: "all", SECOND: made["usual"]["all"][SECOND]}
    assert made["estimators"][0]["metrics"]["airborne"] == {SECOND: {"value": 0.7}}
    assert made["estimators"][0]["metrics"]["rest"] == {}
    assert expanded(made)["estimators"] == rows


def test_a_row_without_a_usual_answer_says_null_and_one_of_its_own_says_itself() -> None:
    rows = [row(all={FIRST: answer(1.0)}), row(all={SECOND: answer(2.0, SECOND)}), row(all={FIRST: answer(3.0)})]
    made = document(rows)
    assert made["estimators"][1]["metrics"]["all"] == {FIRST: None, SECOND: {"value": 2.0}}
    assert made["estimators"][0]["metrics"]["all"] == {FIRST: {"value": 1.0}, SECOND: None}
    assert expanded(made)["estimators"] == rows


def test_details_units_and_their_values_are_told_once_and_come_back() -> None:
    shared = {"kind": "block", "ids": [3, 1], "values": [0.25, 0.5]}
    rows = [
        row(all={FIRST: answer(1.0, units=shared, each=[0.25, 0.5], detail={"slope": 2.0})}),
        row(all={FIRST: answer(2.0, units=shared | {"values": [4.0, 8.0]}, each=[1.0], detail={"slope": 2.0})}),
        row(all={FIRST: answer(None, reason="why", ranked=False)}),
    ]
    made = document(rows)
    assert made["units"] == [{"kind": "block", "ids": [3, 1]}]
    assert made["details"] == [{"slope": 2.0}]
    first, second, third = (r["metrics"]["all"][FIRST] for r in made["estimators"])
    assert first == {"value": 1.0, "each": None, "detail": 0, "unit_values": [0.25, 0.5]}
    assert second == {"value": 2.0, "each": [1.0], "detail": 0, "unit_values": [4.0, 8.0]}
    assert made["evidence"][third["evidence"]] == {"n": 3, "method": 0, "reason": 1}
    del rows[2]["metrics"]["all"][FIRST]["ranked"]
    assert expanded(made)["estimators"] == rows


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda m: m["estimators"][0]["metrics"]["all"][FIRST].update(evidence=2), "evidence: there is no evidence 2"),
        (lambda m: m["estimators"][0]["metrics"]["all"][FIRST].update(evidence=-1), "there is no evidence -1"),
        (lambda m: m["estimators"][0]["metrics"]["all"][FIRST].update(detail=1), "detail: there is no detail 1"),
        (lambda m: m["estimators"][0]["metrics"]["all"][FIRST].update(as_in="rest"), "no such answer in 'rest'"),
        (
            lambda m: m["estimators"][1]["metrics"]["rest"].update({FIRST: {"as_in": "all", "value": 9.0}}),
            ".value: differs",
        ),
        (lambda m: m["sentences"].clear(), "there is no sentence 0"),
    ],
)
def test_what_points_to_nothing_is_told_with_its_place(spoil: Any, says: str) -> None:
    rows = [row(all={FIRST: answer(float(v), n=v)}, rest={FIRST: answer(float(v), window="rest", n=v)}) for v in (5, 6)]
    made = document(rows)
    assert expanded(made)["estimators"] == rows
    spoil(made)
    with pytest.raises(ValueError, match=r"^estimators\[[01]\]\.metrics\.(all|rest)\.") as told:
        expanded(made)
    assert says in str(told.value)


def test_an_answer_equals_what_is_read_back_of_it() -> None:
    found = as_written(Answer(1.23456789, "deg", "all", 3, 1.0, (0.98765432, 2.3456789), each=[0.123456789]))
    assert (found.value, found.ci95, found.each) == (1.23457, (0.987654, 2.34568), [0.12346])


def test_metrics_stand_as_they_are_defined_and_unknown_ones_behind() -> None:
    assert in_order(["unknown", SECOND, "another", FIRST]) == [FIRST, SECOND, "unknown", "another"]


@pytest.mark.parametrize("broken", [{"usual": []}, {"usual": {"all": 3}}, {"estimators": {}}, {"units": "x"}])
def test_a_document_of_other_types_is_left_as_it_is(broken: dict[str, Any]) -> None:
    assert expanded(broken) is broken
