"""Errors are taken where both attitudes are known: never upsampled, never across a gap or a reset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog.base import rotation
from attlog.reference import compare
from attlog.reference.model import Reference

from .flights import attitude_at, compared, estimate, flight, sampled


def reference_of(t, q, segment=None, run=None) -> Reference:
    """A reference without a log."""
    zeros = np.zeros(len(t), np.int64)
    rate = (len(t) - 1) / (t[-1] - t[0])
    return Reference(
        "truth", "SIM", t, q, zeros if run is None else run, zeros if segment is None else segment, rate=rate
    )


def errors(t, q, ref, run=None):
    """Errors of a row."""
    return compare.errors(t, q, np.zeros(len(t), np.int64) if run is None else run, ref)


def test_a_fast_row_is_compared_at_the_slow_references_own_times():
    """The trap: a 10 Hz reference drawn out to 100 Hz would show its own interpolation as the row's error."""
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 0.01)
    found = errors(t, attitude_at(t), ref)
    np.testing.assert_array_equal(found.t, ref.t[ref.t <= t[-1]])
    assert found.total.max() < 0.01
    drawn_out = rotation.slerp(ref.t, ref.q, t[t <= ref.t[-1]])
    lost = np.degrees(rotation.total_angle(rotation.error(attitude_at(t[t <= ref.t[-1]]), drawn_out)))
    assert lost.max() > 2 * found.total.max()


def test_a_slow_row_is_compared_at_its_own_times():
    ref = reference_of((fast := sampled(50.0)).t, fast.q)
    slow = sampled(10.0)
    found = errors(slow.t + 0.003, attitude_at(slow.t + 0.003), ref)
    assert len(found.t) == np.count_nonzero(slow.t + 0.003 <= ref.t[-1])
    assert found.total.max() < 0.01


def test_nothing_is_compared_across_a_gap_of_the_row():
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 0.01)
    t = t[(t < 30.0) | (t > 30.3)]
    found = errors(t, attitude_at(t), ref)
    assert not np.any((found.t > 30.0) & (found.t < 30.3))
    assert found.total.max() < 0.01
    assert np.unique(found.gap_segment).tolist() == [0, 1]


def test_nothing_is_compared_across_a_gap_or_reset_of_the_reference():
    slow = sampled(10.0)
    segment = (slow.t >= 30.0).astype(np.int64)
    q = np.where(segment[:, None], rotation.turn_about_down(slow.q, np.radians(40.0)), slow.q)
    ref = reference_of(slow.t, q, segment)
    own = np.arange(0.05, 59, 0.1)
    found = errors(own, attitude_at(own), ref)
    assert not np.any((found.t > 29.9) & (found.t < 30.0))
    assert set(np.round(found.heading, 1)) <= {0.0, -0.0, -40.0}
    assert np.flatnonzero(np.diff(found.segment)).tolist() == [np.searchsorted(found.t, 30.0) - 1]


def test_a_restart_of_the_row_begins_a_run():
    ref = reference_of((slow := sampled(20.0)).t, slow.q)
    t = np.arange(0, 60, 0.01)
    found = errors(t, attitude_at(t), ref, (t >= 25).astype(np.int64))
    assert found.gap_segment[-1] == 1
    assert found.t[np.argmax(found.gap_segment == 1)] == pytest.approx(25.0, abs=0.051)


def test_heading_errors_wrap_and_never_read_as_a_full_turn():
    """The flight turns through south: headings of +179 and -179 are 2 deg apart."""
    row, _, _ = compared(flight(), estimate(heading_deg=2.0))
    assert row.errors is not None
    np.testing.assert_allclose(row.errors.heading, 2.0, atol=0.05)
    np.testing.assert_allclose(row.errors.total, 2.0, atol=0.05)
    np.testing.assert_allclose(row.errors.inclination, 0.0, atol=0.05)


def test_errors_are_those_put_in():
    row, _, _ = compared(flight(), estimate(heading_deg=-5.0, tilt_deg=3.0))
    assert row.errors is not None
    np.testing.assert_allclose(row.errors.heading, -5.0, atol=0.05)
    np.testing.assert_allclose(row.errors.inclination, 3.0, atol=0.05)


def test_attitudes_without_common_time_have_no_errors():
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(100.0, 110.0, 0.01)
    assert len(errors(t, attitude_at(t), ref).t) == 0
    assert len(errors(np.zeros(0), np.zeros((0, 4)), ref).t) == 0


@settings(max_examples=25, deadline=None)
@given(yaw=st.floats(-3.1, 3.1), shift=st.floats(-1e4, 1e4))
def test_errors_depend_neither_on_north_nor_on_the_clock(yaw, shift):
    """Yaw equivariance and time shift invariance, whatever the signs of the quaternions."""
    slow = sampled(10.0)
    t = np.arange(0, 60, 0.02)
    q = rotation.multiply(rotation.from_rotvec(np.radians([2.0, -1.0, 4.0])), attitude_at(t))
    plain = errors(t, q, reference_of(slow.t, slow.q))
    signs = np.where(np.arange(len(t)) % 3, 1.0, -1.0)[:, None]
    ref = reference_of(slow.t + shift, rotation.turn_about_down(slow.q, yaw))
    moved = errors(t + shift, signs * rotation.turn_about_down(q, yaw), ref)
    assert abs(len(moved.t) - len(plain.t)) <= 1
    n = min(len(moved.t), len(plain.t))
    np.testing.assert_allclose(moved.heading[1 : n - 1], plain.heading[1 : n - 1], atol=1e-5)
    np.testing.assert_allclose(moved.total[1 : n - 1], plain.total[1 : n - 1], atol=1e-5)
    np.testing.assert_allclose(moved.inclination.mean(), plain.inclination.mean(), atol=1e-3)


@pytest.mark.parametrize("hz", [100.0, 4.0])
def test_rows_of_the_same_times_share_what_they_are_compared_with_and_no_others_do(hz):
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 1.0 / hz)
    q = attitude_at(t)
    lost = q.copy()
    lost[len(t) // 2] = np.nan
    first, same, holed, later = (errors(at, x, ref) for at, x in ((t, q), (t, q), (t, lost), (t + 0.01, q)))
    assert same.q_ref is first.q_ref
    assert same.t is first.t
    for found, at, x in ((holed, t, lost), (later, t + 0.01, q)):
        alone = errors(at, x, reference_of(slow.t, slow.q))
        assert found.q_ref is not first.q_ref
        for name in ("t", "q_est", "q_ref", "total", "segment", "gap_segment", "scored"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


def test_scoring_one_row_leaves_the_next_alone():
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 0.01)
    first = errors(t, attitude_at(t), ref)
    first.scored[:] = False
    assert errors(t, attitude_at(t), ref).scored.any()
