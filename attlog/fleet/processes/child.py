"""What the process of one log does: analyse it, write its files to the room it was given, tell what became of it."""

from __future__ import annotations

import faulthandler
import logging
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.base.errors import BUG, LogUnreadable, OutputError, exit_code, message
from attlog.base.output import is_full
from attlog.fleet.processes.files import analyze_to_files
from attlog.fleet.records.record import written
from attlog.fleet.records.row import index_row
from attlog.fleet.records.work import Work, key, stamp
from attlog.fleet.sources.unchanged import unchanged

Tell = Callable[[dict[str, Any]], None]
"""Sends a message to the process that waits: ``stage``, ``compiling`` or the fields of a record."""
TOLD = {"attlog.stages": "stage", "attlog.compiling": "compiling"}


class Telling(logging.Handler):
    """Passes on what is being done."""

    def __init__(self, tell: Tell) -> None:
        super().__init__(logging.INFO)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell({TOLD[record.name]: record.getMessage()})


def quietly(room: Path) -> None:
    """Let all that this process says, also when it crashes, go to a file in its room."""
    said = os.open(room / "said.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for standard, instead in ((0, nothing), (1, said), (2, said)):
        os.dup2(instead, standard)
    faulthandler.enable(said)


def analyse(work: Work, room: Path, tell: Tell) -> None:
    """Analyse one log to files in ``room``, and tell the fields of its record; an error is told too, never raised."""
    for name in TOLD:
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [Telling(tell)], False
        logger.setLevel(logging.INFO)
    content = ""
    try:
        sign = _stamp(work)
        with unchanged(Path(work.source.place)), work.source.local(room) as log:
            content = log.sha256
            done = analyze_to_files(
                log.path, work.config, room / "out", work.name, command=work.command, deterministic=work.deterministic
            )
        tell(
            {
                "key": key(content, work.settings),
                "stamp": sign,
                "row": index_row(done.result),
                "files": {path.name: written(path) for path in (done.report, done.json)},
            }
        )
    except Exception as error:
        code = exit_code(error)
        tell(
            {
                "key": key(content, work.settings) if content and not isinstance(error, LogUnreadable) else "",
                "code": code,
                "message": message(error, __version__, work.source.name).replace(str(room / "out"), str(work.folder)),
                "trace": "".join(traceback.format_exception(error)) if code == BUG else "",
                "folder_full": isinstance(error, OutputError) and is_full(error.__cause__),
            }
        )


def _stamp(work: Work) -> str:
    """Taken before the bytes, so that a later change is noticed. A server that fails now may answer the download."""
    try:
        return stamp(work.source)
    except LogUnreadable:
        return ""
