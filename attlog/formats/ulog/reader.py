"""Read PX4 logs (``.ulg``) as lazy columns.

One pass finds all records (:mod:`attlog.formats.ulog.walk`); a topic's bytes are gathered on first access to one of its
columns. ULog has no checksums, so a data record is accepted only if another record begins at its end. The record before
damage is rejected, and reading resumes at the next place with three valid records in a row and a plausible time.
"""

from __future__ import annotations

import struct
from array import array
from pathlib import Path

import numpy as np

from attlog.core.brief import counted
from attlog.core.errors import LogUnusable, NotALog
from attlog.core.limits import MAX_BOOTS, MAX_COLUMNS, MAX_GUESSES, MAX_IDS_FOLLOWED, MAX_LAYOUTS
from attlog.core.timestamps import Offsets
from attlog.formats.file_bytes import ERASED, offset_type, offsets_by_kind, read_file_bytes
from attlog.formats.table import Boot, DamageLog, Messages, Table
from attlog.formats.ulog.content import MAX_START_US, Content, Topic, implausible
from attlog.formats.ulog.encrypted import decrypt, is_encrypted
from attlog.formats.ulog.layout import (
    FILE_HEADER,
    MAGIC,
    MAX_UNKNOWN_BYTES,
    SYNC_MARK,
    Definitions,
    TopicLayout,
    decode_ulog_text,
)
from attlog.formats.ulog.walk import (
    ANCHOR_RECORDS,
    DATA,
    DATA_HEADER_BYTES,
    KNOWN_KINDS,
    MAX_SEARCH_BYTES,
    MAX_SORTED_RECORDS,
    Bytes,
    DataChain,
    Framing,
    Identifiers,
    Segments,
    Sizes,
    identifier_at,
    times_rise,
)

__all__ = ["read_ulog"]

# Above this size data records of an unknown id are searched for known records.
MIN_HIDING_BYTES = 300
# Number of recent records with which times are compared, and of last records among which they are searched.
RECENT_RECORDS, MAX_RECENT_SEARCHED = 3, 256
# Records of one size in a row from which an unknown id is followed like a known one.
MIN_EQUAL_RECORDS = 8


def read_ulog(path: Path | str, *, data: Bytes | None = None) -> Messages:
    """Return a ULog with ``(topic, multi id)`` keys.

    ``data`` are its bytes if mapped. LogUnreadable if the file cannot be opened, NotALog if it is no ULog, LogUnusable
    if it is encrypted without key or needs a newer reader. Damage is listed, never raised.
    """
    path = Path(path)
    data = read_file_bytes(path) if data is None else data
    if is_encrypted(data[:FILE_HEADER].tobytes()):
        data = decrypt(path, data)
    begin = _header_place(data)
    head = data[begin : begin + FILE_HEADER].tobytes()
    if not head.startswith(MAGIC) or len(head) < FILE_HEADER:
        raise NotALog(f"{path}: no ULog header at the start of the file")
    return _Reader(path, data, begin).messages()


def _header_place(data: Bytes) -> int:
    """Return the position of the first byte that is not erased."""
    for at in range(0, len(data), MAX_SEARCH_BYTES):
        block = data[at : at + MAX_SEARCH_BYTES]
        written = ((block != ERASED[0]) & (block != ERASED[1])).nonzero()[0]
        if len(written):
            return at + int(written[0])
    return 0


class _Reader:
    """Reader of one file, in one pass by :meth:`messages`."""

    def __init__(self, path: Path, data: Bytes, begin: int) -> None:
        self.path, self.data, self.raw, self.size = path, data, data.data, len(data)
        self.losses = DamageLog()
        self.damaged = False  # by more than truncation
        self.sizes = Sizes()  # of subscribed ids
        self.framing = Framing(data, self.sizes)
        self.followed = Sizes()  # of all ids that the chain follows
        self.chain = DataChain(self.data, self.followed)
        self.content = Content(self._time_before)
        self.topics: dict[tuple[str, int], Topic] = {}
        self.boots: list[int] = []
        self.headers = 0
        self.unknown: dict[int, array[int]] = {}  # starts of records without definition
        self.equal_sized: dict[int, tuple[int, int]] = {}  # size of an unknown id, and records of it in a row
        self.segments: Segments = []  # not sorted yet
        self.pending = 0  # records in them
        self.appended: list[int] = []  # starts of appended data
        self.last, self.low = 0, 0  # last data record, and the place from which anchors are searched
        if begin:
            self.losses.add(0, begin, f"{counted(begin, 'erased byte')} before the log", f"at byte {begin}")
        self._start_log(begin)

    def messages(self) -> Messages:
        """Walk the file and return its tables."""
        position = self.header + FILE_HEADER
        while position < self.size:
            stop = min((a for a in self.appended if a > position), default=self.size)
            position = self._walk(position, stop)
        self._end_log()
        tables = self._tables()
        ends = [*self.boots[1:], self.size]
        content = self.content
        del self.content, self.framing, self.chain  # cycles with the reader
        return Messages(
            self.path,
            "ulog",
            self.size,
            tables,
            content.params,
            content.texts,
            content.info,
            self.losses,
            content.dropouts_ms,
            [Boot(a, b) for a, b in zip(self.boots, ends, strict=True)],
        )

    def _tables(self) -> dict[tuple[str, int], Table]:
        """Return the topics with records by name, and report what exceeds the limits."""
        tables: dict[tuple[str, int], Table] = {}
        columns: dict[int, int] = {}
        in_groups = any(len(topic.parts) > 1 for topic in self.topics.values())
        for (name, multi), topic in sorted(self.topics.items()):
            offset = int(topic.parts[0][1][0])
            more = sum(layout.columns for layout in topic.layouts if id(layout) not in columns)
            if sum(columns.values()) + more > MAX_COLUMNS:
                self.losses.add_limit(
                    f"{name} has {more} fields, with which the log has more than the {MAX_COLUMNS} that are "
                    "read; it and what follows it is left out.",
                    offset,
                )
                break
            columns |= {id(layout): layout.columns for layout in topic.layouts}
            with self.losses.around(name, "its table", offset):
                table = topic.table(self.data, name, multi, self.losses, own_starts=in_groups)
                if self.damaged:
                    table = self._without_implausible(table)
                    topic.forget()
                if len(table):
                    tables[name, multi] = table
            if topic.left_out:
                self.losses.add_limit(
                    f"{name} has more than {MAX_LAYOUTS} layouts; {counted(topic.left_out, 'record')} of further ones "
                    f"{'is' if topic.left_out == 1 else 'are'} left out.",
                    offset,
                    topic.left_out,
                )
        self.content.report(self.losses)
        if self.headers > MAX_BOOTS:
            self.losses.add_limit(
                f"The file holds {self.headers} headers; from the {MAX_BOOTS}th on all is one power-up."
            )
        return tables

    def _walk(self, position: int, stop: int) -> int:
        """Read records up to ``stop``, or up to announced appended data."""
        plan, raw = self.appended, self.raw
        while position < stop and self.appended is plan:
            if position + DATA_HEADER_BYTES <= stop and raw[position + 2] == DATA:
                starts, ids = self.chain.follow(position, stop)
                if len(starts):
                    self._keep(starts, ids)
                    position = self.framing.end(self.last)
                    continue
            if raw[position] == SYNC_MARK[0] and raw[position : position + len(SYNC_MARK)] == SYNC_MARK:
                position += len(SYNC_MARK)
                continue
            following = self._record(position, stop)
            position = self._resume(position, stop) if following is None else following
        return position

    def _keep(self, starts: Offsets, ids: Identifiers) -> None:
        if self.pending >= MAX_SORTED_RECORDS:  # before adding, because the last record may be rejected
            self._group()
        self.segments.append((starts, ids))
        self.pending += len(starts)
        self._remember()

    def _remember(self) -> None:
        """Update the last record and the recent records with known times."""
        if not self.segments:
            self.last, self.framing.recent = 0, []
            return
        starts, ids = self.segments[-1]
        self.last = int(starts[-1])
        if self.equal_sized:
            starts = starts[-MAX_RECENT_SEARCHED:]
            starts = starts[self.sizes.smallest[ids[-MAX_RECENT_SEARCHED:]] > 0]
            if not len(starts):
                self.framing.recent = [start for start in self.framing.recent if start <= self.last]
                return
        self.framing.recent = starts[-RECENT_RECORDS:].tolist()

    def _record(self, position: int, stop: int) -> int | None:
        """Read a record other than known data; return the next position, None without a valid record."""
        if self.framing.is_header(position) and position + FILE_HEADER <= stop:
            self._end_log()
            self._start_log(position)
            return position + FILE_HEADER
        if position + 3 > stop or (end := self.framing.end(position)) > stop:
            return None
        kind = self.raw[position + 2]
        if kind == DATA or not self.framing.is_strict(position, end):
            return self._uncertain_record(position, end, stop)
        if not self.framing.leads_on(end, stop, 1, odd=True):
            return None
        self._take(kind, position, end)
        return end

    def _uncertain_record(self, position: int, end: int, stop: int) -> int | None:
        """Read a doubtful record: data of an unknown id, or a record that is not strictly valid for its type.

        Returns the next position, None if rejected.
        """
        kind, length = self.raw[position + 2], end - position - 3
        if kind == 0 or not length or (not KNOWN_KINDS[kind] and length > MAX_UNKNOWN_BYTES):
            return None
        if (kind == DATA and length < 2) or not self.framing.leads_on(end, stop, 2, odd=kind != DATA):
            return None
        may_hide_records = kind != DATA or length > MIN_HIDING_BYTES
        if may_hide_records and self.framing.anchor(position + 1, end) < end:
            return None
        if kind == DATA:
            self._take_unknown(identifier_at(self.raw, position), position, length)
        elif kind in b"IMFPQALC":
            self._take(kind, position, end)
        return end

    def _take_unknown(self, identifier: int, position: int, length: int) -> None:
        """Add a data record without definition.

        After MIN_EQUAL_RECORDS records of one size its id is followed like a known one.
        """
        self.unknown.setdefault(identifier, array("q")).append(position)
        if self.followed.smallest[identifier] or len(self.equal_sized) >= MAX_IDS_FOLLOWED:
            return
        size, count = self.equal_sized.get(identifier, (length, 0))
        self.equal_sized[identifier] = length, count + 1 if size == length else 1
        if size == length and count + 1 == MIN_EQUAL_RECORDS:
            self.followed.set(identifier, length, length)
            self.chain.forget()

    def _resume(self, position: int, stop: int) -> int:
        """Report damage at ``position`` and return the next valid record's position.

        The data record that ends at ``position`` is rejected, except if the log ends in a truncated record.
        """
        if self.framing.is_cut_off(position, stop) and self.framing.anchor(position + 1, stop) == stop:
            resumed = "at the end of the file" if stop == self.size else f"at the appended data, byte {stop}"
            self.losses.add(position, stop - position, "a record that is cut off", resumed)
            return stop
        self.damaged = True
        begin = position
        if self.segments and self.framing.end(self.last) == position:
            begin = self.last
            self._drop_last()
        here = self.framing.anchor(max(begin + 1, self.low), stop)
        self.low = here
        lost = f"{counted(here - begin, 'byte')} outside records"
        self.losses.add(
            begin, here - begin, lost, f"at byte {here}" if here < stop else "nothing behind it is readable"
        )
        return here

    def _drop_last(self) -> None:
        starts, ids = self.segments.pop()
        self.pending -= 1
        if len(starts) > 1:
            self.segments.append((starts[:-1], ids[:-1]))
        self._remember()

    def _without_implausible(self, table: Table) -> Table:
        """Return the table without implausible records."""
        false = implausible(table.rows(slice(None)))
        if not false.any():
            return table
        for start in table.offsets[false].tolist():
            lost = f"a record of {table.name} with impossible numbers"
            self.losses.add(start, self.framing.end(start) - start, lost, "behind it")
        return table.rows(~false)

    def _end_log(self) -> None:
        """Sort pending records by topic, and assign or report records without subscription."""
        self._group()
        for identifier, places in self.unknown.items():
            starts: Offsets = np.sort(np.frombuffer(places, np.int64)).astype(offset_type(self.size))
            first = int(starts[0])
            lengths = 3 + self.data[starts].astype(np.int64) + 256 * self.data[starts + 1].astype(np.int64)
            found = None
            if identifier not in self.definitions.by_id and identifier not in self.definitions.why_not:
                found = self._only_topic_for(lengths, starts)
            if found is not None:
                name, layout = found
                self._add((name, 0), layout, starts)
                lost = f"the subscription of id {identifier}; its {counted(len(starts), 'record')} can only be {name}"
                self.losses.add(first, 0, lost, f"read as {name}")
                continue
            name, why = self.definitions.why_not.get(identifier, ("", ""))
            what = (
                f"{name}, which cannot be used: {why}"
                if name
                else (f"id {identifier}, which no readable definition describes")
            )
            lost = f"{counted(len(starts), 'record')} ({counted(int(lengths.sum()), 'byte')}) of {what}"
            self.losses.add(first, 0, lost, "skipped one by one")
            self.losses.bytes += int(lengths.sum())
        self.unknown.clear()
        self.equal_sized.clear()
        if self.headers <= MAX_BOOTS:
            self.definitions.report(self.losses)

    def _only_topic_for(self, lengths: Offsets, starts: Offsets) -> tuple[str, TopicLayout] | None:
        """Return the only topic without subscription with this size and rising times, else None."""
        if len(starts) < ANCHOR_RECORDS or (lengths != lengths[0]).any():
            return None
        fitting: list[tuple[str, TopicLayout]] = []
        tried: dict[int | None, bool] = {}
        for name, layout in self.definitions.without_subscription(int(lengths[0]) - DATA_HEADER_BYTES):
            if layout.time_at not in tried:
                if len(tried) >= MAX_GUESSES:
                    return None
                tried[layout.time_at] = times_rise(self.data, starts, layout)
            if tried[layout.time_at]:
                fitting.append((name, layout))
            if len(fitting) > 1:
                return None
        return fitting[0] if fitting else None

    def _start_log(self, position: int) -> None:
        """Begin a power-up with its own definitions at a file header."""
        self.definitions = Definitions()
        self.framing.forget()
        self.last, self.low = 0, 0
        self.segments.clear()
        self.headers += 1
        self.header = position
        if self.headers <= MAX_BOOTS:
            self.boots.append(position)
        self.content.start(self.raw[position + 7], struct.unpack_from("<Q", self.raw, position + 8)[0])
        self.sizes.forget()
        self.followed.forget()
        self.chain.forget()

    def _take(self, kind: int, position: int, end: int) -> None:
        payload = bytes(self.raw[position + 3 : end])
        try:
            match chr(kind):
                case "F":
                    self.definitions.declare(decode_ulog_text(payload))
                case "A":
                    self._take_subscription(payload)
                case "B":
                    self._take_flags(payload, position)
                case _:
                    self.content.take(kind, payload, position)
        except (IndexError, struct.error):
            self.losses.add(position, end - position, f"a malformed {chr(kind)} record", "behind it")
        except Exception as error:
            self.losses.caught(error, f"Records of type {chr(kind)}", "one of them", position)

    def _take_subscription(self, payload: bytes) -> None:
        self.content.in_data = True
        multi, identifier = struct.unpack_from("<BH", payload)
        subscription = self.definitions.subscription(identifier, decode_ulog_text(payload[3:]), multi)
        if subscription is None:
            return
        if subscription != self.definitions.by_id.get(identifier):
            if self.followed.smallest[identifier]:
                self._group()  # earlier records keep their meaning
            self.definitions.by_id[identifier] = subscription
        layout = subscription.layout
        self.framing.subscribe(identifier, layout)
        if self.followed.set(identifier, layout.size + 2, layout.full_size + 2):
            self.chain.forget()

    def _take_flags(self, payload: bytes, position: int) -> None:
        if position != self.header + FILE_HEADER:
            return  # flags follow the header; anything else is damage
        incompatible = payload[8:16]
        if incompatible[0] & ~1 or any(incompatible[1:]):
            raise LogUnusable(
                f"{self.path}: the log says that it needs a newer reader (incompatible flags "
                f"{incompatible.hex()}); update attlog"
            )
        if incompatible[0] & 1:
            offsets = struct.unpack_from("<3Q", payload, 16)
            self.appended = [self.header + a for a in offsets if position < self.header + a < self.size]

    def _time_before(self, position: int) -> int | None:
        """Return the last stamp before a position, None without one."""
        last = self.framing.recent[-1] if self.framing.recent else 0
        stamp = self.framing.time_at(last) if last and last < position else None
        return stamp if stamp is not None and stamp < MAX_START_US else None

    def _group(self) -> None:
        """Sort the collected starts into their topics, file order within each."""
        if not self.segments:
            return
        segments, self.segments, self.pending = self.segments, [], 0
        for identifier, part in offsets_by_kind(segments):
            meant = self.definitions.by_id.get(identifier)
            if meant is None:
                self.unknown.setdefault(identifier, array("q")).frombytes(part.astype(np.int64).tobytes())
            else:
                self._add((meant.name, meant.multi), meant.layout, part)

    def _add(self, key: tuple[str, int], layout: TopicLayout, offsets: Offsets) -> None:
        if key not in self.topics:
            self.topics[key] = Topic([layout])
        self.topics[key].add(layout, offsets)
