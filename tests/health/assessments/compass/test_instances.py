"""Which compasses are judged how: the one in use, a spare one, one that is switched off, one without an attitude."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attlog.health.assessments import compass
from attlog.health.assessments.compass.study import CompassStudy, studied
from attlog.health.assessments.model import Assessment, HealthCase
from attlog.health.model import Check
from attlog.segments.model import Segment, Segments
from tests.health.assessments.compass.made import empty_log, samples


def asked(monkeypatch: pytest.MonkeyPatch, *, in_use: int, enabled: bool = True) -> dict[str, Assessment]:
    """What is said of the offset of two compasses, the second of which is off by 30 uT."""
    found: list[CompassStudy] = []
    for k, offset in enumerate(((0.0, 0.0, 0.0), (30.0, 0.0, 0.0))):
        study = studied(samples(offset, index=k))
        assert study is not None
        found.append(study)
    found[1].samples.mag.enabled = enabled
    log = replace(empty_log(), mags=[study.samples.mag for study in found], mag=in_use)
    monkeypatch.setattr(compass, "studies", lambda case: (found, ""))
    case = HealthCase(log, Segments([Segment("airborne", 20.0, 120.0)]), None, [], lambda: None)
    return {a.sensor: a for a in compass.assessed(case) if a.question == "compass_offset"}


def test_an_offset_is_a_fault_of_the_compass_in_use_and_a_warning_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(monkeypatch, in_use=1)["MAG.1"].verdict == "fault"
    assert asked(monkeypatch, in_use=0)["MAG.1"].verdict == "warning"


def test_a_compass_that_is_switched_off_raises_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(asked(monkeypatch, in_use=0, enabled=False)) == ["MAG.0"]


def test_without_an_attitude_the_audit_tells_whether_the_field_follows_the_motors() -> None:
    check = Check(
        "field against motors", "fault", "The field goes from 29.3 to 41.4 uT.", 41.3, "%", "fault above 30 %"
    )
    log = replace(empty_log(), mags=[samples().mag], mag=0)
    found = compass.assessed(HealthCase(log, None, None, [check], lambda: None))
    assert [(a.question, a.verdict, a.value) for a in found] == [
        ("compass_offset", "unknown", None),
        ("compass_motors", "fault", 41.3),
    ]
    assert "Move the compass" in found[1].action
