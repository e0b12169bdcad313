"""Questions about the sensors of real logs: ids that tables and gates know, and what a bug in one leaves."""

from __future__ import annotations

from dataclasses import replace

import pytest

import attlog
from attlog.analysis.pipeline import health
from attlog.health.assessments import TOPICS, HealthCase, Setting
from attlog.health.assessments.questions import assess
from attlog.segments.model import Segments
from tests.conftest import SAMPLES
from tests.health.assessments.made import MADE, OFFSET, asked

QUESTIONS = "attlog.health.assessments.questions.QUESTIONS"

LOGS = ("px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog")


@pytest.mark.slow
@pytest.mark.parametrize("log", LOGS)
def test_assessments_of_every_log_have_known_ids(log: str) -> None:
    found = health(SAMPLES / log).health
    assert {a.question for a in found} <= set(TOPICS), "an id needs its line in topics.py"
    assert all(a.text.strip().endswith(".") for a in found)


def test_a_log_that_cannot_be_replayed_is_assessed_with_its_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[HealthCase] = []
    asked(monkeypatch)
    monkeypatch.setattr(QUESTIONS, {"made": lambda case: seen.append(case) or MADE})
    log = attlog.read(SAMPLES / "copter_steps_stabilize.tlog")
    log.imu = None
    found = health(log)
    (case,) = seen
    assert case.segments.spans("airborne")
    assert (case.reference, case.motion) == (None, None)
    assert found.health == MADE
    assert [(f.kind, f.action) for f in found.findings if f.kind == "compass"] == [
        ("compass", "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25.")
    ]


@pytest.mark.slow
def test_health_and_analyze_say_the_same_of_the_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    asked(monkeypatch, OFFSET)
    quick = health(SAMPLES / "px4_hover.ulg")
    whole = attlog.analyze(SAMPLES / "px4_hover.ulg", {"estimators": ["gyro"]})
    assert quick.health == whole.health == [OFFSET]
    assert [f for f in quick.findings if f.is_trouble] == [f for f in whole.findings if f.is_trouble]
    assert (quick.headline, quick.events, quick.audit) == (whole.headline, whole.events, whole.audit)
    assert quick.estimators == []


def test_a_question_that_ends_in_a_bug_is_unknown_and_costs_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(QUESTIONS, {"gyro bias": lambda case: 1 // 0, "made": lambda case: [OFFSET]})
    monkeypatch.delenv("ATTLOG_RAISE")
    case = HealthCase(attlog.read(SAMPLES / "px4_hover.ulg"), Segments(), None, [], lambda: None)
    found = assess(case)
    assert [(a.question, a.verdict) for a in found] == [("gyro_bias", "unknown"), ("compass_offset", "warning")]


def test_numbers_that_are_none_reach_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    nan = float("nan")
    broken = replace(OFFSET, value=nan, vector=[1.0, nan, 0.0], settings=[*OFFSET.settings, Setting("Z", 0.0, nan)])
    half = replace(OFFSET, ci95=(nan, 1.0), vector_ci95=[nan, 1.0, 1.0])
    asked(monkeypatch, broken, half, OFFSET)
    first, second, third = assess(
        HealthCase(attlog.read(SAMPLES / "px4_hover.ulg"), Segments(), None, [], lambda: None)
    )
    assert (first.value, first.ci95, first.vector, first.vector_ci95, first.settings) == (None, None, [], [], [])
    assert (second.value, second.ci95, second.vector, second.vector_ci95) == (24.0, None, OFFSET.vector, [])
    assert third == OFFSET
