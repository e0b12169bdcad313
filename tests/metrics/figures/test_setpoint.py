"""The set-point over the flight: while armed, with its gaps, in the axes of the rows."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude
from attlog.metrics.figures.setpoint import MOST, demanded
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 60.0, 0.1)


def rolled(t: np.ndarray, deg: float = 10.0) -> np.ndarray:
    """A constant roll."""
    return rotation.from_rotvec(np.tile(np.radians([deg, 0.0, 0.0]), (len(t), 1)))


def asked(t: np.ndarray = T, armed: tuple[float, float] = (10.0, 50.0)):
    """A case whose log holds a set-point."""
    case = flights.case([], [Segment("continuous", 0.0, 60.0), Segment("armed", *armed)])
    case.log.setpoints = Attitude(t, rolled(t), "ATT.Des")
    return case


def test_the_set_point_is_drawn_while_armed():
    found = demanded(asked())[0]
    assert (found.figure, found.row) == ("demand", "")
    assert found.t[[0, -1]] == pytest.approx([10.0, 50.0], abs=0.11)
    assert found.columns["roll"] == pytest.approx(10.0)


def test_a_pause_of_the_logger_breaks_the_line():
    found = demanded(asked(T[(T < 20.0) | (T > 30.0)]))[0]
    assert np.isnan(found.columns["heading"]).sum() == 1


def test_the_trim_is_taken_out_as_of_the_rows():
    case = asked()
    case.reference.trim = np.radians([2.0, 0.0, 0.0])
    assert demanded(case)[0].columns["roll"] == pytest.approx(8.0)
    case.log.setpoints.has_trim = True
    assert demanded(case)[0].columns["roll"] == pytest.approx(10.0)


def test_a_long_one_becomes_an_envelope_and_none_gives_nothing():
    found = demanded(asked(np.linspace(0.0, 60.0, 100_000), (0.0, 60.0)))[0]
    assert len(found.t) <= MOST
    assert found.ratio > 3
    assert demanded(flights.case([], [])) == []
