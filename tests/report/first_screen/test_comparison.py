"""The four questions on the first screen: order of rows, words for what is missing, one box where nothing can be."""

from __future__ import annotations

from attlog.metrics.answer import missing
from attlog.report.first_screen.comparison import comparison
from attlog.report.look import looks
from attlog.result import Result
from tests.report.conftest import answer, make_result


def drawn(result: Result):
    return comparison(result, looks(result))


def test_onboard_stands_first_then_filters_by_accuracy_and_the_gyro_last() -> None:
    result = make_result()
    tilt = {
        r.name: r.metrics["airborne"]["inclination_rmse_deg"].value for r in result.estimators if r.kind == "replay"
    }
    shown = drawn(result).rows
    assert shown[0] == "onboard"
    assert shown[-1] == "gyro"
    assert shown[1:-1] == sorted((n for n in tilt if n != "gyro"), key=lambda name: tilt[name])


def test_every_column_has_a_dot_or_a_word_for_every_row() -> None:
    found = drawn(make_result())
    assert [q.title for q in found.questions] == ["Accuracy", "Static noise", "Step response", "Yaw drift"]
    for question in found.questions:
        assert len(question.dots) == len(found.rows)
        assert all(dot.text for dot in question.dots)
        assert all(dot.low <= dot.x <= dot.high for dot in question.dots if dot.x is not None)


def test_a_filter_without_a_lag_says_why_in_its_place() -> None:
    result = make_result()
    found = drawn(result)
    dot = found.questions[2].dots[found.rows.index("complementary@fan")]
    assert dot.x is None
    assert dot.text == "not a pure delay"
    assert "follows 51 % of the step" in dot.hint


def test_a_filter_that_misses_the_step_is_named_beside_lags_that_are_small() -> None:
    result = make_result()
    for row in result.estimators:
        wrong = row.name == "vqf"
        row.metrics["airborne"]["step_error_deg.0.5s"] = answer(9.2 if wrong else 0.1, "deg", "airborne")
        row.metrics["airborne"]["step_error_pct.0.5s"] = answer(-27.3 if wrong else 0.3, "pct", "airborne")
    assert drawn(result).questions[2].sentence.endswith("VQF is 27 % short after 0.5 s.")
    for row in result.estimators:
        row.metrics["airborne"]["step_error_pct.0.5s"].value = 0.3
    assert "after 0.5 s" not in drawn(result).questions[2].sentence


def test_a_value_that_is_not_ranked_is_pale_and_says_so() -> None:
    result = make_result()
    found = drawn(result)
    dot = found.questions[1].dots[found.rows.index("gyro")]
    assert dot.pale
    assert not dot.best
    assert "Not ranked: the gyro alone" in dot.hint


def test_the_hint_tells_interval_number_and_seconds() -> None:
    found = drawn(make_result())
    dot = found.questions[1].dots[found.rows.index("vqf")]
    assert dot.hint.startswith("VQF: 0.00")
    assert "(95 %: " in dot.hint
    assert ", n 28, 40 s" in dot.hint


def test_a_log_that_answers_nothing_has_one_box_with_the_reasons() -> None:
    result = make_result()
    for one in result.estimators:
        one.metrics = {}
    found = drawn(result)
    assert found.nothing.startswith("Cannot be determined")
    assert all(q.empty for q in found.questions)
    assert not drawn(make_result()).nothing


def test_without_filters_the_box_says_that_none_was_run() -> None:
    result = make_result()
    result.estimators = [r for r in result.estimators if r.kind != "replay"]
    assert "no filter was run" in drawn(result).nothing


def test_a_reason_is_written_out_once_and_then_named_by_its_question() -> None:
    result = make_result()
    for one in result.estimators:
        for metrics in one.metrics.values():
            for name in [n for n in metrics if n.startswith(("noise_", "drift_"))]:
                metrics[name] = missing("no_rest", "the vehicle never stood still", metrics[name].unit, "rest")
    found = {q.id: q for q in drawn(result).questions}
    assert found["noise"].sentence == "Cannot be determined: the vehicle never stood still."
    assert found["yaw_drift"].sentence == "Cannot be determined: same reason as static noise."


def test_a_large_value_is_not_marked_beside_a_smaller_one_that_is_not() -> None:
    result = make_result()
    window, metric = "rest", "noise_tilt_deg"
    sizes = {r.name: r.metrics[window][metric].value for r in result.estimators if r.kind == "replay"}
    least, *_, most = sorted((n for n in sizes if n != "gyro"), key=lambda n: sizes[n])
    result.best = {window: {metric: [least, most]}}
    found = drawn(result)
    marked = [name for name, dot in zip(found.rows, found.questions[1].dots, strict=True) if dot.best]
    assert marked == [least]


def test_a_question_that_cannot_be_answered_draws_no_values_beneath_its_sentence() -> None:
    result = make_result()
    for row in result.estimators:
        if row.kind == "replay":
            row.status, row.reason = "not_judged", "the gyro reads 24 deg/s while the vehicle stands still"
    result.ranked, result.best = {}, {}
    found = drawn(result)
    for question in found.questions:
        assert question.empty == question.sentence.startswith("Cannot be determined")
        assert bool(question.dots) != question.empty
    assert found.questions[0].empty


def test_a_lag_that_cannot_be_determined_gets_no_remark_on_the_step() -> None:
    result = make_result()
    for one in result.estimators:
        one.metrics["airborne"]["lag_ms"] = missing("no_events", "no step in flight", "ms", "airborne")
        one.metrics["airborne"]["step_error_deg.0.5s"] = answer(9.2, "deg", "airborne")
        one.metrics["airborne"]["step_error_pct.0.5s"] = answer(-27.3, "pct", "airborne")
    found = drawn(result).questions[2]
    assert found.empty
    assert found.sentence == "Cannot be determined: no step in flight."
