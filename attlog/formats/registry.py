"""One entry per log format: how it is recognised, read, written and checked, loaded when it is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import UsageError
from attlog.formats.base import Messages
from attlog.formats.recording import Recording

if TYPE_CHECKING:
    from attlog.formats.oracle import Oracle


@dataclass(frozen=True, slots=True)
class Format:
    """A log format. Recogniser, reader, writer and oracle name places below ``attlog.formats`` as ``module:name``.

    ``name`` is ``Messages.format``; ``title`` and ``suffix`` are what messages say (files are told apart by content
    when they are read, by suffix when they are written). ``recogniser(head) -> bool`` judges the first bytes;
    ``reader(path, *, data) -> Messages`` decodes; ``writer(path, recording)`` takes a
    :class:`attlog.formats.recording.Recording` and is None for formats that are only read; ``oracle`` is an
    :class:`attlog.formats.oracle.Oracle`. ``several_vehicles``: the reader takes ``system`` too.
    """

    name: str
    title: str
    suffix: str
    recogniser: str
    reader: str
    writer: str | None
    oracle: str
    several_vehicles: bool = False

    @property
    def for_people(self) -> str:
        """Title and suffix."""
        return f"{self.title} {self.suffix}"

    def recognises(self, head: bytes) -> bool:
        """Whether a file that begins with these bytes is such a log."""
        return bool(_load(self.recogniser)(head))

    def read(self, path: Path, data: NDArray[np.uint8], system: int | None = None) -> Messages:
        """The log whose bytes are ``data``; ``system`` means nothing to a format of one vehicle."""
        read: Callable[..., Messages] = _load(self.reader)
        return read(path, system=system, data=data) if self.several_vehicles else read(path, data=data)

    def write(self, path: Path, recording: Recording) -> None:
        """Write the log; UsageError for what the format cannot hold, and where attlog has no writer for it."""
        if self.writer is None:
            raise UsageError(f"{path}: attlog reads {self.title} logs and does not write them")
        _load(self.writer)(path, recording)

    def load_oracle(self) -> Oracle:
        """How the official library is asked."""
        oracle: Oracle = _load(self.oracle)
        return oracle


def _load(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(f"attlog.formats.{module}"), name)
