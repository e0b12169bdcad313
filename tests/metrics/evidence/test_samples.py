import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from attlog.base import rotation
from attlog.metrics.drift import slope as drift
from attlog.metrics.evidence import samples as evidence


def test_stretches_end_at_gaps_and_restarts():
    t = np.concatenate([np.arange(0.0, 5.0, 0.01), np.arange(6.0, 9.0, 0.01)])
    run = (t > 7.5).astype(np.int64)
    found = evidence.within(t, (1.0, 8.5), run)
    assert [(round(t[s.start], 2), round(t[s.stop - 1], 2)) for s in found] == [(1.0, 4.99), (6.0, 7.5), (7.51, 8.5)]
    assert evidence.within(t, (5.2, 5.8)) == []
    assert evidence.within(np.zeros(0), (0.0, 1.0)) == []


@given(st.lists(st.tuples(st.floats(0.005, 0.2), st.booleans()), min_size=1, max_size=200))
def test_stretches_cover_what_is_inside_once_and_nothing_else(samples):
    t = np.cumsum([s for s, _ in samples])
    inside = np.array([b for _, b in samples])
    found = evidence.unbroken(t, inside)
    index = np.concatenate([np.arange(s.start, s.stop) for s in found]) if found else np.zeros(0, int)
    np.testing.assert_array_equal(index, np.flatnonzero(inside))


@given(slope=st.floats(-20, 20), offset=st.floats(-1000, 1000), begin=st.floats(0, 1e5), jump=st.floats(-170, 170))
def test_a_line_has_its_own_slope_wherever_it_starts_and_jumps(slope, offset, begin, jump):
    t = begin + np.arange(0.0, 60.0, 0.1)
    segment = (t > begin + 33.0).astype(np.int64)
    e = (offset + slope / 60.0 * (t - begin) + jump * segment + 180.0) % 360.0 - 180.0
    found = drift.slope(drift.block_means(t, e, segment))
    assert abs(found.value - slope) < 1e-5
    assert found.wander < 1e-5


def test_a_heading_that_wanders_is_no_tilt_however_the_vehicle_lies():
    wander = np.radians(np.sin(np.linspace(0.0, 20.0, 400)))
    found = evidence.deviations(rotation.from_euler(0.6 + 0 * wander, -0.3 + 0 * wander, 1.2 + wander))
    np.testing.assert_allclose(found[:, :2], 0.0, atol=1e-6)
    np.testing.assert_allclose(found[:, 2], np.degrees(wander - np.mean(wander)), atol=1e-3)


def test_tilt_is_told_about_the_vehicles_own_roll_and_pitch_axis_whatever_its_heading():
    nod = np.radians(np.sin(np.linspace(0.0, 20.0, 400)))
    for axis, q in enumerate((rotation.from_euler(nod, 0 * nod, 2.0), rotation.from_euler(0 * nod, nod, 2.0))):
        found = evidence.deviations(q)
        np.testing.assert_allclose(found[:, axis], np.degrees(nod - np.mean(nod)), atol=1e-3)
        np.testing.assert_allclose(found[:, 1 - axis], 0.0, atol=1e-6)
