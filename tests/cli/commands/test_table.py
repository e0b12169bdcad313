"""``attlog table``: what it prints and writes, exit codes."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.formats import Recording
from tests.present.made import lag, merged, result, row, tilt


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three results."""
    for i, value in enumerate((1.0, 2.0, 6.0)):
        rows = [row("mekf", merged(tilt(value), lag(value))), row("mahony@xu-0.6", tilt(2 * value)), row("onboard", {})]
        made = result(rows, name=f"log{i}.ulg", sha256=str(i), vehicle="quadrotor")
        made.to_json(tmp_path / f"log{i}.ulg.json")
    return tmp_path


def test_a_line_for_each_log_with_the_middle_below(attlog, folder: Path) -> None:
    done = attlog("table", folder, "--metric", "inclination_rmse_deg")
    lines = done.out.splitlines()
    assert (done.code, done.err) == (0, "")
    assert lines[0] == "inclination_rmse_deg, airborne, in °"
    assert lines[1].split() == ["log", "date", "mahony@xu-0.6", "mekf"]
    assert [line.split() for line in lines[2:]] == [
        ["log0.ulg", "2.0", "1.0"],
        ["log1.ulg", "4.0", "2.0"],
        ["log2.ulg", "12.0", "6.0"],
        ["median", "4.0", "2.0"],
        ["25", "%", "3.0", "1.5"],
        ["75", "%", "8.0", "4.0"],
        ["logs", "3", "3"],
    ]
    assert not [line for line in lines if line != line.rstrip()]


def test_formats_go_to_the_terminal_or_to_a_file(attlog, folder: Path, tmp_path: Path) -> None:
    lines = list(csv.DictReader(io.StringIO(attlog("table", folder, "--format", "csv", "--row", "mekf").out)))
    assert [(x["log"], float(x["mekf"]), x["vehicle"]) for x in lines] == [
        ("log0.ulg", 1.0, "quadrotor"),
        ("log1.ulg", 2.0, "quadrotor"),
        ("log2.ulg", 6.0, "quadrotor"),
    ]
    for suffix, expected in (("md", "| median |  | 2.0 |"), ("tex", r"log0.ulg &  & 1.0 \\"), ("txt", "log0.ulg")):
        path = tmp_path / f"out.{suffix}"
        done = attlog("table", folder, "--row", "mekf", "-o", path)
        assert (done.code, done.out) == (0, "")
        assert expected in path.read_text(encoding="utf-8")


def test_parquet_names_metric_window_and_unit_of_each_column(attlog, folder: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "out.parquet"
    assert attlog("table", folder, "--metric", "inclination_rmse_deg,lag_ms", "-o", path).code == 0
    table = parquet.read_table(path)
    assert table["lag_ms mekf"].to_pylist() == [1.0, 2.0, 6.0]
    about = table.schema.field("lag_ms mekf").metadata
    assert (about[b"unit"], about[b"window"], about[b"row"]) == (b"ms", b"airborne", b"mekf")
    assert attlog("table", folder, "--by", "vehicle", "-o", path).code == 0
    assert parquet.read_table(path)["mekf median"].to_pylist() == [2.0]


def test_groups(attlog, folder: Path) -> None:
    out = attlog("table", folder, "--by", "vehicle", "--row", "mekf").out.splitlines()
    assert out[2].split() == ["quadrotor", "3", "2.0", "(1.5", "to", "4.0)"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--metric", "lag"], "did you mean lag_ms"),
        (["--row", "mekv"], "did you mean mekf"),
        (["--by", "colour"], "use firmware"),
        (["--format", "xls"], "use md, csv"),
        (["-o", "x.xlsx"], "use md, csv"),
        (["--format", "parquet"], "needs a file"),
        (["--window", "hovering"], "--window hovering: no log has this window"),
        (["--metric", "lag_ms@hovering"], "--metric lag_ms@hovering: no log has this window"),
    ],
)
def test_wrong_options_are_refused_with_what_is_meant(attlog, folder: Path, options: list[str], text: str) -> None:
    done = attlog("table", folder, *options)
    assert (done.code, done.out) == (2, "")
    assert text in done.err


def test_what_cannot_be_used_is_told_and_the_rest_is_shown(attlog, folder: Path) -> None:
    (folder / "broken.json").write_text('{"schema": "attlog-result/2", ')
    done = attlog("table", folder)
    assert done.code == 65
    assert "broken.json" in done.err
    assert "log0.ulg" in done.out
    assert attlog("table", folder / "none").code == 66


def test_columns_that_do_not_fit_are_named(attlog, folder: Path) -> None:
    rows = [row(f"filter{i}@with-a-long-name", tilt(1.0 + i)) for i in range(12)]
    result(rows, name="wide.ulg", sha256="wide").to_json(folder / "wide.ulg.json")
    out = attlog("table", folder / "wide.ulg.json").out.splitlines()
    assert max(map(len, out[:-1])) <= 160
    assert out[-1].startswith("No room for filter")


@pytest.mark.slow
def test_a_result_without_a_replay_is_a_result_too(attlog, tmp_path: Path) -> None:
    """A bench log with an attitude and no IMU has no filters; the table refused it."""
    t = np.arange(1_000_000, 31_000_000, 20_000, dtype=np.uint64)
    q = np.tile(np.float32([1, 0, 0, 0]), (len(t), 1))
    formats.write(tmp_path / "bench.ulg", Recording({("vehicle_attitude", 0): {"timestamp": t, "q": q}}))
    assert attlog("analyze", str(tmp_path / "bench.ulg"), "-o", str(tmp_path / "out")).code == 0
    done = attlog("table", str(tmp_path / "out" / "bench.ulg.json"))
    assert done.code == 2
    assert "no log has it" in done.err  # it was called no result of attlog
