"""Scales of the dots: what is far off does not press the others together, and zero is on a scale with signs."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.metric import missing
from attlog.report.figures.style import row_styles
from attlog.report.first_screen import (
    LABEL_LEVELS,
    StripMark,
    compare_filters,
    flight_strip,
    log_scale,
    place_labels,
    zero_scale,
)
from attlog.result import Result, Trace
from attlog.story.flight_events import Event
from tests.report.conftest import SECONDS, answer, make_result


def test_decades_are_equally_wide_on_a_scale_of_sizes() -> None:
    scale = log_scale([0.01, 0.1, 1.0], [])
    assert scale.place(0.1) - scale.place(0.01) == pytest.approx(scale.place(1.0) - scale.place(0.1))
    assert scale.place(0.1) == pytest.approx(50.0)
    assert scale.ticks == pytest.approx([0.01, 0.1, 1.0])


def test_an_interval_down_to_zero_does_not_stretch_a_scale_of_sizes() -> None:
    scale = log_scale([0.5, 1.0], [(0.0, 0.9), (1e-9, 1.2)])
    assert scale.low == pytest.approx(0.1)
    assert scale.place(0.0) == pytest.approx(3.0)
    assert scale.place(1e-9) == 0.5


def test_a_value_far_off_stands_at_the_edge() -> None:
    scale = zero_scale([1.0, 2.0, -1.5, 900.0], [], "deg/min")
    assert not scale.holds(900.0)
    assert scale.place(900.0) == 99.5
    assert scale.high == 2.0


def test_half_a_millisecond_does_not_fill_a_column() -> None:
    scale = zero_scale([0.2, -0.3], [(-0.5, 0.5)], "ms")
    assert scale.high - scale.low == pytest.approx(10.0)
    assert scale.holds(0.0)


def test_a_single_value_has_a_scale() -> None:
    assert log_scale([0.46], []).holds(0.46)
    assert len(log_scale([0.46], []).ticks) >= 1
    assert zero_scale([3.0], [], "deg/min").holds(0.0)


def test_a_wide_interval_of_a_value_nearby_is_shown_whole() -> None:
    scale = zero_scale([1.0, 7.4, -1.0], [(-4.0, 5.0), (-12.7, 27.4), (-5.0, 3.0)], "deg/min")
    assert scale.holds(27.4)
    assert scale.holds(-12.7)


# The four questions on the first screen: order of rows, words for what is missing, one box where nothing can be.


def compared(result: Result):
    return compare_filters(result, row_styles(result))


def test_onboard_stands_first_then_filters_by_accuracy_and_the_gyro_last() -> None:
    result = make_result()
    tilt = {r.name: r.metrics["airborne"]["tilt_rmse_deg"].value for r in result.estimators if r.kind == "replay"}
    shown = compared(result).rows
    assert shown[0] == "onboard"
    assert shown[-1] == "gyro"
    assert shown[1:-1] == sorted((n for n in tilt if n != "gyro"), key=lambda name: tilt[name])


def test_every_column_has_a_dot_or_a_word_for_every_row() -> None:
    found = compared(make_result())
    assert [q.title for q in found.questions] == ["Accuracy", "Static noise", "Step response", "Yaw drift"]
    for question in found.questions:
        assert len(question.dots) == len(found.rows)
        assert all(dot.text for dot in question.dots)
        assert all(dot.low <= dot.x <= dot.high for dot in question.dots if dot.x is not None)


def test_a_filter_without_a_lag_says_why_in_its_place() -> None:
    result = make_result()
    found = compared(result)
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
    assert compared(result).questions[2].sentence.endswith("VQF is 27 % short after 0.5 s.")
    for row in result.estimators:
        row.metrics["airborne"]["step_error_pct.0.5s"].value = 0.3
    assert "after 0.5 s" not in compared(result).questions[2].sentence


def test_a_value_that_is_not_ranked_is_pale_and_says_so() -> None:
    result = make_result()
    found = compared(result)
    dot = found.questions[1].dots[found.rows.index("gyro")]
    assert dot.pale
    assert not dot.best
    assert "Not ranked: the gyro alone" in dot.hint


def test_the_hint_tells_interval_number_and_seconds() -> None:
    found = compared(make_result())
    dot = found.questions[1].dots[found.rows.index("vqf")]
    assert dot.hint.startswith("VQF: 0.00")
    assert "(95 %: " in dot.hint
    assert ", n 28, 40 s" in dot.hint


def test_a_log_that_answers_nothing_has_one_box_with_the_reasons() -> None:
    result = make_result()
    for one in result.estimators:
        one.metrics = {}
    found = compared(result)
    assert found.nothing.startswith("Cannot be determined")
    assert all(q.empty for q in found.questions)
    assert not compared(make_result()).nothing


def test_without_filters_the_box_says_that_none_was_run() -> None:
    result = make_result()
    result.estimators = [r for r in result.estimators if r.kind != "replay"]
    assert "no filter was run" in compared(result).nothing


def test_a_reason_is_written_out_once_and_then_named_by_its_question() -> None:
    result = make_result()
    for one in result.estimators:
        for metrics in one.metrics.values():
            for name in [n for n in metrics if n.startswith(("noise_", "drift_"))]:
                metrics[name] = missing("no_rest", "the vehicle never stood still", metrics[name].unit, "rest")
    found = {q.id: q for q in compared(result).questions}
    assert found["noise"].sentence == "Cannot be determined: the vehicle never stood still."
    assert found["yaw_drift"].sentence == "Cannot be determined: same reason as static noise."


def test_a_large_value_is_not_marked_beside_a_smaller_one_that_is_not() -> None:
    result = make_result()
    window, metric = "rest", "noise_tilt_deg"
    sizes = {r.name: r.metrics[window][metric].value for r in result.estimators if r.kind == "replay"}
    least, *_, most = sorted((n for n in sizes if n != "gyro"), key=lambda n: sizes[n])
    result.best = {window: {metric: [least, most]}}
    found = compared(result)
    marked = [name for name, dot in zip(found.rows, found.questions[1].dots, strict=True) if dot.best]
    assert marked == [least]


def test_a_question_that_cannot_be_answered_draws_no_values_beneath_its_sentence() -> None:
    result = make_result()
    for row in result.estimators:
        if row.kind == "replay":
            row.status, row.reason = "not_judged", "the gyro reads 24 deg/s while the vehicle stands still"
    result.ranked, result.best = {}, {}
    found = compared(result)
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
    found = compared(result).questions[2]
    assert found.empty
    assert found.sentence == "Cannot be determined: no step in flight."


# The strip of a flight: places across, what gets a mark, labels that do not collide.


def flown(*events: Event) -> Result:
    result = make_result()
    result.log["timeline"] = {"airborne": [[60.0, 185.0]], "modes": [[0.0, 100.0, "LOITER"], [100.0, 104.0, "LAND"]]}
    result.events = list(events)
    return result


def test_places_are_shares_of_the_log() -> None:
    found = flight_strip(flown(Event("impact", SECONDS / 2, "serious", "Hit the ground.")))
    assert abs(found.marks[0].x - 50.0) < 0.1
    assert abs(found.air[0][0] - 100 * 60 / SECONDS) < 0.1


def test_serious_events_and_the_routine_get_marks_and_notes_do_not() -> None:
    found = flight_strip(
        flown(
            Event("liftoff", 60.0, "info", "Lift-off."),
            Event("gnss_lost", 80.0, "note", "GNSS lost."),
            Event("impact", 180.0, "serious", "Hit the ground."),
        )
    )
    assert [(m.label, m.style) for m in found.marks] == [("lift-off", ""), ("impact", "bad")]


def test_the_height_goes_up_from_the_ground_to_the_top_in_flight() -> None:
    result = flown()
    t = np.arange(0.0, 200.0, 1.0)
    trace = Trace("height", "", t, {"height": np.where((t > 70) & (t < 170), 12.0, 0.0)}, values={"top": 12.4})
    result.traces.append(trace)
    found = flight_strip(result)
    assert found.top == "12 m"
    assert ",0.0 " in found.curve
    result.traces.pop()
    assert flight_strip(result).curve == ""


def test_the_height_is_told_in_the_headlines_figures_and_not_where_the_log_shows_no_ground() -> None:
    result = flown()
    t = np.arange(0.0, 200.0, 1.0)
    trace = Trace("height", "", t, {"height": np.where((t > 70) & (t < 170), 12.0, 0.0)})
    result.traces.append(trace)
    assert flight_strip(result).top == ""
    assert flight_strip(result).curve
    for top, said in ((1.94, "1.9 m"), (4.4, "4 m"), (13.6, "14 m")):
        trace.values["top"] = top
        assert flight_strip(result).top == said


def test_a_name_of_a_mode_stands_only_where_it_fits() -> None:
    assert [name for _, _, name in flight_strip(flown()).modes] == ["LOITER", ""]


def test_labels_of_what_is_serious_come_first_and_none_overlap() -> None:
    marks = [StripMark(float(i), 50.0 + 0.1 * i, "warn", "x", f"warning {i}") for i in range(9)]
    marks.append(StripMark(9.0, 50.4, "bad", "x", "impact"))
    found = place_labels(marks)
    assert found[-1].label == "impact"
    shown = [m for m in found if m.label]
    assert len({(m.level, m.left) for m in shown}) == len(shown) <= 2 * LABEL_LEVELS


def test_the_same_warning_is_labelled_once() -> None:
    marks = [StripMark(t, t, "warn", "x", "clipping") for t in (10.0, 40.0, 80.0)]
    assert [m.label for m in place_labels(marks)] == ["clipping", "", ""]


def test_a_barometer_that_never_flew_draws_no_height() -> None:
    result = flown()
    t = np.arange(0.0, 200.0, 1.0)
    result.traces.append(Trace("height", "", t, {"height": 0.05 * t}))
    assert flight_strip(result).curve
    result.log["timeline"]["airborne"] = []
    assert flight_strip(result).curve == ""
