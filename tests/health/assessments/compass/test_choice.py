"""Which compass to use: by headings where they can be judged, else by the field's size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Gnss, TimeLine
from attlog.health.assessments.compass import choice
from attlog.health.assessments.compass.study import CompassStudy, studied
from attlog.health.assessments.model import HealthCase
from attlog.reference import declination
from attlog.segments.model import Segment, Segments
from tests.health.assessments.compass.made import empty_log, samples

Vector = tuple[float, float, float]


def two(one: Vector, other: Vector, switches: bool = True) -> tuple[HealthCase, list[CompassStudy]]:
    """A log with two compasses that are off by so much; the first is in use."""
    found = [studied(samples(offset, index=k)) for k, offset in enumerate((one, other))]
    studies = [study for study in found if study is not None]
    log: FlightLog = replace(empty_log(), mags=[study.samples.mag for study in studies], mag=0)
    if switches:
        log.compass_switches = {0: "FIRST", 1: "SECOND"}
        log.params = {name: TimeLine(np.zeros(1), [1.0], "PARM") for name in ("FIRST", "SECOND")}
    flown = Segments([Segment("airborne", 20.0, 120.0)])
    return HealthCase(log, flown, None, [], lambda: None), studies


def test_a_much_better_compass_is_to_be_used_with_both_numbers() -> None:
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    (found,) = choice.assessed(case, studies)
    assert found.verdict == "warning"
    assert found.text.startswith("MAG.0, in use, errs by ")
    assert [(s.name, s.old, s.new) for s in found.settings] == [("FIRST", 1.0, 0.0)]  # the second is on already
    assert len(found.evidence) == 2


@pytest.mark.parametrize(
    ("used", "other"),
    [
        ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((1.0, 0.0, 0.0), (12.0, 0.0, 0.0)),
        ((14.0, 0.0, 0.0), (0.0, 10.0, 0.0)),  # better, but not by half
    ],
)
def test_the_compass_in_use_stays_unless_it_is_much_worse(used: Vector, other: Vector) -> None:
    case, studies = two(used, other)
    (found,) = choice.assessed(case, studies)
    assert (found.verdict, found.settings) == ("ok", [])


def test_where_there_is_a_first_compass_the_switch_changes_it_too() -> None:
    """Firmware before 4.1 starts with it, and with no compass at all where it is switched off."""
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    case.log.compass_first = "PRIMARY"
    case.log.params["PRIMARY"] = TimeLine(np.zeros(1), [0.0], "PARM")
    (found,) = choice.assessed(case, studies)
    assert [(s.name, s.old, s.new) for s in found.settings] == [("FIRST", 1.0, 0.0), ("PRIMARY", 0.0, 1.0)]


def test_a_better_compass_whose_offsets_are_zero_is_to_be_calibrated_first() -> None:
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    other = studies[1].samples.mag
    other.offsets = replace(other.field, x=np.zeros_like(other.field.x))
    (found,) = choice.assessed(case, studies)
    assert (found.verdict, found.settings) == ("warning", [])
    assert found.why_no_setting == "MAG.1 was never calibrated: calibrate it first."


def test_a_better_compass_that_errs_too_is_not_to_be_used() -> None:
    case, studies = two((30.0, 0.0, 0.0), (0.0, 9.0, 0.0))
    (found,) = choice.assessed(case, studies)
    assert (found.verdict, found.settings) == ("warning", [])
    assert found.why_no_setting == "MAG.1 is better, but errs too: calibrate both."


def test_without_switches_the_choice_is_words() -> None:
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0), switches=False)
    (found,) = choice.assessed(case, studies)
    assert not found.settings
    assert "priority" in found.why_no_setting


def test_one_compass_leaves_no_choice() -> None:
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    case.log.mags = case.log.mags[:1]
    assert choice.assessed(case, studies[:1]) == []


def test_without_an_attitude_the_size_of_the_field_decides() -> None:
    case, _ = two((0.0, 0.0, 40.0), (0.0, 0.0, 0.0))
    assert choice.assessed(case, []) == []  # no place, so no field of the earth
    case.log.gnss = [_receiver()]
    model = declination.model(case.log)
    assert model is not None
    for mag in case.log.mags:
        mag.field.x = mag.field.x * model.strength_t / 44.8e-6
    (found,) = choice.assessed(case, [])
    assert found.verdict == "warning"
    assert "MAG.1" in found.action
    case.log.mag = 1
    (found,) = choice.assessed(case, [])
    assert found.verdict == "ok"


def _receiver() -> Gnss:
    one = np.ones(1)
    return Gnss(0, one, "GPS", 47 * one, 8 * one, 0 * one, np.zeros((1, 3)), one, one, one, np.array([3]))
