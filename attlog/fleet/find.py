"""Which logs do files, folders and patterns mean?"""

from __future__ import annotations

import glob
from collections.abc import Iterable, Iterator
from pathlib import Path

from attlog import formats
from attlog.errors import AttlogError, LogUnreadable, NotALog, UsageError

PATTERN = frozenset("*?[")
LOG_SUFFIXES = frozenset((".ulg", ".tlog", ".px4log"))
"""A file of these names was meant as a log even where its content is none; other names serve other things too."""


def find(given: Iterable[Path]) -> tuple[list[Path], list[AttlogError]]:
    """The logs that were named, each once, and what is wrong with the names.

    A file is taken as it is, also where it does not exist: reading it says so. A folder
    stands for the logs in it at any depth (hidden folders left out), a pattern that no
    file bears as its name for the logs that it matches (``**`` reaches into folders);
    there logs are known by their content, also in gzip files. A folder or pattern
    without a log is a LogUnreadable, ``-`` a UsageError.
    """
    logs: dict[Path, None] = {}
    wrong: list[AttlogError] = []
    for path in given:
        try:
            logs |= dict.fromkeys(_meant(path))
        except AttlogError as error:
            wrong.append(error)
    return list(logs), wrong


def _meant(path: Path) -> list[Path]:
    if str(path) == "-":
        raise UsageError("a log cannot come from standard input: it is memory-mapped; give a file name")
    if path.is_dir():
        return list(_in_folder(path))
    if path.exists() or not PATTERN & set(str(path)):
        return [path]
    matches = sorted(map(Path, glob.glob(str(path), recursive=True)))
    if not matches:
        raise LogUnreadable(f"{path}: no file matches this pattern")
    files = [m for m in matches if not m.is_dir()]
    logs = list(filter(is_meant, files)) + ([] if files else [log for folder in matches for log in _in_folder(folder)])
    if not logs:
        raise LogUnreadable(f"{path}: none of the {len(files)} files that match is a flight log")
    return logs


def _in_folder(folder: Path) -> Iterator[Path]:
    found = False
    for path in sorted(folder.rglob("*")):
        hidden = any(name.startswith(".") for name in path.relative_to(folder).parts)
        if not hidden and path.is_file() and is_meant(path):
            found = True
            yield path
    if not found:
        raise LogUnreadable(f"{folder}: is a folder without a flight log")


def is_meant(path: Path) -> bool:
    """Whether a file found in a folder is a log, by its content; one that cannot be read or is damaged, by its name."""
    try:
        formats.recognise(path)
    except (NotALog, LogUnreadable):
        name = path.with_suffix("") if path.suffix.lower() == ".gz" else path
        return name.suffix.lower() in LOG_SUFFIXES
    return True
