"""The channels of a bag: MCAP, or a SQLite database as rosbag2 wrote by default before Iron."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnusable
from attlog.base.limits import MAX_FORMATS
from attlog.formats.base import Damage
from attlog.formats.ros import mcap
from attlog.formats.ros.channels import WANTED, Bag, BagChannel
from attlog.formats.ros.detect import MCAP

JOURNAL = slice(18, 20)
"""Where a database says whether a journal (``-wal``) lies beside it: one that does cannot be read from memory."""


def read(path: Path, data: NDArray[np.uint8], wanted: WANTED) -> Bag:
    """The bag in these bytes. LogUnusable for a database or an MCAP file that is none, UsageError without packages."""
    return mcap.read(path, data, wanted) if data[: len(MCAP)].tobytes() == MCAP else _sqlite(path, data, wanted)


def _sqlite(path: Path, data: NDArray[np.uint8], wanted: WANTED) -> Bag:
    content = bytearray(data.tobytes())
    journal = content[JOURNAL] == b"\2\2"
    content[JOURNAL] = b"\1\1"
    bag = Bag([], {}, ended=not (journal and _lies_beside(path)))
    with closing(sqlite3.connect(":memory:")) as database:
        database.text_factory = lambda raw: raw.decode("utf-8", "replace")
        try:
            database.deserialize(bytes(content))
            del content
            database.execute("pragma trusted_schema = off")
            tables = {name for (name,) in database.execute("select name from sqlite_master where type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise LogUnusable(f"{path}: a SQLite database, but no bag of ROS 2 (no tables topics and messages)")
            channels = _topics(database, bag, wanted, "message_definitions" in tables)
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


def _topics(database: sqlite3.Connection, bag: Bag, wanted: WANTED, defined: bool) -> dict[object, BagChannel]:
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


def _lies_beside(path: Path) -> bool:
    """Whether what was written last is still in the database's journal."""
    journal = path.with_name(f"{path.name}-wal")
    return journal.is_file() and journal.stat().st_size > 0
