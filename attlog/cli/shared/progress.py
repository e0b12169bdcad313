"""What a run says while it works: stages on a terminal, compiling also with -v."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from attlog.cli.shared.common import to_stderr

STAGES, COMPILING = "attlog.stages", "attlog.compiling"
"""Loggers: the stage an analysis is in, and filters that are compiled."""


class Shown(logging.Handler):
    """Writes to standard error: each compiled filter a line, stages one line that is overwritten.

    ``before`` begins every stage (``[2/5] flight.ulg: ``).
    """

    def __init__(self, stages: bool) -> None:
        super().__init__(logging.INFO)
        self.stages = stages
        self.before = ""
        self._width = 0

    def emit(self, record: logging.LogRecord) -> None:
        if record.name == COMPILING:
            self.clear()
            to_stderr(f"attlog: {record.getMessage()}")
        elif self.stages:
            self.show(f"{self.before}{record.getMessage()} ...")

    def show(self, text: str) -> None:
        """Put a text in place of the stage that is shown; blanks wipe the old one, so no escape sequence is needed."""
        import shutil

        from attlog.present.text import for_terminal

        text = for_terminal(text)[-(shutil.get_terminal_size().columns - 1) :]
        print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
        self._width = len(text)

    def clear(self) -> None:
        """Leave an empty line where a stage was shown."""
        if self._width:
            print("\r" + " " * self._width + "\r", end="", file=sys.stderr, flush=True)
            self._width = 0


@contextmanager
def progress(quiet: bool, verbose: bool) -> Iterator[Shown]:
    """Show progress while the block runs: all of it on a terminal, what is compiled also with ``verbose``."""
    terminal = sys.stderr.isatty() and not quiet
    shown = Shown(stages=terminal)
    loggers = [logging.getLogger(name) for name in (STAGES, COMPILING)] if terminal or verbose else []
    for logger in loggers:
        logger.addHandler(shown)
        logger.setLevel(logging.INFO)
        logger.propagate = False
    try:
        yield shown
    finally:
        shown.clear()
        for logger in loggers:
            logger.removeHandler(shown)
            logger.setLevel(logging.NOTSET)
            logger.propagate = True
