"""The first figure of a comparison: every sentence agrees with the dots beneath it."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from attlog.compare.configurations.configuration import parse
from attlog.compare.differences.comparison import Comparison
from attlog.compare.tables.matrix import of_log, over_all
from attlog.compare.tables.overview import end_label, headline, overview
from tests.compare.flights import comparison

THREE = [parse(f"mahony:kp={kp}") for kp in (0.3, 0.6, 1.2)]
LABELS = ("kp 0.6", "kp 1.2")


def some(seed: int) -> Comparison:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))

    def each(scale: float) -> list[tuple[float, float]]:
        middle = rng.normal(0.0, 2.0 * scale)
        return [(float(rng.normal(middle, 0.3 * scale)), float(rng.uniform(0.1, 0.6) * scale)) for _ in range(n)]

    changes = {
        "inclination_rmse_deg": each(0.3),
        "heading_rmse_deg": each(0.1),
        "noise_tilt_deg": each(1.5),
        "lag_ms": each(3.0),
        "drift_rest_deg_per_min": each(2.0),
    }
    return comparison(changes, THREE, factors=(1.0, float(rng.normal())))


@pytest.mark.parametrize("seed", range(30))
def test_sentences_agree_with_the_dots(seed: int) -> None:
    found = some(seed)
    columns = overview(found)
    assert [c.title for c in columns] == ["Accuracy", "Static noise", "Step response", "Yaw drift"]
    said = " ".join(headline(found))
    for column in columns:
        assert len(column.sentence.split()) <= 20
        better, _, worse = column.sentence.partition("Worse:")
        for label, cell in zip(LABELS, column.cells, strict=True):
            assert (label in better) == (cell.direction == "better"), column.sentence
            assert (label in worse) == (cell.direction == "worse"), column.sentence
            if cell.direction in ("better", "worse"):
                side = -1.0 if cell.direction == "better" else 1.0
                assert cell.ends is not None
                assert side * (cell.x - 50.0) >= cell.floor
                assert min(side * (e - 50.0) for e in cell.ends) >= 0.0
                noun = column.what.rpartition(",")[0].lower()
                sentence = next(s for s in headline(found) if s.startswith(f"Significantly {cell.direction}"))
                part = next(p for p in re.split(r"[:;]", sentence) if p.strip().startswith(label))
                assert f"{noun} ({cell.value})" in part or "more" in part
            assert re.match(r"[+−<×>]|\d+ times|not comparable", cell.value), cell.value
    significant = any(c.over.direction in ("better", "worse") for q in found.questions for c in q.contrasts if c.over)
    assert said.startswith("Significantly") == significant


@pytest.mark.parametrize("seed", range(10))
def test_the_table_shows_what_the_dots_show(seed: int) -> None:
    found = some(seed)
    rows = {title: cells for title, _, cells in over_all(found).rows}
    for column in overview(found):
        cells = next(cells for title, cells in rows.items() if title.startswith(column.what.rpartition(",")[0] + ","))
        assert [(c.change, c.direction) for c in cells] == [(c.value, c.direction) for c in column.cells]


def test_nothing_significant_is_said_once() -> None:
    found = comparison({"inclination_rmse_deg": [(0.02, 0.1), (-0.03, 0.1)], "lag_ms": [(0.1, 3.0), (0.0, 3.0)]})
    assert headline(found) == ["No significant difference to kp 0.3 in any question."]
    assert {c.sentence for c in overview(found)} == {"No significant difference."}


def test_a_column_that_no_log_answers_says_why_and_has_no_dots() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.1)] * 3})
    found.unanswered = {"lag_ms@airborne": "no steps", "step_error_deg.0.5s@airborne": "no steps"}
    column = next(c for c in overview(found) if c.cells == [])
    assert column.sentence == "Cannot be determined: no steps."


def test_a_difference_far_from_the_others_stands_at_the_end_of_its_column() -> None:
    found = comparison({"noise_tilt_deg": [(0.05, 0.01)] * 3}, THREE, factors=(1.0, 60.0))
    (column,) = overview(found)
    near, far = column.cells
    assert (near.beyond, far.beyond) == (0, 1)
    assert 55.0 < near.x < far.x
    assert (far.direction, column.sentence) == ("worse", "Worse: kp 0.6 and kp 1.2.")


def test_dots_count_the_logs_that_point_the_same_way_of_those_with_an_answer() -> None:
    found = comparison({"inclination_rmse_deg": [(-0.3, 0.1), (-0.2, 0.1), (0.05, 0.1)], "lag_ms": [(1.0, 0.1)]})
    accuracy, lag = overview(found)
    assert accuracy.cells[0].count == "2/3 logs"
    assert lag.cells[0].count == "1/1 log"
    assert len(accuracy.cells[0].logs) == 3


def test_a_log_without_a_difference_has_its_reason_beside_its_table() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.1)] * 2, "lag_ms": [(1.0, 0.1)]})
    matrix = of_log(found, found.logs[1])
    assert [cells[0].change for _, _, cells in matrix.rows] == ["+35 %", "–"]
    assert matrix.reasons == ["no steps"]


@pytest.mark.parametrize(("value", "label"), [(0.5, "−50"), (1.5, "+50"), (40.0, "×40"), (0.005, "÷200")])
def test_ends_of_a_scale_of_ratios_are_percent_and_beyond_ten_a_factor(value: float, label: str) -> None:
    assert end_label(value, SimpleNamespace(scale="ratio", unit="deg")) == label  # type: ignore[arg-type]
