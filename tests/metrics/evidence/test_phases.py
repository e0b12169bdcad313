import numpy as np
import pytest

from attlog.metrics.evidence import phases
from attlog.metrics.noise import windows
from attlog.segments.model import Segment
from tests.metrics import flights


def row(t0=0.0, t1=120.0, hz=20.0, **fields):
    t = np.arange(t0, t1, 1.0 / hz)
    return flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), start=t0, **fields)


FLIGHT = [
    Segment("continuous", 0, 120),
    Segment("rest.long", 0, 31),
    Segment("armed", 31, 90),
    Segment("idle", 31, 38),
    Segment("airborne", 40, 88),
    Segment("hover", 42, 60),
    Segment("cruise", 60, 88),
    Segment("rest.long", 90, 118),
]


def starts(case, row, phase):
    return [w[0] for group in windows.of_row(case, row, phase, phase) for w, _ in group]


def test_a_row_settles_for_10_s_after_its_start_and_5_s_after_the_motors_stop():
    own = row()
    case = flights.case([own], FLIGHT)
    assert phases.rest_spans(case, own, "rest") == [(10.0, 31.0), (95.0, 118.0)]
    assert starts(case, own, "rest") == [10.0, 15.0, 20.0, 25.0, 95.0, 100.0, 105.0, 110.0]


def test_windows_lie_at_the_same_times_for_a_row_that_starts_later():
    late = row(7.0)
    case = flights.case([late], FLIGHT)
    assert starts(case, late, "rest") == [20.0, 25.0, 95.0, 100.0, 105.0, 110.0]


def test_after_a_restart_a_row_settles_again_and_no_window_crosses_it():
    segments = [Segment("continuous", 0, 30), Segment("continuous", 33, 120), Segment("rest.long", 0, 120)]
    own = row()
    own.segment = (own.t > 33).astype(np.int64)
    case = flights.case([own], segments)
    assert starts(case, own, "rest")[:5] == [10.0, 15.0, 20.0, 25.0, 43.0]


def test_an_onboard_row_counts_from_the_reset_that_aligned_it():
    own = row()
    own.kind = "onboard"
    aligned = [Segment("reset", 12.0, 12.05), Segment("reset", 70.0, 70.05)]
    case = flights.case([own], FLIGHT + aligned)
    assert phases.own_start(case, own) == pytest.approx(22.05)


def test_phases_are_never_pooled_and_a_window_of_the_users_own_is_the_first_phase_in_it():
    case = flights.case([row()], FLIGHT)
    told = {w: phases.phase_of(case, w) for w in ("all", "rest", "hover", "cruise", "idle", "airborne", "armed")}
    assert told == {
        "all": "rest",
        "rest": "rest",
        "hover": "hover",
        "cruise": "cruise",
        "idle": "idle",
        "airborne": None,
        "armed": None,
    }
    assert phases.phase_of(case, "45:80") == "hover"
    assert phases.phase_of(case, "62:80") == "cruise"
    assert phases.phase_of(case, "20:80") == "rest"


def test_in_the_air_windows_begin_at_the_scoring_start_and_end_at_the_impact():
    own = row()
    case = flights.case([own], FLIGHT, (own.t, own.q), scoring_start=50.0)
    case.reference.end = 71.0
    assert (starts(case, own, "hover"), starts(case, own, "cruise")) == ([50.0, 55.0], [60.0, 65.0])
    case.forget()
    case.reference.unscored = [(52.0, 67.0)]
    assert (starts(case, own, "hover"), starts(case, own, "cruise")) == ([], [])


def test_rest_of_2_to_5_s_is_one_window_and_shorter_flight_is_none():
    assert windows.lay((3.0, 6.5), "rest") == [(3.0, 6.5)]
    assert windows.lay((3.0, 4.5), "rest") == []
    assert windows.lay((3.0, 6.5), "hover") == []
    assert windows.lay((0.0, 14.97), "hover") == [(0.0, 5.0), (5.0, 10.0), (10.0, 15.0)]


def test_a_window_with_a_gap_a_reset_or_too_few_samples_is_not_used():
    own = row(hz=20.0)
    whole = windows.samples(own.t, own.q, own.segment, (10.0, 15.0))
    assert (whole.start, whole.stop) == (200, 300)
    holes = np.delete(np.arange(len(own.t)), np.arange(220, 228))
    assert windows.samples(own.t[holes], own.q[holes], own.segment[holes], (10.0, 15.0)) is None
    assert windows.samples(own.t, own.q, (own.t > 12).astype(np.int64), (10.0, 15.0)) is None
    assert windows.samples(own.t[::6], own.q[::6], own.segment[::6], (10.0, 15.0)) is None
    assert windows.samples(own.t[:280], own.q[:280], own.segment[:280], (10.0, 15.0)) is None
    spoiled = own.q.copy()
    spoiled[250] = np.nan
    assert windows.samples(own.t, spoiled, own.segment, (10.0, 15.0)) is None


def test_why_there_is_nothing_names_what_would_be_needed():
    case = flights.case([row()], FLIGHT)
    assert phases.why_none(case, "rest", "rest")[0] == "rest_too_short"
    assert "after the filter settled" in phases.why_none(case, "rest", "rest")[1]
    bare = flights.case([row()], FLIGHT[:1])
    assert [phases.why_none(bare, p, p)[0] for p in phases.PHASES] == [
        "no_rest",
        "not_applicable",
        "not_applicable",
        "no_rest",
    ]
