"""Was a file that lies somewhere meant as a log, or as an archive of logs?"""

from __future__ import annotations

import stat
from pathlib import Path, PurePath

from attlog import formats
from attlog.base.errors import LogUnreadable, NotALog

LOG_SUFFIXES = frozenset((".ulg", ".ulge", ".tlog", ".px4log", ".mcap", ".db3"))
"""A file of these names was meant as a log even where its content is none; other names serve other things too."""

MAGICS = (b"PK\x03\x04", b"PK\x05\x06")
"""Zip archives begin so."""

SUFFIXES_OF_LOGS = LOG_SUFFIXES | {".bin", ".log", ".mavlink"}
"""Names that logs have; what stands behind a URL is told by its name alone, because asking each would take hours."""


def is_meant(path: Path) -> bool:
    """Whether a file found in a folder is a log, by its content; one that is damaged or cannot be read, by its name."""
    try:
        formats.recognise(path)
    except NotALog:
        return named_as_log(path.name)
    except LogUnreadable:
        return may_be_log(path.name)  # nobody knows what is in it: rather told than left out
    return True


def is_archive(path: Path) -> bool:
    """Whether a file begins as zip archives do; False where it cannot be read, or is a pipe that may never say."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return file.read(4) in MAGICS
    except OSError:
        return False


def named_as_log(name: str) -> bool:
    """Whether a file of this name can only have been meant as a log."""
    return _suffix(name) in LOG_SUFFIXES


def may_be_log(name: str) -> bool:
    """Whether logs have such names."""
    return _suffix(name) in SUFFIXES_OF_LOGS


def _suffix(name: str) -> str:
    return PurePath(name.lower().removesuffix(".gz")).suffix
