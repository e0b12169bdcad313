"""The accelerometer by GNSS and the compass by the earth's field: planted errors, another in each axis, come back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import FlightLog
from attlog.health import accelerometer, compass_turn
from attlog.health.accelerometer import ForceFit
from attlog.health.check import HealthCase
from attlog.health.compass_turn import TurnFit
from attlog.health.regression import RobustFit
from attlog.reference.model import Reference
from attlog.segments.model import Segment, Segments
from tests.health.made_flight import RATE, SECONDS, attitude, flight
from tests.reference.flights import grouped

FLOWN = Segments([Segment("airborne", 5.0, SECONDS - 5.0)])


def reference(kind: str = "truth", **more: Any) -> Reference:
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    zeros = np.zeros(len(t), np.int64)
    return Reference(kind, "made-up", t, attitude(t), zeros, zeros, rate=RATE, **grouped(**more))  # type: ignore[arg-type]


def pushed(x: float, y: float) -> FlightLog:
    log = flight()
    log.imus[0].acc.x = log.imus[0].acc.x + np.array([x, y, 0.0])
    return log


def checks(log: FlightLog, known: Reference | None = None) -> dict[str, Any]:
    return {
        c.question: c
        for c in accelerometer.accelerometer_checks(HealthCase(log, FLOWN, known or reference()))
        if c.verdict != "unknown"
    }


@pytest.mark.parametrize(("x", "y", "axis", "verdict"), [(0.3, -0.1, "x", "warning"), (0.1, -0.7, "y", "fault")])
def test_an_offset_of_the_force_is_told_by_its_larger_axis_with_its_sign(
    x: float, y: float, axis: str, verdict: str
) -> None:
    found = checks(pushed(x, y))
    assert found["force_axes"].verdict == "ok"
    assert found["accelerometer_offset"].verdict == verdict
    assert found["accelerometer_offset"].value == pytest.approx(x if axis == "x" else y, abs=0.03)
    assert f"too much in {axis} " in found["accelerometer_offset"].text


@pytest.mark.parametrize("words", list(accelerometer.AXIS_ORDERS))
def test_each_order_of_the_horizontal_axes_is_named(words: str) -> None:
    log = flight()
    log.imus[0].acc.x[:, :2] = log.imus[0].acc.x[:, :2] @ np.linalg.inv(accelerometer.AXIS_ORDERS[words]).T
    found = checks(log)
    assert found["force_axes"].verdict == "fault"
    assert found["force_axes"].verdict == "fault"
    assert f": {words} against " in found["force_axes"].text


def test_the_fit_has_the_time_that_was_flown_with_velocities_and_its_matrix_is_the_unit() -> None:
    one = accelerometer.fit_force(pushed(0.2, -0.1), FLOWN, reference())
    assert one is not None
    assert one.seconds == pytest.approx(85.0, abs=0.5)
    np.testing.assert_allclose(one.solution.x[:6], [1.0, 0.0, 0.0, 1.0, -0.2, 0.1], atol=0.03)
    cut = accelerometer.fit_force(pushed(0.0, 0.0), FLOWN, reference(end=60.0))
    assert cut is not None
    assert cut.t.max() <= 60.0
    assert accelerometer.fit_force(pushed(0.0, 0.0), FLOWN, reference(end=25.0)) is None


def test_a_pause_of_the_receiver_neither_bridges_nor_multiplies_its_velocities() -> None:
    log = pushed(0.2, -0.1)
    kept = (log.gnss[0].t < 40.0) | (log.gnss[0].t > 46.0)
    for name in ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix"):
        setattr(log.gnss[0], name, getattr(log.gnss[0], name)[kept])
    one = accelerometer.fit_force(log, FLOWN, reference())
    assert one is not None
    assert not ((one.t > 40.0) & (one.t < 48.0)).any(), "no velocity is differenced across the pause"
    assert np.diff(one.t).min() == pytest.approx(1.0, abs=0.01), "spans of 2 s overlap by half, not by nine tenths"
    np.testing.assert_allclose(one.solution.x[4:6], [-0.2, 0.1], atol=0.03)


def test_a_receiver_that_is_late_spoils_no_offset() -> None:
    log = flight(0.3)
    log.imus[0].acc.x = log.imus[0].acc.x + np.array([0.3, -0.2, 0.0])
    one = accelerometer.fit_force(log, FLOWN, reference())
    assert one is not None
    np.testing.assert_allclose(one.solution.x[4:6], [-0.3, 0.2], atol=0.03)
    assert one.solution.x[0] == pytest.approx(1.0, abs=0.03)


def made_fit(x: float, y: float, sigma: float) -> ForceFit:
    covariance = np.zeros((8, 8))
    covariance[4, 4] = covariance[5, 5] = sigma**2
    solution = RobustFit(np.array([1.0, 0.0, 0.0, 1.0, -x, -y, 0.0, 0.0]), covariance, 0.1, 20)
    return ForceFit(solution, np.zeros((10, 2, 8)), np.zeros((10, 2)), np.arange(10.0), 40.0)


@pytest.mark.parametrize(
    ("x", "sigma", "verdict"),
    [
        (0.16, 0.0, "ok"),
        (0.18, 0.0, "warning"),
        (-0.49, 0.0, "warning"),
        (-0.51, 0.0, "fault"),
        (0.29, 0.05, "ok"),  # four times hypot(0.075, 0.03) are 0.323
        (0.35, 0.05, "warning"),
        (0.9, 0.09, "unknown"),
    ],
)
def test_an_offset_is_told_beyond_its_limit_and_four_sigmas(x: float, sigma: float, verdict: str) -> None:
    assert accelerometer._force_offset_check(flight(), made_fit(x, 0.0, sigma), reference()).verdict == verdict
    assert accelerometer._force_offset_check(flight(), made_fit(0.0, x, sigma), reference()).verdict == verdict


EARTH = np.array([21.0, 2.0, 44.0])


def field(turn_deg: float = 0.0, offset: tuple[float, float, float] = (0.0, 0.0, 0.0), turns: float = 1.0) -> TurnFit:
    """What a compass turned about the vehicle's vertical, with an offset, shows in a flight whose heading swings."""
    t = np.arange(0.0, 100.0, 0.1)
    heading = turns * 3.0 * np.sin(0.2 * t)
    u = rotation.rotate_inverse(rotation.from_euler(0.0 * t, 0.0 * t, heading), EARTH)
    m = rotation.rotate_inverse(rotation.from_euler(0.0, 0.0, np.radians(turn_deg))[None], u) + np.array(offset)
    m = m + np.random.default_rng(1).normal(size=m.shape) * 0.2
    found = compass_turn.fit_simplest(t, u, m, 100.0)
    assert found is not None
    return found


@pytest.mark.parametrize("turn_deg", [-25.0, 12.0])
def test_a_compass_that_is_mounted_askew_has_a_turn_and_no_offset(turn_deg: float) -> None:
    found = field(turn_deg)
    assert found.turn_deg == pytest.approx(turn_deg, abs=0.3)
    np.testing.assert_allclose(found.offset, 0.0, atol=0.1)
    assert found.one_fault


@pytest.mark.parametrize("offset", [(8.0, -3.0, 5.0), (-2.0, 9.0, -6.0)])
def test_iron_is_an_offset_in_each_axis_and_no_turn(offset: tuple[float, float, float]) -> None:
    found = field(0.0, offset)
    np.testing.assert_allclose(found.offset, offset, atol=0.3)
    assert abs(found.turn_deg) < 1.0
    assert found.one_fault
    level, down = np.hypot(21.0, 2.0), 44.0
    tilt = np.radians(0.8)
    assert found.offset_sigma[2] == pytest.approx(
        np.sqrt((tilt * level) ** 2 + (0.01 * np.hypot(level, down)) ** 2 + 0.09)
    )
    assert found.offset_sigma[0] >= np.hypot(tilt * down, 0.3)


def test_a_turn_and_an_offset_together_are_no_single_fault() -> None:
    found = field(30.0, (8.0, -3.0, 0.0))
    assert not found.one_fault
    assert found.turn_deg == pytest.approx(30.0, abs=1.0)
    np.testing.assert_allclose(found.offset[:2], [8.0, -3.0], atol=0.5)


def known(turn: float = 0.0, turn_sigma: float = 0.5, offset: tuple[float, float] = (0.0, 0.0), **more: Any) -> TurnFit:
    sigma = np.full(3, more.pop("sigma", 0.4))
    return TurnFit(np.array([*offset, 0.0]), sigma, turn, turn_sigma, 0.5, 500, 90.0, **more)


@pytest.mark.parametrize(
    ("turn", "sigma", "verdict"),
    [
        (-9.9, 1.0, "ok"),
        (10.1, 1.0, "warning"),
        (-19.9, 1.0, "warning"),
        (20.1, 1.0, "fault"),
        (11.0, 3.0, "ok"),
        (13.0, 3.0, "warning"),
        (3.0, 5.1, "unknown"),
        (3.0, 4.9, "ok"),
    ],
)
def test_a_turn_is_told_beyond_ten_degrees_and_four_sigmas(turn: float, sigma: float, verdict: str) -> None:
    check = compass_turn.fit_checks("MAG:0", known(turn, sigma), reference())[1]
    assert check.verdict == verdict
    if verdict != "unknown":
        assert f" {'clockwise' if turn > 0 else 'anticlockwise'} " in check.text
        assert f"± {1.96 * sigma:.0f} deg" in check.text


@pytest.mark.parametrize(
    ("offset", "sigma", "verdict"),
    [
        ((3.0, -3.9), 0.4, "ok"),
        ((3.0, -4.1), 0.4, "warning"),
        ((-9.0, 11.9), 0.4, "warning"),
        ((9.0, 12.1), 0.4, "fault"),
        ((3.0, 4.1), 1.3, "ok"),
        ((1.0, 1.0), 3.8, "unknown"),
        ((1.0, 1.0), 3.7, "ok"),
    ],
)
def test_an_offset_is_told_by_its_horizontal_size(offset: tuple[float, float], sigma: float, verdict: str) -> None:
    found = compass_turn.fit_checks("MAG:0", known(offset=offset, sigma=sigma), reference())[0]
    assert found.verdict == verdict


def test_what_no_single_fault_explains_is_told_against_truth_alone_and_what_changes_not_at_all() -> None:
    both, moving, turned = known(30.0, 1.0, one_fault=False), known(30.0, 1.0, steady=False), known(30.0, 1.0)
    for fit, by, verdict in (
        (both, "truth", "fault"),
        (both, "onboard", "unknown"),
        (moving, "truth", "unknown"),
        (turned, "onboard", "fault"),
    ):
        assert compass_turn.fit_checks("MAG:0", fit, reference(by))[1].verdict == verdict
