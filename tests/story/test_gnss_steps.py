"""GNSS against its own velocity: a made receiver whose track is a closed form, with and without a planted jump."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Gnss
from attlog.story import gnss_steps

M_PER_DEG = 2.0 * np.pi * 6_371_000.0 / 360.0


def circling(jump_m: float = 0.0, at: float = 18.0, lost: bool = False) -> Gnss:
    """A circle of 20 m radius once in 25 s at 5 Hz, 48 deg north; the position jumps east at ``at`` s."""
    t = np.arange(0.0, 40.0, 0.2)
    turned = 2.0 * np.pi * t / 25.0
    north, east = 20.0 * np.sin(turned), -20.0 * np.cos(turned)
    east = east + np.where(t >= at, jump_m, 0.0)
    speed = 20.0 * 2.0 * np.pi / 25.0
    velocity = np.column_stack([speed * np.cos(turned), speed * np.sin(turned), np.zeros(len(t))])
    none = np.full(len(t), np.nan)
    fix = np.where(lost & (np.abs(t - at) < 1.0), 1, 3).astype(np.int64)
    lat, lon = 48.0 + north / M_PER_DEG, 11.0 + east / (M_PER_DEG * np.cos(np.radians(48.0)))
    return Gnss(0, t, "GPS", lat, lon, none, velocity, none, none, none, fix)


@pytest.mark.parametrize("jump_m", [12.0, -60.0])
def test_a_jump_of_the_position_is_measured(jump_m: float) -> None:
    assert gnss_steps.disagreement([circling(jump_m)], 18.5) == pytest.approx(abs(jump_m), abs=0.5)


def test_a_track_that_follows_its_velocity_is_steady() -> None:
    assert gnss_steps.disagreement([circling()], 18.5) < 0.5 < gnss_steps.STEADY_M


def test_a_jump_long_before_is_another_one() -> None:
    assert gnss_steps.disagreement([circling(30.0, at=5.0)], 18.5) < 0.5


def test_a_lost_fix_is_no_steady_receiver_and_a_short_log_tells_nothing() -> None:
    assert gnss_steps.disagreement([circling(lost=True)], 18.5) == np.inf
    assert np.isnan(gnss_steps.disagreement([circling()], 2.0))
    assert np.isnan(gnss_steps.disagreement([], 18.5))


def cut(first: float, hole: tuple[float, float] = (0.0, 0.0), jump_m: float = 0.0) -> Gnss:
    """The circle from ``first`` s on, without what was received within a hole; a jump at 18 s."""
    whole = circling(jump_m)
    kept = (whole.t >= first - 1e-9) & ~((whole.t > hole[0]) & (whole.t < hole[1]))
    for name in ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix"):
        setattr(whole, name, getattr(whole, name)[kept])
    return whole


@pytest.mark.parametrize(
    ("receiver", "known"),
    [(cut(13.4), True), (cut(13.6), False), (cut(0.0, (14.01, 15.99)), True), (cut(0.0, (14.01, 16.19)), False)],
    ids=["five seconds before", "less", "two seconds of hole", "more"],
)
def test_five_seconds_before_without_a_hole_of_more_than_two_are_needed(receiver: Gnss, known: bool) -> None:
    assert np.isfinite(gnss_steps.disagreement([receiver], 18.5)) == known


@pytest.mark.parametrize(("at", "seen"), [(27.7, True), (28.1, False), (17.1, True), (16.9, False)])
def test_what_lies_from_ten_seconds_before_to_one_after_a_report_counts(at: float, seen: bool) -> None:
    """The jump at 18 s."""
    found = gnss_steps.disagreement([circling(12.0)], at)
    assert (found > 10.0) is seen


def test_a_receiver_that_knows_nothing_leaves_it_to_the_next() -> None:
    blind = circling(40.0)
    blind.vel_ned[:, 0] = np.nan
    late = cut(30.0)
    assert gnss_steps.disagreement([late, blind, circling(12.0)], 18.5) == pytest.approx(12.0, abs=0.5)
