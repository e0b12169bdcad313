"""Every number of a batch in one file: a line for each log, row, window and metric."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import os
import stat
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from attlog.batch.index_row import FORM, Entry, index_row, sensors_of
from attlog.batch.job import INSIDE, records
from attlog.core import files
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.core.files import open_atomic
from attlog.result import SCHEMA_NAME, Result

PARQUET, CSV = "results.parquet", "results.csv"
TEXTS = ("log", "report", "sha256", "date_utc", "vehicle", "firmware", "version", "board", "reference", "attlog")
"""Columns that say of which log a line is."""
COLUMNS: dict[str, str] = {
    **dict.fromkeys(TEXTS, "string"),
    "sensor_faults": "int64",
    "sensor_warnings": "int64",
    "to_set": "string",
    "row": "string",
    "window": "string",
    "metric": "string",
    "value": "double",
    "low": "double",
    "high": "double",
    "n": "int64",
    "seconds": "double",
    "unit": "string",
    "code": "string",
    "reason": "string",
}
"""The columns and their types, in order."""
ABOUT = {
    "log": "the log as it was given",
    "report": "name of its report and its JSON, without suffix",
    "sha256": "of the log's content",
    "date_utc": "when the log begins, ISO 8601",
    "version": "of the firmware",
    "attlog": "version that made the result",
    "reference": "what errors are differences from: truth, smoother, onboard or none",
    "sensor_faults": "assessments of the log's sensors that are faults",
    "sensor_warnings": "assessments of the log's sensors that are warnings",
    "to_set": "parameters that should be set, NAME old -> new; empty without",
    "row": "estimator with preset, an attitude of the log (onboard, onboard:NAME), or a sensor",
    "window": "which seconds of the log; sensors for what is said of a sensor",
    "low": "lower end of the 95 % interval",
    "high": "upper end of the 95 % interval",
    "n": "independent units of evidence",
    "seconds": "time that the value stands on",
    "code": "why there is no value",
    "reason": "the same in words",
}
UNIT_OF = {"value": "see unit", "low": "see unit", "high": "see unit", "seconds": "s", "n": "1"}
"""The unit of a column; values have that of their metric, which stands in ``unit`` and in the file's metadata."""
UNITS, FAILED = "attlog.units", "attlog.failed"
"""Keys of the file's metadata: JSON, metric -> unit; how many logs of the batch have no line because they failed."""
GROUP = 100_000
"""Lines that are held in memory at a time."""


def write_results(folder: Path, entries: Iterable[Entry]) -> Path:
    """Write ``results.parquet`` to a folder, or ``results.csv`` where pyarrow (the extra ``export``) is not installed.

    The file appears whole or not at all; one of the other kind, which would be out of date, goes. Logs without a
    row (they failed) have no line. Memory is bounded: entries are taken one after the other. OutputError if it
    cannot be written.
    """
    has_arrow = importlib.util.find_spec("pyarrow") is not None
    path, other = folder / (PARQUET if has_arrow else CSV), folder / (CSV if has_arrow else PARQUET)
    failed = 0

    def counted() -> Iterator[Entry]:
        nonlocal failed
        for entry in entries:
            failed += entry.row is None
            yield entry

    with open_atomic(path) as file:
        if has_arrow:
            _parquet(file, _batches(counted()), lambda: failed)
        else:
            _csv(file, _batches(entries))
    other.unlink(missing_ok=True)
    return path


def columns(entry: Entry) -> list[list[Any]]:
    """The lines of one log as columns, in the order of COLUMNS; each without lines for a log that failed."""
    if entry.row is None:
        return [[] for _ in COLUMNS]
    answers = entry.row["answers"]
    places: list[list[Any]] = [[], [], [], []]
    found: list[Any] = []
    for row, windows in answers["values"].items():
        for window, metrics in windows.items():
            count = len(metrics)
            units = map(answers["units"].__getitem__, metrics)
            for column, values in zip(places, ([row] * count, [window] * count, metrics, units), strict=True):
                column += values
            found += metrics.values()
    missing = [(None, None, None, None, None, code, reason) for code, reason in answers["missing"]]
    cells = [missing[f] if isinstance(f, int) else (*f, None, None) for f in found]
    flight = entry.row["flight"]
    about: list[Any] = [_text(t) for t in (entry.log, entry.name, *(flight.get(key) for key in TEXTS[2:]))]
    row_, window_, metric, unit = places
    value, low, high, n, seconds, code, reason = (
        map(list, zip(*cells, strict=True)) if cells else ([] for _ in range(7))
    )
    sensors = sensors_of(entry.row)
    about += [sensors["faults"], sensors["warnings"], "; ".join(sensors["to_set"])]
    return [[t] * len(found) for t in about] + [row_, window_, metric, value, low, high, n, seconds, unit, code, reason]


def _batches(entries: Iterable[Entry]) -> Iterator[list[list[Any]]]:
    """Columns of several logs together, of about GROUP lines."""
    held: list[list[Any]] = [[] for _ in COLUMNS]
    for entry in entries:
        for column, more in zip(held, columns(entry), strict=True):
            column += more
        if len(held[0]) >= GROUP:
            yield held
            held = [[] for _ in COLUMNS]
    yield held


def _text(value: Any) -> str | None:
    """A text that UTF-8 can hold: file names may have bytes that it cannot."""
    return None if value is None else str(value).encode("utf-8", "backslashreplace").decode("utf-8")


def _parquet(file: BinaryIO, batches: Iterator[list[list[Any]]], failed: Callable[[], int]) -> None:
    import pyarrow
    from pyarrow import parquet

    def field(name: str, kind: str) -> Any:
        about = {"unit": UNIT_OF.get(name, ""), "about": ABOUT.get(name, "")}
        type_ = pyarrow.type_for_alias(kind)
        return pyarrow.field(name, type_, metadata={key: text for key, text in about.items() if text})

    schema = pyarrow.schema([field(name, kind) for name, kind in COLUMNS.items()])
    units: dict[str, str] = {}
    metric, unit = (list(COLUMNS).index(name) for name in ("metric", "unit"))
    with parquet.ParquetWriter(file, schema, compression="zstd") as out:
        for held in batches:
            units |= dict(zip(held[metric], held[unit], strict=True))
            arrays = [pyarrow.array(c, f.type, from_pandas=False) for c, f in zip(held, schema, strict=True)]
            out.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))
        words = json.dumps(units, ensure_ascii=False, sort_keys=True)
        out.add_key_value_metadata({UNITS: words, FAILED: str(failed())})


def _csv(file: BinaryIO, batches: Iterator[list[list[Any]]]) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    out = csv.writer(text, lineterminator="\n")
    out.writerow(COLUMNS)
    for held in batches:
        out.writerows([files.csv_cell(value) for value in line] for line in zip(*held, strict=True))
    text.flush()
    text.detach()


# The logs of batch folders and of single results, as entries: for what is told across logs.
#
# A batch is read from its one file with every number, where that is there and up to date, else from its records.

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
    """One answer as :func:`attlog.batch.index_row.packed` keeps it."""
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
