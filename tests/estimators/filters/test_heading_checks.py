"""A smoothed heading that GNSS acceleration or the gyro at rest contradicts does not stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import Aids, Estimate
from attlog.estimators.filters import pair
from attlog.estimators.filters.heading_checks import checked
from attlog.estimators.filters.navigation.measured import Inputs, made_ready
from attlog.estimators.filters.navigation.passes.jumps import bias_change_dps
from attlog.testing import still
from attlog.testing.motion import Motion
from tests.estimators.filters.navigation.made import Made, flight


def ready(made: Made) -> Inputs:
    return made_ready(*made.motion.sensors, made.aids, 0.0, ahead=True)


def turned(m: Motion, degrees: float, sigma: float = 0.3) -> Estimate:
    """The truth with its heading turned clockwise, which says of itself that it is sure."""
    n = len(m.t)
    sigmas = np.radians(np.full((2, n), [[0.1], [sigma]]))
    return Estimate(
        m.t,
        rotation.turn_about_down(m.q, np.full(n, np.radians(degrees))),
        aux={"sigma_tilt": sigmas[0], "sigma_heading": sigmas[1]},
        quality={"heading_from": "compass", "sigma_tilt_deg": 0.1, "sigma_heading_deg": sigma},
    )


def test_gnss_acceleration_says_how_far_a_heading_is_off() -> None:
    made = flight()
    run = checked(turned(made.motion, 0.0), ready(made))
    assert run.quality["heading_from"] == "compass"
    assert run.quality["heading_gnss_deg"] == pytest.approx(0.0, abs=1.5)


@pytest.mark.parametrize("degrees", [-12.0, 25.0])
def test_a_heading_that_gnss_acceleration_contradicts_is_withheld(degrees: float) -> None:
    made = flight()
    run = checked(turned(made.motion, degrees), ready(made))
    assert run.quality["heading_from"] == "nobody"
    assert run.quality["heading_gnss_deg"] == pytest.approx(degrees, abs=3.0)
    assert "GNSS acceleration" in str(run.quality["refused"])
    assert (run.aux["sigma_heading"] == np.pi).all()


def test_a_heading_within_its_own_sigma_of_gnss_acceleration_stands() -> None:
    made = flight()
    assert checked(turned(made.motion, 12.0, sigma=6.0), ready(made)).quality["heading_from"] == "compass"


@pytest.mark.parametrize(("degrees", "contradicted"), [(0.0, False), (25.0, True)])
def test_an_unsure_heading_by_motion_is_checked_as_well(degrees: float, contradicted: bool) -> None:
    made = flight()
    run = checked(pair.alone(turned(made.motion, degrees, sigma=3.0)), ready(made))
    assert run.quality["heading_from"] == "nobody"
    assert (run.aux[pair.OWN_HEADING] == np.pi).all() == contradicted


def rested(step_dps: float) -> Inputs:
    """Two rests of 10 s, with a gyro whose bias jumps between them."""
    m = still(30.0)
    gyr = m.gyr + np.outer(m.t > 15.0, np.radians([0.0, 0.0, step_dps]))
    return made_ready(m.t, gyr, m.acc, m.mag, Aids(at_rest=np.array([[0.0, 10.0], [20.0, 30.0]])), 0.0, ahead=True)


def test_the_bias_at_rest_shows_a_jump_between_two_rests() -> None:
    assert bias_change_dps(rested(1.2)) == pytest.approx(1.2, abs=0.01)
    assert bias_change_dps(rested(0.0)) == pytest.approx(0.0, abs=0.01)
    one = rested(1.2)
    one.still[1600:] = False
    assert bias_change_dps(one) == 0.0


def test_a_bias_that_changed_leaves_no_heading_unless_the_jump_is_modelled() -> None:
    run = turned(still(30.0), 0.0)
    assert checked(run, rested(0.2)).quality["heading_from"] == "compass"
    withheld = checked(run, rested(1.2))
    assert withheld.quality["heading_from"] == "nobody"
    assert "1.2 deg/s" in str(withheld.quality["heading_why"])
    modelled = replace(run, quality=run.quality | {"gyro_jump_s": 15.0})
    assert checked(modelled, rested(1.2)).quality["heading_from"] == "compass"
