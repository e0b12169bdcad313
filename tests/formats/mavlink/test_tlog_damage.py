"""Telemetry logs with damage, foreign packets, signatures, several vehicles and restarts."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from attlog.core.errors import LogUnusable
from attlog.core.limits import MAX_SENDERS
from attlog.formats.mavlink import reader
from attlog.formats.mavlink.layout import message_catalogue
from attlog.formats.mavlink.walk import index_packets
from tests.formats.damage import KINDS, damage

START = 1_700_000_000_000_000


class Link:
    """Packets as pymavlink sends them, collected as a telemetry log."""

    def __init__(self, system: int = 1, component: int = 1, stamped: bool = True) -> None:
        self.raw = b""
        self.stamped = stamped
        self.now = START
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def send(self, message: Any, v1: bool = False, step_us: int = 10_000) -> bytes:
        packet = message.pack(self.mav, force_mavlink1=v1)
        self.now += step_us
        self.raw += (struct.pack(">Q", self.now) if self.stamped else b"") + packet
        return packet

    def heartbeat(self, autopilot: int, kind: int = 2) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3))

    def attitudes(self, n: int, start_ms: int = 1000, v1: bool = False) -> None:
        for k in range(n):
            self.send(mavlink.MAVLink_attitude_message(start_ms + 20 * k, k * 0.01, 0, 0, 0, 0, 0), v1)

    def read(self, folder: Path) -> Any:
        path = folder / "link.tlog"
        path.write_bytes(self.raw)
        return reader.read_mavlink(path)


@pytest.fixture(scope="module")
def raw(samples: Path) -> bytes:
    return (samples / "copter_steps_stabilize.tlog").read_bytes()[:300_000]


@pytest.mark.parametrize("kind", KINDS)
def test_every_intact_packet_is_found_and_no_other(raw: bytes, kind: str) -> None:
    clean = index_packets(np.frombuffer(raw, np.uint8), message_catalogue())
    length = np.frombuffer(raw, np.uint8)[clean.offsets + 1].astype(np.int64)
    length += np.where(np.frombuffer(raw, np.uint8)[clean.offsets] == 0xFD, 12, 8)
    for seed in range(8):
        log = damage(raw, kind, 8, np.random.default_rng(seed))
        found = index_packets(log.data, message_catalogue())
        expected = set(clean.offsets[log.whole(clean.offsets, length)].tolist())
        assert set(log.source[found.offsets].tolist()) == expected
        assert found.stamped
        assert 0 < found.losses.bytes < 8 * 3000 + 9 * 300


@pytest.mark.parametrize(
    ("added", "lost"), [(b"\xff", "erased"), (b"\0", "erased"), (b"ab", "without a packet of right checksum")]
)
@pytest.mark.parametrize("number", [0, 1000])
def test_damage_is_told_with_its_bytes(raw: bytes, tmp_path: Path, number: int, added: bytes, lost: str) -> None:
    clean = index_packets(np.frombuffer(raw, np.uint8), message_catalogue())
    at = int(clean.offsets[number]) - 8
    path = tmp_path / "damaged.tlog"
    path.write_bytes(raw[:at] + added * (500 // len(added)) + raw[at:])
    log = reader.read_mavlink(path)
    assert (log.damage[0].offset, log.damage[0].length) == (at, 500)
    assert lost in log.damage[0].lost
    assert sum(len(table) for table in log.values()) == len(clean.offsets)


@pytest.mark.parametrize("cut", [1, 5, 8, 9, 30])
def test_a_file_that_begins_anywhere_keeps_its_stamped_packets(raw: bytes, tmp_path: Path, cut: int) -> None:
    path = tmp_path / "begun.tlog"
    path.write_bytes(raw[cut:])
    log = reader.read_mavlink(path)
    clean = index_packets(np.frombuffer(raw, np.uint8), message_catalogue())
    assert sum(len(table) for table in log.values()) == np.count_nonzero(clean.offsets - 8 >= cut)
    assert log.damage[0].offset == 0
    assert all(table[reader.STAMP_COLUMN].min() > 1_700_000_000_000_000 for table in log.values())


def test_what_is_left_of_a_receiver_time_is_damage(tmp_path: Path) -> None:
    link = Link()
    link.attitudes(4)
    before = len(link.raw)
    link.attitudes(4, start_ms=2000)
    link.raw = link.raw[:before] + link.raw[before + 3 :]
    log = link.read(tmp_path)
    assert len(log["ATTITUDE", 257]) == 8
    assert [(d.offset, d.length) for d in log.damage] == [(before, 5)]


def test_both_versions_signatures_and_raw_captures_are_read(tmp_path: Path) -> None:
    for stamped in (True, False):
        link = Link(stamped=stamped)
        link.attitudes(5, v1=True)
        link.attitudes(5, start_ms=2000)
        link.mav.signing.secret_key = b"k" * 32
        link.mav.signing.sign_outgoing = True
        link.attitudes(5, start_ms=3000)
        log = link.read(tmp_path)
        assert log.format == ("tlog" if stamped else "mavlink")
        assert log.damage == []
        times = log["ATTITUDE", 257]["time_boot_ms"]
        assert times.tolist() == [s + 20 * k for s in (1000, 2000, 3000) for k in range(5)]
        assert (reader.STAMP_COLUMN in log["ATTITUDE", 257]) == stamped


def test_stamps_are_those_of_the_receiver(tmp_path: Path) -> None:
    link = Link()
    link.attitudes(3)
    assert link.read(tmp_path)["ATTITUDE", 257][reader.STAMP_COLUMN].tolist() == [
        START + 10_000 * (k + 1) for k in range(3)
    ]


def test_unknown_messages_are_counted_and_are_no_damage(tmp_path: Path) -> None:
    link = Link()
    link.attitudes(3)
    foreign = bytes([0xFD, 5, 0, 0, 0, 1, 1, 0x39, 0x30, 0x05]) + b"abcde" + b"\x12\x34"
    for _ in range(4):
        link.raw += struct.pack(">Q", link.now) + foreign
    link.attitudes(3, start_ms=2000)
    log = link.read(tmp_path)
    assert log.info["unknown"] == {0x053039: 4}
    assert (log.damage, len(log["ATTITUDE", 257])) == ([], 6)


def test_wrong_checksums_are_damage_by_message(tmp_path: Path) -> None:
    link = Link()
    link.attitudes(3)
    before = len(link.raw)
    link.attitudes(1, start_ms=2000)
    link.raw = link.raw[:-1] + bytes([link.raw[-1] ^ 1])
    length = len(link.raw) - before
    link.attitudes(3, start_ms=3000)
    log = link.read(tmp_path)
    assert len(log["ATTITUDE", 257]) == 6
    assert [(d.offset, d.length) for d in log.damage] == [(before, length)]
    assert "message 30 with a wrong checksum" in log.damage[0].lost


def test_a_packet_inside_a_packet_is_payload(tmp_path: Path) -> None:
    link = Link()
    inner = Link().send(mavlink.MAVLink_attitude_message(7, 0, 0, 0, 0, 0, 0))
    payload = list(inner) + [0] * (128 - len(inner))
    link.attitudes(2)
    link.send(mavlink.MAVLink_tunnel_message(0, 0, 0, len(inner), payload))
    link.attitudes(2, start_ms=2000)
    log = link.read(tmp_path)
    assert len(log["ATTITUDE", 257]) == 4
    assert log.damage == []


@pytest.mark.parametrize(("autopilot", "expected"), [(3, 7), (12, -2)])
def test_integer_parameters_are_read_as_the_autopilot_sends_them(tmp_path: Path, autopilot: int, expected: int) -> None:
    value = 7.0 if autopilot == 3 else struct.unpack("<f", struct.pack("<i", -2))[0]
    link = Link()
    link.heartbeat(autopilot)
    link.attitudes(2)
    link.send(mavlink.MAVLink_param_value_message(b"SYS_AUTOSTART", value, 6, 10, 0))
    link.send(mavlink.MAVLink_param_value_message(b"A_NAME_OF_16_CHR", 0.25, 9, 10, 1))
    params = link.read(tmp_path).params
    assert [(p.name, p.value, p.t_us) for p in params] == [
        ("SYS_AUTOSTART", expected, 1_020_000),
        ("A_NAME_OF_16_CHR", 0.25, 1_020_000),
    ]


def test_the_chunks_of_a_long_text_are_joined(tmp_path: Path) -> None:
    text = "EKF3 lane switch because of the innovation of the magnetometer, and so on until the third chunk: 12345, end"
    link = Link()
    link.heartbeat(3)
    for k in range(0, len(text), 50):
        link.send(mavlink.MAVLink_statustext_message(4, text[k : k + 50].encode(), 9, k // 50))
    link.send(mavlink.MAVLink_statustext_message(6, b"x" * 50))
    link.send(mavlink.MAVLink_statustext_message(2, b"Crash: disarming"))
    assert [(x.text, x.level) for x in link.read(tmp_path).texts] == [(text, 4), ("x" * 50, 6), ("Crash: disarming", 2)]


def test_a_falling_boot_clock_splits_the_log(tmp_path: Path) -> None:
    link = Link()
    link.heartbeat(3)
    link.attitudes(40, start_ms=90_000)
    link.attitudes(40, start_ms=2000)
    log = link.read(tmp_path)
    assert [len(log.boot(k)["ATTITUDE", 257]) for k in (0, 1)] == [40, 40]


def test_the_vehicle_is_chosen_among_ground_station_and_companions(tmp_path: Path) -> None:
    link = Link(system=5)
    link.heartbeat(3)
    link.attitudes(30)
    station = Link(system=255, component=190)
    for _ in range(50):
        station.heartbeat(8, 6)
    link.raw += station.raw
    log = link.read(tmp_path)
    assert log.info["system"] == 5
    assert {s: d["autopilot"] for s, d in log.info["systems"].items()} == {5: 3, 255: None}
    assert reader.read_mavlink(log.path, system=255).info["system"] == 255


def test_a_file_without_a_right_packet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.tlog"
    path.write_bytes(np.random.default_rng(0).bytes(50_000))
    with pytest.raises(LogUnusable, match="no MAVLink packet"):
        reader.read_mavlink(path)


@pytest.mark.parametrize(
    "filler",
    [
        lambda n: bytes(n),
        lambda n: b"\xff" * n,
        lambda n: np.random.default_rng(0).bytes(n),
        lambda n: b"\xfe" * (n // 10),
        lambda n: b"\xfd\0" * (n // 2),
    ],
    ids=["zeros", "erased", "random", "version 1 marks", "version 2 marks"],
)
def test_megabytes_of_nonsense_take_no_time(raw: bytes, tmp_path: Path, filler: Callable[[int], bytes]) -> None:
    import time

    path = tmp_path / "nonsense.tlog"
    path.write_bytes(raw[:100_000] + filler(3_000_000) + raw[100_000:])
    begin = time.process_time()
    log = reader.read_mavlink(path)
    assert time.process_time() - begin < 5
    clean = index_packets(np.frombuffer(raw, np.uint8), message_catalogue())
    assert sum(len(table) for table in log.values()) >= len(clean.offsets) - 1


def test_packets_of_more_senders_than_any_network_has_are_told_and_the_busiest_read(tmp_path: Path) -> None:
    link = Link()
    link.attitudes(50)
    for number in range(MAX_SENDERS + 200):
        link.mav.srcSystem, link.mav.srcComponent = 2 + number // 250, number % 250
        link.attitudes(1)
    log = link.read(tmp_path)
    assert len({instance for _, instance in log}) == MAX_SENDERS
    assert len(log["ATTITUDE", 257]) == 50
    assert (log.damage_places, "201 packets of 201 senders" in log.damage[0].lost) == (1, True)
