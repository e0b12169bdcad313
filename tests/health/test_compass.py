"""Which compass to use: by headings where they can be judged, else by the field's size."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.advice import VehicleSettings
from attlog.flight.model import FlightLog, Gnss, TimeLine
from attlog.health import compass
from attlog.health import settings as parameters
from attlog.health.check import Check, HealthCase, Setting
from attlog.health.compass_offset import CompassStudy, FieldSamples, study_samples
from attlog.reference import alignment
from attlog.segments.model import Segment, Segments
from tests.health.made_compass import HOVER, case_of, empty_log, samples

Vector = tuple[float, float, float]


def set_parameters(log: FlightLog, **values: float) -> None:
    log.settings = VehicleSettings("ArduPilot", values=values)
    log.parameters.lines = {name: TimeLine(np.zeros(1), [value], "PARM") for name, value in values.items()}


def two(one: Vector, other: Vector, switches: bool = True) -> tuple[HealthCase, list[CompassStudy]]:
    """A log with two compasses that are off by so much; the first is in use."""
    found = [study_samples(samples(offset, index=k)) for k, offset in enumerate((one, other))]
    studies = [study for study in found if study is not None]
    log: FlightLog = replace(empty_log(), mags=[study.samples.mag for study in studies], mag=0)
    if switches:
        set_parameters(log, COMPASS_USE=1.0, COMPASS_USE2=1.0)
    flown = Segments([Segment("airborne", 20.0, 120.0)])
    return HealthCase(log, flown), studies


def test_a_much_better_compass_is_to_be_used_with_both_numbers() -> None:
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    (found,) = compass.choice_checks(case, studies)
    assert found.verdict == "warning"
    assert found.text.startswith("MAG.0, in use, is off by ")
    assert [(s.name, s.old, s.new) for s in found.settings] == [("COMPASS_USE", 1.0, 0.0)]  # the second is on already
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
    (found,) = compass.choice_checks(case, studies)
    assert (found.verdict, found.settings) == ("ok", [])


def test_where_there_is_a_first_compass_the_switch_changes_it_too() -> None:
    """Firmware before 4.1 starts with it, and with no compass at all where it is switched off."""
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    set_parameters(case.log, COMPASS_USE=1.0, COMPASS_USE2=1.0, COMPASS_PRIMARY=0.0)
    (found,) = compass.choice_checks(case, studies)
    assert [(s.name, s.old, s.new) for s in found.settings] == [
        ("COMPASS_USE", 1.0, 0.0),
        ("COMPASS_PRIMARY", 0.0, 1.0),
    ]


@pytest.mark.parametrize(
    ("used", "other", "switches", "zero", "why"),
    [
        (12.0, 0.0, True, True, "MAG.1 was never calibrated: calibrate it first."),
        (30.0, 9.0, True, False, "MAG.1 is better, but off too: calibrate both."),
        (12.0, 0.0, False, False, "No single parameter of this log switches a compass."),
    ],
)
def test_a_better_compass_is_not_offered_for_one_reason(
    used: float, other: float, switches: bool, zero: bool, why: str
) -> None:
    case, studies = two((used, 0.0, 0.0), (0.0, other, 0.0), switches)
    mag = studies[1].samples.mag
    mag.offsets = replace(mag.field, x=np.zeros_like(mag.field.x)) if zero else None
    (found,) = compass.choice_checks(case, studies)
    assert (found.verdict, found.settings, found.why_no_setting) == ("warning", [], why)


def test_a_switch_that_the_log_makes_itself_is_not_advised() -> None:
    case, studies = two((12.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    case.log.texts = [(40.0, 4, "EKF3 IMU0 switching to compass 1")]
    (found,) = compass.choice_checks(case, studies)
    assert (found.verdict, found.settings, found.action) == ("ok", [], "")
    case.log.texts.append((50.0, 4, "EKF3 IMU0 switching to compass 0"))
    (found,) = compass.choice_checks(case, studies)
    assert (found.verdict, bool(found.settings)) == ("warning", True)


def test_without_an_attitude_the_size_of_the_field_decides() -> None:
    case, _ = two((0.0, 0.0, 40.0), (0.0, 0.0, 0.0))
    assert compass.choice_checks(case, []) == []  # no place, so no field of the earth
    case.log.gnss = [_receiver()]
    model = alignment.earth_field(case.log)
    assert model is not None
    for mag in case.log.mags:
        mag.field.x = mag.field.x * model.strength_t / 44.8e-6
    (found,) = compass.choice_checks(case, [])
    assert found.verdict == "warning"
    assert "MAG.1" in found.action
    case.log.mag = 1
    (found,) = compass.choice_checks(case, [])
    assert found.verdict == "ok"


def _receiver() -> Gnss:
    one = np.ones(1)
    return Gnss(0, one, "GPS", 47 * one, 8 * one, 0 * one, np.zeros((1, 3)), one, one, one, np.array([3]))


# Which compasses are judged how: the one in use, a spare one, one that is switched off, one without an attitude.


def asked(monkeypatch: pytest.MonkeyPatch, *, in_use: int, enabled: bool = True) -> dict[str, Check]:
    """What is said of the offset of two compasses, the second of which is off by 30 uT."""
    found: list[CompassStudy] = []
    for k, offset in enumerate(((0.0, 0.0, 0.0), (30.0, 0.0, 0.0))):
        study = study_samples(samples(offset, index=k))
        assert study is not None
        found.append(study)
    found[1].samples.mag.enabled = enabled
    log = replace(empty_log(), mags=[study.samples.mag for study in found], mag=in_use)
    monkeypatch.setattr(compass, "compass_studies", lambda case: (found, ""))
    case = HealthCase(log, Segments([Segment("airborne", 20.0, 120.0)]))
    return {a.sensor: a for a in compass.compass_checks(case) if a.question == "compass_offset"}


def test_an_offset_is_a_fault_of_the_compass_in_use_and_a_warning_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(monkeypatch, in_use=1)["MAG.1"].verdict == "fault"
    assert asked(monkeypatch, in_use=0)["MAG.1"].verdict == "warning"


def test_a_compass_that_is_switched_off_raises_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(asked(monkeypatch, in_use=0, enabled=False)) == ["MAG.0"]


def test_without_an_attitude_the_size_of_the_field_shows_the_motors(monkeypatch: pytest.MonkeyPatch) -> None:
    bent = Check("compass_motors", "fault", "The field goes from 29.3 to 41.4 uT.", 41.3, "%", "fault above 30 %")
    monkeypatch.setattr(compass, "interference_check", lambda *_: bent)
    found = compass.compass_checks(HealthCase(replace(empty_log(), mags=[samples().mag], mag=0), Segments()))
    assert [(a.question, a.verdict, a.value) for a in found] == [
        ("compass_offset", "unknown", None),
        ("compass_motors", "fault", 41.3),
    ]


# What is offered for a compass, and what is refused with which reason.

ASKED: list[tuple[Any, ...]] = []


@pytest.fixture(autouse=True)
def _offers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every proposal is granted, and remembered in ASKED."""

    def grant(log: Any, mag: Any, o: Any, c: Any = None, power: str = "current") -> SimpleNamespace:
        ASKED.append((mag.index, o, c, power))
        return SimpleNamespace(refused="", settings=[Setting("SET", 0.0, 1.0)])

    ASKED.clear()
    monkeypatch.setattr(parameters, "compass_proposal", grant)


def study(made: FieldSamples) -> CompassStudy:
    found = study_samples(made)
    assert found is not None
    return found


def answers(made: FieldSamples) -> tuple[Check, Check]:
    one, case = study(made), case_of(empty_log())
    return compass.offset_check(case, one), compass.motor_check(case, one)


def test_a_sound_compass_is_ok_and_nothing_is_offered() -> None:
    one, two = answers(samples())
    assert (one.verdict, two.verdict) == ("ok", "ok")
    assert not ASKED
    assert not one.why_no_setting
    assert one.ci95 is not None
    assert one.n > 900


@pytest.mark.parametrize("planted", [(10.0, 0.0, 0.0), (0.0, -10.0, 2.0), (-6.0, 5.0, -8.0)])
def test_an_offset_that_the_ground_confirms_is_offered_in_tesla(planted: tuple[float, float, float]) -> None:
    one, two = answers(samples(planted))
    assert one.settings
    assert len(ASKED) == 1
    assert 1e6 * ASKED[0][1] == pytest.approx(planted, abs=0.1)
    assert ASKED[0][2] is None
    assert np.all(np.abs(np.array(one.vector) - planted) < one.vector_ci95)
    assert two.verdict == "ok"
    assert any("Heading error on the half not fitted" in said for said in one.evidence)


def test_a_field_of_the_motors_is_no_offset_but_a_compensation() -> None:
    one, two = answers(samples((0.0, 0.0, 0.0), (0.5, -0.3, 0.1)))
    assert one.verdict == "warning"
    assert not one.settings
    assert "On the ground it is off by" in one.why_no_setting
    assert two.settings
    assert two.verdict == "fault"
    assert len(ASKED) == 1
    _, still, per_ampere, power = ASKED[0]
    assert power == "current"
    assert 1e6 * per_ampere == pytest.approx([0.5, -0.3, 0.1], abs=0.01)
    assert still == pytest.approx([0.0, 0.0, 0.0])
    assert two.vector == pytest.approx(np.array([0.5, -0.3, 0.1]) * (HOVER - 0.5), abs=0.3)


def test_the_offset_of_the_ground_goes_with_the_compensation() -> None:
    answers(samples((8.0, 4.0, 0.0), (-0.6, 0.3, 0.0)))
    assert 1e6 * ASKED[0][1] == pytest.approx([8.0, 4.0, 0.0], abs=0.1)
    assert 1e6 * ASKED[0][2] == pytest.approx([-0.6, 0.3, 0.0], abs=0.01)


def test_a_field_of_the_place_is_not_taken_for_the_motors() -> None:
    """Steel at the pad: in flight the compass is right, and a compensation would spoil it."""
    one, two = answers(samples(place=(12.0, 0.0, 0.0)))
    assert one.verdict == "ok"
    assert two.verdict == "fault"
    assert "does not improve the heading" in two.why_no_setting
    assert not ASKED


IRON = (10.0, 0.0, 0.0)


def changed(made: FieldSamples, use: np.ndarray, ut: float) -> FieldSamples:
    made.measured[use] += [ut, 0.0, 0.0]
    return made


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (samples(IRON, ground=(False, False)), "No sample on the ground"),
        (samples(IRON, calibrated=False), "never calibrated"),
        (changed(samples(IRON), samples().t > 70.0, -14.0), "none is constant"),
        # On one heading a turn looks like an offset, on the ground as in the air.
        (samples(turn_deg=25.0, turns=0.03), "askew"),
        # With a heading known to 4 deg the difference is within four sigmas, and the offset little more.
        (samples((9.0, 0.0, 0.0), place=(-5.0, 0.0, 0.0), sigma_deg=4.0), "does not confirm"),
        (samples((0.0, 0.0, -2.5), noise=0.05), "does not improve the heading"),
    ],
)
def test_an_offset_is_not_offered_for_one_reason(made: FieldSamples, why: str) -> None:
    one, _ = answers(made)
    assert one.verdict in ("warning", "unknown")
    assert (one.settings, ASKED) == ([], [])
    assert why in one.why_no_setting


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (samples(motor=(0.5, 0.0, 0.0), ground=(True, False)), "after landing is not logged"),
        (changed(samples(motor=(0.5, 0.0, 0.0)), samples().after, 4.0), "differ"),
        (samples(motor=(0.5, 0.0, 0.0), power=False), "no current and no throttle"),
    ],
)
def test_a_compensation_needs_power_and_the_ground_on_both_ends(made: FieldSamples, why: str) -> None:
    assert why in answers(made)[1].why_no_setting
    assert not ASKED


def test_a_heading_that_is_hardly_known_makes_no_compass_sound() -> None:
    one, two = answers(samples(sigma_deg=5.0, noise=0.0))
    assert one.verdict == "ok"
    made = samples(turns=0.03)
    made.sigma_heading[:] = np.radians(9.0)
    one, two = answers(made)
    assert (one.verdict, two.verdict) == ("unknown", "unknown")


def test_a_refused_compensation_says_what_it_would_bring(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = SimpleNamespace(refused="Reboot and fly once.", settings=[])
    monkeypatch.setattr(parameters, "compass_proposal", lambda *args: refused)
    _, bent = answers(samples((0.0, 0.0, 0.0), (0.5, -0.3, 0.1)))
    proof = study(samples((0.0, 0.0, 0.0), (0.5, -0.3, 0.1))).motor_proof
    assert proof is not None
    assert bent.action.startswith("Reboot and fly once. Run attlog health again: compensated for the motors")
    assert f"by {proof.after:.0f} deg instead of {proof.before:.0f}." in bent.action


def test_motors_whose_field_is_vertical_turn_no_heading() -> None:
    _, bent = answers(samples((0.0, 0.0, 0.0), (0.0, 0.0, 0.4)))
    assert bent.verdict != "ok"
    assert not bent.action


def test_of_bent_compasses_all_say_to_use_the_one_that_a_compensation_mends() -> None:
    """The other one, bent by the place, has none that helps."""
    mends, place = samples((0.0, 0.0, 0.0), (0.5, -0.3, 0.1)), samples((0.0, 3.0, 0.0), (0.4, 0.0, 0.0))
    studies = [study(place), study(mends)]
    studies[0] = studies[0]._replace(before=None)
    answered = [compass.motor_check(case_of(empty_log()), one) for one in studies]
    one, two = compass.motor_advice(answered, studies)
    assert two == answered[1]
    assert one.action.endswith(f"Then use {two.sensor}.")
    assert "compensated for the motors" in one.action
    assert compass.motor_advice(answered[:1], studies[:1]) == answered[:1], "none is mended"


# Soft iron in words: its size against planted ones.


def planted(share: float, turns: float = 2.0, axis_deg: float = 0.0) -> Check:
    """The field stretched by ``share`` along an axis, compressed by as much across it."""
    made = samples((3.0, -2.0, 0.0), turns=turns)
    c, s = np.cos(2.0 * np.radians(axis_deg)), np.sin(2.0 * np.radians(axis_deg))
    made.measured[:, :2] += share * made.expected[:, :2] @ np.array([[c, s], [s, -c]])
    found = study_samples(made)
    assert found is not None
    return compass.soft_iron_check(found)


@pytest.mark.parametrize(("share", "axis"), [(0.0, 0.0), (0.05, 0.0), (0.05, 30.0), (0.2, 70.0)])
def test_a_planted_ellipse_is_inside_the_interval(share: float, axis: float) -> None:
    found = planted(share, axis_deg=axis)
    assert found.ci95 is not None
    assert found.ci95[0] <= 100.0 * share <= found.ci95[1]
    assert found.verdict == ("warning" if share > 0.1 else "ok")
    assert not found.settings
    assert bool(found.why_no_setting) == (share > 0.1)


def test_a_flight_that_does_not_turn_shows_none() -> None:
    assert planted(0.2, turns=0.05).verdict == "unknown"
