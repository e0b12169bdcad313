"""Numbers across logs: windows, repeated logs, quartiles, groups, and where they are read from."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from attlog.batch.across import LogTable, across, group_logs, table_text, table_values, usual_window
from attlog.batch.index_row import FORM, index_row
from attlog.batch.job import Record, record_path, write_record
from attlog.batch.results_file import CSV, PARQUET, BatchNumbers, read_numbers, up_to_date, write_results
from attlog.core.errors import LogUnreadable, LogUnusable, UsageError
from attlog.result import EstimatorRow, Result
from attlog.words.names import CODES
from tests.health.made import OFFSET
from tests.words.made import absent, lag, result, row, tilt

TILT = "tilt_rmse_deg"


def flight(name: str, mekf: float | None, window: str = "airborne", *, vqf: float | None = None, **more: Any) -> Record:
    """A log with the tilt error of one or two filters."""
    version = more.pop("attlog", "0.3.0")
    rows = [made_row("mekf", mekf, window)]
    if vqf is not None:
        rows.append(made_row("vqf", vqf, window))
    made = result(rows, **({"name": name, "sha256": name, "date_utc": None, "vehicle": "quadrotor"} | more))
    made.attlog = {"version": version}
    return Record(f"drive/{name}", name, row=index_row(made))


def made_row(name: str, value: float | None, window: str) -> EstimatorRow:
    return row(name, absent(TILT, window, "no_reference", "x") if value is None else tilt(value, window=window))


@pytest.fixture
def read(tmp_path: Path) -> Any:
    """Read records through the folders of batches."""

    def through(logs: Iterable[Record], metrics: Sequence[str] = (TILT,), **batches: Iterable[Record]) -> BatchNumbers:
        folders = {"results": logs} if logs else {}
        for batch, found in (folders | batches).items():
            for record in found:
                write_record(tmp_path / batch, record)
        return read_numbers([tmp_path / batch for batch in folders | batches], [m.partition("@")[0] for m in metrics])

    return through


def column(found: LogTable, k: int = 0) -> list[float]:
    return found.values[k].tolist()


def test_a_line_for_each_log_and_quartiles_as_numpy_has_them(read: Any) -> None:
    numbers = [1.0, 2.0, 4.0, 7.0, 20.0, 3.0]
    found = across(read([flight(f"{i}.ulg", v, vqf=v / 2) for i, v in enumerate(numbers)]), [TILT])
    assert [(c.row, c.window, c.unit) for c in found.columns] == [
        ("mekf", "airborne", "deg"),
        ("vqf", "airborne", "deg"),
    ]
    assert column(found) == numbers
    table = table_text(found, None, found.columns)
    assert [line[0] for line in table.foot] == ["median", "25 %", "75 %", "logs"]
    assert [line[2] for line in table.foot] == ["3.5", "2.2", "6.2", "6"]
    (line,) = table_values(found, "vehicle")[1]
    assert line[2:6] == [6, *np.percentile(numbers, [25, 50, 75])]


def test_a_missing_number_has_its_reason_and_counts_nowhere(read: Any) -> None:
    found = across(read([flight("a.ulg", 2.0), flight("b.ulg", None)]), [TILT])
    table = table_text(found, None, found.columns)
    assert [line[2] for line in table.body] == ["2.0", CODES["no_reference"][1]]
    assert table.foot[-1][2] == "1"
    head, lines = table_values(found, None)
    assert [line[head.index("mekf")] for line in lines] == [2.0, None]


def test_all_logs_are_looked_up_in_one_window(read: Any) -> None:
    flown = [flight(f"{i}.ulg", 1.0) for i in range(3)]
    numbers = read([*flown, flight("hand.ulg", 9.0, "all")])
    assert across(numbers, [TILT]).columns[0].window == "airborne"
    assert across(numbers, [f"{TILT}@all"]).columns[0].window == "all"
    assert across(numbers, [TILT], window="all").columns[0].window == "all"
    mostly = read((), few=[flown[0], *(flight(f"h{i}.ulg", 9.0, "all") for i in range(4))])
    assert across(mostly, [TILT]).columns[0].window == "all"


@pytest.mark.parametrize(
    ("metric", "windows", "expected"),
    [
        ("noise_roll_deg", ("all", "hover", "rest"), "rest"),
        ("drift_rest_deg_per_min", ("all", "rest"), "rest"),
        ("drift_air_deg_per_min.truth", ("all", "airborne"), "airborne"),
        ("total_p95_deg", ("all", "airborne"), "airborne"),
        ("convergence_s", ("airborne", "all"), "all"),
        ("my_own_metric", ("0:10",), "0:10"),
    ],
)
def test_a_metric_is_looked_up_where_the_page_of_one_log_does(
    metric: str, windows: Sequence[str], expected: str
) -> None:
    assert usual_window(metric, pd.DataFrame({"metric": metric, "window": windows, "value": 1.0})) == expected


def test_of_a_log_that_comes_twice_the_newest_result_counts(read: Any) -> None:
    def only(value: float, attlog: str) -> list[Record]:
        return [flight("a.ulg", value, attlog=attlog)]

    old, new, other = only(1.0, "0.9.0"), only(2.0, "0.10.0"), [flight("b.ulg", 7.0)]
    for batches, expected in (
        ({"old": old, "new": new, "other": other}, 2.0),
        ({"x": new, "y": old, "other": other}, 2.0),
        ({"new": new, "last": only(3.0, "0.10.0"), "other": other}, 3.0),
    ):
        found = across(read((), **batches), [TILT])
        assert (column(found), found.repeats) == ([expected, 7.0], 1)
    both = across(read((), old=old, new=new), [TILT], by="batch")
    assert (len(both.logs), both.repeats) == (2, 0)
    assert [Path(name).name for name in group_logs(both.logs, "batch")] == ["new", "old"]
    unknown = read((), unknown=[flight("a.ulg", 1.0, sha256=None), flight("b.ulg", 1.0, sha256=None)])
    assert len(across(unknown, [TILT]).logs) == 2


def test_groups_have_quartiles_of_their_own(read: Any) -> None:
    logs = [
        flight(f"{i}.ulg", float(i), date_utc=f"202{i % 2}-03-01T00:00:00", vehicle=v)
        for i, v in enumerate(["quadrotor", "fixed wing", None, "quadrotor"])
    ]
    found = across(read(logs), [TILT])
    table = table_text(found, "vehicle", found.columns)
    assert [line[:2] for line in table.body] == [["fixed wing", "1"], ["quadrotor", "2"], ["unknown", "1"]]
    assert table.body[1][2] == "1.5 (0.75 to 2.2)"
    assert table.foot == [["all", "4", "1.5 (0.75 to 2.2)"]]
    assert [line[0] for line in table_text(found, "year", found.columns).body] == ["2020", "2021"]
    head, lines = table_values(found, "vehicle")
    assert head == ["vehicle", "logs", "mekf n", "mekf q25", "mekf median", "mekf q75"]
    assert lines[1] == ["quadrotor", 2, 2, 0.75, 1.5, 2.25]
    with pytest.raises(UsageError, match="use firmware"):
        group_logs(found.logs, "colour")


def test_firmwares_are_sorted_by_number(read: Any) -> None:
    logs = [flight(f"{v}.ulg", 1.0, firmware={"name": "PX4", "version": v}) for v in ("1.10", "1.9", "1.11")]
    assert list(group_logs(across(read(logs), [TILT]).logs, "firmware")) == ["PX4 1.9", "PX4 1.10", "PX4 1.11"]


def test_what_no_log_has_is_refused_with_what_comes_near(read: Any) -> None:
    numbers = read([flight("a.ulg", 1.0, vqf=2.0)])
    for ask, text in (
        ({"metrics": ["tilt_rms_deg"]}, "did you mean tilt_rmse_deg"),
        ({"metrics": [TILT], "rows": ["mefk"]}, "did you mean mekf"),
        ({"metrics": [TILT], "window": "airbone"}, "did you mean airborne"),
        ({"metrics": ["cost_ns"]}, "kept in no table"),
    ):
        with pytest.raises(UsageError, match=text):
            across(numbers, **ask)  # type: ignore[arg-type]
    assert [c.row for c in across(numbers, [TILT], ["v*", "mekf"]).columns] == ["vqf", "mekf"]


def test_a_check_is_a_number_of_its_sensor(read: Any) -> None:
    logs = []
    for name, size in (("a", 24.0), ("b", 3.0)):
        made = result([made_row("mekf", 1.0, "airborne")], name=name, sha256=name)
        made.checks = [replace(OFFSET, value=size)]
        logs.append(Record(name, name, row=index_row(made)))
    found = across(read(logs, ["compass_offset"]), ["compass_offset"])
    assert [(c.row, c.window, c.unit) for c in found.columns] == [("MAG.0", "sensors", "uT")]
    assert column(found) == [24.0, 3.0]


# Where numbers are read from: results file, records, results.


def made(value: float) -> Result:
    return result([row("mekf", tilt(value))], name="c.ulg", sha256="c")


def test_a_batch_folder_is_read_by_its_records_and_other_results_by_themselves(tmp_path: Path) -> None:
    write_record(tmp_path, flight("a.ulg", 1.0))
    write_record(tmp_path, Record("x/b.ulg", "b.ulg", code=65, message="no"))
    (tmp_path / "a.ulg.json").write_text('{"schema": "attlog-result/2", "not": "read"}')
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "below").mkdir()
    made(2.0).to_json(tmp_path / "below" / "c.json")
    numbers = read_numbers([tmp_path], [TILT])
    assert column(across(numbers, [TILT])) == [1.0, 2.0]
    assert (numbers.failed, numbers.wrong) == (1, [])


@pytest.mark.parametrize("form", [FORM, FORM - 1, None])
def test_the_row_of_an_older_record_is_made_again_from_its_result(tmp_path: Path, form: int | None) -> None:
    made(3.0).to_json(tmp_path / "c.ulg.json")
    record = flight("c.ulg", 1.0)
    write_record(tmp_path, replace(record, row=record.row | {"form": form}))
    assert column(across(read_numbers([tmp_path], [TILT]), [TILT])) == [1.0 if form == FORM else 3.0]


def test_broken_results_and_empty_folders_are_reported_and_lose_no_other(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    made(3.0).to_json(tmp_path / "c.json")
    (tmp_path / "broken.json").write_text('{"schema": "attlog-result/7", ')
    given = [tmp_path / name for name in ("empty", "none.json", "broken.json", "c.json")]
    numbers = read_numbers(given, [TILT])
    assert column(across(numbers, [TILT])) == [3.0]
    assert [type(e) for e in numbers.wrong] == [LogUnreadable, LogUnreadable, LogUnusable]


def batch_of_four(folder: Path) -> None:
    """A batch of which one log failed and one has no tilt error."""
    other = Record("x/d.ulg", "d.ulg", row=index_row(result([row("mekf", lag(1.0))], name="d.ulg", sha256="d")))
    logs = [flight("a.ulg", 1.0), flight("b.ulg", None, vqf=3.0), other, Record("x/c.ulg", "c.ulg", code=65)]
    for record in logs:
        write_record(folder, record)
    write_results(folder, logs)


def test_the_results_file_holds_the_same_as_the_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyarrow")
    batch_of_four(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("attlog.batch.results_file.records", lambda _: pytest.fail("the records were read"))
        quick = read_numbers([tmp_path], [TILT])
        with pytest.raises(UsageError, match="did you mean lag_ms"):
            across(read_numbers([tmp_path], ["lag_mss"]), ["lag_mss"])
    (tmp_path / PARQUET).unlink()
    slow = read_numbers([tmp_path], [TILT])
    found, expected = across(quick, [TILT]), across(slow, [TILT])
    assert (table_values(found, None), found.columns) == (table_values(expected, None), expected.columns)
    assert table_text(found, "firmware", found.columns) == table_text(expected, "firmware", expected.columns)
    assert (quick.failed, slow.failed) == (1, 1)


@pytest.mark.parametrize("spoil", ["newer", "broken", "other"])
def test_records_replace_a_results_file_that_is_outdated_or_broken(tmp_path: Path, spoil: str) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    batch_of_four(tmp_path)
    path = tmp_path / PARQUET
    if spoil == "newer":
        write_record(tmp_path, flight("e.ulg", 9.0))
        os.utime(path, ns=(1, 1))
    elif spoil == "broken":
        path.write_bytes(path.read_bytes()[:-100])
    else:
        parquet.write_table(parquet.read_table(path).drop_columns(["code"]), path)
    assert len(across(read_numbers([tmp_path], [TILT]), [TILT]).logs) == (4 if spoil == "newer" else 3)


@pytest.mark.parametrize(("record_s", "used"), [(90, True), (100, True), (110, False)])
def test_a_results_file_counts_unless_a_record_is_newer(tmp_path: Path, record_s: int, used: bool) -> None:
    write_record(tmp_path, Record("logs/a.ulg", "a.ulg"))
    path = tmp_path / PARQUET
    path.write_bytes(b"")
    os.utime(path, (100, 100))
    os.utime(record_path(tmp_path, "a.ulg"), (record_s, record_s))
    assert up_to_date(tmp_path) == (path if used else None)


def test_a_table_has_the_logs_of_the_last_run_as_the_index(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    batch_of_four(tmp_path)
    write_results(tmp_path, [flight("a.ulg", 1.0)])
    for place in (tmp_path, tmp_path / PARQUET):  # the file stands for its folder
        numbers = read_numbers([place], [TILT])
        assert (numbers.logs["report"].tolist(), numbers.failed) == (["a.ulg"], 0)
    assert not (tmp_path / CSV).exists()
