"""With and without the compass: which run stands, on made flights with known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import Estimate, estimate
from attlog.estimators.filters import pair
from attlog.testing.motion import Motion
from tests.estimators.filters.navigation.made import Made, flight, off

Array = np.ndarray


def turned(m: Motion, degrees: float) -> Motion:
    """A compass that sits turned about the vertical body axis."""
    mount = rotation.from_euler(0.0, 0.0, np.radians(degrees))
    return replace(m, mag=rotation.rotate_inverse(np.tile(mount, (len(m.mag), 1)), m.mag))


def rms_deg(x: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(x * x))))


def smoothed(made: Made, turn: float = 0.0) -> tuple[Estimate, float]:
    """The estimate with a compass that sits turned by so many degrees, and the RMS of its error over its sigma."""
    e = estimate("smoother", *turned(made.motion, turn).sensors, aids=made.aids)
    heading = off(e.q, made.motion.q)[1]
    return e, float(np.sqrt(np.mean((heading / e.aux["sigma_heading"]) ** 2)))


def test_a_sound_compass_that_motion_confirms_is_used() -> None:
    e, ratio = smoothed(flight())
    assert e.quality["heading_from"] == "both"
    assert "mag" in str(e.quality["aided_by"])
    assert ratio < 1.5


@pytest.mark.parametrize("turn", [10.0, -40.0, 180.0])
def test_a_turned_compass_is_left_out_where_motion_shows_the_heading(turn: float) -> None:
    made = flight()
    e, ratio = smoothed(made, turn)
    assert e.quality["heading_from"] == "motion"
    assert "mag" not in str(e.quality["aided_by"])
    assert e.quality["compass_disagreement"] > 1.0
    tilt, heading = off(e.q, made.motion.q)
    assert ratio < 2.0
    assert rms_deg(heading) < 1.0
    assert rms_deg(tilt) < 0.2


@pytest.mark.parametrize("turn", [40.0, -90.0])
def test_a_turned_compass_in_a_hover_leaves_no_heading(turn: float) -> None:
    made = flight(reach=0.01)
    e, _ = smoothed(made, turn)
    assert e.quality["heading_from"] == "nobody"
    assert (e.aux["sigma_heading"] == np.pi).all()
    assert str(e.quality["refused"]).startswith("no heading: ")
    assert rms_deg(off(e.q, made.motion.q)[0][3000:]) < 1.0


def test_without_a_compass_motion_shows_the_heading_or_nobody_does() -> None:
    for made, expected in ((flight(), "motion"), (flight(reach=0.01), "nobody")):
        m = made.motion
        assert estimate("smoother", m.t, m.gyr, m.acc, aids=made.aids).quality["heading_from"] == expected


def estimated(heading: float, sigma_heading: float, sigma_tilt: float = 0.2, lean: float = 0.0) -> Estimate:
    """A run of 10 samples that points and leans so many degrees, with sigmas in deg."""
    n = 10
    q = np.tile(rotation.from_euler(np.radians(lean), 0.0, np.radians(heading)), (n, 1))
    sigmas = np.radians(np.full((2, n), [[sigma_tilt], [sigma_heading]]))
    quality: dict[str, float | str] = {"sigma_tilt_deg": sigma_tilt, "sigma_heading_deg": sigma_heading}
    return Estimate(np.arange(n) / 10.0, q, aux={"sigma_tilt": sigmas[0], "sigma_heading": sigmas[1]}, quality=quality)


def test_a_heading_that_both_runs_agree_on_is_as_sure_as_they_agree() -> None:
    """Own sigma 0.3 deg, 0.4 deg apart: hypot is 0.5 deg."""
    e = pair.chosen(estimated(10.4, 0.3), estimated(10.0, 0.8))
    assert e.quality["heading_from"] == "both"
    assert np.degrees(e.aux["sigma_heading"]) == pytest.approx(0.5)
    assert e.quality["sigma_heading_deg"] == pytest.approx(0.5)


def test_a_compass_that_nothing_contradicts_is_said_to_stand_alone() -> None:
    e = pair.chosen(estimated(10.0, 0.5), estimated(11.0, 2.0))
    assert e.quality["heading_from"] == "compass"
    assert np.degrees(e.aux["sigma_heading"]) == pytest.approx(0.5)


def test_two_unsure_runs_have_no_heading_though_they_agree() -> None:
    assert pair.chosen(estimated(10.0, 1.5), estimated(11.0, 2.0)).quality["heading_from"] == "nobody"


def test_where_no_heading_stands_tilt_is_as_sure_as_the_runs_agree() -> None:
    """Own sigma 0.3 deg, 0.4 deg apart: hypot is 0.5 deg."""
    e = pair.chosen(estimated(40.0, 0.5, sigma_tilt=0.3, lean=0.4), estimated(0.0, 2.0))
    assert e.quality["heading_from"] == "nobody"
    assert np.degrees(e.aux["sigma_tilt"]) == pytest.approx(0.5, rel=1e-3)


def test_up_to_two_joint_sigmas_it_is_open_who_errs() -> None:
    """Joint sigma 0.5 deg: at 0.8 deg the difference is part of the sigma, at 5 deg the compass errs."""
    near, far = (pair.chosen(estimated(10.0 + d, 0.3), estimated(10.0, 0.4)) for d in (0.8, 5.0))
    assert near.quality["heading_from"] == far.quality["heading_from"] == "motion"
    assert np.degrees(near.aux["sigma_heading"]) == pytest.approx(np.hypot(0.4, 0.8))
    assert np.degrees(far.aux["sigma_heading"]) == pytest.approx(0.4)


@pytest.mark.parametrize("sigma", [0.4, 3.0])
def test_a_run_by_motion_alone_keeps_what_it_says_of_its_own_heading(sigma: float) -> None:
    n = 10
    run = Estimate(
        np.arange(n, dtype=float),
        np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        aux={"sigma_tilt": np.full(n, 0.001), "sigma_heading": np.radians(np.full(n, sigma))},
    )
    stands = pair.alone(run)
    own = stands.aux.get(pair.OWN_HEADING, stands.aux["sigma_heading"])
    assert np.degrees(own) == pytest.approx(sigma)
    assert (pair.without_heading(stands, "a sensor contradicts it").aux[pair.OWN_HEADING] == np.pi).all()
