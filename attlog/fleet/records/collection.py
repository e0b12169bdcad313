"""The logs of batch folders and of single results, as entries: for what is told across logs.

A batch is read from its one file with every number, where that is there and up to date, else from its records.
"""

from __future__ import annotations

import importlib.util
import json
import os
import stat
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog.base.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.fleet.records.entry import FORM, Entry, index_row
from attlog.fleet.records.record import INSIDE, records
from attlog.fleet.records.results_file import COLUMNS, CSV, FAILED, PARQUET, TEXTS, UNITS
from attlog.result import SCHEMA_NAME, Result

HEAD = 200
"""A result says so within its first bytes."""


@dataclass(slots=True)
class EntryCollection:
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
        found = read_results_file(folder, self.metrics) if self.metrics else None
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


ANSWER = ("row", "window", "metric", "value", "low", "high", "n", "seconds", "code")


def up_to_date(folder: Path) -> Path | None:
    """The results file of a batch folder; None without one, without pyarrow, or where a record is newer.

    A batch writes records as it goes and the file at its end: one that was killed has records that are newer.
    """
    path = folder / PARQUET
    if importlib.util.find_spec("pyarrow") is None or not os.path.isfile(path):
        return None
    written = path.stat().st_mtime_ns
    newest = max((p.stat().st_mtime_ns for p in (folder / INSIDE / "records").glob("*.json")), default=0)
    return path if 0 < newest <= written else None


def read_results_file(folder: Path, metrics: Collection[str]) -> tuple[list[Entry], int] | None:
    """The logs of a batch folder with their answers to ``metrics``, without reasons; and how many failed.

    Those are the logs that the last call of the batch named, as in its index. A log of which no row has one of the
    metrics has an entry without answers. None where the records have to be read.
    """
    path = up_to_date(folder)
    if path is None:
        return None
    try:
        return list(_entries(path, metrics)), _failed(path)
    except (OSError, ValueError, KeyError):  # another version wrote it, or something spoiled it: the records know
        return None


def _failed(path: Path) -> int:
    from pyarrow import parquet

    return int(parquet.read_metadata(path).metadata[FAILED.encode()])


def _entries(path: Path, metrics: Collection[str]) -> Iterator[Entry]:
    import pyarrow
    from pyarrow import compute, parquet

    words = [*TEXTS, "row", "window", "metric", "code"]
    file = parquet.ParquetFile(path, read_dictionary=words)  # texts that repeat are read ten times as fast
    plain = pyarrow.schema([pyarrow.field(n, COLUMNS[n]) for n in (*TEXTS, *ANSWER)])
    units: dict[str, str] = json.loads(file.metadata.metadata[UNITS.encode()])
    logs: dict[str, Entry] = {}
    asked = pyarrow.array(list(metrics))
    for group in range(file.num_row_groups):
        table = file.read_row_group(group, columns=[*TEXTS, *ANSWER])
        held = table.filter(compute.is_in(table["metric"], value_set=asked)).cast(plain)
        others = compute.invert(compute.is_in(table["report"], value_set=held["report"].unique()))
        for part in (held, table.filter(others).cast(plain)):
            for about in part.select(TEXTS).group_by(list(TEXTS), use_threads=False).aggregate([]).to_pylist():
                logs.setdefault(about["report"], _entry(about, units))
        for line in held.select(["report", *ANSWER]).to_pylist():
            _add(logs[line["report"]], line)
    yield from logs.values()


def _entry(about: dict[str, Any], units: dict[str, str]) -> Entry:
    flight = about | {"name": about["report"]}
    row = {"form": FORM, "flight": flight, "answers": {"values": {}, "missing": [], "units": units}}
    return Entry(about["log"], about["report"], row=row)


def _add(entry: Entry, line: dict[str, Any]) -> None:
    """One answer as :func:`attlog.fleet.records.answers.packed` keeps it."""
    assert entry.row is not None
    answers = entry.row["answers"]
    place = answers["values"].setdefault(line["row"], {}).setdefault(line["window"], {})
    if line["value"] is None:
        codes = answers["missing"]
        if [line["code"], ""] not in codes:
            codes.append([line["code"], ""])
        place[line["metric"]] = codes.index([line["code"], ""])
    else:
        place[line["metric"]] = [line[key] for key in ("value", "low", "high", "n", "seconds")]
