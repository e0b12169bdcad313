"""Whether a reference plainly follows the gyro: the same answer as the fit of the lag where it is clear, else none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import inspection, rotation, segments
from attlog.flight import read
from attlog.metrics import followed, lag, possible
from attlog.metrics.base import Case

SAMPLES = Path(__file__).parents[2] / "sample_logs"


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
    row = possible.stand_in(case)
    fitted = lag.compute(case, row, "airborne")[lag.metric_id("lag", "all")]
    assert fitted.value is not None
    assert followed.plainly(case, row, "airborne") == fitted.n


def changed(case: Case, q: np.ndarray, t: np.ndarray | None = None) -> Case:
    """The case with another attitude as reference, nothing of the old one kept."""
    reference = replace(case.reference, q=q, t=case.reference.t if t is None else t)
    return replace(case, reference=reference, of_log={})


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.1])
def test_a_reference_that_comes_later_or_earlier_is_followed_at_that_delay(steps: Case, late_s: float) -> None:
    row = possible.stand_in(steps)
    found = []
    whole = followed.Rates.compared
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(followed.Rates, "compared", lambda self, d: found.append(d) or whole(self, d))
        followed.plainly(changed(steps, steps.reference.q, steps.reference.t - late_s), row, "all")
    assert found == [pytest.approx(late_s, abs=0.0015)]


def test_a_reference_of_another_size_or_shape_is_left_to_the_fit(steps: Case) -> None:
    row = possible.stand_in(steps)
    assert followed.plainly(steps, row, "airborne") is not None
    half = rotation.from_rotvec(0.8 * rotation.to_rotvec(steps.reference.q))
    assert followed.plainly(changed(steps, half), row, "airborne") is None
    t = steps.reference.t
    wobble = rotation.from_rotvec(np.radians(2.0) * np.sin(20.0 * t)[:, None] * np.array([1.0, 1.0, 0.0]))
    assert followed.plainly(changed(steps, rotation.multiply(steps.reference.q, wobble)), row, "airborne") is None


def test_few_events_are_left_to_the_fit(steps: Case) -> None:
    assert followed.plainly(steps, possible.stand_in(steps), "0:1") is None
