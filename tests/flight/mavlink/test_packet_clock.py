"""The autopilot's clock of packets: their own, that of the receiver, or their place in the file."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import median_filter  # type: ignore[import-untyped]

from attlog.flight.mavlink import clock
from attlog.flight.mavlink.clock import PacketClock
from attlog.formats.base import Messages
from attlog.formats.mavlink.reader import STAMP

BOOT_MS = 5_000 + 20 * np.arange(200)
AHEAD_US = 1_700_000_000_000_000
"""The receiver's clock is Unix time."""


class Told(SimpleNamespace):
    """A table by its columns."""

    def __getitem__(self, column: str) -> np.ndarray:
        return np.asarray(self.columns[column])

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def __len__(self) -> int:
        return len(self.offsets)


def told(offsets: Any, instance: int = 1, **columns: Any) -> Any:
    given = {STAMP if key == "stamp" else key: np.asarray(x) for key, x in columns.items()}
    return Told(instance=instance, offsets=np.asarray(offsets), columns=given)


def clock_of(**tables: Any) -> PacketClock:
    known: Any = {(name, t.instance): t for name, t in tables.items()}
    return PacketClock(Messages(Path("x.tlog"), "tlog", 100, known), 1)


ATTITUDE = told(100 * np.arange(200), time_boot_ms=BOOT_MS, stamp=AHEAD_US + 1000 * BOOT_MS)


def test_whole_milliseconds_that_have_passed_are_half_of_one_more() -> None:
    assert clock.of_milliseconds(told([1, 2], time_boot_ms=[7, 4_000_000_000])).tolist() == [7_500, 4_000_000_000_500]


def test_a_message_without_a_clock_is_as_late_as_its_packet_by_the_receiver() -> None:
    own = clock_of(ATTITUDE=ATTITUDE)
    packets = told([550, 10_050], stamp=AHEAD_US + np.array([5_103_000, 7_011_000]))
    assert own.is_steady
    assert own.by_packet(packets).tolist() == [5_103_500, 7_011_500]
    assert own.of(packets).tolist() == [5_103_500, 7_011_500]


def test_where_the_receivers_stamps_come_in_bursts_the_place_in_the_file_tells_the_time() -> None:
    """Ten packets with one stamp: as late as the last of them."""
    bursts = AHEAD_US + 1000 * np.repeat(BOOT_MS[9::10], 10)
    own = clock_of(ATTITUDE=told(100 * np.arange(200), time_boot_ms=BOOT_MS, stamp=bursts))
    assert not own.is_steady
    found = own.by_packet(told([550, 10_025], stamp=[AHEAD_US, AHEAD_US]))
    assert found.tolist() == [5_110_500, 7_005_500]


def test_without_any_clock_there_is_none() -> None:
    assert clock_of().by_packet(told([5, 6], stamp=[1, 2])).tolist() == [0, 0]


def test_clock_messages_are_put_in_file_order_and_those_that_were_never_set_left_out() -> None:
    system = told([150, 5], time_boot_ms=[5_035, 0], stamp=[AHEAD_US + 5_035_000, 0], time_unix_usec=[0, 0])
    own = clock_of(ATTITUDE=ATTITUDE, SYSTEM_TIME=system)
    assert own.offsets[:4].tolist() == [0, 100, 150, 200]
    assert own.boot[:4].tolist() == [5_000_500, 5_020_500, 5_035_500, 5_040_500]
    assert len(own.offsets) == 201


@pytest.mark.parametrize(("late", "steady"), [(0.45, True), (0.55, False)])
def test_stamps_that_advance_otherwise_by_more_than_half_of_a_step_are_no_clock(late: float, steady: bool) -> None:
    boot = 20_000 * np.arange(60)
    packet = boot + np.where(np.arange(60) % 2, round(late * 20_000), 0)
    assert clock.steady(packet, boot) is steady
    assert clock.steady(packet[:20], boot[:20])
    assert clock.steady(packet[:21], boot[:21]) is steady


def test_a_time_in_unix_microseconds_is_put_on_the_boot_clock() -> None:
    unix = 1_650_000_000_000_000
    system = told([1, 2, 3], time_boot_ms=[1_000, 2_000, 0], time_unix_usec=[unix, unix + 1_000_000, unix * 2])
    own = clock_of(SYSTEM_TIME=system)
    assert own.unix == unix - 1_000_000
    assert own.of(told([9, 10], time_usec=[unix + 4_000_000, unix + 5_000_000])).tolist() == [5_000_000, 6_000_000]
    assert own.of(told([9, 10], time_usec=[70, 90])).tolist() == [70, 90]


def test_a_date_that_the_autopilot_never_knew_or_that_cannot_be_is_none() -> None:
    """Milliseconds of Unix time, a year beyond 2100, and a boot clock that stands at zero."""
    for unix, boot_ms in ((10**15 - 1, 5), (5 * 10**15, 5), (1_650_000_000_000_000, 0)):
        system = told([1], time_boot_ms=[boot_ms], time_unix_usec=[unix])
        assert clock_of(SYSTEM_TIME=system).unix is None
    assert clock_of(ATTITUDE=ATTITUDE).unix is None


def test_a_time_usec_that_is_unix_time_of_an_unknown_date_is_left_for_the_packets() -> None:
    own = clock_of(ATTITUDE=ATTITUDE)
    packets = told([550], time_usec=[1_650_000_000_000_000], stamp=[AHEAD_US + 5_103_000])
    assert own.of(packets).tolist() == [5_103_500]
    assert own.of(told([550], time_usec=[0], stamp=[AHEAD_US + 5_103_000])).tolist() == [5_103_500]


def test_small_backward_steps_become_steps_of_a_microsecond_and_large_ones_stay() -> None:
    t = np.array([0, 10, 7, 8, 30, 31])
    assert clock.rising(t).tolist() == [0, 10, 11, 12, 30, 31]
    restarted = np.array([2_000_000, 2_000_010, 5, 15])
    assert clock.rising(restarted).tolist() == restarted.tolist()
    edge = np.array([1_000_000, 2])
    assert clock.rising(edge).tolist() == [1_000_000, 1_000_001]


@pytest.mark.parametrize("count", [11, 12, 21, 60])
def test_the_running_median_is_that_of_scipy_mirrored_at_the_ends(count: int) -> None:
    x = np.random.default_rng(count).integers(0, 10_000, count)
    np.testing.assert_array_equal(clock.running_median(x), median_filter(x, 21, mode="mirror"))


def test_a_median_of_few_is_that_of_all() -> None:
    assert clock.running_median(np.array([5, 1, 90])).tolist() == [5, 5, 5]
