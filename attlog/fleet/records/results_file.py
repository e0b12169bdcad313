"""Every number of a batch in one file: a line for each log, row, window and metric."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from attlog.base.files import spreadsheet
from attlog.base.files.output import writing
from attlog.fleet.records.entry import Entry, sensors_of

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

    with writing(path) as file:
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
        out.writerows([spreadsheet.cell(value) for value in line] for line in zip(*held, strict=True))
    text.flush()
    text.detach()
