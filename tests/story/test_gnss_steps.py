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
