"""Does a file begin as a bag of ROS 2?"""

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

from attlog.core.errors import LogUnusable, UsageError
from attlog.core.limits import MAX_DAMAGE, MAX_FORMATS, MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES
from attlog.formats.table import Damage

MCAP_MAGIC = b"\x89MCAP0\r\n"
# rosbag2's older storage.
SQLITE_MAGIC = b"SQLite format 3\0"
# A column of rosbag2's table of topics; its definition stands on the first page. Other databases lack it.
ROSBAG2_COLUMN = b"serialization_format"


def is_bag(head: bytes) -> bool:
    """Whether these first bytes are those of an MCAP file or of rosbag2's database."""
    return head.startswith(MCAP_MAGIC) or (head.startswith(SQLITE_MAGIC) and ROSBAG2_COLUMN in head)


# What a bag holds, however it is stored: channels with their messages as bytes.

# Whether a channel, by topic and type, is kept.
ChannelFilter = Callable[[str, str], bool]
MISSING_PACKAGES = (
    'a ROS 2 bag needs mcap and rosbags: pip install mcap rosbags, or pip install ".[ros]" in the source folder'
)


@dataclass(slots=True)
class BagChannel:
    """One topic: its ``type`` as ``pkg/msg/Name``, the ``definition`` in ``encoding`` (ros2msg, ros2idl, or empty), the
    messages as bytes and when the recorder got them, ns."""

    topic: str
    type: str
    definition: str = ""
    encoding: str = ""
    messages: list[bytes] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Bag:
    """The channels that were wanted, the topics and types of all, what is broken, and whether the recorder ended it."""

    channels: list[BagChannel]
    types: dict[str, str]
    damage: list[Damage] = field(default_factory=list)
    ended: bool = True


# MCAP files record by record: what is whole is read, whatever is missing behind it.
#
# A record is an opcode (u8), a length (u64) and so many bytes; chunks hold records, packed or not. The index at the
# end
# is not needed, so that a recorder's power may be cut. Specification: MCAP 0, "mcap.dev/spec".

RECORD_HEAD = Struct("<BQ")
# Channel, sequence number, log time and publish time in ns; the rest are the data.
MESSAGE_HEAD = Struct("<HIQQ")
# First and last time, bytes unpacked, their CRC, letters of the compression's name.
CHUNK_HEAD = Struct("<QQQII")
# Opcodes; those below 128 and above the last belong to nobody.
SCHEMA_OPCODE, CHANNEL_OPCODE, MESSAGE_OPCODE, CHUNK_OPCODE, DATA_END_OPCODE, LAST_OPCODE = 3, 4, 5, 6, 15, 15


@dataclass(slots=True)
class _McapState:
    """What has been read so far."""

    wanted: ChannelFilter
    budget: int
    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, BagChannel | None] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    encodings: set[str] = field(default_factory=set)
    damage: list[Damage] = field(default_factory=list)

    def lose(self, at: int, length: int, what: str, resumed: str) -> None:
        """Note a damaged place."""
        if len(self.damage) < MAX_DAMAGE:
            self.damage.append(Damage(at, length, f"{length} bytes of {what}", resumed))


def read_mcap(path: Path, data: NDArray[np.uint8], wanted: ChannelFilter) -> Bag:
    """The bag in an MCAP file. LogUnusable where its messages are not those of ROS 2, UsageError without packages."""
    try:
        import mcap.records  # noqa: F401
    except ImportError:
        raise UsageError(f"{path}: {MISSING_PACKAGES}") from None
    budget = min(MAX_UNPACKED_BYTES, max(UNPACKED_ANYWAY_BYTES, MAX_UNPACKED_RATIO * len(data)))
    state = _McapState(wanted, budget)
    whole = data.data.cast("B")
    ended = False
    for at, opcode, body, length in _mcap_records(whole, len(MCAP_MAGIC)):
        if (
            opcode in (SCHEMA_OPCODE, CHANNEL_OPCODE) and len(body) == length
        ):  # repeated at the end, should a chunk have lost them
            _take_record(state, at, opcode, body)
    for at, opcode, body, length in _mcap_records(whole, len(MCAP_MAGIC)):
        if opcode == DATA_END_OPCODE and len(body) == length:
            ended = True
            break
        if opcode == 0 or LAST_OPCODE < opcode < 128:
            state.lose(at, len(data) - at, "the bag, which follow no record", "not at all")
            break
        if len(body) < length:
            state.lose(at, len(data) - at, "the last record, which is cut", "not at all")
        if opcode == CHUNK_OPCODE:
            _read_chunk(state, at, body, len(body) == length)
        elif opcode == MESSAGE_OPCODE and len(body) == length:
            _take_record(state, at, opcode, body)
    if state.encodings and "cdr" not in state.encodings:
        held = ", ".join(sorted(state.encodings))
        raise LogUnusable(f"{path}: an MCAP file without messages of ROS 2 (it holds {held}); record with ros2 bag")
    kept = [channel for channel in state.channels.values() if channel is not None]
    return Bag(kept, state.types, state.damage, ended)


def _mcap_records(data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview, int]]:
    """Place, opcode and bytes of each record, with the length it should have: the last may be cut."""
    while at + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        begin = at + RECORD_HEAD.size
        yield at, opcode, data[begin : begin + length], length
        at = begin + length


def _read_chunk(state: _McapState, at: int, body: memoryview, whole: bool) -> None:
    """Read what a chunk holds; of one that is cut or broken what can be unpacked."""
    try:
        _, _, size, crc, letters = CHUNK_HEAD.unpack_from(body)
        name = bytes(body[CHUNK_HEAD.size : CHUNK_HEAD.size + letters]).decode("ascii", "replace")
        packed = body[CHUNK_HEAD.size + letters + 8 :]
        if size > state.budget:
            raise ValueError("it unpacks to more than any log")
        content = _unpack_chunk(packed, name, size)
    except (ValueError, error, OSError, RuntimeError, EOFError, MemoryError) as problem:
        if whole:
            state.lose(
                at, RECORD_HEAD.size + len(body), f"a chunk that cannot be unpacked ({problem})", "at the next chunk"
            )
        return
    state.budget -= len(content)
    if whole and (len(content) < size or (crc and zlib.crc32(content) != crc)):
        state.lose(at, RECORD_HEAD.size + len(body), "a chunk whose checksum is wrong", "at the next chunk")
        return
    _read_chunk_records(state, at, memoryview(content))


def _unpack_chunk(packed: memoryview, name: str, size: int) -> bytes | memoryview:
    """At most ``size`` bytes of a chunk's content. Raises what the compressor does, ValueError for another one."""
    if name == "":
        return packed[:size]
    if name == "zstd":
        import zstandard

        reader = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(packed), read_across_frames=True)
        unpacked: bytes = reader.read(size)
        return unpacked
    if name == "lz4":
        import lz4.frame

        unpacked = lz4.frame.LZ4FrameDecompressor().decompress(bytes(packed), max_length=size)
        return unpacked
    raise ValueError(f"compression {name[:16]!r} is not known")


def _read_chunk_records(state: _McapState, at: int, content: memoryview) -> None:
    """The records of a chunk; a loop of its own, because a bag has hundred thousands of messages."""
    head, message, channels, end = RECORD_HEAD.unpack_from, MESSAGE_HEAD.unpack_from, state.channels, len(content)
    place, data_at = 0, MESSAGE_HEAD.size
    while place + RECORD_HEAD.size <= end:
        opcode, length = head(content, place)
        place += RECORD_HEAD.size
        after = place + length
        if after > end:
            break
        if opcode == MESSAGE_OPCODE and length >= data_at:
            number, _, time, _ = message(content, place)
            channel = channels.get(number)
            if channel is not None:
                channel.messages.append(bytes(content[place + data_at : after]))
                channel.times_ns.append(time)
        elif opcode in (SCHEMA_OPCODE, CHANNEL_OPCODE):
            _take_record(state, at, opcode, content[place:after])
        place = after


def _take_record(state: _McapState, at: int, opcode: int, body: memoryview) -> None:
    """A schema, a channel, or a message that stands in no chunk."""
    if opcode == MESSAGE_OPCODE:
        if len(body) >= MESSAGE_HEAD.size:
            number, _, time, _ = MESSAGE_HEAD.unpack_from(body)
            channel = state.channels.get(number)
            if channel is not None:
                channel.messages.append(bytes(body[MESSAGE_HEAD.size :]))
                channel.times_ns.append(time)
        return
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.records import Channel, Schema

    try:
        stream = ReadDataStream(io.BytesIO(bytes(body)))
        if opcode == SCHEMA_OPCODE:
            schema = Schema.read(stream)
            if len(state.schemas) < MAX_FORMATS:
                state.schemas[schema.id] = schema
            return
        channel = Channel.read(stream)
    except (McapError, ValueError, error, EOFError, MemoryError) as problem:
        state.lose(at, RECORD_HEAD.size + len(body), f"a definition ({type(problem).__name__})", "at the next record")
        return
    if channel.id not in state.channels and len(state.channels) < MAX_FORMATS:
        _open_channel(state, channel)


def _open_channel(state: _McapState, channel: Any) -> None:
    """Note a channel; its messages are kept if they are ROS 2's and wanted."""
    schema = state.schemas.get(channel.schema_id)
    kind = "" if schema is None else schema.name
    state.types[channel.topic] = kind
    state.encodings.add(channel.message_encoding or "unnamed messages")
    state.channels[channel.id] = None
    if channel.message_encoding == "cdr" and schema is not None and state.wanted(channel.topic, kind):
        text = schema.data.decode("utf-8", "replace")
        state.channels[channel.id] = BagChannel(channel.topic, kind, text, schema.encoding)


# The channels of a bag: MCAP, or a SQLite database as rosbag2 wrote by default before Iron.

# Where a database says whether a journal (``-wal``) lies beside it: one that does cannot be read from memory.
JOURNAL_VERSION = slice(18, 20)


def read_bag(path: Path, data: NDArray[np.uint8], wanted: ChannelFilter) -> Bag:
    """The bag in these bytes. LogUnusable for a database or an MCAP file that is none, UsageError without packages."""
    return (
        read_mcap(path, data, wanted)
        if data[: len(MCAP_MAGIC)].tobytes() == MCAP_MAGIC
        else _read_sqlite(path, data, wanted)
    )


def _read_sqlite(path: Path, data: NDArray[np.uint8], wanted: ChannelFilter) -> Bag:
    content = bytearray(data.tobytes())
    journal = content[JOURNAL_VERSION] == b"\2\2"
    content[JOURNAL_VERSION] = b"\1\1"
    bag = Bag([], {}, ended=not (journal and _has_journal(path)))
    with closing(sqlite3.connect(":memory:")) as database:
        database.text_factory = lambda raw: raw.decode("utf-8", "replace")
        try:
            database.deserialize(bytes(content))
            del content
            database.execute("pragma trusted_schema = off")
            tables = {name for (name,) in database.execute("select name from sqlite_master where type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise LogUnusable(f"{path}: a SQLite database, but no bag of ROS 2 (no tables topics and messages)")
            channels = _sqlite_topics(database, bag, wanted, "message_definitions" in tables)
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise LogUnusable(f"{path}: a damaged SQLite database ({error})") from None
        try:
            for number, time, message in database.execute("select topic_id, timestamp, data from messages"):
                channel = channels.get(number)
                if channel is not None and isinstance(message, bytes) and isinstance(time, int):
                    channel.messages.append(message)
                    channel.times_ns.append(time)
        except sqlite3.Error as error:
            bag.damage.append(Damage(len(data) - 1, 1, f"messages of the bag ({error})", "not at all"))
    return bag


def _sqlite_topics(
    database: sqlite3.Connection, bag: Bag, wanted: ChannelFilter, defined: bool
) -> dict[object, BagChannel]:
    """The wanted topics by their numbers, noted in the bag."""
    definitions: dict[object, tuple[str, str]] = {}
    if defined:  # since Iron
        query = "select topic_type, encoded_message_definition, encoding from message_definitions"
        definitions = {kind: (str(text), str(encoding)) for kind, text, encoding in database.execute(query)}
    channels: dict[object, BagChannel] = {}
    for number, topic, kind, form in database.execute("select id, name, type, serialization_format from topics"):
        bag.types[str(topic)] = str(kind)
        if form == "cdr" and len(channels) < MAX_FORMATS and wanted(str(topic), str(kind)):
            channels[number] = BagChannel(str(topic), str(kind), *definitions.get(kind, ("", "")))
    bag.channels = list(channels.values())
    return channels


def _has_journal(path: Path) -> bool:
    """Whether what was written last is still in the database's journal."""
    journal = path.with_name(f"{path.name}-wal")
    return journal.is_file() and journal.stat().st_size > 0
