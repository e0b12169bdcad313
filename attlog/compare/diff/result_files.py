"""Which results belong together: two files, or the files of two folders by name, else by the log they are of."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from attlog.base.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.result import SCHEMA_NAME, Result

HEAD = 200
"""A result says so within its first bytes."""


@dataclass(slots=True)
class ResultPairs:
    """Results by the name that both sides share; None where one side has none. ``wrong``: files that cannot be used."""

    pairs: dict[str, tuple[Result | None, Result | None]] = field(default_factory=dict)
    wrong: list[AttlogError] = field(default_factory=list)


def found(old: Path, new: Path) -> ResultPairs:
    """The results in two files or two folders. LogUnreadable, LogUnusable for a file or folder that has none.

    UsageError for a file beside a folder. In folders a broken file is left out and named in ``wrong``.
    """
    if os.path.isdir(old) != os.path.isdir(new) and os.path.exists(old) and os.path.exists(new):
        raise UsageError(f"{old} and {new}: give two files or two folders")
    if not os.path.isdir(old):
        return ResultPairs({new.name: (loaded(old), loaded(new))})
    answer = ResultPairs()
    sides = [_of_folder(folder, answer.wrong) for folder in (old, new)]
    names = {name: name for name in sides[0] if name in sides[1]}
    for name in (n for n in sides[0] if n not in names):
        log = sides[0][name].log.get("sha256")
        same = [n for n in sides[1] if n not in names.values() and sides[1][n].log.get("sha256") == log and log]
        names |= {name: same[0]} if len(same) == 1 else {}
    answer.pairs = {name: (sides[0][name], sides[1][names[name]] if name in names else None) for name in sides[0]}
    answer.pairs |= {name: (None, r) for name, r in sides[1].items() if name not in names.values()}
    return answer


def loaded(path: Path) -> Result:
    """A result. LogUnreadable if the file cannot be opened, LogUnusable if it is no result."""
    try:
        return Result.load(path)
    except UsageError as error:
        raise LogUnusable(str(error)) from None


def _of_folder(folder: Path, wrong: list[AttlogError]) -> dict[str, Result]:
    """The results below a folder by their path in it; other JSON files are not meant."""
    meant = [p for p in sorted(folder.rglob("*.json")) if os.path.isfile(p) and _is_result_file(p)]
    if not meant:
        raise LogUnreadable(f"{folder}: is a folder without a result of attlog analyze (*.json)")
    results: dict[str, Result] = {}
    for path in meant:
        try:
            results[path.relative_to(folder).as_posix()] = loaded(path)
        except AttlogError as error:
            wrong.append(error)
    return results


def _is_result_file(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return SCHEMA_NAME.encode() in file.read(HEAD)
    except OSError:
        return True  # reading it says what is wrong
