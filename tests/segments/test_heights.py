"""Heights over the ground, of an altitude that is given."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Stream
from attlog.segments.airborne import heights
from attlog.segments.airborne.grid import Grid


def test_a_rangefinder_that_looks_aslant_tells_the_height_and_not_the_slant_range() -> None:
    """It stands 0.2 m up, then hangs at 3 m and rolls by 60 deg, so that the beam is twice as long."""
    t = np.arange(0.0, 20.0, 0.1)
    roll = np.where(t < 15.0, 0.0, np.radians(60.0))
    down = rotation.rotate_inverse(rotation.from_euler(roll, 0.0 * t, 0.0 * t), np.array([0.0, 0.0, 1.0]))
    height = np.where(t < 10.0, 0.2, 3.0)
    none, nothing, all_known = np.full(len(t), np.nan), np.zeros(len(t), bool), np.ones(len(t), bool)
    grid = Grid(t, all_known, np.zeros((len(t), 3)), none, none, none, nothing, none, down, False)
    beam = Stream(t, (height / np.cos(roll))[:, None], "m", "", "distance_sensor:0")
    log = SimpleNamespace(rangefinder=beam, baro=[], gnss=[])
    (level,) = heights.levels_of(log, grid, t >= 10.0)  # type: ignore[arg-type]
    assert level.sensor == "range"
    assert level.above[t > 16.0] == pytest.approx(2.8)
    assert level.above[t < 9.0] == pytest.approx(0.0)


def level(sensor: str, above: np.ndarray) -> heights.Level:
    return heights.Level(sensor, sensor, above)


def test_a_flight_is_as_high_as_a_rangefinder_that_saw_the_ground_nearly_all_the_time_tells() -> None:
    flying = np.arange(200) < 100
    ranged, pressed = np.full(200, 8.0), np.full(200, 9.5)
    ranged[150], pressed[150] = 50.0, 60.0  # after landing
    both = [level("range", ranged), level("barometer", pressed)]
    assert heights.highest(both, flying) == (both[0], 8.0)
    ranged[:4] = np.nan
    assert heights.highest(both, flying) == (both[0], 8.0)
    ranged[:6] = np.nan
    assert heights.highest(both, flying) == (both[1], 9.5)
    pressed[:100] = 0.2
    assert heights.highest(both, flying) == (both[0], 8.0)
    assert heights.highest([level("GNSS", np.full(200, np.nan))], flying) is None


def test_a_rangefinder_beyond_its_range_tells_no_height() -> None:
    """A sonar that reads 6 m all the time while the barometer climbs to 50."""
    flying = np.ones(200, bool)
    sonar, pressed = np.full(200, 6.0), np.linspace(0.0, 14.0, 200)
    both = [level("range", sonar), level("barometer", pressed)]
    assert heights.highest(both, flying) == (both[0], 6.0)
    both[1] = level("barometer", 3.5 * pressed)
    assert heights.highest(both, flying) == (both[1], pytest.approx(49.0))


def test_spikes_of_a_barometer_are_no_height_and_a_fast_climb_is_one() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    climb = np.clip(30.0 * (t - 20.0), 0.0, 300.0)
    spiky = climb.copy()
    spiky[450:453], spiky[454:457] = spiky[450:453] + 180.0, spiky[454:457] - 90.0
    found = heights._averaged(t, Stream(t, spiky[:, None], "m", "", "BARO"))
    assert np.abs(found - climb).max() < 15.0
    assert np.abs(found - climb)[440:470].max() < 1e-9
    assert np.nanmax(found) == pytest.approx(300.0)
