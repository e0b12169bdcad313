"""The last barrier: a bug in one part costs that part, says so, and the rest of the log is analysed; tests see it."""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import pytest

from attlog import formats, pipeline, segments
from attlog.core import errors, files
from attlog.core.errors import LogUnreadable, UsageError
from attlog.flight import flight_in, read
from attlog.formats import Table
from attlog.health import registry
from attlog.metrics import drift
from attlog.pipeline import evaluation
from attlog.result import Result
from tests.conftest import SAMPLES, few

LOG = SAMPLES / "px4_hover.ulg"


def broken(*args: Any, **kwargs: Any) -> Any:
    raise ZeroDivisionError("nobody thought of this")


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """As users run it: the barrier stands."""
    monkeypatch.delenv(errors.RAISE_VARIABLE)


def breaks(part: object, name: str) -> Any:
    return mock.patch.object(part, name, broken)


def breaks_checks(*questions: str) -> Any:
    """Their functions end in a bug."""
    rows = {question: registry.CHECKS[question]._replace(make=broken) for question in questions}
    return mock.patch.dict(registry.CHECKS, rows)


@pytest.mark.usefixtures("quiet")
def test_errors_on_purpose_pass() -> None:
    def wrong() -> None:
        raise UsageError("use another option")

    with pytest.raises(UsageError):
        errors.call_guarded("x", wrong, str)


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize(
    ("topic", "field"),
    [
        ("battery_status", "power.battery"),
        ("vehicle_gps_position", "gnss"),
        ("vehicle_air_data", "baro"),
        ("vehicle_attitude_setpoint", "setpoints.attitude"),
        ("vehicle_magnetometer", "mags"),
        ("vehicle_attitude", "attitudes"),
    ],
)
def test_a_message_that_breaks_its_reader_is_one_problem_and_the_rest_is_there(
    topic: str, field: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    column = Table.__getitem__
    monkeypatch.setattr(Table, "__getitem__", lambda self, name: broken() if self.name == topic else column(self, name))
    log = read(LOG)
    failed = [p for p in log.problems if p.code == "part_failed"]
    assert failed
    assert all("ZeroDivisionError" in p.text and "please report it" in p.text for p in failed)
    assert log.imu is not None
    assert not attrgetter(field)(log)


@pytest.mark.parametrize(
    ("log", "topic"),
    [("px4_hover.ulg", "battery_status"), ("px4_hover.ulg", "vehicle_magnetometer"), ("copter_yaw_turns.bin", "BARO")],
)
def test_a_message_without_a_record_is_a_note(log: str, topic: str) -> None:
    messages = formats.open(SAMPLES / log)
    for (name, _), table in messages.items():
        if name == topic:
            table.offsets = table.offsets[:0]
    found = flight_in(messages).problems
    assert [(p.severity, p.text) for p in found if topic in p.text] == [("note", f"Without a record: {topic}.")]
    assert not [p for p in found if "cannot be used" in p.text or p.code == "part_failed"]


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("error", [ValueError("cannot reshape array of size 0"), TypeError("x() takes 2")])
def test_no_words_of_a_library_reach_the_user(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*_: object) -> Any:
        raise error

    column = Table.__getitem__
    wanted = "battery_status"
    monkeypatch.setattr(Table, "__getitem__", lambda self, n: breaks() if self.name == wanted else column(self, n))
    texts = [p.text for p in read(LOG).problems if "cannot be used" in p.text]
    assert "The battery cannot be used: its fields are not as expected." in texts
    assert not [text for text in texts if str(error) in text]


@pytest.fixture(scope="module")
def case() -> Any:
    return pipeline.prepare(LOG)


def evaluated(case: Any) -> Result:
    case.forget()
    return pipeline.evaluate(case, ["gyro", "mahony"], traces=True)


@pytest.mark.usefixtures("quiet")
def test_a_check_or_a_metric_that_fails_is_missing_and_the_others_are_there(case: Any) -> None:
    whole = evaluated(case)
    assert not [p for p in whole.findings if p.kind == "part_failed"]
    with breaks_checks("gyro_dead", "gyro_range"), breaks(drift, "rest_records"), breaks(evaluation, "verdicts"):
        result = evaluated(case)
    assert {c.question: c.verdict for c in result.checks}["gyro_dead"] == "unknown"
    assert [c for c in result.checks if c.question.startswith("field")] == [
        c for c in whole.checks if c.question.startswith("field")
    ]
    answers = result.estimators[1].metrics["all"]
    assert (answers["drift_rest_deg_per_min"].code, answers["drift_rest_deg_per_min"].value) == ("part_failed", None)
    assert answers["lag_ms"].value == whole.estimators[1].metrics["all"]["lag_ms"].value
    failed = [p.text for p in result.findings if p.kind == "part_failed"]
    assert len(failed) == 1 + len(result.estimators) + 1, "the check, the metric of each row, the sentences"
    assert result.to_json()


@pytest.mark.usefixtures("quiet")
def test_a_filter_that_ends_in_a_bug_is_a_failed_row(case: Any) -> None:
    from attlog.pipeline import replay

    original = replay.replayed

    def once(*args: Any, **kwargs: Any) -> Any:
        return broken() if args[3].name == "mahony" else original(*args, **kwargs)

    with mock.patch.object(replay, "replayed", once):
        result = evaluated(case)
    assert {r.name: r.status for r in result.estimators}["mahony"] == "failed"
    assert result.estimators[0].status != "failed"


@pytest.mark.usefixtures("quiet")
def test_info_goes_on_without_a_reference_and_without_answers() -> None:
    from attlog.pipeline import inspection

    choose, calls = inspection.reference.choose, []

    def unless_none(*args: Any, **kwargs: Any) -> Any:
        calls.append(args)
        return choose(*args, **kwargs) if args[2].reference == "none" else broken()

    with mock.patch.object(inspection.reference, "choose", unless_none), breaks(inspection, "answerable"):
        told = inspection.inspect(LOG)
    failed = [p["text"] for p in told["findings"] if p["kind"] == "part_failed"]
    assert len(failed) == 2
    assert told["messages"]
    assert told["answerable"] == []


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize(
    ("part", "name", "kinds"),
    few(
        [
            (segments.rest, "find_rests", {"continuous"}),
            (segments.rest, "airborne_spans", {"continuous"}),
            (segments.model, "find_continuous", {"continuous"}),
            (segments.rest, "find_hovers", {"armed", "airborne", "continuous", "rest.long"}),
            (segments.increments, "find_resets", {"armed", "airborne", "continuous", "rest.long"}),
        ],
        2,
    ),
)
def test_without_segments_the_log_is_still_analysed(part: ModuleType, name: str, kinds: set[str]) -> None:
    with breaks(part, name):
        result = pipeline.analyze(LOG, {"estimators": ["mahony"], "reference": "onboard"})
    assert kinds <= {s.kind for s in result.segments}
    assert kinds > {"continuous"} or {s.kind for s in result.segments} <= {"continuous", "gap", "reset"}
    whole = result.estimators[0].metrics["all"]
    assert whole["total_rmse_deg"].value is not None
    told = [p for p in result.findings if p.kind == "part_failed"]
    assert 1 <= len(told) <= 4
    assert all("ZeroDivisionError" in p.text for p in told)


def test_a_log_that_is_gone_when_it_is_described_is_unreadable(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadable, match="cannot be read any more"):
        files.sha256(tmp_path / "gone.ulg")
