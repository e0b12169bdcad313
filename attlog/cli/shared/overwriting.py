"""Is a file that a command would write one that it reads, or somebody's flight log? Then it would be gone.

``--junit flight.bin`` is a slip of the fingers, a log cannot be flown again. Reports of earlier runs are replaced.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from attlog.base.errors import AttlogError, UsageError

WRITTEN = {"junit": "--junit", "summary": "--summary", "output": "-o"}
"""Parameters of commands that name what is written, and the options that people type."""
OUTPUT_IS_A_FILE = ("extract", "diff", "table", "simulate")
"""Elsewhere ``-o`` is a folder, and a file of that name is left alone without this."""
WRITES_LOGS = "simulate"


def check(command: str, params: Mapping[str, Any]) -> None:
    """UsageError where a file to write, among the parameters of a command, is a log or one of the files to read."""
    read = [word for name, value in params.items() if name not in WRITTEN for word in _words(value)]
    for name, option in WRITTEN.items():
        if name == "output" and command not in OUTPUT_IS_A_FILE:
            continue
        for path in _words(params.get(name)):
            refuse(option, path, read, logs=command != WRITES_LOGS)


def refuse(option: str, path: str, read: Iterable[str], *, logs: bool = True) -> None:
    """UsageError where ``path``, which ``option`` would write, is a file that is read or, with ``logs``, a log."""
    if not os.path.isfile(path):
        return
    if any(os.path.isfile(word) and os.path.samefile(path, word) for word in read):
        raise UsageError(f"{option} {path}: is read by this command and would be overwritten; use another name")
    if logs and _is_log(path):
        raise UsageError(f"{option} {path}: is a flight log and would be overwritten; use another name")


def _words(value: Any) -> Iterator[str]:
    """The texts of a parameter that may be names of files, those of a list of filters one by one."""
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        yield text
        if "," in text:
            yield from text.split(",")
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _words(item)


def _is_log(path: str) -> bool:
    from attlog import formats

    try:
        formats.recognise(path)
    except AttlogError:
        return False
    return True
