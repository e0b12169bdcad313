"""When a sensor measures: rasters, phases, jitter and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.simulate.sensors.timing import instants, kept


def test_a_raster_begins_its_phase_after_zero_and_ends_with_the_flight() -> None:
    random = np.random.default_rng(0)
    assert instants(4.0, 1.0, 0.0, random) == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert instants(4.0, 1.0, 0.0, random, phase=0.5) == pytest.approx([0.125, 0.375, 0.625, 0.875])
    assert instants(4.0, 1.1, 0.0, random, phase=0.0) == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_jitter_stays_within_0_45_of_a_period_to_both_sides() -> None:
    """At 4 Hz with a jitter of a second nearly all are at the limits."""
    t = instants(4.0, 400.0, 1.0, np.random.default_rng(1))
    off = np.concatenate([t - 0.25 * np.rint(t / 0.25)])
    assert np.abs(off).max() == pytest.approx(0.45 * 0.25)
    assert (off.min(), off.max()) == pytest.approx((-0.1125, 0.1125))
    assert (np.diff(t) > 0.0).all()
    assert 0.0 < t[0]
    assert t[-1] <= 400.0


def test_a_gap_takes_its_beginning_and_leaves_its_end() -> None:
    t = np.arange(10.0)
    random = np.random.default_rng(2)
    assert t[kept(t, 0.0, ((2.0, 5.0), (8.0, 8.5)), random)].tolist() == [0.0, 1.0, 5.0, 6.0, 7.0, 9.0]
    assert kept(np.zeros(20_000), 30.0, (), random).mean() == pytest.approx(0.7, abs=0.02)
    assert not kept(t, 100.0, (), random).any()
