"""The entries of a batch from its one file with every number, where that is there and up to date."""

from __future__ import annotations

import importlib.util
import json
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from attlog.fleet.records.entry import FORM, Entry
from attlog.fleet.records.record import INSIDE
from attlog.fleet.records.results_file import COLUMNS, FAILED, PARQUET, TEXTS, UNITS

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


def found(folder: Path, metrics: Collection[str]) -> tuple[list[Entry], int] | None:
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
