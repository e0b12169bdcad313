"""What should be set, all questions together."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core.plain import to_plain
from attlog.health import compass_turn, registry
from attlog.health.check import HealthCase, Setting, agreed_settings, as_sentence, graded, number_text
from attlog.health.registry import CHECKS, run_checks
from attlog.pipeline.evaluation import health as evaluation_health
from attlog.pipeline.inspection import inspect
from attlog.segments.model import Segments
from tests.conftest import SAMPLES
from tests.health.made import MADE, OFFSET, REFUSED, asked


def test_settings_stand_in_the_order_of_the_questions_each_once() -> None:
    first = replace(OFFSET, settings=[Setting("B", 1.0, 2.0), Setting("A", None, 3.0)])
    again = replace(REFUSED, settings=[Setting("C", 0.0, 1.0), Setting("B", 1.0, 2.0 * (1.0 + 1e-8))])
    assert agreed_settings([first, again]) == [Setting("B", 1.0, 2.0), Setting("A", None, 3.0), Setting("C", 0.0, 1.0)]
    assert agreed_settings([REFUSED]) == []


def test_where_two_questions_dispute_a_value_neither_offers_anything() -> None:
    """Half of an offset is worse than none."""
    one = replace(OFFSET, settings=[Setting("X", 0.0, 1.0), Setting("Y", 0.0, 5.0)])
    other = replace(REFUSED, settings=[Setting("X", 0.0, 2.0), Setting("Z", 0.0, 6.0)])
    third = replace(REFUSED, settings=[Setting("W", 0.0, 7.0)])
    assert agreed_settings([one, other, third]) == [Setting("W", 0.0, 7.0)]


@pytest.mark.parametrize("value", [145.0, -20.25, 0.0, -0.0, 1310988.0, 0.1, -12345.678, 3.4e-05])
def test_a_number_as_text_is_the_same_number_in_32_bits(value: float) -> None:
    text = number_text(value)
    assert np.float32(text) == pytest.approx(np.float32(value), rel=1e-6)
    assert not text.startswith("-0") or value


# A size at its limit is still within it; and whose heading judges a compass.


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(-5.0, "ok"), (2.0, "ok"), (2.001, "warning"), (7.0, "warning"), (7.001, "fault"), (float("nan"), "fault")],
)
def test_a_size_at_a_limit_is_within_it(value: float, verdict: str) -> None:
    assert graded(value, 2.0, 7.0) == verdict


def by(heading: str) -> Any:
    return SimpleNamespace(heading=SimpleNamespace(by=heading))


@pytest.mark.parametrize(
    ("reference", "rates", "judge"),
    [("own", "own", 0), ("onboard", "own", 1), (None, "own", 1), ("onboard", "onboard", None), (None, None, None)],
)
def test_a_compass_is_judged_by_a_heading_of_its_own_or_by_none(reference, rates, judge) -> None:
    pair = [None if x is None else by(x) for x in (reference, rates)]
    case: Any = SimpleNamespace(reference=pair[0], rates=pair[1])
    assert compass_turn.heading_reference(case) is (None if judge is None else pair[judge])


# A reason becomes a sentence; a name from the log is not respelled.


@pytest.mark.parametrize(
    ("reason", "sentence"),
    [
        ("vehicle_attitude is tilted by 29 deg", "vehicle_attitude is tilted by 29 deg."),
        ("the gyro and the attitude differ", "The gyro and the attitude differ."),
        ("There is no gyro.", "There is no gyro."),
        ("AHR2 is late", "AHR2 is late."),
    ],
)
def test_a_reason_becomes_a_sentence_and_a_name_from_the_log_stays(reason, sentence):
    assert as_sentence(reason) == sentence


# Questions about the sensors of real logs: ids that tables and gates know, and what a bug in one leaves.


def test_a_log_that_cannot_be_replayed_is_checked_with_its_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[HealthCase] = []
    asked(monkeypatch, *MADE, seen=seen)
    log = attlog.read(SAMPLES / "copter_steps_stabilize.tlog")
    log.imu = None
    found = evaluation_health(log)
    assert seen[0].segments.spans("airborne")
    assert (seen[0].reference, seen[0].motion) == (None, None)
    assert found.checks == sorted(MADE, key=lambda check: [*CHECKS].index(check.question))
    assert [(f.kind, f.action) for f in found.findings if f.kind == "compass"] == [
        ("compass", "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25.")
    ]


@pytest.mark.slow
def test_info_health_and_analyze_name_the_same_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = evaluation_health(SAMPLES / "px4_hover.ulg")
    whole = attlog.analyze(SAMPLES / "px4_hover.ulg", {"estimators": ["gyro"]})
    looked = inspect(SAMPLES / "px4_hover.ulg")
    assert quick.checks == whole.checks
    assert looked["checks"] == to_plain(quick.checks)
    assert [f for f in quick.findings if f.is_trouble] == [f for f in whole.findings if f.is_trouble]
    assert looked["findings"] == to_plain(quick.findings)
    assert looked["headline"] == quick.headline == whole.headline
    assert quick.estimators == []


def test_a_check_that_ends_in_a_bug_is_unknown_and_costs_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    asked(monkeypatch, OFFSET)
    monkeypatch.setitem(registry.CHECKS, "gyro_bias", registry.CHECKS["gyro_bias"]._replace(make=lambda case: 1 // 0))
    monkeypatch.delenv("ATTLOG_RAISE")
    found = run_checks(HealthCase(attlog.read(SAMPLES / "px4_hover.ulg"), Segments()))
    assert [(c.question, c.verdict, c.about) for c in found] == [
        ("gyro_bias", "unknown", "part_failed"),
        ("compass_offset", "warning", ""),
    ]


def test_numbers_that_are_none_go(monkeypatch: pytest.MonkeyPatch) -> None:
    nan = float("nan")
    broken = replace(OFFSET, value=nan, vector=[1.0, nan, 0.0], settings=[*OFFSET.settings, Setting("Z", 0.0, nan)])
    half = replace(OFFSET, ci95=(nan, 1.0), vector_ci95=[nan, 1.0, 1.0])
    asked(monkeypatch, broken, half, OFFSET)
    first, second, third = run_checks(HealthCase(attlog.read(SAMPLES / "px4_hover.ulg"), Segments()))
    assert (first.value, first.ci95, first.vector, first.vector_ci95, first.settings) == (None, None, [], [], [])
    assert (second.value, second.ci95, second.vector, second.vector_ci95) == (24.0, None, OFFSET.vector, [])
    assert third == OFFSET
