"""The comparison table: columns, words for what is missing, marks."""

from __future__ import annotations

import dataclasses

import pytest

from attlog.metrics.metric import CODES, Answer, missing
from attlog.report.figures.style import row_styles
from attlog.words.names import CODES as WORDS
from attlog.words.table import axis_table, main_table, window_tables
from tests.report.conftest import answer, make_result

TILT_NOISE = "noise_tilt_deg"


def cells(result, name):
    """The cells of one row by metric."""
    table = main_table(result)
    found = next(c for row, c in table.rows if row.name == name)
    return {column.metric: c for column, c in zip(table.columns, found, strict=True)}


def test_every_code_has_a_word_and_a_short_one():
    assert set(WORDS) == set(CODES)
    assert max(len(brief) for _, brief in WORDS.values()) <= 9


def test_each_phase_has_its_own_column_of_noise_in_the_order_of_the_sentence():
    result = make_result()
    for row in result.estimators[1:]:
        for phase in ("idle", "hover"):
            row.metrics[phase] = {TILT_NOISE: answer(0.3, "deg", phase, 0.1)}
    found = [(c.title, c.window) for c in main_table(result).columns if c.metric == TILT_NOISE]
    assert found == [("Noise at rest", "rest"), ("Noise added in hover", "hover"), ("Noise added idling", "idle")]


def test_a_column_has_one_window_for_all_rows():
    result = make_result()
    result.estimators[2].metrics["airborne"].pop("tilt_rmse_deg")
    result.estimators[2].metrics["all"]["tilt_rmse_deg"] = answer(9.0, "deg", "all")
    assert cells(result, "complementary@fan")["tilt_rmse_deg"].missing


def test_an_asked_window_is_the_only_one_that_is_looked_at():
    metrics = {c.metric for c in main_table(make_result(), "all").columns}
    assert {"lag_ms", TILT_NOISE} <= metrics
    assert {c.metric for c in main_table(make_result(), "rest").columns} == {TILT_NOISE, "drift_rest_deg_per_min"}


def test_the_gyro_alone_stands_after_the_filters_and_has_no_star():
    result = make_result()
    result.best["rest"][TILT_NOISE] = ["gyro", "vqf"]
    names = [row.name for row, _ in main_table(result).rows]
    assert names[-1] == "gyro"
    assert not cells(result, "gyro")[TILT_NOISE].best
    assert cells(result, "gyro")[TILT_NOISE].unranked


def test_lag_is_called_lag_on_every_axis():
    assert "Roll lag" in [c.title for c in axis_table(make_result()).columns]


def test_a_column_without_any_value_is_left_out():
    result = make_result()
    assert "lag_ms" in cells(result, "gyro")
    for row in result.estimators:
        row.metrics["airborne"]["lag_ms"] = missing("no_events", "no steps", "ms", "airborne")
    assert "lag_ms" not in cells(result, "gyro")


def test_what_flew_stands_first_and_other_onboard_attitudes_last():
    result = make_result()
    other = dataclasses.replace(result.estimators[0], name="onboard:AHR2", is_reference=False)
    result.estimators.insert(0, other)
    names = [row.name for row, _ in main_table(result).rows]
    assert names[0] == "onboard"
    assert names[-1] == "onboard:AHR2"
    assert next(iter(row_styles(result))) == "onboard"


def test_missing_is_a_word_never_a_number():
    result = make_result()
    assert cells(result, "gyro")["heading_rmse_deg"].text == "no mag"
    assert cells(result, "onboard")["tilt_rmse_deg"].text == "reference"
    assert cells(result, "complementary@fan")["lag_ms"].text == "not a pure delay"
    assert cells(result, "complementary@fan")["lag_ms"].sort is None


def test_best_marks_come_from_the_result_and_not_for_shape():
    result = make_result()
    result.best["airborne"]["step_gain_roll"] = ["vqf"]
    assert cells(result, "vqf")[TILT_NOISE].best
    assert not cells(result, "madgwick@marg")[TILT_NOISE].best
    table = axis_table(result)
    gain = next(i for i, c in enumerate(table.columns) if c.metric == "step_gain_roll")
    assert not any(cells[gain].best or cells[gain].unranked for _, cells in table.rows)


def test_what_was_not_compared_is_shown_as_such_with_its_reason():
    result = make_result()
    row = next(r for r in result.estimators if r.name == "vqf")
    row.metrics["rest"][TILT_NOISE] = Answer(0.1, "deg", "rest", ranked=False, reason="does not follow motion")
    result.ranked["rest"][TILT_NOISE].remove("vqf")
    assert cells(result, "vqf")[TILT_NOISE].unranked
    assert cells(result, "vqf")[TILT_NOISE].reason == "does not follow motion"
    assert not cells(result, "mahony@xu-0.6")[TILT_NOISE].unranked


def test_low_coverage_is_printed_beside_the_value():
    result = make_result()
    poor = answer(2.0, "deg", "airborne")
    poor.coverage_pct = 62.0
    result.estimators[1].metrics["airborne"]["tilt_rmse_deg"] = poor
    assert cells(result, "gyro")["tilt_rmse_deg"].small == ("[1.9, 2.1]", "of 62 %")


def test_drift_in_the_air_has_the_column_of_the_quoted_heading_reference():
    result = make_result()
    result.estimators[2].metrics["airborne"]["drift_air_deg_per_min.truth"] = answer(1.0, "deg/min", "airborne")
    metrics = [c.metric for c in main_table(result).columns]
    assert [m for m in metrics if m.startswith("drift_air")] == ["drift_air_deg_per_min.truth"]


def test_sorting_goes_by_distance_from_the_best_value():
    result = make_result()
    assert cells(result, "gyro")["drift_rest_deg_per_min"].sort == pytest.approx(1.2)
    assert cells(result, "mahony@xu-0.6")["lag_ms"].sort == pytest.approx(12.0)


def test_the_expert_finds_every_metric_of_every_window():
    result = make_result()
    tables = window_tables(result)
    assert set(tables) == {"rest", "airborne", "all"}
    assert {"total_rmse_deg", "convergence_s", "cost_ns"} == {c.metric for c in tables["all"].columns}
