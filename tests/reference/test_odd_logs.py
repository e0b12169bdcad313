"""Logs of any shape get segments, a reference and rows without an exception or a warning."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog import segments, story
from attlog.estimators.base import Estimate
from attlog.flight.model import Attitude, FlightLog, Gnss, Mag, Stream, TimeLine
from attlog.reference import choose, heading_references, onboard_rows, replayed
from tests.segments.flights import imu_log

count = st.integers(0, 40)
steps = st.sampled_from([0.0, 0.0025, 0.02, 0.1, 0.4, 3.0, 900.0])
values = st.sampled_from([0.0, 1.0, -9.81, 40.0, np.nan, 1e-9])


@st.composite
def times(draw: st.DrawFn, least: int = 0) -> np.ndarray:
    """Ascending times with repeats, gaps and jumps."""
    n = max(draw(count), least)
    return draw(st.floats(-5, 5)) + np.cumsum([draw(steps) for _ in range(n)] or [0.0])[:n]


def filled(draw: st.DrawFn, n: int, k: int) -> np.ndarray:
    """Values of any kind."""
    return np.array([draw(values) for _ in range(n * k)]).reshape(n, k)


@st.composite
def attitudes(draw: st.DrawFn, source: str) -> Attitude:
    """An attitude that may be anything."""
    t = draw(times())
    resets = np.unique([draw(st.integers(0, 50)) for _ in range(draw(st.integers(0, 3)))]).astype(np.int64)
    return Attitude(t, filled(draw, len(t), 4), source, resets=resets, has_trim=draw(st.booleans()))


@st.composite
def flags(draw: st.DrawFn, source: str) -> TimeLine | None:
    """A flag, or none."""
    t = draw(times())[:4]
    return None if draw(st.booleans()) else TimeLine(t, [draw(st.booleans()) for _ in t], source)


@st.composite
def logs(draw: st.DrawFn) -> FlightLog:
    """A log in which every part may be missing, short, constant, or no number."""
    t = draw(times())
    log = imu_log(t, filled(draw, len(t), 3), filled(draw, len(t), 3))
    if draw(st.booleans()):
        log.attitudes, log.onboard = {"ATT": draw(attitudes("ATT")), "AHR2": draw(attitudes("AHR2"))}, "ATT"
    log.truth = draw(attitudes("SIM")) if draw(st.booleans()) else None
    log.armed, log.landed = draw(flags("vehicle_status")), draw(flags("EV"))
    tm = draw(times(1))
    log.mags, log.mag = [Mag(0, Stream(tm, filled(draw, len(tm), 3), "T", "FRD", "MAG"))], 0
    n = len(tm)
    one = np.ones(n)
    log.gnss = [
        Gnss(
            0, tm, "GPS", filled(draw, n, 1)[:, 0], one, one, filled(draw, n, 3), one, one, one, np.full(n, 3), yaw=one
        )
    ]
    log.throttle = Stream(tm, filled(draw, n, 1), "1", "", "CTUN")
    log.baro = [Stream(tm, filled(draw, n, 1), "m", "", "BARO")]
    if draw(st.booleans()):
        log.imus, log.imu = [], None
    return log


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(log=logs(), e=st.data())
def test_nothing_in_a_log_breaks_the_comparison(log, e):
    found = segments.build(log)
    assert all(s.t1 >= s.t0 and s.kind in segments.KINDS and s.why for s in found.segments)
    happened = story.events(log, found)
    assert all(e.text and e.evidence and np.isfinite(e.t) for e in happened)
    reference = choose(log, found)
    assert len(reference.t) == len(reference.q) == len(reference.segment) == len(reference.gap_segment)
    rows = onboard_rows(log, found, reference)
    t = e.draw(times(1))
    rows.append(replayed(log, found, reference, Estimate(t, filled(e.draw, len(t), 4)), name="made", uses_mag=False))
    for row in rows:
        assert row.coverage_pct is None or 0 <= row.coverage_pct <= 100
        assert row.errors is None or np.isfinite(row.errors.heading).all()
    for heading_reference in heading_references(log, found, reference).values():
        assert np.isfinite(heading_reference.heading_deg).all()
