"""Gravity's size at rest, of every unit."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.assessments.inertial.accelerometer_rest import answer
from attlog.segments import Segment, Segments
from tests.health.assessments.inertial.cases import G, case, log_of, unit

NONE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("down", "verdict"), [(0.2, "ok"), (-0.4, "warning"), (1.4, "fault")])
def test_the_size_at_rest_is_gravity_s_less_what_the_unit_reads_too_much(down: float, verdict: str) -> None:
    sound, off = answer(case(log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, (0.0, 0.0, down), NONE))))
    assert (sound.verdict, off.verdict) == ("ok", verdict)
    for one, size in ((sound, G), (off, G - down)):
        assert one.ci95 is not None
        assert one.ci95[0] < size < one.ci95[1]
        assert one.ci95[1] - one.ci95[0] < 0.1
        assert one.seconds == pytest.approx(56.0, abs=1.0)
    assert bool(off.why_no_setting) == (verdict != "ok")
    assert not off.settings


def test_without_rest_or_with_shaking_motors_nothing_is_said_but_that() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    assert [a.verdict for a in answer(case(log, segments=Segments([Segment("airborne", 30.0, 90.0)])))] == ["unknown"]
    log.imus[0].acc.x += 5.0 * np.random.default_rng(1).normal(size=(len(log.imus[0].acc.t), 3)).cumsum(axis=0) / 10
    assert [a.verdict for a in answer(case(log))] == ["unknown"]


def test_dead_and_empty_units_are_left_out() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, 100.0, NONE, NONE))
    log.imus[1].acc.x = np.zeros_like(log.imus[1].acc.x)
    assert [a.sensor for a in answer(case(log))] == ["IMU:0"]
    log.imus = []
    assert answer(case(log)) == []
