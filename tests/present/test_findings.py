"""What is wrong in words: one line with its action, why behind it, a time to click on, nothing said twice."""

from __future__ import annotations

import pytest

from attlog.cli.shared.terminal import wrong
from attlog.present.findings import findings, nothing_wrong
from attlog.result import Finding, Result


def result(*found: Finding) -> Result:
    return Result({}, "", {}, {"name": "x"}, findings=list(found))


def printed(made: Result, verbose: bool = False, width: int = 100) -> list[str]:
    return [line.text for line in wrong(findings(made), lambda text: text, width, verbose)]


GYRO = Finding(
    "gyro_bias",
    "serious",
    "Standing still the gyro reads -24.30 deg/s.",
    value=-24.3,
    unit="deg/s",
    evidence=["Its bias moved."],
    cause="It is warm.",
    action="Calibrate it.",
)
NOTE = Finding("cut_at_end", "note", "The last record is cut.")


def test_a_finding_is_one_line_with_its_action_and_why_only_where_asked_for() -> None:
    assert printed(result(GYRO)) == ["serious   Standing still the gyro reads −24.30°/s. Calibrate it."]
    assert [line.strip() for line in printed(result(GYRO), verbose=True)[1:]] == [
        "Its bias moved.",
        "Cause: It is warm.",
    ]


def test_no_problem_is_only_said_where_there_is_none_and_hidden_notes_are_counted() -> None:
    assert printed(result())[0].strip() == "No problem was found."
    assert printed(result(NOTE))[0].strip() == "No problem was found; 1 note with -v."
    assert "cut" in printed(result(NOTE), verbose=True)[0]
    assert "No problem" not in "".join(printed(result(GYRO, NOTE)))
    assert nothing_wrong(findings(result(NOTE))) == ""


@pytest.mark.parametrize(
    ("text", "t", "parts"),
    [
        ("It shook at 53.7 s.", 53.7, ("It shook at ", "53.7 s", ".")),
        ("From 54 s on it shakes.", 53.7, ("From ", "54 s", " on it shakes.")),
        ("It shakes.", 53.7, ("It shakes (at ", "53.7 s", ").")),
        ("It shakes by 53.7 m/s^2.", None, ("It shakes by 53.7 m/s².", "", "")),
        ("It shook at 3000.0 s.", 3000.0, ("It shook at ", "0:50:00", ".")),
    ],
)
def test_a_sentence_is_parted_at_its_time(text: str, t: float | None, parts: tuple[str, str, str]) -> None:
    (one,) = findings(result(Finding("x", "warning", text, t=t)))
    assert (one.before, one.when, one.after) == parts


def test_a_count_and_an_action_that_the_sentence_holds_are_not_said_again() -> None:
    (one,) = findings(result(Finding("x", "warning", "It failed 3 times. Mend it.", count=3, action="Mend it.")))
    assert one.line == "It failed 3 times. Mend it."
    (one,) = findings(result(Finding("x", "warning", "It failed at 7.0 s.", t=7.0, count=3)))
    assert one.line == "It failed at 7.0 s (3 times)."
    for text in ("It left out 2,078 of 2,797 records.", "It left out 2078 records."):
        assert findings(result(Finding("x", "warning", text, count=2078)))[0].line == text
    (one,) = findings(result(Finding("x", "warning", "It shook.", count=2078)))
    assert one.line == "It shook (2,078 times)."
