"""Numbers across logs: which window, which result of a log counts, quartiles, groups, what is refused."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog.batch.across import Log, across, grouped, references, spread, usual_window, values, words
from attlog.batch.index_row import Entry, index_row
from attlog.batch.job import Record, write_record
from attlog.batch.results_file import PARQUET, EntryCollection, write_results
from attlog.core.errors import LogUnreadable, LogUnusable, UsageError
from attlog.result import EstimatorRow, Result
from attlog.words.names import CODES
from tests.health.made import OFFSET
from tests.words.made import absent, lag, merged, result, row, tilt

TILT = "tilt_rmse_deg"


def flight(
    name: str, mekf: float | None, window: str = "airborne", *, vqf: float | None = None, **more: object
) -> tuple[str, Entry]:
    """A log with the tilt error of one or two filters."""
    batch = str(more.pop("batch", "results"))
    version = str(more.pop("attlog", "0.3.0"))
    rows = [made_row("mekf", mekf, window)]
    if vqf is not None:
        rows.append(made_row("vqf", vqf, window))
    made = result(rows, **({"name": name, "sha256": name, "date_utc": None, "vehicle": "quadrotor"} | more))
    made.attlog = {"version": version}
    return batch, Entry(f"drive/{name}", name, row=index_row(made))


def made_row(name: str, value: float | None, window: str) -> EstimatorRow:
    return row(name, absent(TILT, window, "no_reference", "x") if value is None else tilt(value, window=window))


def test_a_line_for_each_log_and_quartiles_as_numpy_has_them() -> None:
    numbers = [1.0, 2.0, 4.0, 7.0, 20.0, 3.0]
    found = across([flight(f"{i}.ulg", v, vqf=v / 2) for i, v in enumerate(numbers)], [TILT])
    assert [(c.row, c.window, c.unit) for c in found.columns] == [
        ("mekf", "airborne", "deg"),
        ("vqf", "airborne", "deg"),
    ]
    assert [log.value(found.columns[0]) for log in found.logs] == numbers
    table = words(found, None, found.columns)
    assert [line[0] for line in table.foot] == ["median", "25 %", "75 %", "logs"]
    assert [line[2] for line in table.foot] == ["3.5", "2.2", "6.2", "6"]
    quartiles = spread(numbers)
    assert quartiles is not None
    expected = np.percentile(numbers, [25, 50, 75])
    assert (quartiles.low, quartiles.median, quartiles.high) == pytest.approx(tuple(expected))
    assert spread([None, None]) is None
    one = spread([5.0, None])
    assert one is not None
    assert (one.n, one.low, one.high) == (1, 5.0, 5.0)


def test_a_missing_number_says_why_and_counts_nowhere() -> None:
    found = across([flight("a.ulg", 2.0), flight("b.ulg", None)], [TILT])
    table = words(found, None, found.columns)
    assert [line[2] for line in table.body] == ["2.0", CODES["no_reference"][1]]
    assert table.foot[-1][2] == "1"
    head, lines = values(found, None)
    assert [line[head.index("mekf")] for line in lines] == [2.0, None]


def test_all_logs_are_looked_up_in_one_window() -> None:
    flown = [flight(f"{i}.ulg", 1.0) for i in range(3)]
    hand = [flight("hand.ulg", 9.0, "all")]
    assert across([*flown, *hand], [TILT]).columns[0].window == "airborne"
    assert (
        across([*flown[:1], *hand, *[flight(f"h{i}.ulg", 9.0, "all") for i in range(3)]], [TILT]).columns[0].window
        == "all"
    )
    assert across([*flown, *hand], [f"{TILT}@all"]).columns[0].window == "all"
    assert across([*flown, *hand], [TILT], window="all").columns[0].window == "all"


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
    log = Log("", "", "", {}, {(metric, w, "mekf"): 1.0 for w in windows})
    assert usual_window(metric, [log]) == expected


def test_of_a_log_that_comes_twice_the_newest_result_counts() -> None:
    old, new, last = (
        flight("a.ulg", v, batch=b, attlog=x)
        for v, b, x in ((1.0, "old", "0.9.0"), (2.0, "new", "0.10.0"), (3.0, "last", "0.10.0"))
    )
    other = flight("b.ulg", 7.0)
    for order, expected in (([old, new, other], 2.0), ([new, old, other], 2.0), ([new, last, other], 3.0)):
        found = across(order, [TILT])
        assert [log.value(found.columns[0]) for log in found.logs] == [expected, 7.0]
        assert found.twice == 1
    both = across([old, new], [TILT], by="batch")
    assert (len(both.logs), both.twice) == (2, 0)
    assert list(grouped(both.logs, "batch")) == ["new", "old"]
    copies = across([flight("a.ulg", 1.0), flight("copy of a.ulg", 1.0, sha256="a.ulg")], [TILT])
    assert (len(copies.logs), copies.twice) == (1, 1)
    unknown = across([flight("a.ulg", 1.0, sha256=None), flight("b.ulg", 1.0, sha256=None)], [TILT])
    assert len(unknown.logs) == 2


def test_groups_have_quartiles_of_their_own() -> None:
    entries = [
        flight(f"{i}.ulg", float(i), date_utc=f"202{i % 2}-03-01T00:00:00", vehicle=v)
        for i, v in enumerate(["quadrotor", "fixed wing", None, "quadrotor"])
    ]
    found = across(entries, [TILT])
    table = words(found, "vehicle", found.columns)
    assert [line[:2] for line in table.body] == [["fixed wing", "1"], ["quadrotor", "2"], ["unknown", "1"]]
    assert table.body[1][2] == "1.5 (0.75 to 2.2)"
    assert table.foot == [["all", "4", "1.5 (0.75 to 2.2)"]]
    assert [line[0] for line in words(found, "year", found.columns).body] == ["2020", "2021"]
    head, lines = values(found, "vehicle")
    assert head == ["vehicle", "logs", "mekf n", "mekf q25", "mekf median", "mekf q75"]
    assert lines[1] == ["quadrotor", 2, 2, 0.75, 1.5, 2.25]
    with pytest.raises(UsageError, match="use firmware"):
        grouped(found.logs, "colour")


def test_firmwares_stand_as_people_count() -> None:
    entries = [flight(f"{v}.ulg", 1.0, firmware={"name": "PX4", "version": v}) for v in ("1.10", "1.9", "1.11")]
    assert list(grouped(across(entries, [TILT]).logs, "firmware")) == ["PX4 1.9", "PX4 1.10", "PX4 1.11"]


def test_what_no_log_has_is_refused_with_what_comes_near() -> None:
    entries = [flight("a.ulg", 1.0, vqf=2.0)]
    for ask, text in (
        ({"metrics": ["tilt_rms_deg"]}, "did you mean tilt_rmse_deg"),
        ({"metrics": [TILT], "rows": ["mefk"]}, "did you mean mekf"),
        ({"metrics": [TILT], "window": "airbone"}, "did you mean airborne"),
        ({"metrics": ["cost_ns"]}, "kept in no table"),
    ):
        with pytest.raises(UsageError, match=text):
            across(entries, **ask)  # type: ignore[arg-type]
    assert [c.row for c in across(entries, [TILT], ["v*", "mekf"]).columns] == ["vqf", "mekf"]


def test_several_metrics_are_told_apart_in_their_columns() -> None:
    made = result([row("mekf", merged(tilt(1.0), lag(4.0)))], name="a.ulg", sha256="a")
    found = across([("", Entry("a.ulg", "a.ulg", row=index_row(made)))], [TILT, "lag_ms"])
    assert values(found, None)[0][5:] == [f"{TILT} mekf", "lag_ms mekf"]


def test_differences_from_different_things_are_told() -> None:
    entries = [flight("a.ulg", 1.0), flight("b.ulg", 2.0)]
    assert entries[0][1].row is not None
    entries[0][1].row["flight"]["reference"] = "truth"
    assert references(across(entries, [TILT])) == {"truth": 1, "onboard": 1}


def test_a_batch_folder_is_read_by_its_records_and_other_results_by_themselves(tmp_path: Path) -> None:
    write_record(tmp_path, Record("x/a.ulg", "a.ulg", row=flight("a.ulg", 1.0)[1].row or {}))
    write_record(tmp_path, Record("x/b.ulg", "b.ulg", code=65, message="no"))
    (tmp_path / "a.ulg.json").write_text('{"schema": "attlog-result/2", "not": "read"}')
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "below").mkdir()
    made(2.0).to_json(tmp_path / "below" / "c.json")
    gathered = EntryCollection([tmp_path])
    found = across(gathered, [TILT])
    assert [log.value(found.columns[0]) for log in found.logs] == [1.0, 2.0]
    assert (gathered.failed, gathered.wrong) == (1, [])


def made(value: float) -> Result:
    return result([row("mekf", tilt(value))], name="c.ulg", sha256="c")


def test_broken_results_are_told_and_lose_no_other(tmp_path: Path) -> None:
    made(3.0).to_json(tmp_path / "sound.json")
    (tmp_path / "broken.json").write_text('{"schema": "attlog-result/7", ')
    gathered = EntryCollection([tmp_path])
    found = across(gathered, [TILT])
    assert [log.value(found.columns[0]) for log in found.logs] == [3.0]
    assert [type(e) for e in gathered.wrong] == [LogUnusable]


def test_folders_and_files_without_a_result_are_told_and_lose_no_other(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    made(3.0).to_json(tmp_path / "c.json")
    gathered = EntryCollection([tmp_path / "empty", tmp_path / "none.json", tmp_path / "c.json"])
    assert len(list(gathered)) == 1
    assert [type(e) for e in gathered.wrong] == [LogUnreadable, LogUnreadable]


def kept(folder: Path) -> None:
    """A batch of four logs, of which one failed and one has no tilt error, as a batch leaves it."""
    row_a, row_b = flight("a.ulg", 1.0)[1].row, flight("b.ulg", None, vqf=3.0)[1].row
    row_d = index_row(result([row("mekf", lag(1.0))], name="d.ulg", sha256="d"))
    rows = {"a.ulg": row_a, "b.ulg": row_b, "d.ulg": row_d}
    records = [Record(f"x/{name}", name, row=found or {}) for name, found in rows.items()]
    for record in [*records, Record("x/c.ulg", "c.ulg", code=65, message="no")]:
        write_record(folder, record)
    write_results(folder, [*(Entry(r.log, r.name, row=r.row) for r in records), Entry("x/c.ulg", "c.ulg", 65)])


def test_the_results_file_tells_the_same_as_the_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyarrow")
    kept(tmp_path)
    slow, quick = EntryCollection([tmp_path]), EntryCollection([tmp_path], [TILT])
    expected = across(slow, [TILT])
    monkeypatch.setattr("attlog.batch.results_file.records", lambda _: pytest.fail("the records were read"))
    found = across(quick, [TILT])
    assert (values(found, None), found.columns) == (values(expected, None), expected.columns)
    assert words(found, "firmware", found.columns) == words(expected, "firmware", expected.columns)
    assert (quick.failed, slow.failed) == (1, 1)
    with pytest.raises(UsageError, match="did you mean lag_ms"):
        across(EntryCollection([tmp_path], ["lag_mss"]), ["lag_mss"])


@pytest.mark.parametrize("spoil", ["newer", "broken", "other"])
def test_a_results_file_that_is_out_of_date_or_broken_is_not_believed(tmp_path: Path, spoil: str) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    kept(tmp_path)
    path = tmp_path / PARQUET
    if spoil == "newer":
        write_record(tmp_path, Record("x/e.ulg", "e.ulg", row=flight("e.ulg", 9.0)[1].row or {}))
        os.utime(path, ns=(1, 1))
    elif spoil == "broken":
        path.write_bytes(path.read_bytes()[:-100])
    else:
        parquet.write_table(parquet.read_table(path).drop_columns(["code"]), path)
    found = across(EntryCollection([tmp_path], [TILT]), [TILT])
    assert len(found.logs) == (4 if spoil == "newer" else 3)


def test_a_table_shows_the_logs_of_the_last_call_as_the_index_does(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    kept(tmp_path)
    write_results(tmp_path, [Entry("x/a.ulg", "a.ulg", row=flight("a.ulg", 1.0)[1].row)])
    gathered = EntryCollection([tmp_path], [TILT])
    assert [log.name for log in across(gathered, [TILT]).logs] == ["a.ulg"]
    alone = EntryCollection([tmp_path / PARQUET], [TILT])  # the file stands for its folder
    assert len(across(alone, [TILT]).logs) == 1
    assert gathered.failed == 0


def test_an_assessment_is_a_number_of_its_sensor() -> None:
    entries = []
    for name, size in (("a", 24.0), ("b", 3.0)):
        made = result([made_row("mekf", 1.0, "airborne")], name=name, sha256=name)
        made.checks = [replace(OFFSET, value=size)]
        entries.append(("batch", Entry(name, name, row=index_row(made))))
    found = across(entries, ["compass_offset"])
    assert [(c.row, c.window, c.unit) for c in found.columns] == [("MAG.0", "sensors", "uT")]
    assert [log.value(found.columns[0]) for log in found.logs] == [24.0, 3.0]
