"""What the smoother makes of a log with an impact: two parts, each by itself."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.estimators import Aids as estimators_Aids
from attlog.estimators import Estimate as estimators_Estimate
from attlog.estimators import estimate
from attlog.estimators.aids import Aids
from attlog.estimators.filters import smoother
from attlog.estimators.filters.navigation.inputs import Inputs, prepare_inputs
from attlog.estimators.filters.navigation.jumps import bias_change_dps
from attlog.estimators.filters.smoother import check_heading
from attlog.estimators.interface import Estimate
from attlog.testing import still
from attlog.testing.motions import Motion
from tests.estimators.filters.navigation.made import Made, flight, off


def test_attitude_bias_and_sigmas_of_both_sides_of_an_impact_are_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(0.0, 20.0, 0.1)
    zero = np.zeros((len(t), 3))

    def part(t, gyr, acc, mag, aids, params):  # type: ignore[no-untyped-def]
        own = np.full(len(t), t[0])
        return Estimate(t, np.tile(own[:, None], (1, 4)), np.tile(own[:, None], (1, 3)), {"sigma_tilt": own})

    monkeypatch.setattr(smoother, "smooth_part", part)
    found = smoother.run(t, zero, zero, zero, Aids(impact=12.0), {})
    begin = np.where(t < 12.0 - smoother.BEFORE_IMPACT_S, 0.0, t[np.searchsorted(t, 12.0 - smoother.BEFORE_IMPACT_S)])
    np.testing.assert_array_equal(found.t, t)
    for x in (found.q, found.bias, found.aux["sigma_tilt"][:, None]):
        np.testing.assert_array_equal(x, np.tile(begin[:, None], (1, x.shape[1])))
    whole = smoother.run(t, zero, zero, zero, Aids(impact=4.0), {})
    assert not whole.q.any(), "less than 5 s before an impact are no flight of their own"


# Where an impact parts a run of the smoother, and what each part is given.


# With and without the compass: which run stands, on made flights with known truth.

Array = np.ndarray


def turned(m: Motion, degrees: float) -> Motion:
    """A compass that sits turned about the vertical body axis."""
    mount = rotation.from_euler(0.0, 0.0, np.radians(degrees))
    return replace(m, mag=rotation.rotate_inverse(np.tile(mount, (len(m.mag), 1)), m.mag))


def rms_deg(x: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(x * x))))


def smoothed_run(made: Made, turn: float = 0.0) -> tuple[estimators_Estimate, float]:
    """The estimate with a compass that sits turned by so many degrees, and the RMS of its error over its sigma."""
    e = estimate("smoother", *turned(made.motion, turn).sensors, aids=made.aids)
    heading = off(e.q, made.motion.q)[1]
    return e, float(np.sqrt(np.mean((heading / e.aux["sigma_heading"]) ** 2)))


def test_a_sound_compass_that_motion_confirms_is_used() -> None:
    e, ratio = smoothed_run(flight())
    assert e.quality["heading_from"] == "both"
    assert "mag" in str(e.quality["aided_by"])
    assert ratio < 1.5


@pytest.mark.parametrize("turn", [10.0, -40.0, 180.0])
def test_a_turned_compass_is_left_out_where_motion_shows_the_heading(turn: float) -> None:
    made = flight()
    e, ratio = smoothed_run(made, turn)
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
    e, _ = smoothed_run(made, turn)
    assert e.quality["heading_from"] == "none"
    assert (e.aux["sigma_heading"] == np.pi).all()
    assert str(e.quality["refused"]).startswith("no heading: ")
    assert rms_deg(off(e.q, made.motion.q)[0][3000:]) < 1.0


def test_without_a_compass_motion_shows_the_heading_or_nobody_does() -> None:
    for made, expected in ((flight(), "motion"), (flight(reach=0.01), "none")):
        m = made.motion
        assert estimate("smoother", m.t, m.gyr, m.acc, aids=made.aids).quality["heading_from"] == expected


def estimated(heading: float, sigma_heading: float, sigma_tilt: float = 0.2, lean: float = 0.0) -> estimators_Estimate:
    """A run of 10 samples that points and leans so many degrees, with sigmas in deg."""
    n = 10
    q = np.tile(rotation.from_euler(np.radians(lean), 0.0, np.radians(heading)), (n, 1))
    sigmas = np.radians(np.full((2, n), [[sigma_tilt], [sigma_heading]]))
    quality: dict[str, float | str] = {"sigma_tilt_deg": sigma_tilt, "sigma_heading_deg": sigma_heading}
    return estimators_Estimate(
        np.arange(n) / 10.0, q, aux={"sigma_tilt": sigmas[0], "sigma_heading": sigmas[1]}, quality=quality
    )


def test_a_heading_that_both_runs_agree_on_is_as_sure_as_they_agree() -> None:
    """Own sigma 0.3 deg, 0.4 deg apart: hypot is 0.5 deg."""
    e = smoother.choose_heading(estimated(10.4, 0.3), estimated(10.0, 0.8))
    assert e.quality["heading_from"] == "both"
    assert np.degrees(e.aux["sigma_heading"]) == pytest.approx(0.5)
    assert e.quality["sigma_heading_deg"] == pytest.approx(0.5)


def test_a_compass_that_nothing_contradicts_is_said_to_stand_alone() -> None:
    e = smoother.choose_heading(estimated(10.0, 0.5), estimated(11.0, 2.0))
    assert e.quality["heading_from"] == "compass"
    assert np.degrees(e.aux["sigma_heading"]) == pytest.approx(0.5)


@pytest.mark.parametrize(("apart", "ratio", "found"), [(0.8, 0.6, "both"), (0.8, 3.0, "motion"), (5.0, 0.6, "motion")])
def test_up_to_two_joint_sigmas_the_fit_of_the_field_decides(apart: float, ratio: float, found: str) -> None:
    """Joint sigma 0.5 deg: at 0.8 deg the difference is part of the sigma, at 5 deg the compass errs."""
    one = estimated(10.0 + apart, 0.3)
    one = replace(one, aux=one.aux | {"test_ratio_mag": np.full(10, ratio)})
    e = smoother.choose_heading(one, estimated(10.0, 0.4))
    assert e.quality["heading_from"] == found
    own = 0.3 if found == "both" else 0.4
    assert np.degrees(e.aux["sigma_heading"]) == pytest.approx(np.hypot(own, apart) if apart < 1.0 else own)


def test_beside_an_unsure_motion_a_compass_counts_up_to_one_joint_sigma() -> None:
    near, far = (smoother.choose_heading(estimated(10.0 + d, 0.3), estimated(10.0, 4.0)) for d in (3.5, 6.5))
    assert (near.quality["heading_from"], far.quality["heading_from"]) == ("compass", "none")


# A smoothed heading that GNSS acceleration or the gyro at rest contradicts does not stand.


def ready(made: Made) -> Inputs:
    return prepare_inputs(*made.motion.sensors, made.aids, 0.0, ahead=True)


def turned_run(m: Motion, degrees: float, sigma: float = 0.3) -> estimators_Estimate:
    """The truth with its heading turned clockwise, which says of itself that it is sure."""
    n = len(m.t)
    sigmas = np.radians(np.full((2, n), [[0.1], [sigma]]))
    return estimators_Estimate(
        m.t,
        rotation.turn_about_down(m.q, np.full(n, np.radians(degrees))),
        aux={"sigma_tilt": sigmas[0], "sigma_heading": sigmas[1]},
        quality={"heading_from": "compass", "sigma_tilt_deg": 0.1, "sigma_heading_deg": sigma},
    )


@pytest.mark.parametrize("degrees", [-12.0, 25.0])
def test_a_heading_that_gnss_acceleration_contradicts_is_withheld(degrees: float) -> None:
    made = flight()
    run = check_heading(turned_run(made.motion, degrees), ready(made))
    assert run.quality["heading_from"] == "none"
    assert run.quality["heading_gnss_deg"] == pytest.approx(degrees, abs=3.0)
    assert "GNSS acceleration" in str(run.quality["refused"])
    assert (run.aux["sigma_heading"] == np.pi).all()


def rested(step_dps: float) -> Inputs:
    """Two rests of 10 s, with a gyro whose bias jumps between them."""
    m = still(30.0)
    gyr = m.gyr + np.outer(m.t > 15.0, np.radians([0.0, 0.0, step_dps]))
    return prepare_inputs(
        m.t, gyr, m.acc, m.mag, estimators_Aids(at_rest=np.array([[0.0, 10.0], [20.0, 30.0]])), 0.0, ahead=True
    )


def test_the_bias_at_rest_shows_a_jump_between_two_rests() -> None:
    assert bias_change_dps(rested(1.2)) == pytest.approx(1.2, abs=0.01)
    assert bias_change_dps(rested(0.0)) == pytest.approx(0.0, abs=0.01)
    one = rested(1.2)
    one.still[1600:] = False
    assert bias_change_dps(one) == 0.0


# At which offset, which sigma and which change of bias a heading is withheld: each limit from both sides.

N = 10


def run(sigma_deg: float = 0.5, **quality: float | str) -> estimators_Estimate:
    sigmas = {"sigma_tilt": np.full(N, 1e-3), "sigma_heading": np.radians(np.full(N, sigma_deg))}
    told: dict[str, float | str] = {"heading_from": "both", "sigma_tilt_deg": 0.1, "sigma_heading_deg": sigma_deg}
    return estimators_Estimate(np.arange(N) * 0.1, np.tile([1.0, 0, 0, 0], (N, 1)), aux=sigmas, quality=told | quality)


def checked_run(
    monkeypatch: pytest.MonkeyPatch, one: estimators_Estimate, offset: Any = None, changed: float = 0.0
) -> estimators_Estimate:
    monkeypatch.setattr(smoother, "heading_offset_by_gnss", lambda run, inputs: offset)
    monkeypatch.setattr(smoother, "bias_change_dps", lambda inputs: changed)
    none: Any = None
    return smoother.check_heading(one, none)


def gnss(offset: float, sigma: float = 0.1, told: bool = True) -> Any:
    return SimpleNamespace(offset_deg=offset, sigma_deg=sigma, known=told)


@pytest.mark.parametrize(
    ("offset", "sigma", "own", "stands"),
    [
        (2.9, 0.1, 0.1, True),
        (3.1, 0.1, 0.1, False),
        (-3.1, 0.1, 0.1, False),
        (14.9, 3.0, 4.0, True),
        (15.1, 3.0, 4.0, False),
        (-15.1, 3.0, 4.0, False),
    ],
)
def test_a_heading_stands_within_three_degrees_and_three_joint_sigmas_of_gnss(
    monkeypatch: pytest.MonkeyPatch, offset: float, sigma: float, own: float, stands: bool
) -> None:
    found = checked_run(monkeypatch, run(own), gnss(offset, sigma))
    assert (found.quality["heading_from"] == "both") == stands
    assert (found.quality["heading_gnss_deg"], found.quality["heading_gnss_sigma_deg"]) == (offset, sigma)
    if not stands:
        assert f"shows it {abs(offset):.0f} deg off" in str(found.quality["heading_why"])


@pytest.mark.parametrize(("changed", "stands"), [(0.49, True), (0.51, False)])
def test_a_bias_that_changed_by_half_a_degree_per_second_leaves_no_heading(
    monkeypatch: pytest.MonkeyPatch, changed: float, stands: bool
) -> None:
    assert (checked_run(monkeypatch, run(), changed=changed).quality["heading_from"] == "both") == stands
    assert checked_run(monkeypatch, run(gyro_jump_s=5.0), changed=9.0).quality["heading_from"] == "both"


@pytest.mark.parametrize(("sigma", "found"), [(0.99, "motion"), (1.01, "none"), (np.nan, "none")])
def test_without_a_compass_a_heading_stands_that_is_sure_to_a_degree(sigma: float, found: str) -> None:
    alone = smoother.without_compass_twin(run(sigma))
    assert alone.quality["heading_from"] == found
    assert (smoother.OWN_HEADING in alone.aux) == (found == "none")
    assert smoother.by_compass(run(sigma)).quality["heading_from"] == "compass"
