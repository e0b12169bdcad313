"""Every way to fail ends with the documented exit code, one message on standard error and no traceback."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

LOGS = ("px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog")


def expect(done, code: int, *words: str) -> None:
    assert done.code == code, (done.code, done.out, done.err)
    assert "Traceback" not in done.err
    for word in words:
        assert word in done.err, done.err


@pytest.mark.parametrize("command", ["analyze", "info", "extract"])
def test_a_missing_file_is_66(attlog, tmp_path, command):
    expect(attlog(command, tmp_path / "none.ulg"), 66, "none.ulg", "no such file")


@pytest.mark.parametrize("command", ["analyze", "info", "extract"])
def test_a_folder_is_66(attlog, tmp_path, command):
    expect(attlog(command, tmp_path), 66, "folder")


@pytest.mark.parametrize("command", ["analyze", "info", "extract"])
def test_standard_input_is_refused_with_the_reason(attlog, command):
    expect(attlog(command, "-"), 2, "memory-mapped")


STRANGE = {
    "empty": b"",
    "zeros": b"\0" * 5000,
    "text": b"hello world\n" * 400,
    "seven_bytes": b"\xa3\x95\x80\xfe\xfd\x01\x02",
    "encrypted": b"ULogEnc" + b"x" * 500,
}


@pytest.mark.parametrize("content", STRANGE.values(), ids=STRANGE.keys())
@pytest.mark.parametrize("command", ["analyze", "info", "extract"])
def test_what_is_no_log_is_65(attlog, tmp_path, command, content):
    path = tmp_path / "strange.bin"
    path.write_bytes(content)
    done = attlog(command, path)
    expect(done, 65, "strange.bin")
    assert len(done.err.strip().splitlines()) <= 2


@pytest.mark.rights
def test_unreadable_for_lack_of_rights_is_66(attlog, tmp_path):
    path = tmp_path / "secret.ulg"
    path.write_bytes(b"x")
    path.chmod(0)
    expect(attlog("info", path), 66, "secret.ulg")


@pytest.mark.parametrize(
    "wrong",
    [
        ["--estimators", "mahonny"],
        ["--estimators", "mahony:kq=1"],
        ["--estimators", "mahony:kp=-1"],
        ["--estimators", "mahony@nope"],
        ["--reference", "moon"],
        ["--window", "lunch"],
        ["--window", "9:3"],
        ["--trim", "maybe"],
        ["--declination", "east"],
        ["--clock", "wall"],
        ["--imu", "first"],
        ["--imu", "7"],
        ["--mag", "9"],
        ["--json", "out.json"],
        ["--plotly", "cdn"],
        ["--score-from", "-3"],
        ["--reference", "onboard:NOPE"],
        ["--estimators", "no_such_file.py"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_2_and_says_what_is_right(attlog, samples, tmp_path, wrong):
    done = attlog("analyze", samples / LOGS[0], "-o", tmp_path, *wrong)
    expect(done, 2)
    assert len(done.err) > 30
    assert not list(tmp_path.iterdir())


def test_all_problems_of_a_config_file_are_told_at_once(attlog, samples, tmp_path):
    config = tmp_path / "c.toml"
    config.write_text('estimater = ["gyro"]\nclock = "wall"\ntrim = "perhaps"\n')
    done = attlog("analyze", samples / LOGS[0], "--config", config, "-o", tmp_path / "out")
    expect(done, 2, "did you mean 'estimators'", "clock", "trim")


def test_a_place_that_cannot_be_written_is_73_and_leaves_nothing(attlog, samples, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("x")
    expect(
        attlog("analyze", samples / LOGS[0], "-o", blocked / "reports", "--estimators", "gyro"), 73, "cannot be written"
    )
    assert blocked.read_text() == "x"


def test_good_logs_are_finished_and_the_worst_code_counts(attlog, samples, tmp_path):
    bad = tmp_path / "bad.bin"
    bad.write_bytes(b"no log at all" * 100)
    out = tmp_path / "out"
    done = attlog(
        "analyze", bad, samples / LOGS[0], tmp_path / "none.ulg", "-o", out, "--estimators", "gyro", "--json", "-"
    )
    expect(done, 66, "bad.bin", "none.ulg")
    assert (out / f"{LOGS[0]}.html").exists()
    lines = done.out.strip().splitlines()
    assert len(lines) == 1
    assert json.loads(lines[0])["log"]["name"] == LOGS[0]


def test_a_bug_is_70_with_one_line(attlog, samples, monkeypatch):
    def broken(*_a, **_k):
        raise ZeroDivisionError("inside")

    monkeypatch.setattr("attlog.inspection.inspect", broken)
    expect(attlog("info", samples / LOGS[0]), 70, "a bug in attlog", "ZeroDivisionError")


def test_an_interrupt_is_130(attlog, samples, monkeypatch):
    def interrupted(*_a, **_k):
        raise KeyboardInterrupt

    monkeypatch.setattr("attlog.inspection.inspect", interrupted)
    assert attlog("info", samples / LOGS[0]).code == 130


def test_no_command_prints_help(attlog):
    done = attlog()
    assert done.code == 2
    assert "analyze" in done.out + done.err


def test_reports_of_equal_names_do_not_overwrite_each_other():
    from attlog.cli.analyze import report_names

    assert report_names([Path("a/x.ulg"), Path("b/x.ulg"), Path("x.bin"), Path("c/x.ulg")]) == [
        "x.ulg",
        "x.ulg-2",
        "x.bin",
        "x.ulg-3",
    ]
