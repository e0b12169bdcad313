"""Every number of a batch in one file: a line for each log, row, window and metric."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from attlog.fleet.answers import Number, numbers
from attlog.fleet.entry import Entry
from attlog.output import writing

PARQUET, CSV = "results.parquet", "results.csv"
TEXTS = ("log", "report", "sha256", "date_utc", "vehicle", "firmware", "board", "reference")
"""Columns that say of which log a line is."""
COLUMNS: dict[str, str] = {
    **dict.fromkeys(TEXTS, "string"),
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
    "reference": "what errors are differences from: truth, smoother, onboard or none",
    "row": "estimator with preset, or an attitude of the log (onboard, onboard:NAME)",
    "window": "which seconds of the log",
    "low": "lower end of the 95 % interval",
    "high": "upper end of the 95 % interval",
    "n": "independent pieces of evidence",
    "seconds": "time that the value stands on",
    "code": "why there is no value",
    "reason": "the same in words",
}
UNIT_OF = {"value": "see unit", "low": "see unit", "high": "see unit", "seconds": "s", "n": "1"}
"""The unit of a column; values have that of their metric, which stands in ``unit`` and in the file's metadata."""
GROUP = 200_000
"""Lines that are held in memory at a time."""


def write_results(folder: Path, entries: Iterable[Entry]) -> Path:
    """Write ``results.parquet`` to a folder, or ``results.csv`` where pyarrow (the extra ``export``) is not installed.

    The file appears whole or not at all; one of the other kind, which would be out of date, goes. Logs without a
    row (they failed) have no line. Memory is bounded: entries are taken one after the other. OutputError if it
    cannot be written.
    """
    has_arrow = importlib.util.find_spec("pyarrow") is not None
    path, other = folder / (PARQUET if has_arrow else CSV), folder / (CSV if has_arrow else PARQUET)
    with writing(path) as file:
        (_parquet if has_arrow else _csv)(file, _batches(entries))
    other.unlink(missing_ok=True)
    return path


def lines(entry: Entry) -> Iterator[tuple[Any, ...]]:
    """The lines of one log, in the order of COLUMNS."""
    if entry.row is None:
        return
    flight = entry.row["flight"]
    about = tuple(map(_text, (entry.log, entry.name, *(flight.get(key) for key in TEXTS[2:]))))
    for number in numbers(entry.row["answers"]):
        yield (*about, *_cells(number))


def _text(value: Any) -> str | None:
    """A text that UTF-8 can hold: file names may have bytes that it cannot."""
    return None if value is None else str(value).encode("utf-8", "backslashreplace").decode("utf-8")


def _cells(n: Number) -> tuple[Any, ...]:
    return n.row, n.window, n.metric, n.value, n.low, n.high, n.n, n.seconds, n.unit, n.code, n.reason


def _batches(entries: Iterable[Entry]) -> Iterator[list[tuple[Any, ...]]]:
    """Lines of several logs together, at most about GROUP of them."""
    held: list[tuple[Any, ...]] = []
    for entry in entries:
        held += lines(entry)
        if len(held) >= GROUP:
            yield held
            held = []
    yield held


def _parquet(file: BinaryIO, batches: Iterator[list[tuple[Any, ...]]]) -> None:
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
            units |= {line[metric]: line[unit] for line in held}
            columns = zip(*held, strict=True) if held else ([] for _ in COLUMNS)
            arrays = [pyarrow.array(c, f.type, from_pandas=False) for c, f in zip(columns, schema, strict=True)]
            out.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))
        out.add_key_value_metadata({"attlog.units": json.dumps(units, ensure_ascii=False, sort_keys=True)})


def _csv(file: BinaryIO, batches: Iterator[list[tuple[Any, ...]]]) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    out = csv.writer(text, lineterminator="\n")
    out.writerow(COLUMNS)
    for held in batches:
        out.writerows(held)
    text.flush()
    text.detach()
