"""A time is false where the rest of the log contradicts it, and only there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from attlog.flight.builder import LogBuilder
from attlog.formats.base import Field, Messages, Table

FLIGHT = np.concatenate([np.arange(0, 60_000_000, 20_000), np.arange(400_000_000, 460_000_000, 20_000)])
"""Two minutes at 50 Hz with a pause of the logger of over five minutes."""


def log_of(judged: NDArray[np.int64], *others: NDArray[np.int64], log_format: str = "ulog") -> LogBuilder:
    """A log of the judged message and others, by their times."""
    tables = {}
    for name, times in [("judged", judged), *((f"other_{k}", t) for k, t in enumerate(others))]:
        fields = {"timestamp": Field("timestamp", np.dtype(np.int64))}
        tables[name, 0] = Table(name, 0, fields, np.arange(len(times)), lambda _, at, t=times: t[at])
    return LogBuilder(Messages(Path("made.ulg"), log_format, 1, tables))


def refused(builder: LogBuilder, good: NDArray[np.bool_] | None = None) -> list[int]:
    """Which records are left out, and each one counted as such."""
    t = builder.messages["judged", 0]["timestamp"]
    kept = builder.keep(t, "judged", good)
    lost = np.setdiff1d(np.arange(len(t)) if good is None else np.flatnonzero(good), kept)
    assert sum(p.count for p in builder.problems if p.code in ("false_times", "time_backward")) == len(lost)
    return lost.tolist()


OTHERS = (FLIGHT + 1_000, FLIGHT[::50] + 2_000, FLIGHT[::5] + 3_000)
LAST = len(FLIGHT) - 1


@pytest.mark.parametrize(
    ("places", "moved_s"),
    [
        ([70], 3600.0),  # single
        ([70], -30.0),
        (list(range(900, 930)), 3600.0),  # a run
        ([LAST], 3600.0),  # at the end, where nothing follows
        ([LAST], 15.0),
        (list(range(LAST - 29, LAST + 1)), 900.0),
        ([0], 200.0),  # the first, into the pause
        ([0], 5000.0),
        ([2999], 100.0),  # the last before the pause
    ],
)
def test_planted_false_times_are_found(places: list[int], moved_s: float) -> None:
    t = FLIGHT + 100_000_000
    t[places] += round(moved_s * 1e6)
    others = [o + 100_000_000 for o in OTHERS]
    assert refused(log_of(t, *others)) == places


@pytest.mark.parametrize("count", [1, 2, 10])
def test_a_few_records_behind_a_pause_of_the_whole_log_are_kept(count: int) -> None:
    end = 5_000_000_000
    t = np.append(FLIGHT, end + 20_000 * np.arange(count))
    assert refused(log_of(t, *(np.append(o, end + 500_000) for o in OTHERS))) == []


def test_records_beside_others_with_values_out_of_range_are_kept() -> None:
    """Only every 15 s a value can be used: the times are continuous all the same."""
    t = np.arange(0, 600_000_000, 200_000)
    good = np.zeros(len(t), bool)
    good[:500] = good[500::75] = True
    assert refused(log_of(t, *OTHERS), good) == []


def test_flights_of_more_than_a_day_keep_their_beginning_and_end() -> None:
    t = np.arange(0, 30 * 3600, 2, dtype=np.int64) * 1_000_000
    assert refused(log_of(t, t + 1, t + 2)) == []


def test_a_log_of_two_messages_contradicts_none_of_them() -> None:
    t = np.append(FLIGHT, FLIGHT[-1] + 900_000_000)
    assert refused(log_of(t, OTHERS[0])) == []


def test_checked_telemetry_has_no_false_times() -> None:
    t = np.append(FLIGHT, FLIGHT[-1] + 900_000_000)
    assert refused(log_of(t, *OTHERS, log_format="tlog")) == []
