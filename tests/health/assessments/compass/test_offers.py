"""What is offered for a compass, and what is refused with which reason."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.health.assessments.compass import motors, offset
from attlog.health.assessments.compass.samples import FieldSamples
from attlog.health.assessments.compass.study import CompassStudy, studied
from attlog.health.assessments.model import Assessment, Setting
from attlog.health.settings import compass as parameters
from tests.health.assessments.compass.made import HOVER, case_of, empty_log, samples

ASKED: list[tuple[Any, ...]] = []


@pytest.fixture(autouse=True)
def _offers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every proposal is granted, and remembered in ASKED."""

    def grant(log: Any, mag: Any, o: Any, c: Any = None, power: str = "current") -> SimpleNamespace:
        ASKED.append((mag.index, o, c, power))
        return SimpleNamespace(refused="", settings=[Setting("SET", 0.0, 1.0)])

    ASKED.clear()
    monkeypatch.setattr(parameters, "proposal", grant)


def study(made: FieldSamples) -> CompassStudy:
    found = studied(made)
    assert found is not None
    return found


def answers(made: FieldSamples) -> tuple[Assessment, Assessment]:
    one, case = study(made), case_of(empty_log())
    return offset.assessed(case, one), motors.assessed(case, one)


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


def test_without_samples_on_the_ground_no_number_is_offered() -> None:
    one, two = answers(samples((10.0, 0.0, 0.0), ground=(False, False)))
    assert one.verdict == "warning"
    assert "No sample on the ground" in one.why_no_setting
    assert two.verdict == "unknown"
    assert not ASKED


def test_a_compensation_needs_the_ground_on_both_ends() -> None:
    _, two = answers(samples(motor=(0.5, 0.0, 0.0), ground=(True, False)))
    assert "after landing is not logged" in two.why_no_setting
    made = samples(motor=(0.5, 0.0, 0.0))
    made.measured[made.after] += [4.0, 0.0, 0.0]
    _, two = answers(made)
    assert "differ" in two.why_no_setting
    assert not ASKED


def test_without_power_the_motors_get_words() -> None:
    one, two = answers(samples(motor=(0.5, 0.0, 0.0), power=False))
    assert "neither" not in one.text
    assert "no current and no throttle" in two.why_no_setting
    assert not ASKED


def test_an_offset_of_one_half_is_not_constant() -> None:
    made = samples((10.0, 0.0, 0.0))
    made.measured[made.t > 70.0] -= [14.0, 0.0, 0.0]
    one, _ = answers(made)
    assert "none is constant" in one.why_no_setting
    assert not ASKED


def test_a_compass_mounted_askew_gets_no_offset() -> None:
    """On one heading a turn looks like an offset, on the ground as in the air."""
    one, _ = answers(samples(turn_deg=25.0, turns=0.03))
    assert one.verdict == "warning"
    assert "askew" in one.why_no_setting
    one, _ = answers(samples(turn_deg=25.0))
    assert not one.settings
    assert not ASKED


def test_a_ground_that_shows_half_of_it_confirms_nothing() -> None:
    """With a heading known to 4 deg the difference is within four sigmas, and the offset little more."""
    one, _ = answers(samples((9.0, 0.0, 0.0), place=(-5.0, 0.0, 0.0), sigma_deg=4.0))
    assert one.verdict == "warning"
    assert "does not confirm" in one.why_no_setting
    assert not ASKED


def test_an_offset_that_hardly_turns_the_heading_is_not_offered() -> None:
    one, _ = answers(samples((0.0, 0.0, -2.5), noise=0.05))
    assert one.verdict == "warning"
    assert "does not improve the heading" in one.why_no_setting
    assert not ASKED


def test_an_uncalibrated_compass_is_to_be_calibrated() -> None:
    one, _ = answers(samples((10.0, 0.0, 0.0), calibrated=False))
    assert "never calibrated" in one.why_no_setting
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
    monkeypatch.setattr(parameters, "proposal", lambda *args: refused)
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
    studies[0] = replace(studies[0], before=None)
    answered = [motors.assessed(case_of(empty_log()), one) for one in studies]
    one, two = motors.advised(answered, studies)
    assert two == answered[1]
    assert one.action.endswith(f"Then use {two.sensor}.")
    assert "compensated for the motors" in one.action
    assert motors.advised(answered[:1], studies[:1]) == answered[:1], "none is mended"
