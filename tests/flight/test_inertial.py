"""Candidates for an inertial unit: what of them is believed, and which is the best."""

from __future__ import annotations

import numpy as np

from attlog.flight.builder import LogBuilder
from attlog.flight.inertial import ImuCandidate, best_per_unit, validate
from tests.flight.fake import messages, micros


def candidate(n: int, rate: float = 100.0, rank: int = 0, source: str = "IMU") -> ImuCandidate:
    acc = np.tile([0.0, 0.0, -9.81], (n, 1))
    return ImuCandidate(0, rank, micros(n, rate).astype(np.int64), np.zeros((n, 3)), acc, source, "instant")


def builder() -> LogBuilder:
    return LogBuilder(messages("ulog", {}))


def test_a_better_message_that_covers_next_to_nothing_is_not_preferred() -> None:
    """The first second of a log of minutes, say, in which a faster message was switched on by mistake."""
    short, long = candidate(100, 1000.0, 0, "fast"), candidate(3000, 50.0, 1, "slow")
    assert best_per_unit(builder(), [short, long])[0].source == "slow"
    short = candidate(5000, 1000.0, 0, "fast")
    assert best_per_unit(builder(), [short, long])[0].source == "fast"


def test_a_unit_that_measures_in_fewer_than_one_record_of_a_hundred_was_never_read() -> None:
    for measured, kept in ((5, False), (30, True)):
        unit = candidate(1000)
        unit.acc[measured:] = 0.0
        assert (validate(builder(), unit) is not None) is kept


def test_repeated_stamps_count_as_refused_only_where_nearly_all_repeat() -> None:
    """Two tasks that log each record leave half of them; a stamp that stands still is no clock."""
    for repeats, refused in ((2, 0.0), (20, 0.95)):
        unit = candidate(1000)
        unit.t_us = unit.t_us[np.arange(1000) // repeats * repeats]
        found = validate(builder(), unit)
        assert found is not None
        assert found.refused == refused
