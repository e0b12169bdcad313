"""The gyro's scale with its interval: a planted size, and the words of the check."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from attlog import flight, segments
from attlog.flight.model import FlightLog
from attlog.health.assessments.inertial.gyro_scale import answer
from attlog.health.fits import turns
from attlog.health.model import Check
from attlog.reference import choose
from tests.conftest import SAMPLES
from tests.health.assessments.inertial.cases import case, log_of, unit

NONE = (0.0, 0.0, 0.0)


@cache
def read() -> FlightLog:
    return flight.read(SAMPLES / "px4_steps.ulg")


@pytest.mark.parametrize("factor", [1.0, 1.05, 0.93])
def test_a_planted_scale_lies_inside_the_interval(factor: float) -> None:
    """The flight's own scale errors are 0.2 to 0.4 %."""
    log = read()
    phases = segments.build(log)
    reference = choose(log, phases, heading=False)
    imu = log.replay_imu
    assert imu is not None
    sound = imu.gyro.x
    imu.gyro.x = factor * sound
    try:
        checks = turns.checks(log, phases, reference)
    finally:
        imu.gyro.x = sound
    (found,) = answer(case(log, checks=checks))
    assert found.ci95 is not None
    assert found.value is not None
    low, high = sorted(abs(v) for v in found.ci95)
    assert (found.verdict == "ok") == (factor == 1.0)
    assert found.ci95[0] - 0.4 < 100.0 * (factor - 1.0) < found.ci95[1] + 0.4
    assert high - low < 4.0
    assert found.n * turns.SPAN_S == pytest.approx(found.seconds, abs=0.1)
    assert bool(found.why_no_setting) == (factor != 1.0)


def test_what_cannot_be_judged_is_unknown_with_what_to_fly() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    too_little = Check(turns.SCALE, "unknown", "In flight x, y, z turn by 1, 1, 0 deg/s.", threshold=turns.LIMIT)
    for checks in ([], [too_little]):
        (found,) = answer(case(log, checks=checks))
        assert found.verdict == "unknown"
        assert found.value is None
        assert found.action
    log.imu = None
    assert answer(case(log)) == []
    assert np.isfinite(turns.OFF)
