"""Rows of the list of events: what is in it, and sources in words."""

from __future__ import annotations

from attlog.result import Finding, Result
from attlog.story.flight_events import Event
from attlog.words.events import minor_title, shown_event, shown_events, source_text
from tests.report.conftest import make_result


def eventful(*findings: Finding) -> Result:
    result = make_result()
    result.findings = list(findings)
    result.events = [
        Event("power_up", -3.0, "info", "Switched on."),
        Event("liftoff", 5.0, "info", "Lifted off at 5.0 s."),
        Event("impact", 80.0, "serious", "Hit the ground at 80.0 s."),
    ]
    return result


def test_a_wrong_heading_that_is_no_event_of_its_own_is_listed_at_its_time() -> None:
    wrong = Finding("compass", "serious", "The heading is 24 deg off.", t=30.0, about="heading_by_gnss")
    found = shown_events(eventful(wrong))
    assert [e.t for e in found] == [-3.0, 5.0, 30.0, 80.0]
    assert (found[2].label, found[2].severity, found[2].style) == ("heading wrong", "Serious", "bad")
    assert found[2].source == "check of heading by GNSS"


def test_findings_that_an_event_shows_notes_and_those_of_the_whole_log_are_not_listed() -> None:
    same = Finding("crash", "serious", "Hit the ground at 80.0 s.", t=80.2)
    found = shown_events(eventful(same, Finding("x", "note", "Odd.", t=9.0), Finding("y", "serious", "Off.")))
    assert [e.kind for e in found] == ["power_up", "liftoff", "impact"]
    beside = Finding("compass", "warning", "Off from take-off on.", t=5.0)
    assert "Off from take-off on." in [e.text for e in shown_events(eventful(beside))], (
        "a routine event explains nothing"
    )


def test_a_kill_switch_is_labelled_by_its_name_not_as_any_failsafe() -> None:
    labels = [shown_event(Event("failsafe", 1.0, "warning", "X.", about=about)).label for about in ("kill switch", "")]
    assert labels == ["kill switch", "failsafe"]


def test_a_report_that_is_no_event_has_a_label_in_words() -> None:
    result = make_result()
    result.events, result.findings = [], [Finding(kind, "warning", "x", t=5.0) for kind in ("err_27_1", "ev_99")]
    assert [event.label for event in shown_events(result)] == ["leak", "report"]


def test_minor_events_are_counted_by_kind() -> None:
    texts = [Event("message", 1.0, "note", "“a”"), Event("message", 2.0, "warning", "“b”")]
    rows = [shown_event(e) for e in (Event("reset", 0.0, "note", "Reset."), *texts)]
    assert [row.minor for row in rows] == [True, True, False]
    assert minor_title(rows[:2]) == "2 minor: resets and messages"


def test_sources_are_in_words_with_the_message_behind_them() -> None:
    def source(*evidence: str, kind: str = "x", text: str = "It happened.") -> str:
        return source_text(Event(kind, 1.0, "note", text, evidence=list(evidence)))

    assert source("EV") == "arming state (EV)"
    assert source("RCOU: motor 2 92 %") == "motor outputs (RCOU): motor 2 92 %"
    assert source("vehicle_imu_status:1.accel_clipping: 5 samples").startswith("clip counter (vehicle_imu_status:1")
    assert source("XKF4:0.SM", text="Largest test ratio 1.3 (XKF4:0.SM).") == "EKF test ratio (XKF4:0.SM)"
    assert source("NEW: 3 %") == "NEW: 3 %", "an unknown message keeps its name"
    assert source("text at 1.0 s: Crash", "text at 2.0 s: Disarming") == "autopilot: “Crash”, “Disarming”"
    assert source("report at 1.0 s: Crash", text="“Crash”.") == "autopilot’s text"
    jump = "jump of 9.4 deg that the gyro does not explain"
    assert source(jump, kind="reset", text=f"Reset: {jump}.") == "attitude against the gyro"
