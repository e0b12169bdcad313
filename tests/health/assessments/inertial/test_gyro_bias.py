"""The bias of every gyro at rest and in flight; its step by the check, and no verdict against the check's."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.assessments.inertial.gyro_bias import answer
from attlog.health.fits import turns
from attlog.health.model import Check
from attlog.segments import Segment, Segments
from tests.health.assessments.inertial.cases import case, log_of, unit
from tests.health.assessments.inertial.cases import told as told_by_smoother

NONE = (0.0, 0.0, 0.0)


def told(dps: tuple[float, float, float]) -> dict[str, float | str]:
    return told_by_smoother(NONE, gyro=dps)


@pytest.mark.parametrize(("dps", "verdict"), [(0.4, "ok"), (-1.6, "warning"), (24.0, "fault")])
def test_the_reading_at_rest_of_every_unit(dps: float, verdict: str) -> None:
    first, second = answer(case(log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, NONE, (0.1, dps, 0.0)))))
    assert (first.verdict, second.verdict) == ("ok", verdict)
    assert second.vector == pytest.approx([0.1, dps, 0.0], abs=0.03)
    assert second.ci95 is not None
    assert second.ci95[0] < dps < second.ci95[1]
    assert not second.settings


def test_a_bias_that_moves_from_rest_to_flight_counts_and_a_small_one_does_not() -> None:
    log = log_of(unit(0, 100.0, NONE, (0.3, 0.0, 0.0)))
    assert answer(case(log, told((0.4, 0.0, 0.0))))[0].verdict == "ok"
    (moved,) = answer(case(log, told((2.0, 0.0, 0.0))))
    assert moved.verdict == "warning"
    assert "+2.00" in moved.evidence[0]


def test_without_rest_the_smoother_tells_and_a_second_unit_by_its_difference() -> None:
    air = Segments([Segment("airborne", 30.0, 90.0)])
    log = log_of(unit(0, 100.0, NONE, (0.3, 0.0, 0.0)), unit(1, 50.0, NONE, (0.3, 0.0, 1.5)))
    first, second = answer(case(log, told((0.3, 0.0, 0.0)), segments=air))
    assert (first.verdict, second.verdict) == ("ok", "warning")
    assert second.vector == pytest.approx([0.3, 0.0, 1.5], abs=0.1)
    assert [a.verdict for a in answer(case(log, segments=air))] == ["unknown"]


def test_the_verdict_of_the_replayed_unit_is_the_check_s() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    moved = Check("gyro bias", "warning", "Its bias moved by 1.20 deg/s.", 0.6, "deg/s")
    assert answer(case(log, checks=[moved]))[0].verdict == "warning"


def test_a_step_is_told_with_time_and_interval() -> None:
    step = Check(turns.STEP, "fault", "It steps.", 4.0, "deg/s", t=61.0, ci95=(3.8, 4.2), samples=300, seconds=90.0)
    log = log_of(unit(0, 100.0, NONE, NONE))
    _, found = answer(case(log, checks=[step]))
    assert (found.question, found.verdict, found.t, found.ci95, found.n) == (
        "gyro_bias_step",
        "fault",
        61.0,
        (3.8, 4.2),
        300,
    )
    assert len(answer(case(log, checks=[Check(turns.STEP, "ok", "No step.")]))) == 1


def test_damaged_streams_do_no_harm() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    log.imus[0].gyro.x[::2] = np.nan
    assert answer(case(log))[0].verdict == "ok"
    log.imus[0].gyro.x[:] = np.nan
    assert [a.verdict for a in answer(case(log))] == ["unknown"]
