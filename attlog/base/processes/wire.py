"""Values between two processes over a socket, each whole or not at all.

A frame is the number of its parts, their sizes and the parts: the pickle of a value, then the arrays in it, which are
neither copied into the pickle nor out of it. Pickles run code of whoever sent them: both ends are processes of one
user, and what a process of a filter is kept from is accident, not malice.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Sequence
from pickle import PickleBuffer, dumps, loads
from typing import Any

COUNT, SIZE = struct.Struct("!I"), struct.Struct("!Q")
ANY_SIZE = 1 << 62
MOST_PARTS = 1 << 20


class NonsenseError(Exception):
    """What came is no frame: the memory of the process that sent it is spoilt."""


class Wire:
    """One end of a socket; both ends may be used by several threads, each end by one thread that receives."""

    def __init__(self, connection: socket.socket, most_bytes: int = ANY_SIZE) -> None:
        """``most_bytes``: what is larger is nonsense."""
        self._connection, self._most = connection, most_bytes
        self._lock = threading.Lock()

    def fileno(self) -> int:
        """The descriptor to wait for."""
        return self._connection.fileno()

    def send(self, value: Any, seconds: float | None = None) -> None:
        """Send a value. TimeoutError where it is not taken in time, OSError where nobody is there."""
        self.send_parts(parts(value), seconds)

    def send_parts(self, sent: Sequence[Any], seconds: float | None = None) -> None:
        """Send what :func:`parts` made."""
        with self._lock:
            self._connection.settimeout(seconds)
            sizes = [len(part) for part in sent]
            self._connection.sendall(b"".join([COUNT.pack(len(sizes)), *map(SIZE.pack, sizes)]))
            for part in sent:
                self._connection.sendall(part)

    def receive(self, begins_s: float | None = None, ends_s: float | None = None) -> list[bytearray]:
        """The parts of the next value, for :func:`value`.

        TimeoutError where nothing comes within ``begins_s``, or not all of it within ``ends_s`` after that; EOFError
        where the other end is closed.
        """
        self._connection.settimeout(begins_s)
        try:
            begin = self._connection.recv(1)
        except BlockingIOError:
            raise TimeoutError from None
        if not begin:
            raise EOFError
        until = None if ends_s is None else time.monotonic() + ends_s
        (count,) = COUNT.unpack(begin + self._exactly(COUNT.size - 1, until))
        if not 0 < count <= MOST_PARTS:
            raise NonsenseError(f"{count} parts")
        sizes = [size for (size,) in SIZE.iter_unpack(self._exactly(SIZE.size * count, until))]
        if sum(sizes) > self._most:
            raise NonsenseError(f"{sum(sizes)} bytes")
        return [self._exactly(size, until) for size in sizes]

    def close(self) -> None:
        """End it: the other side reads an end."""
        self._connection.close()

    def _exactly(self, size: int, until: float | None) -> bytearray:
        found = bytearray(size)
        left = memoryview(found)
        while left:
            self._connection.settimeout(None if until is None else max(until - time.monotonic(), 1e-3))
            count = self._connection.recv_into(left)
            if not count:
                raise EOFError
            left = left[count:]
        return found


def parts(value: Any) -> list[Any]:
    """A value as the parts of a frame: its pickle, then the memory of its arrays."""
    buffers: list[PickleBuffer] = []
    pickled = dumps(value, 5, buffer_callback=buffers.append)
    return [pickled, *(buffer.raw() for buffer in buffers)]


def value(received: Sequence[bytearray]) -> Any:
    """The value of a frame; its arrays lie in what was received. Any exception, where the pickle is none."""
    return loads(received[0], buffers=received[1:])
