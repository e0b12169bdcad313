"""The logs of folders: what a record holds in today's form, else what the result itself says."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from attlog.fleet.records.collection import EntryCollection, up_to_date
from attlog.fleet.records.entry import FORM, index_row
from attlog.fleet.records.record import Record, record_path, write_record
from attlog.fleet.records.results_file import PARQUET
from tests.report.conftest import make_result


@pytest.mark.parametrize("form", [FORM, FORM - 1, None])
def test_the_row_of_an_older_record_is_made_again_from_its_result(tmp_path: Path, form: int | None) -> None:
    made = make_result(with_traces=False)
    made.to_json(tmp_path / "a.ulg.json")
    row = index_row(made)
    kept = row | {"form": form, "trouble": {"level": "of the record"}}
    write_record(tmp_path, Record("logs/a.ulg", "a.ulg", row=kept))
    (entry,) = (entry for _, entry in EntryCollection([tmp_path]))
    assert entry.row["form"] == FORM
    assert entry.row["trouble"] == (kept if form == FORM else row)["trouble"]


def test_a_log_that_failed_is_counted_and_is_no_entry(tmp_path: Path) -> None:
    made = make_result(with_traces=False)
    write_record(tmp_path, Record("logs/a.ulg", "a.ulg", row=index_row(made)))
    write_record(tmp_path, Record("logs/b.ulg", "b.ulg", code=65, message="b.ulg: not a log"))
    gathered = EntryCollection([tmp_path])
    assert [entry.log for _, entry in gathered] == ["logs/a.ulg"]
    assert gathered.failed == 1


@pytest.mark.parametrize(("record_s", "used"), [(90, True), (100, True), (110, False)])
def test_a_results_file_counts_unless_a_record_is_newer(tmp_path: Path, record_s: int, used: bool) -> None:
    """A batch that was killed has records of which the file of the run before knows nothing."""
    write_record(tmp_path, Record("logs/a.ulg", "a.ulg"))
    path = tmp_path / PARQUET
    path.write_bytes(b"")
    os.utime(path, (100, 100))
    os.utime(record_path(tmp_path, "a.ulg"), (record_s, record_s))
    assert up_to_date(tmp_path) == (path if used else None)
