"""The last barrier around one message type of a reader, see :mod:`attlog.base.barrier`: the rest of the log goes on.

What nobody expected becomes a remark with the message, the kind of error and its place, and a traceback at log level
debug.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from attlog.base.barrier import RAISE, sentence
from attlog.base.errors import AttlogError
from attlog.formats.base import Remark

CODE = "part_failed"
"""Code of the remarks made here; no log that is sound may have one."""


class Barrier:
    """Collects what failed into ``remarks``, one for each message type however often it fails."""

    def __init__(self, remarks: list[Remark]) -> None:
        self._remarks = remarks
        self._failed: set[str] = set()

    @contextmanager
    def around(self, message: str, what: str, offset: int | None) -> Iterator[None]:
        """Run the body; an unexpected error in it ends here. ``what`` of the message it reads, ``offset`` where."""
        try:
            yield
        except Exception as error:
            self.caught(error, message, what, offset)

    def caught(self, error: Exception, message: str, what: str, offset: int | None) -> None:
        """The same for an error at hand; raises it where it was meant, or is no message's fault, or under test."""
        if isinstance(error, (AttlogError, MemoryError)) or os.environ.get(RAISE):
            raise error
        import logging  # nearly no log needs it

        logging.getLogger("attlog.formats").debug("%s, %s, byte %s", message, what, offset, exc_info=error)
        if message not in self._failed:
            self._failed.add(message)
            at = "" if offset is None else f" from byte {offset} on"
            self._remarks.append(Remark(CODE, sentence(f"{message}{at}", error), offset))


def unguarded(message: str, what: str, offset: int | None) -> AbstractContextManager[None]:
    """No barrier: for what is read on behalf of a reader that has its own around it."""
    return nullcontext()
