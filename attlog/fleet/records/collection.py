"""The logs of batch folders and of single results, as entries: for what is told across logs."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog.base.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.fleet.records import restored as from_results
from attlog.fleet.records.entry import FORM, Entry, index_row
from attlog.fleet.records.record import INSIDE, records
from attlog.fleet.records.results_file import CSV, PARQUET
from attlog.result import SCHEMA_NAME, Result

HEAD = 200
"""A result says so within its first bytes."""


@dataclass(slots=True)
class Gathered:
    """Goes through the entries of files and folders, one after the other.

    ``metrics``: what is asked for; of a batch whose results file is up to date only these are read from there.
    Without any, or without that file, entries hold everything. ``wrong``: what could not be used, complete when all
    entries were taken; ``failed``: how many logs of the batches have no result.
    """

    given: list[Path]
    metrics: Sequence[str] = ()
    wrong: list[AttlogError] = field(default_factory=list)
    failed: int = 0

    def __iter__(self) -> Iterator[tuple[str, Entry]]:
        """(what was given, entry) of every log with a result, in the order of names."""
        for given in self.given:
            path = given.parent if given.name in (PARQUET, CSV) and os.path.isfile(given) else given
            try:
                for entry in self._of_folder(path) if os.path.isdir(path) else [of_result(path)]:
                    yield str(path), entry
            except AttlogError as error:
                self.wrong.append(error)

    def _of_folder(self, folder: Path) -> Iterator[Entry]:
        """A batch folder by its records, results without one by themselves; any other folder by its results."""
        seen: set[str] = set()
        found = from_results.found(folder, self.metrics) if self.metrics else None
        if found is not None:
            seen = {p.name for p in (folder / INSIDE / "records").glob("*.json")}
            entries, failed = found
            self.failed += failed
            yield from entries
        for record in records(folder) if found is None else ():
            seen.add(f"{record.name}.json")
            if not record.done:
                self.failed += 1
            elif record.row.get("form") == FORM:
                yield Entry(record.log, record.name, row=record.row)
            else:
                yield from self._read([folder / f"{record.name}.json"])
        meant = [p for p in sorted(folder.rglob("*.json")) if INSIDE not in p.parts and p.name not in seen]
        results = [p for p in meant if is_result(p)]
        if not results and not seen:
            raise LogUnreadable(f"{folder}: is a folder without a batch or a result of attlog (*.json)")
        yield from self._read(results)

    def _read(self, paths: Iterable[Path]) -> Iterator[Entry]:
        for path in paths:
            try:
                yield of_result(path)
            except AttlogError as error:
                self.wrong.append(error)


def of_result(path: Path) -> Entry:
    """The entry of one result of ``attlog analyze``, also of an older schema. LogUnreadable, LogUnusable if none."""
    try:
        result = Result.load(path)
    except UsageError as error:
        raise LogUnusable(str(error)) from None
    row: dict[str, Any] = index_row(result)
    return Entry(str(row["flight"]["name"] or path.name), path.name.removesuffix(".json"), row=row)


def is_result(path: Path) -> bool:
    """Whether a JSON file says that it is a result, or cannot be read, which reading it tells; no pipe is asked."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return SCHEMA_NAME.encode() in file.read(HEAD)
    except OSError:
        return True
