"""Whether a reference plainly follows the gyro: the same answer as the fit of the lag where it is clear, else none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import segments
from attlog.analysis import inspection
from attlog.base import rotation
from attlog.flight import read
from attlog.metrics.answerable import plain_lag, questions
from attlog.metrics.base import Case
from attlog.metrics.steps import lag

SAMPLES = Path(__file__).parents[3] / "sample_logs"


def case_of(name: str) -> Case:
    log = read(SAMPLES / name)
    case = inspection._compared(log, segments.build(log))[1]
    assert case is not None
    return case


@pytest.fixture(scope="module")
def steps() -> Case:
    return case_of("px4_steps.ulg")


@pytest.mark.parametrize("name", ["px4_hover.ulg", "copter_yaw_turns.bin"])
def test_the_events_are_those_of_the_fit(name: str) -> None:
    case = case_of(name)
    row = questions.stand_in(case)
    fitted = lag.compute(case, row, "airborne")[lag.metric_id("lag", "all")]
    assert fitted.value is not None
    assert plain_lag.plainly(case, row, "airborne") == fitted.n


def changed(case: Case, q: np.ndarray, t: np.ndarray | None = None) -> Case:
    """The case with another attitude as reference, nothing of the old one kept."""
    reference = replace(case.reference, q=q, t=case.reference.t if t is None else t)
    return replace(case, reference=reference, of_log={})


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.1])
def test_a_reference_that_comes_later_or_earlier_is_followed_at_that_delay(steps: Case, late_s: float) -> None:
    row = questions.stand_in(steps)
    found = []
    whole = plain_lag.Rates.compared
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plain_lag.Rates, "compared", lambda self, d: found.append(d) or whole(self, d))
        plain_lag.plainly(changed(steps, steps.reference.q, steps.reference.t - late_s), row, "all")
    assert found == [pytest.approx(late_s, abs=0.0015)]


def test_a_reference_of_another_size_or_shape_is_left_to_the_fit(steps: Case) -> None:
    row = questions.stand_in(steps)
    assert plain_lag.plainly(steps, row, "airborne") is not None
    half = rotation.from_rotvec(0.8 * rotation.to_rotvec(steps.reference.q))
    assert plain_lag.plainly(changed(steps, half), row, "airborne") is None
    t = steps.reference.t
    wobble = rotation.from_rotvec(np.radians(2.0) * np.sin(20.0 * t)[:, None] * np.array([1.0, 1.0, 0.0]))
    assert plain_lag.plainly(changed(steps, rotation.multiply(steps.reference.q, wobble)), row, "airborne") is None


def test_few_events_are_left_to_the_fit(steps: Case) -> None:
    assert plain_lag.plainly(steps, questions.stand_in(steps), "0:1") is None


@pytest.mark.parametrize(("kind", "told"), [("truth", False), ("onboard", True)])
def test_a_row_ahead_of_its_reference_is_left_to_the_fit_unless_that_is_an_estimate_itself(
    steps: Case, kind: str, told: bool
) -> None:
    """What flew may well be late; truth is not, and a row that is ahead of it has something wrong."""
    ahead = changed(steps, steps.reference.q, steps.reference.t + 0.03)
    ahead.reference.kind = kind  # type: ignore[assignment]
    assert (plain_lag.plainly(ahead, questions.stand_in(steps), "all") is not None) is told


def test_a_row_that_shakes_beside_its_movement_is_left_to_the_fit(steps: Case) -> None:
    """The gain is right, the shape is not: 1 deg at 8 Hz adds tens of deg/s that the reference does not turn."""
    row = questions.stand_in(steps)
    shake = rotation.from_rotvec(np.radians(1.0) * np.sin(50.0 * row.t)[:, None] * np.array([1.0, 1.0, 1.0]))
    shaken = replace(row, q=rotation.multiply(row.q, shake))
    assert plain_lag.plainly(steps, row, "airborne") is not None
    assert plain_lag.plainly(steps, shaken, "airborne") is None
