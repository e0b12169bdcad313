"""What a bag holds: channels with their messages as bytes. MCAP by the package mcap, SQLite by Python's own module."""

from __future__ import annotations

import io
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnusable, UsageError
from attlog.formats.base import Damage
from attlog.formats.ros.detect import MCAP

Bytes = NDArray[np.uint8]
WANTED = Callable[[str, str], bool]
"""Whether a channel, by topic and type, is kept."""
NEEDS = 'a ROS 2 bag needs mcap and rosbags: pip install mcap rosbags, or pip install ".[ros]" in the source folder'
MOST_RECORD = 1 << 30
"""Larger records are damage, not sensors."""


@dataclass(slots=True)
class BagChannel:
    """One topic: ``type`` as ``pkg/msg/Name``, its ``definition`` in ``encoding`` (ros2msg, ros2idl, or empty), its
    messages as bytes and when the recorder got them, ns."""

    topic: str
    type: str
    definition: str = ""
    encoding: str = ""
    messages: list[bytes] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Bag:
    """The channels that were wanted, the topics and types of all, and what is broken."""

    channels: list[BagChannel]
    types: dict[str, str]
    damage: list[Damage] = field(default_factory=list)


def read(path: Path, data: Bytes, wanted: WANTED) -> Bag:
    """The bag in these bytes. LogUnusable for a database or an MCAP file that is none, UsageError without packages."""
    return _mcap(path, data, wanted) if data[: len(MCAP)].tobytes() == MCAP else _sqlite(path, data, wanted)


def _mcap(path: Path, data: Bytes, wanted: WANTED) -> Bag:
    try:
        from mcap.exceptions import McapError
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader
    except ImportError:
        raise UsageError(f"{path}: {NEEDS}") from None
    schemas: dict[int, Schema] = {}
    channels: dict[int, BagChannel | None] = {}
    types: dict[str, str] = {}
    foreign: set[str] = set()
    ros = False
    damage: list[Damage] = []
    stream = io.BytesIO(data.data)
    records = iter(StreamReader(stream, record_size_limit=MOST_RECORD).records)
    while True:
        begin = stream.tell()
        try:
            record = next(records, None)
        except (McapError, ValueError, EOFError, OSError, RuntimeError, MemoryError, IndexError, KeyError) as error:
            lost = len(data) - begin
            damage.append(Damage(begin, lost, f"{lost} bytes of the bag ({type(error).__name__})", "not at all"))
            break
        if record is None:
            break
        if isinstance(record, Message):
            channel = channels.get(record.channel_id)
            if channel is not None:
                channel.messages.append(record.data)
                channel.times_ns.append(record.log_time)
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas.get(record.schema_id)
            kind = "" if schema is None else schema.name
            types[record.topic] = kind
            if record.message_encoding != "cdr" or schema is None:
                foreign.add(record.message_encoding or "none")
                channels[record.id] = None
                continue
            ros = True
            text = schema.data.decode("utf-8", "replace")
            made = BagChannel(record.topic, kind, text, schema.encoding)
            channels[record.id] = made if wanted(record.topic, kind) else None
    if foreign and not ros:
        raise LogUnusable(f"{path}: an MCAP file without messages of ROS 2 (encodings: {', '.join(sorted(foreign))})")
    return Bag([channel for channel in channels.values() if channel is not None], types, damage)


def _sqlite(path: Path, data: Bytes, wanted: WANTED) -> Bag:
    with closing(sqlite3.connect(":memory:")) as database:
        try:
            database.deserialize(data.tobytes())
            tables = {name for (name,) in database.execute("select name from sqlite_master where type = 'table'")}
        except sqlite3.Error as error:
            raise LogUnusable(f"{path}: a damaged SQLite database ({error})") from None
        if not {"topics", "messages"} <= tables:
            raise LogUnusable(f"{path}: a SQLite database, but no bag of ROS 2 (no tables topics and messages)")
        damage: list[Damage] = []
        definitions = {}
        if "message_definitions" in tables:
            query = "select topic_type, encoding, encoded_message_definition from message_definitions"
            definitions = {kind: (text, encoding) for kind, encoding, text in database.execute(query)}
        channels: dict[int, BagChannel] = {}
        types: dict[str, str] = {}
        for number, topic, kind, serialization in database.execute(
            "select id, name, type, serialization_format from topics"
        ):
            types[topic] = kind
            if serialization == "cdr" and wanted(topic, kind):
                channels[number] = BagChannel(topic, kind, *definitions.get(kind, ("", "")))
        for number, time, message in _rows(database, damage, len(data)):
            channel = channels.get(number)
            if channel is not None:
                channel.messages.append(message)
                channel.times_ns.append(time)
    return Bag(list(channels.values()), types, damage)


def _rows(database: sqlite3.Connection, damage: list[Damage], size: int) -> Iterator[tuple[int, int, bytes]]:
    """The messages in the order of their times; where the database is broken what stands before."""
    try:
        yield from database.execute("select topic_id, timestamp, data from messages order by timestamp")
    except sqlite3.Error as error:
        damage.append(Damage(size - 1, 1, f"messages of the bag ({error})", "not at all"))
