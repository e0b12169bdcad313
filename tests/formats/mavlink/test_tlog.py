"""Telemetry: the boot clock, the search for packets, recognition, writing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from attlog import formats
from attlog.core.errors import UsageError
from attlog.formats import Recording
from attlog.formats.file_bytes import read_file_bytes
from attlog.formats.mavlink import reader
from attlog.formats.mavlink.layout import crc_of_rows, dialect, is_capture, is_tlog, message_layout
from attlog.formats.mavlink.reader import boot_timeline
from attlog.formats.mavlink.walk import walk_all_packets
from attlog.formats.table import Messages
from tests.conftest import SAMPLES
from tests.formats.reference import differences

# The boot clock of telemetry is the autopilot's, whatever else speaks under the vehicle's number.


class Told(SimpleNamespace):
    """A table of one clock message."""

    def __getitem__(self, column: str) -> np.ndarray:
        return np.asarray(self.columns[column])


def test_a_camera_that_booted_later_does_not_turn_the_vehicles_clock_back() -> None:
    """Component 1 is the autopilot, 154 a gimbal with the same system number; another vehicle has number 2."""
    senders = {(1, 1): ([10, 30], [70_000, 71_000]), (1, 154): ([20, 40], [500, 1_500]), (2, 1): ([5, 35], [9, 10])}
    tables: Any = {}
    for (system, component), (offsets, boot_ms) in senders.items():
        instance = system << 8 | component
        tables["ATTITUDE", instance] = Told(
            instance=instance, offsets=np.array(offsets), columns={"time_boot_ms": np.array(boot_ms, np.uint32)}
        )
    messages = Messages(Path("x.tlog"), "tlog", 100, tables)
    messages.info["systems"] = {1: {"component": 1}, 2: {}}
    at, time = boot_timeline(messages, 1)
    assert (at.tolist(), time.tolist()) == ([10, 30], [70_000_000, 71_000_000])


@pytest.mark.parametrize("seed", range(2))
def test_the_walk_runs_as_plain_python_too(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    dice = np.random.default_rng(seed)
    data, known = read_file_bytes(SAMPLES / "copter_steps_stabilize.tlog")[:60_000].copy(), reader.message_catalogue()
    for at in dice.integers(0, len(data) - 300, 20).tolist():
        data[at : at + int(dice.integers(1, 300))] = dice.choice([0, 0xFD, 0xFE, 0xFF])
    compiled = walk_all_packets(data, known)
    monkeypatch.setenv("ATTLOG_NO_JIT", "1")
    for mine, theirs in zip(walk_all_packets(data, known), compiled, strict=True):
        assert np.array_equal(mine, theirs)


@pytest.mark.parametrize("version", [0xFE, 0xFD])
def test_payloads_are_padded_also_at_the_end_of_the_file(version: int) -> None:
    """Messages of every length: shorter than the record, longer, the last one without room for a whole record."""
    head = 6 if version == 0xFE else 10
    packets = [bytes([version, length]) + bytes(head - 2) + bytes(range(1, length + 1)) for length in range(60)]
    data = np.frombuffer(b"".join(packets), np.uint8)
    offsets = np.cumsum([0, *(len(packet) for packet in packets[:-1])]).astype(np.int32)
    record = np.dtype([("a", "<f4"), ("b", "(9,)<u4"), ("c", "S3")])
    size = record.itemsize
    found = reader.read_payloads(data, offsets, record)
    assert found.tobytes() == b"".join(bytes(range(1, n + 1))[:size].ljust(size, b"\0") for n in range(60))


# Does a file consist of MAVLink packets?

PACKET = b"\xfe" + bytes([9]) + bytes(15)
"""A packet of MAVLink 1 with 9 bytes, as far as its length tells."""


def test_one_length_that_fits_is_an_accident_and_four_in_a_row_are_none() -> None:
    noise = np.random.default_rng(1).integers(0, 200, 4000).astype(np.uint8).tobytes()
    assert not is_capture(noise[:100] + PACKET + noise)
    assert not is_capture(noise[:100] + 3 * PACKET + noise)
    assert not is_capture(noise[:2040] + 3 * PACKET)
    assert is_capture(noise[:2040] + 4 * PACKET)
    assert is_tlog(300 * (bytes(8) + PACKET))


def test_a_short_file_is_one_where_it_is_made_of_packets_only() -> None:
    assert is_capture(PACKET)
    assert not is_capture(PACKET + b"text")


# What is written as telemetry log comes back, from our reader and from pymavlink.

Log = dict[tuple[str, int], dict[str, np.ndarray]]
START = 1_700_000_000_000_000


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Random messages of the dialect from random senders, with random values and many trailing zeros."""
    messages: Log = {}
    for number in draw(st.lists(st.sampled_from(sorted(dialect())), min_size=1, max_size=5, unique=True)):
        name, fields, _ = message_layout(number)
        n = draw(st.integers(1, 5))
        columns = {reader.STAMP_COLUMN: START + np.cumsum(draw(hnp.arrays(np.uint32, n)), dtype=np.int64)}
        for field in draw(st.lists(st.sampled_from(list(fields)), max_size=6, unique=True)):
            kind = fields[field].dtype
            columns[field] = (
                np.array(draw(st.lists(st.text("aB9 ", max_size=kind.itemsize), min_size=n, max_size=n)), kind)
                if kind.kind == "S"
                else draw(hnp.arrays(kind.base, (n, *kind.shape)))
            )
        messages[name, draw(st.integers(0, 65535))] = columns
    return messages


@pytest.mark.slow
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=logs())
def test_random_logs_come_back_and_pymavlink_reads_the_same(messages: Log, tmp_path: Path) -> None:
    path = tmp_path / "random.tlog"
    formats.write(path, Recording(messages), replace=True)
    log = reader.read_mavlink(path)
    assert (log.damage, log.damage_bytes) == ([], 0)
    assert differences(path) == []
    assert set(log) == set(messages)
    for key, expected in messages.items():
        for column, values in expected.items():
            assert log[key][column].tobytes() == values.tobytes(), (key, column)


@given(st.binary(min_size=2, max_size=300))
def test_the_checksum_is_that_of_pymavlink(raw: bytes) -> None:
    from pymavlink.generator.mavcrc import x25crc

    assert crc_of_rows(np.frombuffer(raw, np.uint8)[np.newaxis])[0] == x25crc(raw).crc


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        ({("NOT_A_MESSAGE", 257): {reader.STAMP_COLUMN: np.zeros(1, np.int64)}}, "not a message"),
        ({("ATTITUDE", 257): {"roll": np.zeros(1)}}, "needs a column _t_us"),
        ({("ATTITUDE", 257): {reader.STAMP_COLUMN: np.zeros(1, np.int64), "rol": np.zeros(1)}}, "has no field rol"),
    ],
)
def test_what_mavlink_does_not_know_is_refused(tmp_path: Path, messages: Log, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        formats.write(tmp_path / "x.tlog", Recording(messages))
