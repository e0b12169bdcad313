"""Which logs are of one flight?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import flight as flights
from attlog.compare.same_flight import FlightTrack, find_repeats, flight_track, same_flight
from attlog.core import rotation
from attlog.flight.model import FlightLog
from tests.reference.flights import attitude_at, flight


def recorded(onboard_hz: float, boot_s: float = 40.0, begin: float = 0.0) -> FlightLog:
    """A record of one flight that begins some seconds after the other's."""
    log = flight(60.0, onboard_hz=onboard_hz)
    log.t0_us = round(1e6 * (boot_s + begin))
    attitude = log.attitudes["ATT"]
    kept = attitude.t >= begin
    log.attitudes["ATT"] = replace(attitude, t=attitude.t[kept] - begin, q=attitude.q[kept])
    return log


def swayed(seed: int, seconds: float = 60.0) -> FlightTrack:
    """Another vehicle: its attitude is moved by gusts of its own, of half a degree."""
    t = np.arange(0.0, seconds, 0.2)
    gusts = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.2, (len(t), 3)), axis=0)
    q = rotation.multiply(attitude_at(t), rotation.from_rotvec(np.radians(gusts)))
    return FlightTrack(f"{seed}", "", 100.0, 200, q)


def test_a_card_and_a_radio_record_one_flight_each_with_its_own_rate_and_begin() -> None:
    card, radio = flight_track(recorded(25.0), "a.bin"), flight_track(recorded(4.0, begin=7.3), "a.tlog")
    assert same_flight(card, radio)
    assert same_flight(radio, card)


def test_two_vehicles_that_fly_the_same_at_the_same_time_are_two_flights() -> None:
    assert not same_flight(swayed(1), swayed(2))
    assert same_flight(swayed(1), swayed(1))


def test_the_same_motion_at_another_time_since_boot_is_another_flight() -> None:
    assert not same_flight(flight_track(recorded(25.0), "a"), flight_track(recorded(25.0, boot_s=43.0), "b"))


def test_vehicles_that_stand_still_are_one_only_by_their_content() -> None:
    still = FlightTrack("a", "", 100.0, 0, np.tile([1.0, 0.0, 0.0, 0.0], (300, 1)))
    assert not same_flight(still, replace(still, name="b"))
    assert same_flight(replace(still, sha256="5f"), replace(still, name="b", sha256="5f"))


def test_a_common_part_that_is_short_proves_nothing() -> None:
    whole = swayed(1)
    late = replace(whole, first=whole.first + 220, q=whole.q[220:])  # 16 s of it
    assert not same_flight(whole, late)
    half = replace(whole, first=whole.first + 120, q=np.concatenate([whole.q[120:], swayed(2, 100.0).q[:200]]))
    assert not same_flight(whole, replace(half, q=np.where(np.arange(len(half.q))[:, None] < 100, half.q, np.nan)))


def test_the_higher_rate_counts_and_of_equal_ones_the_first() -> None:
    one = swayed(1)
    tracks = [replace(one, name="a.tlog", rate_hz=10.0), replace(one, name="a.bin"), replace(one, name="copy.bin")]
    assert find_repeats([*tracks, swayed(2)]) == {"a.tlog": "a.bin", "copy.bin": "a.bin"}


def test_a_log_without_an_onboard_attitude_is_like_no_other() -> None:
    log = recorded(25.0)
    log.onboard = None
    nothing = flight_track(log, "a")
    assert not same_flight(nothing, flight_track(recorded(25.0), "b"))
    assert not same_flight(nothing, nothing)


@pytest.mark.parametrize("name", ["copter_steps_stabilize", "copter_yaw_turns", "plane_fbwa_cruise"])
def test_flights_that_were_logged_twice_are_found(corpus: Path, name: str) -> None:
    folder = corpus / "sitl" / "ardupilot"
    tracks = [flight_track(flights.read(folder / f), f) for f in (name + ".bin", name + ".tlog", "copter_long.bin")]
    assert find_repeats(tracks) == {name + ".tlog": name + ".bin"}


@pytest.mark.parametrize(("steps", "same"), [(100, True), (99, False)])
def test_twenty_seconds_in_common_are_enough(steps: int, same: bool) -> None:
    whole = swayed(1, 20.0)
    part = replace(whole, q=np.where(np.arange(len(whole.q))[:, None] < steps, whole.q, np.nan))
    assert same_flight(whole, part) is same
    assert same_flight(part, whole) is same


@pytest.mark.parametrize(("share", "same"), [(0.5, True), (0.49, False)])
def test_half_of_the_shorter_log_is_in_common(share: float, same: bool) -> None:
    a = swayed(1, 60.0)
    common = round(share * 300)
    b = replace(a, first=a.first + 300 - common, q=np.concatenate([a.q[300 - common :], a.q])[:300])
    assert same_flight(a, b) is same


@pytest.mark.parametrize(("apart_deg", "same"), [(0.19, True), (0.21, False)])
def test_attitudes_that_are_equal_to_a_fifth_of_a_degree_are_of_one_flight(apart_deg: float, same: bool) -> None:
    a = swayed(1)
    b = replace(
        a, q=rotation.multiply(a.q, rotation.from_rotvec(np.radians([[0.6 * apart_deg, 0.0, 0.8 * apart_deg]])))
    )
    assert same_flight(a, b) is same


@pytest.mark.parametrize(("size_deg", "same"), [(2.7, False), (2.95, True)])
def test_two_degrees_of_motion_tell_flights_apart(size_deg: float, same: bool) -> None:
    """A sine has its size over the root of two."""
    t = np.arange(0.0, 60.0, 0.2)
    swing = np.radians(size_deg) * np.column_stack([np.sin(2.0 * np.pi * t / 6.0), 0.0 * t, 0.0 * t])
    one = FlightTrack("a", "", 100.0, 0, rotation.from_rotvec(swing))
    assert same_flight(one, replace(one, name="b")) is same
