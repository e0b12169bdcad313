"""Set-points from commands, by closed forms and without a simulator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.base import rotation
from attlog.simulate.autopilot.controller import ENGAGED, THRUST
from attlog.simulate.autopilot.guidance import BRAKING_M_S2, Guidance, _lean
from attlog.simulate.autopilot.loop import Controller
from attlog.simulate.scenario.commands import Command

G, HOVER, DT = 9.81, 0.43, 0.0025
LEVEL, NOWHERE = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
UP = (Command(t=0.0, do="arm"), Command(t=0.0, do="takeoff", up_m=0.0))


def after(
    *commands: Command,
    seconds: float,
    placed: bool = True,
    p: np.ndarray = NOWHERE,
    v: np.ndarray = NOWHERE,
    q: np.ndarray = LEVEL,
) -> Guidance:
    """The guidance of a vehicle that is held where it is, ``seconds`` later."""
    made = Guidance((*UP, *commands), Controller(), HOVER, G)
    for k in range(round(seconds / DT) + 1):
        made.step(k * DT, DT, q, p, v, placed)
    return made


def wanted(made: Guidance) -> np.ndarray:
    return np.degrees(rotation.to_euler(made.command[:4]))


def test_the_lean_points_the_thrust_where_the_acceleration_is() -> None:
    rng = np.random.default_rng(1)
    for north, east, heading in zip(*rng.uniform(-2.5, 2.5, (3, 100)), strict=True):
        roll, pitch = _lean(north, east, G + 1.0, heading, 60.0)
        thrust = rotation.rotate(rotation.from_euler(roll, pitch, heading), np.array([0.0, 0.0, -1.0]))
        np.testing.assert_allclose(thrust / -thrust[2], [north / (G + 1.0), east / (G + 1.0), -1.0], atol=1e-12)


def test_the_lean_is_limited_and_keeps_its_direction() -> None:
    roll, pitch = _lean(30.0, 40.0, G, 0.3, 35.0)
    thrust = rotation.rotate(rotation.from_euler(roll, pitch, 0.3), np.array([0.0, 0.0, -1.0]))
    assert math.degrees(math.acos(-thrust[2])) == pytest.approx(35.0)
    assert math.atan2(thrust[1], thrust[0]) == pytest.approx(math.atan2(40.0, 30.0))


def test_hovering_where_it_shall_be_asks_for_level_and_for_the_weight() -> None:
    made = after(seconds=3.0)
    assert wanted(made) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert made.command[THRUST] == pytest.approx(HOVER)
    assert made.command[ENGAGED] == 1.0


def test_the_thrust_grows_with_the_tilt_that_it_has() -> None:
    tilted = rotation.from_euler(np.radians(40.0), 0.0, 0.0)
    assert after(seconds=0.5, q=tilted).command[THRUST] == pytest.approx(HOVER / math.cos(math.radians(40.0)))


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_tracking_is_the_wave_that_was_asked_for(axis: str) -> None:
    index = ("roll", "pitch").index(axis)
    for shape, seconds, angle in (
        ("sine", 0.5, 10.0),
        ("sine", 1.0, 0.0),
        ("sine", 1.5, -10.0),
        ("square", 0.3, 10.0),
        ("square", 1.3, -10.0),
    ):
        wave = Command(t=1.0, do="track", axis=axis, shape=shape, amplitude_deg=10.0, period_s=2.0)
        found = wanted(after(wave, seconds=1.0 + seconds))
        assert found[index] == pytest.approx(angle, abs=0.02)
        assert found[1 - index] == pytest.approx(0.0, abs=1e-9)


def test_an_attitude_command_counts_in_the_heading_it_has() -> None:
    east = rotation.from_euler(0.0, 0.0, np.pi / 2)
    found = wanted(after(Command(t=1.0, do="attitude", roll_deg=12.0, pitch_deg=-7.0), seconds=1.1, q=east))
    assert found == pytest.approx([12.0, -7.0, 90.0])


def test_the_heading_turns_at_its_rate_the_shorter_way() -> None:
    start = rotation.from_euler(0.0, 0.0, np.radians(170.0))
    turn = Command(t=1.0, do="hold", heading_deg=-160.0, yaw_rate_dps=20.0)
    assert wanted(after(turn, seconds=1.25, q=start))[2] == pytest.approx(175.0, abs=0.1)
    assert wanted(after(turn, seconds=2.0, q=start))[2] == pytest.approx(-170.0, abs=0.1)
    assert wanted(after(turn, seconds=4.0, q=start))[2] == pytest.approx(-160.0, abs=0.1)


def test_the_point_that_is_followed_gathers_speed_gently() -> None:
    made = after(Command(t=1.0, do="goto", north_m=100.0, speed_m_s=4.0), seconds=3.0)
    assert made._path[0] == pytest.approx(0.5 * BRAKING_M_S2 * 2.0**2, rel=0.01)
    made = after(Command(t=1.0, do="goto", north_m=5.0, speed_m_s=4.0), seconds=15.0)
    assert made._path == pytest.approx([5.0, 0.0], abs=0.01)


def test_without_a_position_it_asks_for_level() -> None:
    moving = np.array([3.0, -2.0, 0.0])
    far = Command(t=1.0, do="goto", north_m=100.0)
    assert wanted(after(far, seconds=3.0, placed=False, v=moving)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert wanted(after(far, seconds=3.0, v=moving))[1] != pytest.approx(0.0, abs=1.0)


def test_before_it_is_armed_and_after_it_is_disarmed_rotors_stand() -> None:
    made = Guidance((), Controller(), HOVER, G)
    made.step(0.0, DT, LEVEL, NOWHERE, NOWHERE, True)
    assert (made.armed, made.landed, made.command[ENGAGED]) == (False, True, 0.0)
    made = after(Command(t=1.0, do="disarm"), seconds=1.1)
    assert (made.armed, made.command[ENGAGED]) == (False, 0.0)


def test_it_has_landed_when_it_does_not_sink_any_more_and_disarms_itself() -> None:
    sinking, landing = np.array([0.0, 0.0, 0.5]), Command(t=1.0, do="land")
    assert not after(landing, seconds=6.0, v=sinking).landed
    made = after(landing, seconds=3.0)
    assert (made.landed, made.armed, made.mode) == (True, True, "LAND")
    assert not after(landing, seconds=6.0).armed


def test_what_has_not_begun_to_sink_has_not_landed() -> None:
    """For 0.9 s after the command it still stands in the air; on the ground it is landed after 0.6 s."""
    made = after(seconds=3.0)
    made._commands += (Command(t=3.0, do="land"),)
    for k in range(round(4.0 / DT)):
        t = 3.0 + k * DT
        sinking = 0.9 <= t - 3.0 < 2.0
        made.step(t, DT, LEVEL, NOWHERE, np.array([0.0, 0.0, 0.5 if sinking else 0.0]), True)
        assert made.landed == (t - 3.0 > 2.0 + 0.6 + DT) or abs(t - 5.6) < 3 * DT
