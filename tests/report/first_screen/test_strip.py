"""The strip of a flight: places across, what gets a mark, labels that do not collide."""

from __future__ import annotations

import numpy as np

from attlog.report.first_screen.strip import LEVELS, Mark, labelled, strip
from attlog.result import Result, Trace
from attlog.story.event import Event
from tests.report.conftest import SECONDS, make_result


def flown(*events: Event) -> Result:
    result = make_result()
    result.log["timeline"] = {"airborne": [[60.0, 185.0]], "modes": [[0.0, 100.0, "LOITER"], [100.0, 104.0, "LAND"]]}
    result.events = list(events)
    return result


def test_places_are_shares_of_the_log() -> None:
    found = strip(flown(Event("impact", SECONDS / 2, "serious", "Hit the ground.")))
    assert abs(found.marks[0].x - 50.0) < 0.1
    assert abs(found.air[0][0] - 100 * 60 / SECONDS) < 0.1


def test_serious_events_and_the_routine_get_marks_and_notes_do_not() -> None:
    found = strip(
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
    found = strip(result)
    assert found.top == "12 m"
    assert ",0.0 " in found.curve
    result.traces.pop()
    assert strip(result).curve == ""


def test_the_height_is_told_in_the_headlines_figures_and_not_where_the_log_shows_no_ground() -> None:
    result = flown()
    t = np.arange(0.0, 200.0, 1.0)
    trace = Trace("height", "", t, {"height": np.where((t > 70) & (t < 170), 12.0, 0.0)})
    result.traces.append(trace)
    assert strip(result).top == ""
    assert strip(result).curve
    for top, said in ((1.94, "1.9 m"), (4.4, "4 m"), (13.6, "14 m")):
        trace.values["top"] = top
        assert strip(result).top == said


def test_a_name_of_a_mode_stands_only_where_it_fits() -> None:
    assert [name for _, _, name in strip(flown()).modes] == ["LOITER", ""]


def test_labels_of_what_is_serious_come_first_and_none_overlap() -> None:
    marks = [Mark(float(i), 50.0 + 0.1 * i, "warn", "x", f"warning {i}") for i in range(9)]
    marks.append(Mark(9.0, 50.4, "bad", "x", "impact"))
    found = labelled(marks)
    assert found[-1].label == "impact"
    shown = [m for m in found if m.label]
    assert len({(m.level, m.left) for m in shown}) == len(shown) <= 2 * LEVELS


def test_the_same_warning_is_labelled_once() -> None:
    marks = [Mark(t, t, "warn", "x", "clipping") for t in (10.0, 40.0, 80.0)]
    assert [m.label for m in labelled(marks)] == ["clipping", "", ""]


def test_a_barometer_that_never_flew_draws_no_height() -> None:
    result = flown()
    t = np.arange(0.0, 200.0, 1.0)
    result.traces.append(Trace("height", "", t, {"height": 0.05 * t}))
    assert strip(result).curve
    result.log["timeline"]["airborne"] = []
    assert strip(result).curve == ""
