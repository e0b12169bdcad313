"""Read the channels of a ROS 2 bag: MCAP, or SQLite (default of rosbag2 before Iron).

MCAP is read record by record, so that a truncated bag yields all complete records. A record is an opcode
(u8), a length (u64) and its body; chunks hold records, packed or not. Specification: MCAP 0, "mcap.dev/spec".
"""

from __future__ import annotations

import io
import sqlite3
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct, error
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.errors import LogUnusable, UsageError
from attlog.core.limits import LAST_TIME_US, MAX_FORMATS, MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES
from attlog.formats.table import DamageLog

MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\0"
# A column of rosbag2's table of topics, defined on the first page; other databases lack it.
ROSBAG2_COLUMN = b"serialization_format"
# Bytes of a database that are 2 where a journal (``-wal``) lies beside it; such a database cannot be read from memory.
JOURNAL_VERSION = slice(18, 20)
MISSING_PACKAGES = (
    'a ROS 2 bag needs mcap and rosbags: pip install mcap rosbags, or pip install ".[ros]" in the source folder'
)

RECORD_HEAD = Struct("<BQ")
# Channel, sequence number, log time and publish time in ns; the rest is the message.
MESSAGE_HEAD = Struct("<HIQQ")
# First and last time, unpacked bytes, their CRC, letters of the compression's name.
CHUNK_HEAD = Struct("<QQQII")
# Opcodes; those from 16 to 127 are not assigned.
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 3, 4, 5, 6, 15

ChannelFilter = Callable[[str, str], bool]  # True for a topic and type whose messages are kept


@dataclass(slots=True)
class BagChannel:
    """Topic of a bag with its messages as bytes and the recorder's times in ns.

    ``type`` is ``pkg/msg/Name``, ``definition`` its text in ``encoding`` (ros2msg, ros2idl, or empty).
    """

    topic: str
    type: str
    definition: str = ""
    encoding: str = ""
    messages: list[bytes] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Bag:
    """Kept channels of a bag, types of all topics, damage, and whether its end was found."""

    channels: list[BagChannel]
    types: dict[str, str]
    losses: DamageLog
    ended: bool = True


def is_bag(head: bytes) -> bool:
    """Return whether a file is MCAP or rosbag2's database."""
    return head.startswith(MCAP_MAGIC) or (head.startswith(SQLITE_MAGIC) and ROSBAG2_COLUMN in head)


def read_bag(path: Path, data: NDArray[np.uint8], wanted: ChannelFilter) -> Bag:
    """Read a bag. LogUnusable for an MCAP file or database of other content, UsageError without packages."""
    if data[: len(MCAP_MAGIC)].tobytes() == MCAP_MAGIC:
        return _McapReader(wanted, len(data)).read(path, data.data.cast("B"))
    return _read_sqlite(path, data, wanted)


class _McapReader:
    """State of reading an MCAP file."""

    def __init__(self, wanted: ChannelFilter, size: int) -> None:
        self.wanted = wanted
        self.budget = min(MAX_UNPACKED_BYTES, max(UNPACKED_ANYWAY_BYTES, MAX_UNPACKED_RATIO * size))
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, BagChannel | None] = {}
        self.types: dict[str, str] = {}
        self.encodings: set[str] = set()
        self.losses = DamageLog()
        self.false_times = self.undefined = 0

    def read(self, path: Path, data: memoryview) -> Bag:
        """Read a file, beginning with schemas and channels outside chunks, which a bag repeats at its end."""
        try:
            import mcap.records  # noqa: F401
        except ImportError:
            raise UsageError(f"{path}: {MISSING_PACKAGES}") from None
        ended = False
        for at, opcode, body, length in _records(data, len(MCAP_MAGIC)):
            if opcode in (SCHEMA, CHANNEL) and len(body) == length:
                self._define(at, opcode, body)
        for at, opcode, body, length in _records(data, len(MCAP_MAGIC)):
            if opcode == DATA_END and len(body) == length:
                ended = True
                break
            if opcode == 0 or DATA_END < opcode < 128:
                self._lose(at, len(data) - at, "the bag, which follow no record", "not at all")
                break
            if opcode == CHUNK:
                unread = self._read_chunk(at, body, len(body) == length)
            else:
                unread = len(data) - at
            if len(body) < length:
                unread = min(max(unread, 1), len(data) - at)
                self._lose(len(data) - unread, unread, "the last record, which is cut", "not at all")
            if opcode == MESSAGE and len(body) == length:
                self._take_message(body, 0, len(body))
        if self.encodings and "cdr" not in self.encodings:
            held = ", ".join(sorted(self.encodings))
            raise LogUnusable(f"{path}: an MCAP file without messages of ROS 2 (it holds {held}); record with ros2 bag")
        if self.undefined:
            text = f"Left out {counted(self.undefined, 'message')} of the bag, whose channels nothing defines."
            self.losses.add_remark("unreadable_message", text, count=self.undefined)
        if self.false_times:
            text = f"Left out {counted(self.false_times, 'message')} of the bag, whose recorder times lie after 2100."
            self.losses.add_remark("false_times", text, count=self.false_times)
        kept = [channel for channel in self.channels.values() if channel is not None]
        return Bag(kept, self.types, self.losses, ended)

    def _lose(self, at: int, length: int, what: str, resumed: str) -> None:
        self.losses.add(at, length, f"{counted(length, 'byte')} of {what}", resumed)

    def _read_chunk(self, at: int, body: memoryview, whole: bool) -> int:
        """Read the records of a chunk, of a truncated one as many as possible. Returns its bytes without a record."""
        try:
            _, _, size, crc, letters = CHUNK_HEAD.unpack_from(body)
            name = bytes(body[CHUNK_HEAD.size : CHUNK_HEAD.size + letters]).decode("ascii", "replace")
            if size > self.budget:
                raise ValueError("it unpacks to more than any log")
            content = _unpacked(body[CHUNK_HEAD.size + letters + 8 :], name, size)
        except (ValueError, error) as problem:
            if whole:
                what = f"a chunk that cannot be unpacked ({problem})"
                self._lose(at, RECORD_HEAD.size + len(body), what, "at the next chunk")
            return len(body)
        self.budget -= len(content)
        if whole and (len(content) < size or (crc and zlib.crc32(content) != crc)):
            self._lose(at, RECORD_HEAD.size + len(body), "a chunk whose checksum is wrong", "at the next chunk")
            return len(body)
        unread = self._read_records(at, memoryview(content))
        if unread and whole:
            self._lose(at, unread, "a chunk that hold no whole record", "at the next chunk")
        return unread

    def _read_records(self, at: int, content: memoryview) -> int:
        """Read the records of an unpacked chunk; return the bytes behind the last whole one."""
        head, end, place = RECORD_HEAD.unpack_from, len(content), 0
        while place + RECORD_HEAD.size <= end:
            opcode, length = head(content, place)
            begin, after = place + RECORD_HEAD.size, place + RECORD_HEAD.size + length
            if after > end:
                break
            if opcode == MESSAGE:
                self._take_message(content, begin, after)
            elif opcode in (SCHEMA, CHANNEL):
                self._define(at, opcode, content[begin:after])
            place = after
        return end - place

    def _take_message(self, content: memoryview, begin: int, end: int) -> None:
        if end - begin < MESSAGE_HEAD.size:
            return
        number, _, time, _ = MESSAGE_HEAD.unpack_from(content, begin)
        channel = self.channels.get(number)
        if channel is None:
            self.undefined += number not in self.channels
            return
        if time > LAST_TIME_US * 1000:
            self.false_times += 1
            return
        channel.messages.append(bytes(content[begin + MESSAGE_HEAD.size : end]))
        channel.times_ns.append(time)

    def _define(self, at: int, opcode: int, body: memoryview) -> None:
        """Add a schema or a channel; messages of a channel are kept if in CDR and selected."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema

        try:
            stream = ReadDataStream(io.BytesIO(bytes(body)))
            if opcode == SCHEMA:
                schema = Schema.read(stream)
                if len(self.schemas) < MAX_FORMATS:
                    self.schemas[schema.id] = schema
                return
            channel = Channel.read(stream)
        except Exception:  # whatever the library raises for damaged bytes
            self._lose(at, RECORD_HEAD.size + len(body), "a definition", "at the next record")
            return
        if channel.id in self.channels or len(self.channels) >= MAX_FORMATS:
            return
        schema = self.schemas.get(channel.schema_id)
        kind = "" if schema is None else schema.name
        self.types[channel.topic] = kind
        self.encodings.add(channel.message_encoding or "unnamed messages")
        self.channels[channel.id] = None
        if channel.message_encoding == "cdr" and schema is not None and self.wanted(channel.topic, kind):
            text = schema.data.decode("utf-8", "replace")
            self.channels[channel.id] = BagChannel(channel.topic, kind, text, schema.encoding)


def _records(data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview, int]]:
    """Yield place, opcode, body and declared length of each record. The last may be cut."""
    while at + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        begin = at + RECORD_HEAD.size
        yield at, opcode, data[begin : begin + length], length
        at = begin + length


def _unpacked(packed: memoryview, name: str, size: int) -> bytes | memoryview:
    """Unpack at most ``size`` bytes of a chunk. ValueError for an unknown compression and damaged bytes."""
    if name == "":
        return packed[:size]
    if name not in ("zstd", "lz4"):
        raise ValueError(f"compression {name[:16]!r} is not known")
    import lz4.frame
    import zstandard

    unpacked: bytes
    try:
        if name == "zstd":
            reader = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(packed), read_across_frames=True)
            unpacked = reader.read(size)
        else:
            unpacked = lz4.frame.LZ4FrameDecompressor().decompress(bytes(packed), max_length=size)
    except Exception:  # whatever the libraries raise for damaged bytes
        raise ValueError(f"its {name} bytes are damaged") from None
    return unpacked


def _read_sqlite(path: Path, data: NDArray[np.uint8], wanted: ChannelFilter) -> Bag:
    content = bytearray(data.tobytes())
    beside = path.with_name(f"{path.name}-wal")
    unfinished = content[JOURNAL_VERSION] == b"\2\2" and beside.is_file() and beside.stat().st_size > 0
    content[JOURNAL_VERSION] = b"\1\1"
    bag = Bag([], {}, DamageLog(), ended=not unfinished)
    with closing(sqlite3.connect(":memory:")) as database:
        database.text_factory = lambda raw: raw.decode("utf-8", "replace")
        try:
            database.deserialize(bytes(content))
            del content
            database.execute("pragma trusted_schema = off")
            tables = {name for (name,) in database.execute("select name from sqlite_master where type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise LogUnusable(f"{path}: a SQLite database, but no bag of ROS 2 (no tables topics and messages)")
            channels = _sqlite_channels(database, bag, wanted, "message_definitions" in tables)
        except LogUnusable:
            raise
        except Exception:  # whatever SQLite raises for damaged bytes
            raise LogUnusable(f"{path}: a SQLite database whose tables are damaged") from None
        try:
            for number, time, message in database.execute("select topic_id, timestamp, data from messages"):
                channel = channels.get(number)
                if channel is not None and isinstance(message, bytes) and isinstance(time, int):
                    channel.messages.append(message)
                    channel.times_ns.append(time)
        except Exception:  # whatever SQLite raises for damaged bytes
            bag.losses.add(len(data) - 1, 1, "the messages behind a damaged page", "not at all")
    return bag


def _sqlite_channels(
    database: sqlite3.Connection, bag: Bag, wanted: ChannelFilter, defined: bool
) -> dict[object, BagChannel]:
    """Return the wanted channels by number; fill in the bag. ``defined``: with definitions, since Iron."""
    definitions: dict[object, tuple[str, str]] = {}
    if defined:
        query = "select topic_type, encoded_message_definition, encoding from message_definitions"
        definitions = {kind: (str(text), str(encoding)) for kind, text, encoding in database.execute(query)}
    channels: dict[object, BagChannel] = {}
    for number, topic, kind, form in database.execute("select id, name, type, serialization_format from topics"):
        bag.types[str(topic)] = str(kind)
        if form == "cdr" and len(channels) < MAX_FORMATS and wanted(str(topic), str(kind)):
            channels[number] = BagChannel(str(topic), str(kind), *definitions.get(kind, ("", "")))
    bag.channels = list(channels.values())
    return channels
