"""Scales of the dots: what is far off does not press the others together, and zero is on a scale with signs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from attlog.metrics.metric import missing
from attlog.report.figures.style import row_styles
from attlog.report.first_screen import (
    LABEL_LEVELS,
    QuestionColumn,
    StripMark,
    clear_of_marks,
    compare_filters,
    flight_strip,
    log_scale,
    place_labels,
    repeat_reasons_once,
    zero_scale,
)
from attlog.result import Result, Trace
from attlog.story.flight_events import Event
from tests.golden import check_golden
from tests.report.conftest import SECONDS, answer, make_result, unconfirmed_onboard


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

GOLDEN = Path(__file__).parent / "golden"
WINDOW, NOISE = "rest", "noise_tilt_deg"


def without(result: Result, *starts: str, code: str, why: str) -> Result:
    """Take the answers of metrics that begin so away."""
    for one in result.estimators:
        for window, metrics in one.metrics.items():
            for name in [n for n in metrics if n.startswith(starts)]:
                metrics[name] = missing(code, why, metrics[name].unit, window)
    return result


def with_step_error(result: Result) -> Result:
    for row in result.estimators:
        wrong = row.name == "vqf"
        row.metrics["airborne"]["step_error_deg.0.5s"] = answer(9.2 if wrong else 0.1, "deg", "airborne")
        row.metrics["airborne"]["step_error_pct.0.5s"] = answer(-27.3 if wrong else 0.3, "pct", "airborne")
    return result


def results() -> Iterator[tuple[str, Result]]:
    yield "plain", make_result()
    yield "one misses the step", with_step_error(make_result())
    no_step = without(with_step_error(make_result()), "lag_ms", code="no_events", why="no step in flight")
    yield "no lag, so no remark on the step", no_step
    still = "the vehicle never stood still"
    yield "one reason for two questions", without(make_result(), "noise_", "drift_", code="no_rest", why=still)
    tied = make_result()
    sizes = {r.name: r.metrics[WINDOW][NOISE].value for r in tied.estimators if r.kind == "replay"}
    least, *_, most = sorted((n for n in sizes if n != "gyro"), key=lambda n: sizes[n])
    tied.best = {WINDOW: {NOISE: [least, most]}}
    yield "the largest noise is marked beside smaller ones that are not", tied
    unjudged = make_result()
    for row in unjudged.estimators:
        if row.kind == "replay":
            row.status, row.reason = "not_judged", "the gyro reads 24 deg/s while the vehicle stands still"
    unjudged.ranked, unjudged.best = {}, {}
    yield "not judged", unjudged
    empty, alone = make_result(), make_result()
    for row in empty.estimators:
        row.metrics = {}
    yield "no answer at all", empty
    alone.estimators = [r for r in alone.estimators if r.kind != "replay"]
    yield "no filter", alone


def test_the_columns_of_dots_are_as_reviewed() -> None:
    """Of each row its text, ``*`` best, ``~`` pale, its hint; places are tested apart."""
    lines = []
    for name, result in results():
        found = compare_filters(result, row_styles(result))
        lines += [f"== {name}: {found.nothing or 'answered'}", f"rows {', '.join(found.rows)}"]
        for q in found.questions:
            lines.append(f"{q.title} ({q.unit}): {q.sentence}")
            for row, dot in zip(found.rows, q.dots, strict=not q.empty):
                assert dot.x is None or dot.low <= dot.x <= dot.high
                lines.append(f"  {row}: {'*' * dot.best}{'~' * dot.pale}{dot.text} | {dot.hint}")
    check_golden(GOLDEN / "first_screen.txt", lines)


def test_a_long_reason_is_given_once_also_where_values_are_not_ranked() -> None:
    why = "the onboard attitude is unproven, the smoother refused"
    columns = [
        QuestionColumn("accuracy", "Accuracy", "", "", f"Not ranked ({why}): tilt 1 to 2°.", False),
        QuestionColumn("noise", "Static noise", "", "", "Not ranked (too short): 0.1°.", False),
        QuestionColumn("lag", "Step response", "", "", f"Not ranked ({why}): −1 to 0 ms.", False),
        QuestionColumn("yaw_drift", "Yaw drift", "", "", "Not ranked (too short): 3°/min.", False),
    ]
    sentences = [one.sentence for one in repeat_reasons_once(columns)]
    assert sentences[2] == "Not ranked (same reason as accuracy): −1 to 0 ms."
    assert [sentences[0], sentences[1], sentences[3]] == [columns[k].sentence for k in (0, 1, 3)]


# The strip of a flight: places across, what gets a mark, labels that do not collide.

T = np.arange(0.0, 200.0, 1.0)


def flown(*events: Event, height: np.ndarray | None = None, **values: float) -> Result:
    result = make_result()
    result.log["timeline"] = {"airborne": [[60.0, 185.0]], "modes": [[0.0, 100.0, "LOITER"], [100.0, 104.0, "LAND"]]}
    result.events, result.findings = list(events), []
    if height is not None:
        result.traces.append(Trace("height", "", T, {"height": height}, values=values))
    return result


def test_places_are_shares_of_the_log_and_notes_get_no_mark() -> None:
    found = flight_strip(
        flown(
            Event("liftoff", 60.0, "info", "Lift-off."),
            Event("gnss_lost", 80.0, "note", "GNSS lost."),
            Event("impact", SECONDS / 2, "serious", "Hit the ground."),
        )
    )
    assert [(m.label, m.style) for m in found.marks] == [("lift-off", ""), ("impact", "bad")]
    assert abs(found.marks[1].x - 50.0) < 0.1
    assert abs(found.air[0][0] - 100 * 60 / SECONDS) < 0.1
    assert [name for _, _, name in found.modes] == ["LOITER", ""], "a name stands only where it fits"


def test_the_height_goes_up_to_the_headlines_top_and_none_is_drawn_without_a_flight() -> None:
    hop = np.where((T > 70) & (T < 170), 12.0, 0.0)
    assert ",0.0 " in flight_strip(flown(height=hop)).curve
    for top, said in ((None, ""), (1.94, "1.9 m"), (4.4, "4 m"), (13.6, "14 m")):
        assert flight_strip(flown(height=hop, **({} if top is None else {"top": top}))).top == said
    assert flight_strip(flown()).curve == ""
    grounded = flown(height=0.05 * T)
    grounded.log["timeline"]["airborne"] = []
    assert flight_strip(grounded).curve == "", "a barometer on the ground shows the weather"


def test_labels_of_what_is_serious_come_first_none_overlap_and_none_is_repeated() -> None:
    marks = [StripMark(float(i), 50.0 + 0.1 * i, "warn", "x", f"warning {i}") for i in range(9)]
    marks.append(StripMark(9.0, 50.4, "bad", "x", "impact"))
    found = place_labels(marks)
    assert found[-1].label == "impact"
    shown = [m for m in found if m.label]
    assert len({(m.level, m.left) for m in shown}) == len(shown) <= 2 * LABEL_LEVELS
    marks = [StripMark(t, t, "warn", "x", "clipping") for t in (10.0, 40.0, 80.0)]
    assert [m.label for m in place_labels(marks)] == ["clipping", "", ""]


@pytest.mark.parametrize("label", ["no thrust", "impact"])
def test_no_label_lies_on_that_of_the_largest_height(label: str) -> None:
    (mark,) = place_labels([StripMark(10.0, 50.0, "bad", "x", label)], peak=52.6)
    assert mark.level == 2 or mark.left
    (far,) = place_labels([StripMark(10.0, 50.0, "bad", "x", label)], peak=90.0)
    assert (far.level, far.left) == (0, False)


@pytest.mark.parametrize("marks", [[], [50.0], [49.0, 51.5], [46.0, 50.0, 53.0]])
def test_the_height_at_the_peak_is_written_on_no_mark(marks):
    at = clear_of_marks(50.0, marks)
    assert all(abs(at - x) >= 100.0 * 20.0 / 830.0 for x in marks)
    assert abs(at - 50.0) < 10.0
    assert marks or at == 50.0


def test_against_the_onboard_attitude_accuracy_is_called_agreement() -> None:
    result = make_result()
    assert result.reference is not None
    for choice, title in (("onboard", "Agreement with onboard"), ("truth", "Accuracy")):
        result.reference.choice = choice
        assert compare_filters(result, row_styles(result)).questions[0].title == title


def test_the_card_names_no_best_against_an_unproven_onboard_attitude() -> None:
    result = unconfirmed_onboard()
    card = compare_filters(result, row_styles(result)).questions[0]
    assert card.title == "Agreement with onboard"
    assert card.sentence.startswith("Not ranked (the onboard attitude is unproven): tilt ")
    assert any(dot.pale for dot in card.dots)
    assert not any(dot.best for dot in card.dots)
