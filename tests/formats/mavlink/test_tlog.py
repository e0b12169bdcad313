"""Telemetry logs against pymavlink's reader: every message, field and packet of every undamaged log in hand."""

from __future__ import annotations

import struct
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.formats.mavlink import reader
from tests.conftest import corpus_logs

LOGS = [p for p in corpus_logs(".tlog", ".mavlink") if not p.name.startswith("made_")]
SMALL = 300_000  # bytes; larger ones take pymavlink seconds


def read_with_pymavlink(path: Path, stamped: bool) -> tuple[dict[tuple[str, int], dict[str, list[Any]]], int]:
    """(name, instance) -> field -> values in file order, and how many packets of known messages it refused."""
    from pymavlink.dialects.v20 import ardupilotmega

    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    rows: dict[tuple[str, int], dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    refused = 0
    data = path.read_bytes()
    at = 0
    while at < len(data):
        stamp = None
        if stamped:
            stamp = struct.unpack_from(">Q", data, at)[0] if at + 8 <= len(data) else None
            at += 8
        message = None
        while message is None and at < len(data):
            need = max(parser.bytes_needed(), 1)
            message = parser.parse_char(data[at : at + need])
            at += need
        if message is None or message.get_type().startswith(("BAD_DATA", "UNKNOWN")):
            refused += message is not None and message.get_type() == "BAD_DATA"
            continue
        table = rows[message.get_type(), message.get_srcSystem() * 256 + message.get_srcComponent()]
        if stamp is not None:
            table[reader.STAMP].append(stamp)
        for name in message.get_fieldnames():
            table[name].append(getattr(message, name))
    return rows, refused


def assert_equal(path: Path) -> None:
    """Every field of every packet is what pymavlink reads."""
    ours = reader.read(path)
    theirs, _ = read_with_pymavlink(path, ours.format == "tlog")
    assert set(ours) == set(theirs)
    for key, columns in theirs.items():
        assert list(ours[key].fields) == list(columns), key
        for name, values in columns.items():
            column = ours[key][name]
            if column.dtype.kind == "S":
                assert [raw.decode("ascii", "replace") for raw in column.tolist()] == values, (key, name)
            else:
                expected = np.array(values).astype(column.dtype)
                assert column.tobytes() == expected.tobytes(), (key, name)


@pytest.mark.parametrize(
    "path", [pytest.param(p, id=p.name, marks=[pytest.mark.slow] if p.stat().st_size > SMALL else []) for p in LOGS]
)
def test_every_value_equals_what_pymavlink_reads(path: Path) -> None:
    assert_equal(path)


def test_the_head_of_a_flight_equals_what_pymavlink_reads(samples: Path, tmp_path: Path) -> None:
    head = tmp_path / "head.tlog"
    head.write_bytes((samples / "copter_steps_stabilize.tlog").read_bytes()[:150_001])
    assert len(reader.read(head).first("ATTITUDE") or ()) > 50
    assert_equal(head)
