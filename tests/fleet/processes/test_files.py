"""One log to files: whole or not at all, under names that do not meet."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from attlog import Config, Result
from attlog.base.errors import EXIT_ORDER, LogUnreadable, OutputError, UsageError, exit_code, message, worst
from attlog.fleet.processes.files import analyze_to_files, figure_starts, report_names
from tests.conftest import SAMPLES

LOG = SAMPLES / "copter_yaw_turns.bin"
GYRO = Config(estimators=["gyro"])


def test_report_and_json_are_named_after_the_log_with_its_suffix(tmp_path: Path) -> None:
    done = analyze_to_files(LOG, GYRO, tmp_path / "new", command="attlog analyze")
    assert sorted((tmp_path / "new").iterdir()) == [done.report, done.json]
    assert (done.report.name, done.json.name) == ("copter_yaw_turns.bin.html", "copter_yaw_turns.bin.json")
    assert Result.load(done.json).to_json() == done.result.to_json()
    assert "copter_yaw_turns.bin" in done.report.read_text(encoding="utf-8")
    assert done.result.traces


def test_the_document_is_made_once_for_both_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    to_dict = Result.to_dict

    def counted(result: Result, deterministic: bool = False) -> dict[str, Any]:
        made.append(deterministic)
        return to_dict(result, deterministic)

    monkeypatch.setattr(Result, "to_dict", counted)
    done = analyze_to_files(LOG, GYRO, tmp_path, deterministic=True)
    assert made == [True]
    block = re.search(r'id="result">([^<]+)<', done.report.read_text(encoding="utf-8"))
    assert block is not None
    assert json.loads(gzip.decompress(base64.b64decode(block[1]))) == json.loads(done.json.read_text(encoding="utf-8"))


def test_the_name_can_be_given_and_measured_times_left_out(tmp_path: Path) -> None:
    done = analyze_to_files(LOG, GYRO, tmp_path, "b-2", deterministic=True)
    assert done.json.name == "b-2.json"
    assert "cost_ns" not in done.json.read_text(encoding="utf-8")


def test_nothing_is_written_of_a_log_that_fails(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadable):
        analyze_to_files(tmp_path / "none.ulg", GYRO, tmp_path / "new")
    with pytest.raises(UsageError):
        analyze_to_files(LOG, Config(estimators=["mahonny"]), tmp_path / "new")
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        analyze_to_files(LOG, GYRO, tmp_path / "file")


def test_reports_of_equal_names_do_not_overwrite_each_other() -> None:
    logs = ["x.ulg", "x.ulg", "x.bin", "x.ulg", "x.ulg-2", "X.BIN"]
    assert report_names(logs) == ["x.ulg", "x.ulg-2", "x.bin", "x.ulg-3", "x.ulg-2-2", "X.BIN-2"]
    assert report_names(["x.ulg", "y.ulg", "index"], taken=["X.ulg"]) == ["x.ulg-2", "y.ulg", "index-2"]


def test_a_report_has_a_name_that_fits_a_folder() -> None:
    first, second = report_names(["é" * 120 + ".ulg", "é" * 120 + ".bin"])
    assert len(os.fsencode(first)) <= 200
    assert (first[:90], first[-4:], second[-4:]) == ("é" * 90, ".ulg", ".bin")
    assert report_names(["a\udcff.bin", "a\udcfe.bin", "a\n.bin"]) == ["a_.bin", "a_.bin-2", "a_.bin-3"]


def test_of_several_codes_the_gravest_counts() -> None:
    assert EXIT_ORDER == (130, 70, 73, 2, 66, 65, 75, 1, 0)
    assert (worst([65, 2, 66]), worst([1, 75, 0]), worst([73, 70]), worst([])) == (2, 75, 70, 0)
    errors = (KeyboardInterrupt(), ZeroDivisionError(), OutputError("x"), LogUnreadable("x"))
    assert [exit_code(e) for e in errors] == [130, 70, 73, 66]


def test_a_message_names_the_log_once() -> None:
    assert message(UsageError("a.bin: no such window"), "1", "a.bin") == "attlog: a.bin: no such window"
    assert message(UsageError("no such window"), "1", "a.bin") == "attlog: a.bin: no such window"
    assert message(ValueError("x"), "1.2", "a.bin").startswith("attlog: a.bin: a bug in attlog 1.2: ValueError: x\n")


def test_figures_begin_with_the_name_of_their_log_without_suffix_and_each_log_has_its_own() -> None:
    starts = figure_starts(Path("out"), ["a.ulg", "a.bin", "b.ulg.gz", ".bin"])
    assert [path.as_posix() for path in starts] == ["out/a", "out/a-2", "out/b", "out/_bin"]


def test_a_report_stays_where_its_figures_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BROWSER_PATH", "/bin/true")
    with pytest.raises(OutputError, match="drew no figure"):
        analyze_to_files(LOG, GYRO, tmp_path / "out", figures=tmp_path / "figures" / "log")
    assert len(list((tmp_path / "out").iterdir())) == 2
    assert not list((tmp_path / "figures").iterdir())
