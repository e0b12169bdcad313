"""Windows are names or times, and a wrong one says what is allowed."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import timestamps
from attlog.segments import model
from attlog.segments.model import CONVERGED_AFTER_MOTORS_S, Segment, Segments, converged_spans

FOUND = Segments(
    [
        Segment("continuous", 0.0, 100.0),
        Segment("rest.short", 50.0, 55.0),
        Segment("rest.long", 0.0, 20.0),
        Segment("idle", 20.0, 25.0),
        Segment("airborne", 25.0, 50.0),
    ]
)


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        ("all", [(0.0, 100.0)]),
        ("rest", [(0.0, 20.0), (50.0, 55.0)]),
        ("rest.long", [(0.0, 20.0)]),
        ("idle", [(20.0, 25.0)]),
        ("hover", []),
        ("30:40.5", [(30.0, 40.5)]),
        ("-5:3", [(-5.0, 3.0)]),
    ],
)
def test_a_window_is_a_name_or_a_pair_of_times(window, expected):
    assert FOUND.spans(window) == expected


@pytest.mark.parametrize("window", ["resting", "5", "9:3", "a:b", "", ":", "3:3", "nan:4"])
def test_a_wrong_window_is_refused_with_what_is_allowed(window):
    with pytest.raises(ValueError, match="use all, rest, "):
        FOUND.spans(window)


def test_the_mask_of_a_window_holds_its_ends():
    t = np.array([-1.0, 0.0, 20.0, 20.1, 49.9, 50.0, 55.0, np.nan])
    np.testing.assert_array_equal(FOUND.mask(t, "rest"), [False, True, True, False, False, True, True, False])
    assert not FOUND.mask(t, "hover").any()


# Runs end at gaps, restarts at longer ones, and nothing else counts as a gap.


def at_rate(rate: float, seconds: float, start: float = 0.0) -> np.ndarray:
    """Regular times."""
    return start + np.arange(0, seconds, 1 / rate)


def kinds(t: np.ndarray) -> list[tuple[str, float, float]]:
    """Kind, start and end of what is found."""
    return [(s.kind, round(s.t0, 3), round(s.t1, 3)) for s in sorted(model.find_continuous(t), key=lambda s: s.t0)]


def test_a_log_without_gap_is_one_run():
    assert kinds(at_rate(200, 10)) == [("continuous", 0.0, 9.995)]


@pytest.mark.parametrize(("rate", "limit"), [(400, 0.05), (200, 0.05), (50, 0.1), (25, 0.2), (10, 0.5)])
def test_a_gap_is_longer_than_five_intervals_and_than_fifty_milliseconds(rate, limit):
    assert timestamps.gap_limit_of_times(at_rate(rate, 20)) == pytest.approx(limit)
    head = at_rate(rate, 5)
    below = np.concatenate([head, head + head[-1] + 0.98 * limit])
    above = np.concatenate([head, head + head[-1] + 1.02 * limit])
    assert [k for k, _, _ in kinds(below)] == ["continuous"]
    assert [k for k, _, _ in kinds(above)] == ["continuous", "gap", "continuous"]


def test_a_gap_says_how_long_it_is_and_what_a_filter_does_there():
    t = np.concatenate([at_rate(100, 5), at_rate(100, 5, 5.2), at_rate(100, 5, 20)])
    found = [s for s in model.find_continuous(t) if s.kind == "gap"]
    assert "integrates across" in found[0].why
    assert "restarts" in found[1].why
    np.testing.assert_allclose(model.restart_times(t), [0.0, 20.0])


def test_without_an_imu_a_gap_is_the_attitudes_and_no_filter_restarts():
    t = np.concatenate([at_rate(100, 5), at_rate(100, 5, 20)])
    (found,) = (s for s in model.find_continuous(t, replayed=False) if s.kind == "gap")
    assert found.why == "no attitude for 15.01 s"


def test_time_that_goes_back_ends_a_run():
    t = np.concatenate([at_rate(100, 5), at_rate(100, 5)])
    assert [k for k, _, _ in kinds(t)] == ["continuous", "continuous"]
    np.testing.assert_array_equal(np.unique(model.number_segments(t)), [0, 1])


def test_samples_that_are_not_finite_or_not_later_are_left_out():
    t = np.array([0.0, 1.0, 1.0, np.nan, 0.5, 2.0, 3.0])
    x = np.array([[0.0], [1.0], [9.0], [9.0], [9.0], [np.nan], [3.0]])
    kept_t, kept_x = model.select_rising(t, x)
    np.testing.assert_array_equal(kept_t, [0.0, 1.0, 3.0])
    np.testing.assert_array_equal(kept_x[:, 0], [0.0, 1.0, 3.0])


def test_the_rate_does_not_count_the_time_lost_in_gaps():
    assert model.sample_rate(np.concatenate([at_rate(50, 10), at_rate(50, 10, 100)])) == pytest.approx(50.0)
    assert model.sample_rate(np.array([0.0, 0.1, 0.3, 0.4])) == pytest.approx(7.5)
    assert model.sample_rate(np.zeros(1)) == 0.0


@pytest.mark.parametrize("number", [[0, 0, 1, 1], [1, 1, 0, 0]])
def test_neighbours_of_two_segments_are_never_one_range(number):
    """Numbers rise by one; of two kinds joined they may also fall."""
    inside = np.array([True, True, True, True])
    assert model.segment_slices(inside, np.array(number)) == [slice(0, 2), slice(2, 4)]
    assert model.merge_numbers(np.array(number), np.zeros(4, np.int64)).tolist() == [0, 0, 1, 1]
    assert model.merge_numbers(np.array([4, 4, 4, 5]), np.array(number)).tolist() == [0, 0, 1, 2]


# Settled time of many spans at once equals that of each span alone, by plain arithmetic with sets of seconds.


@pytest.mark.parametrize("seed", range(5))
def test_settled_time_is_what_neither_start_nor_motors_disturb(seed: int) -> None:
    draw = np.random.default_rng(seed)
    edges = np.unique(draw.integers(0, 900, 40)).astype(float)
    rests = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=False))
    flown = np.unique(draw.integers(0, 900, 12)).astype(float)
    segments = Segments(
        [Segment("armed", a, b) for a, b in zip(flown[::2].tolist(), flown[1::2].tolist(), strict=False)]
    )
    starts = sorted(draw.integers(20, 900, 3).astype(float).tolist())
    t = np.arange(0.0, 1000.0, 0.25) + 0.125
    free = t > starts[0]
    for begin in starts:
        free &= ~((t > begin) & (t < begin + 20.0))
    for one in segments.of("armed"):
        free &= ~((t > one.t1) & (t < one.t1 + CONVERGED_AFTER_MOTORS_S))
    found = list(converged_spans(rests, segments, starts, 20.0))
    assert len(found) == len(rests)
    for (t0, t1), spans in zip(rests, found, strict=True):
        inside = np.zeros(len(t), bool)
        for a, b in spans:
            assert t0 <= a < b <= t1
            inside |= (t > a) & (t < b)
        np.testing.assert_array_equal(inside, free & (t > t0) & (t < t1))


@pytest.mark.parametrize("kind", ["armed", "airborne", "idle"])
def test_every_sign_of_motors_that_stop_unsettles_and_what_tells_no_motor_does_not(kind: str) -> None:
    for name, free in ((kind, (30.0 + CONVERGED_AFTER_MOTORS_S, 60.0)), ("hover", (30.0, 60.0))):
        (found,) = converged_spans([(30.0, 60.0)], Segments([Segment(name, 10.0, 30.0)]), [0.0], 20.0)
        assert found == [free]
