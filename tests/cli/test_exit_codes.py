"""Every way to fail ends with the documented exit code, one message on standard error and no traceback."""

from __future__ import annotations

import json
import os

import pytest

from tests.batch.harm import harm, installed

pytestmark = pytest.mark.usefixtures("interruptible")

LOGS = ("px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog")


def expect(done, code: int, *words: str) -> None:
    assert done.code == code, (done.code, done.out, done.err)
    assert "Traceback" not in done.err
    for word in words:
        assert word in done.err, done.err


@pytest.mark.parametrize(
    ("name", "code", "words"),
    [("none.ulg", 66, "none.ulg: no such file"), ("", 66, "folder"), ("-", 2, "memory-mapped")],
    ids=["missing", "folder", "standard input"],
)
@pytest.mark.parametrize("command", ["analyze", "info", "health", "extract"])
def test_what_is_no_file_is_refused_with_the_reason(attlog, tmp_path, command, name, code, words):
    expect(attlog(command, name if name == "-" else tmp_path / name), code, words)


STRANGE = {
    "empty": b"",
    "zeros": b"\0" * 5000,
    "seven_bytes": b"\xa3\x95\x80\xfe\xfd\x01\x02",
    "encrypted": b"ULogEnc" + b"x" * 500,
}


@pytest.mark.parametrize("content", STRANGE.values(), ids=STRANGE.keys())
@pytest.mark.parametrize("command", ["analyze", "info", "health", "extract"])
def test_what_is_no_log_is_65(attlog, tmp_path, command, content):
    path = tmp_path / "strange.bin"
    path.write_bytes(content)
    done = attlog(command, path)
    expect(done, 65, "strange.bin")
    assert len(done.err.strip().splitlines()) <= 2


UNSEARCHABLE = {
    "info LOCKED/a.bin": 66,
    "analyze LOCKED/a.bin": 66,
    "extract LOCKED/a.bin": 66,
    "compare LOCKED/a.bin mahony gyro": 66,
    "sweep LOCKED/a.bin mahony kp=1,2": 66,
    "diff LOCKED/a LOCKED/b": 66,
    "analyze LOG --estimators LOCKED/f.py": 2,
    "analyze LOG --estimators LOCKED/f.csv": 2,
    "reproduce xu --logs LOCKED/a.bin": 66,
    "new LOCKED/x.py": 73,
    "check-estimator LOCKED/x.py": 2,
    "table LOCKED/r.json": 66,
    "extract LOG ATT -o LOCKED/x.csv": 73,
}


@pytest.mark.rights
@pytest.mark.parametrize("words", UNSEARCHABLE)
def test_a_folder_that_cannot_be_searched_is_no_bug(attlog, samples, tmp_path, words):
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(0)
    try:
        done = attlog(*words.replace("LOCKED", str(locked)).replace("LOG", str(samples / LOGS[1])).split())
    finally:
        locked.chmod(0o755)
    expect(done, UNSEARCHABLE[words])


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
        ["--imu", "first"],
        ["--imu", "7"],
        ["--mag", "9"],
        ["--format", "xls"],
        ["--json", "--format", "md"],
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
    expect(done, 2, "did you mean estimators?", "clock", "trim")


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


@pytest.mark.parametrize(("error", "code"), [(ZeroDivisionError("inside"), 70), (KeyboardInterrupt(), 130)])
def test_a_bug_is_70_with_one_line_or_its_traceback_and_an_interrupt_130(attlog, samples, monkeypatch, error, code):
    def broken(*_a, **_k):
        raise error

    monkeypatch.setattr("attlog.pipeline.inspection.inspect", broken)
    expect(attlog("info", samples / LOGS[0]), code, *(["a bug in attlog", "ZeroDivisionError"] if code == 70 else []))
    assert ("Traceback" in attlog("info", samples / LOGS[0], "-vv").err) == (code == 70)


def breaks(monkeypatch, name, error):
    """The analysis of the log of this name fails as nobody foresaw, where it runs in this process."""

    from attlog import pipeline

    analyze = pipeline.analyze

    def broken(log, *args, **kwargs):
        if log.name == name:
            raise error
        return analyze(log, *args, **kwargs)

    monkeypatch.setattr(pipeline, "analyze", broken)


@pytest.fixture
def harmful():
    """A way to make the filter of an installed package do something to its log's process, never to that of the test."""
    with installed():

        def broken_filter(name, what):
            """A filter that does ``what`` to the process of the log of this name, just before its report is drawn."""
            return harm(
                "import os, signal, time\nimport attlog.report.page as page\nrender = page.render\n"
                f"def broken(result, *a, **k):\n    if result.log['name'] == {name!r}:\n        {what}\n"
                f"    return render(result, *a, **k)\nif os.getpid() != {os.getpid()}:\n    page.render = broken\n"
            )

        yield broken_filter


@pytest.mark.slow
def test_a_bug_in_one_of_several_logs_loses_no_other(attlog, samples, tmp_path, harmful):
    filter_file = harmful(LOGS[0], "raise ZeroDivisionError('inside')")
    logs = [samples / LOGS[0], tmp_path / "none.ulg", samples / LOGS[1]]
    done = attlog("analyze", *logs, "-o", tmp_path / "out", "--estimators", filter_file, "--json", "-", "-vv")
    assert (done.code, "Traceback" in done.err) == (70, True)
    for words in (f"{LOGS[0]}: a bug in attlog", "ZeroDivisionError: inside", "none.ulg: no such file"):
        assert words in done.err
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [f"{LOGS[1]}.html", f"{LOGS[1]}.json"]
    assert [json.loads(line)["log"]["name"] for line in done.out.strip().splitlines()] == [LOGS[1]]


INTERRUPT = f"os.kill({os.getpid()}, signal.SIGINT); time.sleep(60)"
"""Stops the whole run, as Ctrl-C does."""


@pytest.mark.slow
def test_a_bug_while_a_log_is_told_loses_no_other(attlog, samples, tmp_path, monkeypatch):
    from attlog.cli import tables

    shown = tables.result_lines

    def broken(result, *settings, **more):
        if result.log["name"] == LOGS[0]:
            raise IndexError("no such column")
        return shown(result, *settings, **more)

    monkeypatch.setattr(tables, "result_lines", broken)
    done = attlog("analyze", samples / LOGS[0], samples / LOGS[1], "-o", tmp_path, "--estimators", "gyro")
    expect(done, 70, "IndexError")
    assert len(list(tmp_path.glob("*.json"))) == 2


def test_no_command_prints_help(attlog):
    done = attlog()
    assert done.code == 2
    assert "analyze" in done.out + done.err


@pytest.mark.slow
def test_an_interrupt_says_what_was_kept(attlog, samples, tmp_path, monkeypatch, harmful):
    out, filter_file = tmp_path / "out", harmful(LOGS[1], INTERRUPT)
    done = attlog("analyze", *(samples / log for log in LOGS), "-o", out, "--estimators", filter_file)
    expect(done, 130, f"kept 1 of 3 reports in {out}: {LOGS[0]}.html")
    assert sorted(p.name for p in out.iterdir()) == [f"{LOGS[0]}.html", f"{LOGS[0]}.json"]
    breaks(monkeypatch, LOGS[1], KeyboardInterrupt())
    done = attlog("analyze", samples / LOGS[1], "-o", tmp_path, "--estimators", "gyro")
    expect(done, 130, "nothing was written")


@pytest.mark.slow
def test_an_interrupt_ends_all_processes(samples, tmp_path):
    import signal
    import subprocess
    import sys
    import time

    command = [sys.executable, "-m", "attlog", samples, "-o", tmp_path, "-j", "2", "--estimators", "all"]
    run = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
    time.sleep(6)
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=20)
    assert run.returncode == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err
    time.sleep(1)
    left = subprocess.run(["ps", "-s", str(run.pid), "-o", "stat="], capture_output=True, text=True).stdout.split()
    assert [state for state in left if not state.startswith("Z")] == []


@pytest.mark.rights
def test_a_log_that_may_not_be_read_loses_no_other(attlog, samples, tmp_path):
    import shutil

    (tmp_path / "secret.ulg").write_bytes(b"x")
    (tmp_path / "secret.ulg").chmod(0)
    shutil.copy(samples / LOGS[0], tmp_path / LOGS[0])
    done = attlog("analyze", tmp_path, "-o", tmp_path / "out", "--estimators", "gyro")
    expect(done, 66, "secret.ulg")
    assert (tmp_path / "out" / f"{LOGS[0]}.html").exists()
