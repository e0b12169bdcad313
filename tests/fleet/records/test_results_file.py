"""One file with every number of a batch: what it says, in which units, and that it appears whole or not at all."""

from __future__ import annotations

import csv
import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from attlog.base.errors import OutputError
from attlog.fleet.records import results_file
from attlog.fleet.records.entry import Entry, index_row
from attlog.fleet.records.results_file import COLUMNS, CSV, PARQUET, write_results
from attlog.result import MEASURED_TIMES, Result
from tests.health.assessments.made import MADE
from tests.report.conftest import make_result


def flown(name: str = "a.ulg", **log: object) -> Entry:
    made = make_result(with_traces=False)
    made.health = []
    made.log |= {"name": name} | log
    return Entry(f"logs/{name}", name, row=index_row(made))


FAILED = Entry("logs/b.ulg", "b.ulg", 65, "b.ulg: not a log")


def expected(made: Result) -> dict[tuple[str, str, str], float | None]:
    return {
        (r.name, w, m): a.value
        for r in made.estimators
        for w, answers in r.metrics.items()
        for m, a in answers.items()
        if m not in MEASURED_TIMES
    }


@pytest.fixture
def without_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "pyarrow" else real(name, *a))


def test_parquet_holds_a_line_for_each_log_row_window_and_metric(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = write_results(tmp_path, [flown(), FAILED, flown("c.ulg")])
    table = parquet.read_table(path)
    assert (path.name, table.column_names) == (PARQUET, list(COLUMNS))
    lines = table.to_pylist()
    values = expected(make_result(with_traces=False))
    assert len(lines) == 2 * len(values)
    assert {line["log"] for line in lines} == {"logs/a.ulg", "logs/c.ulg"}
    found = {(x["row"], x["window"], x["metric"]): x for x in lines if x["report"] == "a.ulg"}
    assert {key: x["value"] for key, x in found.items()} == values
    lag = found["complementary@fan", "airborne", "lag_ms"]
    assert (lag["value"], lag["code"], lag["unit"]) == (None, "not_a_pure_delay", "ms")
    assert "51 %" in lag["reason"]
    noise = found["gyro", "rest", "noise_tilt_deg"]
    assert (noise["n"], noise["seconds"], noise["code"]) == (28, 40.0, None)
    assert noise["low"] < noise["value"] < noise["high"]


def test_units_stand_in_the_metadata(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = write_results(tmp_path, [flown()])
    schema = parquet.read_schema(path)
    assert schema.field("seconds").metadata[b"unit"] == b"s"
    assert schema.field("value").metadata[b"unit"] == b"see unit"
    units = json.loads(parquet.read_metadata(path).metadata[b"attlog.units"])
    assert (units["lag_ms"], units["noise_tilt_deg"], units["drift_rest_deg_per_min"]) == ("ms", "deg", "deg/min")


def test_csv_says_the_same_where_pyarrow_is_missing(tmp_path: Path, without_pyarrow: None) -> None:
    (tmp_path / PARQUET).write_bytes(b"of an earlier run")
    path = write_results(tmp_path, [flown('odd "name", #1.ulg'), FAILED])
    assert [p.name for p in tmp_path.iterdir()] == [CSV]
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert lines[0]["log"] == 'logs/odd "name", #1.ulg'
    values = expected(make_result(with_traces=False))
    found = {(x["row"], x["window"], x["metric"]): x["value"] for x in lines}
    assert {key: float(text) if text else None for key, text in found.items()} == values


@pytest.mark.parametrize("arrow", [True, False])
def test_a_batch_in_which_nothing_succeeded_has_a_file_without_lines(
    tmp_path: Path, arrow: bool, request: pytest.FixtureRequest
) -> None:
    if not arrow:
        request.getfixturevalue("without_pyarrow")
    path = write_results(tmp_path, [FAILED])
    if arrow:
        assert pytest.importorskip("pyarrow.parquet").read_table(path).num_rows == 0
    else:
        assert path.read_text() == ",".join(COLUMNS) + "\n"


def test_names_that_are_no_utf8_are_written(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    lines = parquet.read_table(write_results(tmp_path, [flown("a\udcff.ulg")])).to_pylist()
    assert lines[0]["log"] == "logs/a\\udcff.ulg"


def test_entries_are_taken_as_lines_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand rows are never held together."""
    monkeypatch.setattr(results_file, "GROUP", 300)
    held = 0
    most = 0

    class Counted(Entry):
        def __del__(self) -> None:
            nonlocal held
            held -= 1

    def entries() -> Iterator[Entry]:
        nonlocal held, most
        for k in range(40):
            held += 1
            most = max(most, held)
            one = flown(f"{k}.ulg")
            yield Counted(one.log, one.name, row=one.row)

    write_results(tmp_path, entries())
    assert most <= 5


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = write_results(tmp_path, [flown()])
    before = path.read_bytes()

    def broken() -> Iterator[Entry]:
        yield flown("x.ulg")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left"):
        write_results(tmp_path, broken())
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_every_line_tells_what_is_off_with_the_sensors_and_what_to_set(tmp_path: Path, without_pyarrow: None) -> None:
    made = make_result(with_traces=False)
    made.health = list(MADE)
    entries = [Entry("logs/off.ulg", "off.ulg", row=index_row(made)), flown()]
    with write_results(tmp_path, entries).open(newline="") as file:
        lines = list(csv.DictReader(file))
    told = {(x["report"], x["sensor_faults"], x["sensor_warnings"], x["to_set"]) for x in lines}
    assert told == {
        ("off.ulg", "1", "1", "COMPASS_OFS_X -12 -> 145; COMPASS_OFS_Y 4.5 -> -20.25"),
        ("a.ulg", "0", "0", ""),
    }
    (offset,) = [x for x in lines if x["metric"] == "compass_offset"]
    assert (offset["row"], offset["window"], offset["value"], offset["unit"]) == ("MAG.0", "sensors", "24.0", "uT")
