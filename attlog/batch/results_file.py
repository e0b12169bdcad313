"""Every number of a batch in one file, read for tables across logs."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import os
import stat
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from attlog.batch.index_row import FORM, index_row, numbers, sensors_of
from attlog.batch.job import RECORDS_FOLDER, Record, records
from attlog.core import files
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.core.files import open_atomic
from attlog.core.own_files import RESULTS
from attlog.result import SCHEMA_NAME, Result

if TYPE_CHECKING:
    import pandas as pd

PARQUET, CSV = "results.parquet", "results.csv"
# Columns that describe the log of a line.
TEXTS = ("log", "report", "sha256", "date_utc", "vehicle", "firmware", "version", "board", "reference", "attlog")
# All columns in order, with their types.
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
# Meanings and units of columns. The unit of a value is that of its metric: column ``unit`` and metadata of the file.
ABOUT = {
    "log": "the log as it was given",
    "report": "name of its report and its JSON, without suffix",
    "sha256": "of the log's content",
    "date_utc": "when the log begins, ISO 8601",
    "version": "of the firmware",
    "attlog": "version that made the result",
    "reference": "what errors are relative to: truth, smoother, onboard or none",
    "sensor_faults": "checks of the log's sensors that found a fault",
    "sensor_warnings": "checks of the log's sensors that found a warning",
    "to_set": "parameters to set, NAME old -> new; empty without",
    "row": "estimator with preset, an attitude of the log (onboard, onboard:NAME), or a sensor",
    "window": "span of the log; sensors for checks of a sensor",
    "low": "lower end of the 95 % interval",
    "high": "upper end of the 95 % interval",
    "n": "independent units of evidence",
    "seconds": "seconds of data behind the value",
    "code": "code of a missing value",
    "reason": "reason of a missing value",
}
UNIT_OF = {"value": "see unit", "low": "see unit", "high": "see unit", "seconds": "s", "n": "1"}
# Metadata keys of the file: JSON of metric -> unit; number of failed logs, which have no lines.
UNITS, FAILED = "attlog.units", "attlog.failed"
# Lines held in memory at a time.
GROUP_LINES = 100_000
# Byte range in which a result names its schema.
HEAD_BYTES = 200


def write_results(folder: Path, found: Iterable[Record]) -> Path:
    """Write ``results.parquet``, or ``results.csv`` without pyarrow (extra ``export``).

    The file is replaced as a whole, and an outdated one of the other kind removed. Failed logs have no lines. Records
    are read one by one, so memory is bounded. OutputError if the file cannot be written.
    """
    has_arrow = importlib.util.find_spec("pyarrow") is not None
    path, other = folder / (PARQUET if has_arrow else CSV), folder / (CSV if has_arrow else PARQUET)
    with open_atomic(path, RESULTS) as file:
        (_write_parquet if has_arrow else _write_csv)(file, found)
    if RESULTS.includes(other):
        other.unlink()
    return path


def lines(record: Record) -> Iterator[tuple[Any, ...]]:
    """Yield the lines of one log by COLUMNS; none if it failed."""
    if not record.row:
        return
    flight, sensors = record.row["flight"], sensors_of(record.row)
    about: list[Any] = [_text(t) for t in (record.log, record.name, *(flight.get(key) for key in TEXTS[2:]))]
    about += [sensors["faults"], sensors["warnings"], "; ".join(sensors["to_set"])]
    for number in numbers(record.row["answers"]):
        yield (*about, *number)


def _text(value: Any) -> str | None:
    """Escape bytes of file names that are not UTF-8."""
    return None if value is None else str(value).encode("utf-8", "backslashreplace").decode("utf-8")


def _write_parquet(file: BinaryIO, found: Iterable[Record]) -> None:
    import pyarrow
    from pyarrow import parquet

    def field(name: str, kind: str) -> Any:
        about = {"unit": UNIT_OF.get(name, ""), "about": ABOUT.get(name, "")}
        return pyarrow.field(
            name, pyarrow.type_for_alias(kind), metadata={k: text for k, text in about.items() if text}
        )

    failed, units = 0, dict[str, str]()

    def every() -> Iterator[tuple[Any, ...]]:
        nonlocal failed
        for record in found:
            failed += not record.row
            yield from lines(record)
            units.update(record.row["answers"]["units"] if record.row else {})

    schema = pyarrow.schema([field(name, kind) for name, kind in COLUMNS.items()])
    coming = every()
    with parquet.ParquetWriter(file, schema, compression="zstd") as out:
        while group := list(islice(coming, GROUP_LINES)):
            columns = zip(*group, strict=True)
            arrays = [pyarrow.array(c, f.type, from_pandas=False) for c, f in zip(columns, schema, strict=True)]
            out.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))
        text = json.dumps(units, ensure_ascii=False, sort_keys=True)
        out.add_key_value_metadata({UNITS: text, FAILED: str(failed)})


def _write_csv(file: BinaryIO, found: Iterable[Record]) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    out = csv.writer(text, lineterminator="\n")
    out.writerow(COLUMNS)
    for record in found:
        out.writerows(map(files.csv_cell, line) for line in lines(record))
    text.flush()
    text.detach()


@dataclass(slots=True)
class BatchNumbers:
    """Metrics of many logs: input of tables.

    ``logs``: one row per log with ``batch`` (folder or file it was read from) and TEXTS. ``answers``: one row per
    number with ``at`` (index into ``logs``), ``row``, ``window``, ``metric``, ``value``, ``code``. ``units``: of all
    metrics of the logs, requested or not. ``wrong``: errors of files. ``failed``: number of logs without a result.
    """

    logs: pd.DataFrame
    answers: pd.DataFrame
    units: dict[str, str] = field(default_factory=dict)
    wrong: list[AttlogError] = field(default_factory=list)
    failed: int = 0


ANSWER = ("row", "window", "metric", "value", "code")


def read_numbers(given: Iterable[Path], metrics: Collection[str]) -> BatchNumbers:
    """Read metrics from batch folders, folders of results and single results.

    Names keep their order. A batch is read from its results file if no record is newer, else from its records.
    """
    import pandas as pd

    logs: list[dict[str, Any]] = []
    answers: list[tuple[Any, ...]] = []
    found = BatchNumbers(pd.DataFrame(), pd.DataFrame())

    def add(batch: Path, about: Sequence[dict[str, Any]], numbers: Iterable[tuple[Any, ...]]) -> None:
        """Append logs, and numbers whose first field is the report of their log."""
        at = {log["report"]: len(logs) + k for k, log in enumerate(about)}
        logs.extend({"batch": str(batch)} | log for log in about)
        answers.extend((at[report], *number) for report, *number in numbers)

    for path in given:
        place = path.parent if path.name in (PARQUET, CSV) and os.path.isfile(path) else path
        try:
            file = up_to_date(place)
            try:
                whole = None if file is None else _read_parquet(file, metrics)
            except (OSError, ValueError, KeyError):  # damaged, or of another version: the records hold the same numbers
                whole = None
            if whole is not None:
                about, asked, units, failed = whole
                add(place, about, asked)
                found.units |= units
                found.failed += failed
            for record in _folder_records(place, whole is not None, found) if os.path.isdir(place) else [load(place)]:
                texts = {key: record.row["flight"].get(key) for key in TEXTS} | {"log": record.log}
                some = numbers(record.row["answers"], metrics)
                rows = [(record.name, n.row, n.window, n.metric, n.value, n.code) for n in some]
                add(place, [texts | {"report": record.name}], rows)
                found.units |= record.row["answers"]["units"]
        except AttlogError as error:
            found.wrong.append(error)
    table = pd.DataFrame(logs, columns=["batch", *TEXTS]).astype(object)
    found.logs = table.where(table.notna(), None)
    found.answers = pd.DataFrame(answers, columns=["at", *ANSWER]).astype({"value": float})
    return found


def _folder_records(folder: Path, is_read: bool, found: BatchNumbers) -> Iterator[Record]:
    """Yield records of a folder, then results without a record.

    Records of a batch are skipped if its results file was read (``is_read``).
    """
    seen = {path.name for path in (folder / RECORDS_FOLDER / "records").glob("*.json")}
    outdated = []
    for record in () if is_read else records(folder):
        if not record.done:
            found.failed += 1
        elif record.row.get("form") == FORM:
            yield record
        else:
            outdated.append(folder / f"{record.name}.json")
    others = [p for p in sorted(folder.rglob("*.json")) if RECORDS_FOLDER not in p.parts and p.name not in seen]
    results = [p for p in others if is_result(p)]
    if not results and not seen:
        raise LogUnreadable(f"{folder}: is a folder without a batch or a result of attlog (*.json)")
    for path in [*outdated, *results]:
        try:
            yield load(path)
        except AttlogError as error:
            found.wrong.append(error)


def load(path: Path) -> Record:
    """Read the record of a result. LogUnreadable, LogUnusable for other files."""
    try:
        result = Result.load(path)
    except UsageError as error:
        raise LogUnusable(str(error)) from None
    row: dict[str, Any] = index_row(result)
    return Record(str(row["flight"]["name"] or path.name), path.name.removesuffix(".json"), row=row)


def is_result(path: Path) -> bool:
    """Recognise a result by its first bytes; True for an unreadable file."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return SCHEMA_NAME.encode() in file.read(HEAD_BYTES)
    except OSError:
        return True


def up_to_date(folder: Path) -> Path | None:
    """Return the results file of a batch folder, if it is current.

    None without one, without pyarrow, or if a record is newer. Records are written as logs finish and the file at the
    end, so a killed batch has newer records.
    """
    path = folder / PARQUET
    if importlib.util.find_spec("pyarrow") is None or not os.path.isfile(path):
        return None
    written = path.stat().st_mtime_ns
    newest = max((p.stat().st_mtime_ns for p in (folder / RECORDS_FOLDER / "records").glob("*.json")), default=0)
    return path if 0 < newest <= written else None


def _read_parquet(
    path: Path, metrics: Collection[str]
) -> tuple[list[dict[str, Any]], list[tuple[Any, ...]], dict[str, str], int]:
    """Return logs, numbers of ``metrics``, units and failed logs of a results file.

    Repeated texts are read as categories, which is ten times as fast.
    """
    from pyarrow import parquet

    file = parquet.ParquetFile(path, read_dictionary=[*TEXTS, "row", "window", "metric", "code"])
    metadata = file.metadata.metadata
    logs: dict[str, dict[str, Any]] = {}
    answers: list[tuple[Any, ...]] = []
    for group in range(file.num_row_groups):
        lines = file.read_row_group(group, columns=[*TEXTS, *ANSWER]).to_pandas()
        logs |= {log["report"]: log for log in lines[[*TEXTS]].drop_duplicates("report").to_dict("records")}
        asked = lines[lines["metric"].isin(metrics)]
        answers += asked[["report", *ANSWER]].itertuples(index=False, name=None)
    return list(logs.values()), answers, json.loads(metadata[UNITS.encode()]), int(metadata[FAILED.encode()])
