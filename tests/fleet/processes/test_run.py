"""One log in a process of its own: whatever becomes of the process is told by the record."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from attlog import Config
from attlog.base.errors import LogUnreadable
from attlog.base.processes.forks import Closed, Forks
from attlog.fleet.processes import files
from attlog.fleet.processes.files import analyze_to_files
from attlog.fleet.processes.run import forks, run_one
from attlog.fleet.records.record import Record, read_record, record_path, records
from attlog.fleet.records.work import Work, settings_key
from attlog.fleet.sources.source import Source
from tests.conftest import SAMPLES
from tests.fleet.harm import harm, installed

LOG = SAMPLES / "copter_yaw_turns.bin"


@pytest.fixture(scope="module")
def processes() -> Iterator[Forks]:
    with installed():
        kept = forks()
        yield kept
        kept.close()


def work(folder: Path, log: Path = LOG, specs: str = "gyro", **more: Any) -> Work:
    config = Config(estimators=specs.split(","))
    settings = settings_key(config, deterministic=True)
    return replace(Work(Source(str(log)), log.name, folder, config, settings, deterministic=True), **more)


def plugin(folder: Path, body: str) -> str:
    """A filter file that does something to its process as soon as it is loaded."""
    path = folder / "filter.py"
    path.write_text(f"{body}\nfrom attlog.estimators.filters.gyro import *\n")
    return str(path)


def test_the_process_writes_what_the_caller_would(tmp_path: Path, processes: Forks) -> None:
    record = run_one(work(tmp_path / "a"), processes)
    here = analyze_to_files(LOG, Config(estimators=["gyro"]), tmp_path / "b", deterministic=True)
    assert (record.code, record.message) == (0, "")
    for path in (here.report, here.json):
        assert (tmp_path / "a" / path.name).read_bytes() == path.read_bytes()
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == [".attlog", here.report.name, here.json.name]
    assert not list((tmp_path / "a" / ".attlog" / "scratch").iterdir())


def test_a_record_reads_back_as_it_was(tmp_path: Path, processes: Forks) -> None:
    record = run_one(work(tmp_path), processes)
    assert read_record(tmp_path, LOG.name) == record
    assert list(records(tmp_path)) == [record]
    assert min(record.cpu_s, record.wall_s) > 0
    assert 50 < record.peak_mb < 5000
    assert set(record.files) == {f"{LOG.name}.html", f"{LOG.name}.json"}
    assert record.row["flight"]["name"] == LOG.name


@pytest.mark.slow
def test_what_is_done_is_not_done_again_unless_something_changed(tmp_path: Path, processes: Forks) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    first = run_one(work(tmp_path / "out", log), processes)
    task = work(tmp_path / "out", log, resume=True)
    assert run_one(task, processes).again
    assert run_one(task, processes) == first
    assert not run_one(replace(task, resume=False), processes).again
    report = tmp_path / "out" / "a.bin.html"
    whole = report.read_bytes()
    report.write_bytes(whole[:-1] + b" ")
    assert not run_one(task, processes).again
    assert report.read_bytes() == whole
    assert not run_one(work(tmp_path / "out", log, specs="accel_mag", resume=True), processes).again
    assert not run_one(task, processes).again
    log.write_bytes(LOG.read_bytes()[:-200])
    assert not run_one(task, processes).again


@pytest.mark.slow
def test_a_record_that_is_damaged_is_a_log_that_is_not_done(tmp_path: Path, processes: Forks) -> None:
    run_one(work(tmp_path), processes)
    place = record_path(tmp_path, LOG.name)
    place.write_bytes(place.read_bytes()[:100])
    assert not run_one(work(tmp_path, resume=True), processes).again


def test_settings_follow_what_stands_in_a_filter_file(tmp_path: Path) -> None:
    file = plugin(tmp_path, "")
    before = work(tmp_path, specs=f"{file}:k=1").settings
    plugin(tmp_path, "x = 1")
    assert work(tmp_path, specs=f"{file}:k=1").settings != before


@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ("import os; os._exit(9)", 70, "without a word"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", 70, "crashed (SIGSEGV)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", 70, "killed from outside"),
        ("import time; time.sleep(100)", 75, "longer than 1.5 s"),
        ("import os\nif not os.fork():\n    os._exit(0)\nwhile True: pass", 75, "longer than 1.5 s"),
        ("x = bytearray(10**9)\nwhile True: pass", 75, "more than 600 MB"),
    ],
)
def test_a_process_that_fails_is_one_record(tmp_path: Path, processes: Forks, body: str, code: int, words: str) -> None:
    limits: dict[str, Any] = {"timeout": 1.5 if code == 75 and "MB" not in words else 300.0, "memory": 600.0}
    record = run_one(work(tmp_path, specs=harm(body), **limits), processes)
    assert record.code == code
    assert words in record.message
    assert str(LOG) in record.message
    assert not list(tmp_path.glob("*.json"))
    assert not list((tmp_path / ".attlog" / "scratch").iterdir())
    assert read_record(tmp_path, LOG.name) == record
    assert run_one(work(tmp_path), processes).code == 0


def test_memory_of_a_filter_from_a_file_is_counted(tmp_path: Path, processes: Forks) -> None:
    file = plugin(tmp_path, "x = bytearray(10**9)\nwhile True: pass")
    record = run_one(work(tmp_path, specs=file, memory=600.0), processes)
    assert (record.code, "more than 600 MB" in record.message) == (75, True)


def test_a_log_that_is_cut_while_it_is_mapped_is_unreadable(tmp_path: Path, processes: Forks) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    body = f"import os; os.truncate({str(log)!r}, 1000)"
    record = run_one(work(tmp_path, log, specs=harm(body)), processes)
    assert record.code == 66
    assert "changed while it was read" in record.message


def test_a_log_that_grows_while_it_is_read_is_unreadable(tmp_path: Path, processes: Forks) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    body = f"open({str(log)!r}, 'ab').write(b'x')"
    record = run_one(work(tmp_path, log, specs=plugin(tmp_path, body)), processes)
    assert (record.code, record.key) == (66, "")
    assert not list(tmp_path.glob("*.json"))


def test_a_bug_is_told_with_its_traceback(tmp_path: Path, processes: Forks) -> None:
    body = "import attlog.report.page as page\ndef broken(*a, **k): raise ZeroDivisionError('x')\npage.render = broken"
    record = run_one(work(tmp_path, specs=harm(body)), processes)
    assert (record.code, "a bug in attlog" in record.message) == (70, True)
    assert "ZeroDivisionError" in record.trace


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, processes: Forks) -> None:
    (tmp_path / "file").write_text("x")
    assert run_one(work(tmp_path / "file" / "out"), processes).code == 73
    (tmp_path / "out" / f"{LOG.name}.html").mkdir(parents=True)
    record = run_one(work(tmp_path / "out"), processes)
    assert (record.code, record.folder_full) == (73, False)
    assert f"{LOG.name}.html: cannot be written" in record.message


@pytest.mark.slow
def test_the_death_of_the_forking_program_costs_its_children_alone(tmp_path: Path) -> None:
    with installed():
        processes = forks()
        assert run_one(work(tmp_path / "first"), processes).code == 0  # it loads the filters of its first log itself
        pid = tmp_path / "pid"
        kills_the_program = (
            f"import os, signal, time\nopen({str(pid)!r}, 'w').write(str(os.getpid()))\n"
            "os.kill(os.getppid(), signal.SIGKILL)\ntime.sleep(100)"
        )
        record = run_one(work(tmp_path, specs=harm(kills_the_program)), processes)
        assert record.code == 70
        assert "so is the one that started it" in record.message
        assert gone(int(pid.read_text()))
        assert run_one(work(tmp_path), processes).code == 0
        processes.close()
        with pytest.raises(Closed):
            run_one(work(tmp_path), processes)


def pid_in(place: Path) -> int:
    """The process number that a filter wrote to that file."""
    for _ in range(1200):
        if place.exists() and place.read_text():
            return int(place.read_text())
        time.sleep(0.05)
    raise AssertionError("the process never came to its filter")


def gone(pid: int) -> bool:
    """Whether a process ends within seconds; one that nobody reaps counts as gone."""
    for _ in range(100):
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
def test_a_process_that_never_gives_way_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    """It holds the interpreter lock, so that no thread of its own could end it."""
    pid = tmp_path / "pid"
    for_ever = "import re; re.match(r'(a+)+$', 'a' * 60 + 'b')"
    filter_file = plugin(tmp_path, f"import os\nopen({str(pid)!r}, 'w').write(str(os.getpid()))\n{for_ever}")
    run = subprocess.Popen(
        [sys.executable, "-m", "attlog", "batch", LOG, "-o", tmp_path / "out", "--estimators", filter_file],
        cwd=SAMPLES.parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    number = pid_in(pid)
    run.kill()
    run.wait()
    assert gone(number)


@pytest.mark.slow
def test_closing_ends_what_runs(tmp_path: Path) -> None:
    import threading

    processes = forks()
    body = f"import os, time\nopen({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid()))\ntime.sleep(100)"
    ended: list[object] = []

    def run() -> None:
        try:
            ended.append(run_one(work(tmp_path, specs=plugin(tmp_path, body)), processes))
        except Closed as closed:
            ended.append(closed)

    thread = threading.Thread(target=run)
    thread.start()
    pid = pid_in(tmp_path / "pid")
    processes.close()
    thread.join(10)
    assert [type(e) for e in ended] == [Closed]
    assert gone(pid)


def test_a_work_is_small_and_plain(tmp_path: Path) -> None:
    import pickle

    task = work(tmp_path)
    assert pickle.loads(pickle.dumps(task)) == task
    assert len(pickle.dumps(task)) < 2000


def test_a_record_knows_when_it_is_of_another_version(tmp_path: Path) -> None:
    from attlog.fleet.records.record import write_record

    write_record(tmp_path, Record("a", "a"))
    place = record_path(tmp_path, "a")
    place.write_text(json.dumps(json.loads(place.read_text()) | {"schema": "attlog-record/99"}))
    assert read_record(tmp_path, "a") is None


@pytest.mark.slow
def test_a_server_that_does_not_answer_at_first_is_asked_again_by_the_download(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def silent(_: Source) -> str:
        raise LogUnreadable("no answer")

    monkeypatch.setattr(files, "stamp", silent)
    told = files.fields_of_record(work(tmp_path), tmp_path, lambda _: None)
    assert told["files"]
    assert told["stamp"] == ""
