"""One list of what is wrong: from every check, sorted, each entry once; and silence where nothing is."""

from __future__ import annotations

import re
from copy import deepcopy
from pathlib import Path

import pytest

from attlog import health
from attlog.flight.model import FlightLog, Problem
from attlog.flight.remedies import GENERAL
from attlog.health.findings import ABOUT, OpenQuestion, findings, unusable
from attlog.health.model import Check, not_judged
from tests.conftest import ROOT
from tests.health.test_health import good


@pytest.fixture
def log() -> FlightLog:
    found = deepcopy(good("px4_steps.ulg"))
    found.problems = []
    return found


def check(name: str, verdict: str = "fault", value: float | str | None = None, t: float | None = None) -> Check:
    return Check(name, verdict, f"{name} is off.", value, "m", t=t)


def test_nothing_is_found_where_every_check_is_good_and_every_question_answered(log: FlightLog) -> None:
    assert findings(log, [check(name, "ok") for name in ABOUT]) == []


@pytest.mark.parametrize("name", ABOUT)
def test_every_check_that_is_not_good_is_an_entry(log: FlightLog, name: str) -> None:
    for verdict in ("warning", "fault"):
        found = findings(log, [check(name, verdict, 4.0, 7.0)])
        assert [p.text for p in found] == [f"{name} is off."]
        assert (found[0].t, found[0].value, found[0].unit) == (7.0, 4.0, "m")


def test_an_unknown_check_is_an_entry_as_well(log: FlightLog) -> None:
    assert [p.code for p in findings(log, [check("tea temperature")])] == ["tea_temperature"]


def test_the_worst_stands_first(log: FlightLog) -> None:
    others = [Problem("cut_at_end", "note", "Cut."), Problem("x", "error", "Broken.")]
    found = findings(log, [check("field", "warning"), check("crash")], others)
    assert [p.severity for p in found] == ["error", "error", "warning", "note"]
    assert found[0].code == "crash"


def test_a_check_and_a_report_of_the_same_are_one_entry(log: FlightLog) -> None:
    report = Problem("crash", "error", "Crash check (12/1).", t=9.5, cause="Lost thrust.")
    (one,) = findings(log, [check("crash", t=9.0)], [report])
    assert "Crash check (12/1)." in one.text
    assert "crash is off." in one.text
    assert (one.t, one.cause) == (9.0, "Lost thrust.")


def test_the_same_report_twice_is_one_entry_with_both_counts(log: FlightLog) -> None:
    log.problems = [Problem("a", "note", "A.", t=5.0, count=2), Problem("a", "note", "A.", t=3.0)]
    (one,) = findings(log, [])
    assert (one.count, one.t) == (3, 3.0)


def test_what_a_refused_attitude_judges_is_not_said_beside_it(log: FlightLog) -> None:
    refused = Problem("reference_contradicted", "error", "ATT is wrong.")
    found = findings(log, [check("gravity in flight"), check("field against attitude"), check("vibration")], [refused])
    assert {p.code for p in found} == {"reference_contradicted", "vibration"}


def test_checks_that_could_not_be_made_and_open_questions_are_one_entry_each(log: FlightLog) -> None:
    checks = [not_judged("delay", "Unknown."), not_judged("trim", "None.")]
    found = findings(log, checks, [], [OpenQuestion("Lag", "Fly steps."), OpenQuestion("Yaw drift", "Fly steps.")])
    assert [(p.code, p.severity) for p in found] == [("unanswered", "note"), ("not_checked", "info")]
    assert found[0].text == "Not answered: lag, yaw drift."
    assert found[0].remedy == "Fly steps."
    assert "delay, trim" in found[1].text


def test_a_gyro_is_hopeless_from_ten_degrees_a_second_on(log: FlightLog) -> None:
    assert unusable([check("gyro bias", value=9.9)]) == ""
    assert "-24 deg/s" in unusable([check("gyro bias", value=-24.3)])
    (one,) = findings(log, [check("gyro bias", value=-24.3)])
    assert one.severity == "error"
    assert "Nothing below is judged" in one.means
    (one,) = findings(log, [check("gyro bias", value=4.0)])
    assert one.severity == "warning"


def test_every_serious_entry_has_cause_and_remedy(log: FlightLog) -> None:
    sensors_stopped = ("rate", "gyro", "frozen gyro", "frozen sensors")
    for name, about in ABOUT.items():
        if "error" in (about.as_warning, about.as_fault) and name not in sensors_stopped:
            (one,) = findings(log, [check(name)])
            assert one.cause
            assert one.remedy


def test_every_fault_has_a_general_remedy() -> None:
    assert {a.fault for a in ABOUT.values() if a.fault} <= set(GENERAL)


def test_every_check_has_its_row_in_the_documentation() -> None:
    """As every metric has: what is good and what is bad, in a row that begins with the check's name."""
    pages = "\n".join(page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs").glob("*.md")))
    rows = [row.split("|") for row in pages.splitlines() if row.startswith("|")]
    told = {name for cells in rows if not cells[2].strip().isdigit() for name in re.findall(r"`([^`]+)`", cells[1])}
    source = "".join(path.read_text(encoding="utf-8") for path in Path(health.__file__).parent.rglob("*.py"))
    named = set(re.findall(r"\bCheck\(\s*\"([^\"]+)\"", source))
    assert len(named) > 15
    assert sorted((named | set(ABOUT)) - told) == []
