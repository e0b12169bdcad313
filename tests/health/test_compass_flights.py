"""Compasses of flights that ArduPilot and PX4 simulated, as they are and with planted errors."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from attlog import flight, reference, segments
from attlog.health import compass, figures
from attlog.health.check import Check, HealthCase, MotionAttitude, unknown
from attlog.health.registry import run_checks
from attlog.metrics.metric import Case
from attlog.pipeline.config import Config
from attlog.pipeline.evaluation import motion_attitude
from attlog.reference.model import ReferenceOptions
from attlog.segments.model import Segments
from tests.conftest import SAMPLES
from tests.health.made_compass import case_of, empty_log

FLIGHTS = ["px4_steps.ulg", "copter_steps_stabilize.bin"]


@cache
def flown(name: str) -> tuple[Segments, MotionAttitude]:
    """Segments and the attitude by motion alone, which no compass changes."""
    log = flight.read(SAMPLES / name)
    phases = segments.build(log)
    none = reference.choose(log, phases, ReferenceOptions(reference="none"))
    found = motion_attitude(Case(log, phases, none, settings=Config().resolved()))
    assert found is not None
    return phases, found


def case(name: str) -> HealthCase:
    phases, found = flown(name)
    return HealthCase(deepcopy(flight.read(SAMPLES / name)), phases, None, lambda: found)


def named(found: list[Check], question: str) -> Check:
    return next(a for a in found if a.question == question)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_an_untouched_flight_gets_no_offer(name: str) -> None:
    found = compass.compass_checks(case(name))
    assert {a.verdict for a in found} <= {"ok", "unknown"}
    assert not [a for a in found if a.settings]


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
@pytest.mark.parametrize("planted", [(10.0, 0.0, 0.0), (-7.0, 7.0, 0.0), (0.0, -15.0, 12.0)])
def test_a_planted_offset_is_found_inside_its_interval(name: str, planted: tuple[float, float, float]) -> None:
    asked = case(name)
    before = np.array(named(compass.compass_checks(asked), "compass_offset").vector)
    for mag in asked.log.mags:
        mag.field.x = mag.field.x + 1e-6 * np.array(planted)
    found = named(compass.compass_checks(asked), "compass_offset")
    assert found.verdict in ("warning", "fault")
    assert np.array(found.vector) - before == pytest.approx(planted, abs=0.1)
    assert np.all(np.abs(np.array(found.vector) - planted) < found.vector_ci95)


def test_what_is_unknown_of_every_compass_is_said_once() -> None:
    why = [unknown("soft_iron", "The flight does not turn.", sensor=f"MAG.{k}") for k in range(2)]
    assert [a.sensor for a in compass.without_repeats([*why, replace(why[0], verdict="ok")])] == ["MAG.0", "MAG.0"]


def test_a_log_without_compass_or_anything_else_is_silent_or_unknown() -> None:
    log = empty_log()
    assert compass.compass_checks(case_of(log)) == []
    assert figures.traces(case_of(log), []) == []


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["nan", "empty", "one", "still"])
def test_damaged_compasses_raise_nothing(damage: str) -> None:
    asked = case(FLIGHTS[1])
    for mag in asked.log.mags:
        keep = {"empty": 0, "one": 1}.get(damage, len(mag.field.t))
        mag.field.t, mag.field.x = mag.field.t[:keep], mag.field.x[:keep]
        mag.field.t_sample = None
        if damage == "nan":
            mag.field.x[:] = np.nan
        if damage == "still":
            mag.field.x[:] = [2e-5, 0.0, 4e-5]
    found = run_checks(asked)
    measured = [a for a in found if a.question.startswith("compass") and a.question != "compass_dead"]
    assert not [a for a in measured if a.is_trouble]
    figures.traces(asked, found)
