"""MCAP files record by record: what is whole is read, whatever is missing behind it.

A record is an opcode (u8), a length (u64) and so many bytes; chunks hold records, packed or not. The index at the end
is not needed, so that a recorder's power may be cut. Specification: MCAP 0, "mcap.dev/spec".
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct, error
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnusable, UsageError
from attlog.base.limits import MAX_DAMAGE, MAX_FORMATS, MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES
from attlog.formats.base import Damage
from attlog.formats.ros.channels import NEEDS, WANTED, Bag, BagChannel
from attlog.formats.ros.detect import MCAP

HEAD = Struct("<BQ")
MESSAGE = Struct("<HIQQ")
"""Channel, sequence number, log time and publish time in ns; the rest are the data."""
CHUNK = Struct("<QQQII")
"""First and last time, bytes unpacked, their CRC, letters of the compression's name."""
SCHEMA, CHANNEL, MESSAGES, CHUNKS, DATA_END, LAST = 3, 4, 5, 6, 15, 15
"""Opcodes; those below 128 and above the last belong to nobody."""


@dataclass(slots=True)
class _Reading:
    """What has been read so far."""

    wanted: WANTED
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


def read(path: Path, data: NDArray[np.uint8], wanted: WANTED) -> Bag:
    """The bag in an MCAP file. LogUnusable where its messages are not those of ROS 2, UsageError without packages."""
    try:
        import mcap.records  # noqa: F401
    except ImportError:
        raise UsageError(f"{path}: {NEEDS}") from None
    budget = min(MAX_UNPACKED_BYTES, max(UNPACKED_ANYWAY_BYTES, MAX_UNPACKED_RATIO * len(data)))
    state = _Reading(wanted, budget)
    whole = data.data.cast("B")
    ended = False
    for at, opcode, body, length in _records(whole, len(MCAP)):
        if opcode in (SCHEMA, CHANNEL) and len(body) == length:  # repeated at the end, should a chunk have lost them
            _take(state, at, opcode, body)
    for at, opcode, body, length in _records(whole, len(MCAP)):
        if opcode == DATA_END and len(body) == length:
            ended = True
            break
        if opcode == 0 or LAST < opcode < 128:
            state.lose(at, len(data) - at, "the bag, which follow no record", "not at all")
            break
        if len(body) < length:
            state.lose(at, len(data) - at, "the last record, which is cut", "not at all")
        if opcode == CHUNKS:
            _chunk(state, at, body, len(body) == length)
        elif opcode == MESSAGES and len(body) == length:
            _take(state, at, opcode, body)
    if state.encodings and "cdr" not in state.encodings:
        held = ", ".join(sorted(state.encodings))
        raise LogUnusable(f"{path}: an MCAP file without messages of ROS 2 (it holds {held}); record with ros2 bag")
    kept = [channel for channel in state.channels.values() if channel is not None]
    return Bag(kept, state.types, state.damage, ended)


def _records(data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview, int]]:
    """Place, opcode and bytes of each record, with the length it should have: the last may be cut."""
    while at + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        begin = at + HEAD.size
        yield at, opcode, data[begin : begin + length], length
        at = begin + length


def _chunk(state: _Reading, at: int, body: memoryview, whole: bool) -> None:
    """Read what a chunk holds; of one that is cut or broken what can be unpacked."""
    try:
        _, _, size, crc, letters = CHUNK.unpack_from(body)
        name = bytes(body[CHUNK.size : CHUNK.size + letters]).decode("ascii", "replace")
        packed = body[CHUNK.size + letters + 8 :]
        if size > state.budget:
            raise ValueError("it unpacks to more than any log")
        content = _unpacked(packed, name, size)
    except (ValueError, error, OSError, RuntimeError, EOFError, MemoryError) as problem:
        if whole:
            state.lose(at, HEAD.size + len(body), f"a chunk that cannot be unpacked ({problem})", "at the next chunk")
        return
    state.budget -= len(content)
    if whole and (len(content) < size or (crc and zlib.crc32(content) != crc)):
        state.lose(at, HEAD.size + len(body), "a chunk whose checksum is wrong", "at the next chunk")
        return
    _contents(state, at, memoryview(content))


def _unpacked(packed: memoryview, name: str, size: int) -> bytes | memoryview:
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


def _contents(state: _Reading, at: int, content: memoryview) -> None:
    """The records of a chunk; a loop of its own, because a bag has hundred thousands of messages."""
    head, message, channels, end = HEAD.unpack_from, MESSAGE.unpack_from, state.channels, len(content)
    place, data_at = 0, MESSAGE.size
    while place + HEAD.size <= end:
        opcode, length = head(content, place)
        place += HEAD.size
        after = place + length
        if after > end:
            break
        if opcode == MESSAGES and length >= data_at:
            number, _, time, _ = message(content, place)
            channel = channels.get(number)
            if channel is not None:
                channel.messages.append(bytes(content[place + data_at : after]))
                channel.times_ns.append(time)
        elif opcode in (SCHEMA, CHANNEL):
            _take(state, at, opcode, content[place:after])
        place = after


def _take(state: _Reading, at: int, opcode: int, body: memoryview) -> None:
    """A schema, a channel, or a message that stands in no chunk."""
    if opcode == MESSAGES:
        if len(body) >= MESSAGE.size:
            number, _, time, _ = MESSAGE.unpack_from(body)
            channel = state.channels.get(number)
            if channel is not None:
                channel.messages.append(bytes(body[MESSAGE.size :]))
                channel.times_ns.append(time)
        return
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.records import Channel, Schema

    try:
        stream = ReadDataStream(io.BytesIO(bytes(body)))
        if opcode == SCHEMA:
            schema = Schema.read(stream)
            if len(state.schemas) < MAX_FORMATS:
                state.schemas[schema.id] = schema
            return
        channel = Channel.read(stream)
    except (McapError, ValueError, error, EOFError, MemoryError) as problem:
        state.lose(at, HEAD.size + len(body), f"a definition ({type(problem).__name__})", "at the next record")
        return
    if channel.id not in state.channels and len(state.channels) < MAX_FORMATS:
        _open(state, channel)


def _open(state: _Reading, channel: Any) -> None:
    """Note a channel; its messages are kept if they are ROS 2's and wanted."""
    schema = state.schemas.get(channel.schema_id)
    kind = "" if schema is None else schema.name
    state.types[channel.topic] = kind
    state.encodings.add(channel.message_encoding or "unnamed messages")
    state.channels[channel.id] = None
    if channel.message_encoding == "cdr" and schema is not None and state.wanted(channel.topic, kind):
        text = schema.data.decode("utf-8", "replace")
        state.channels[channel.id] = BagChannel(channel.topic, kind, text, schema.encoding)
