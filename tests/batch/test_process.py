"""One log to files: whole or not at all, under names that do not meet."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from attlog import Config, Result
from attlog.batch.job import Job, Record, read_record, record_path, records, settings_key
from attlog.batch.process import run_one, start_fork_server
from attlog.batch.report_files import analyze_to_files, figure_starts, load_shared, report_names
from attlog.batch.run import lock_folder
from attlog.batch.sources import Source
from attlog.core.errors import EXIT_ORDER, LogUnreadable, OutputError, UsageError, exit_code, worst_exit_code
from attlog.core.workers import Closed, ForkServer
from tests.batch.harm import harm, installed
from tests.conftest import SAMPLES

COPTER_LOG = SAMPLES / "copter_yaw_turns.bin"
GYRO = Config(estimators=["gyro"])


def test_report_and_json_are_named_after_the_log_with_its_suffix(tmp_path: Path) -> None:
    done = analyze_to_files(COPTER_LOG, GYRO, tmp_path / "new", command="attlog analyze")
    assert sorted((tmp_path / "new").iterdir()) == [done.report, done.json]
    assert (done.report.name, done.json.name) == ("copter_yaw_turns.bin.html", "copter_yaw_turns.bin.json")
    assert Result.load(done.json).to_json() == done.result.to_json()
    assert "copter_yaw_turns.bin" in done.report.read_text(encoding="utf-8")
    assert done.result.traces


def test_filters_are_shared_with_log_processes_where_the_script_of_pages_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing() -> None:
        raise FileNotFoundError

    loaded: list[list[str]] = []
    monkeypatch.setattr("attlog.report.bundle.bundle", missing)
    monkeypatch.setattr("attlog.pipeline.replay.preload", loaded.append)
    load_shared(["mahony"], on_message=lambda _: None)
    assert loaded == [["mahony"]]


def test_nothing_is_written_of_a_log_that_fails(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadable):
        analyze_to_files(tmp_path / "none.ulg", GYRO, tmp_path / "new")
    with pytest.raises(UsageError):
        analyze_to_files(COPTER_LOG, Config(estimators=["mahonny"]), tmp_path / "new")
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        analyze_to_files(COPTER_LOG, GYRO, tmp_path / "file")


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
    assert (
        worst_exit_code([65, 2, 66]),
        worst_exit_code([1, 75, 0]),
        worst_exit_code([73, 70]),
        worst_exit_code([]),
    ) == (2, 75, 70, 0)
    errors = (KeyboardInterrupt(), ZeroDivisionError(), OutputError("x"), LogUnreadable("x"))
    assert [exit_code(e) for e in errors] == [130, 70, 73, 66]


def test_figures_begin_with_the_name_of_their_log_without_suffix_and_each_log_has_its_own() -> None:
    starts = figure_starts(Path("out"), ["a.ulg", "a.bin", "b.ulg.gz", ".bin"])
    assert [path.as_posix() for path in starts] == ["out/a", "out/a-2", "out/b", "out/_bin"]


def test_a_report_of_another_log_is_refused_before_any_filter_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, out = tmp_path / "a.bin", tmp_path / "out"
    log.write_bytes(COPTER_LOG.read_bytes()[:400_000])
    analyze_to_files(log, GYRO, out)
    log.write_bytes(COPTER_LOG.read_bytes()[:350_000])
    monkeypatch.setattr("attlog.pipeline.analyze", lambda *_, **__: pytest.fail("filters ran"))
    with pytest.raises(OutputError, match="is a report of another log"):
        analyze_to_files(log, GYRO, out)


def test_figures_of_a_log_of_which_more_has_come_are_replaced_with_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, seen = tmp_path / "a.bin", list[set[str]]()
    monkeypatch.setattr("attlog.report.figures.files.write_figures", lambda _, __, logs: seen.append(set(logs)))
    hashes = set()
    for size in (350_000, 400_000):
        log.write_bytes(COPTER_LOG.read_bytes()[:size])
        hashes.add(hashlib.sha256(log.read_bytes()).hexdigest())
        analyze_to_files(log, GYRO, tmp_path / "out", figures=tmp_path / "figures" / "a")
    assert seen[1] == hashes


def test_a_report_stays_where_its_figures_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BROWSER_PATH", "/bin/true")
    with pytest.raises(OutputError, match="drew no figure"):
        analyze_to_files(COPTER_LOG, GYRO, tmp_path / "out", figures=tmp_path / "figures" / "log")
    assert len(list((tmp_path / "out").iterdir())) == 2
    assert not list((tmp_path / "figures").iterdir())


# One log in a process of its own: whatever becomes of the process is told by the record.

LOG = SAMPLES / "copter_yaw_turns.bin"


@pytest.fixture(scope="module")
def processes() -> Iterator[ForkServer]:
    with installed():
        kept = start_fork_server()
        yield kept
        kept.close()


def work(folder: Path, log: Path = LOG, specs: str = "gyro", **more: Any) -> Job:
    config = Config(estimators=specs.split(","))
    settings = settings_key(config, deterministic=True)
    return Job(Source(str(log)), log.name, folder, config, settings, deterministic=True)._replace(**more)


def plugin(folder: Path, body: str) -> str:
    """A filter file that does something to its process as soon as it is loaded."""
    path = folder / "filter.py"
    path.write_text(f"{body}\nfrom attlog.estimators.filters.gyro import *\n")
    return str(path)


def test_the_process_writes_what_the_caller_would(tmp_path: Path, processes: ForkServer) -> None:
    record = run_one(work(tmp_path / "a"), processes)
    here = analyze_to_files(LOG, Config(estimators=["gyro"]), tmp_path / "b", deterministic=True)
    assert (record.code, record.message) == (0, "")
    for path in (here.report, here.json):
        assert (tmp_path / "a" / path.name).read_bytes() == path.read_bytes()
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == [".attlog", here.report.name, here.json.name]
    assert not list((tmp_path / "a" / ".attlog" / "scratch").iterdir())


def test_a_record_reads_back_as_it_was(tmp_path: Path, processes: ForkServer) -> None:
    record = run_one(work(tmp_path), processes)
    assert read_record(tmp_path, LOG.name) == record
    assert list(records(tmp_path)) == [record]
    assert min(record.cpu_s, record.wall_s) > 0
    assert 50 < record.peak_mb < 5000
    assert set(record.files) == {f"{LOG.name}.html", f"{LOG.name}.json"}
    assert record.row["flight"]["name"] == LOG.name


@pytest.mark.slow
def test_what_is_done_is_not_done_again_unless_something_changed(tmp_path: Path, processes: ForkServer) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    first = run_one(work(tmp_path / "out", log), processes)
    task = work(tmp_path / "out", log, resume=True)
    assert run_one(task, processes).again
    assert run_one(task, processes) == first
    assert not run_one(task._replace(resume=False), processes).again
    report = tmp_path / "out" / "a.bin.html"
    whole = report.read_bytes()
    report.write_bytes(whole[:-1] + b" ")
    assert not run_one(task, processes).again
    assert report.read_bytes() == whole
    assert not run_one(work(tmp_path / "out", log, specs="accel_mag", resume=True), processes).again
    assert not run_one(task, processes).again
    log.write_bytes(LOG.read_bytes()[:-200])
    assert not run_one(task, processes).again


def test_settings_follow_what_stands_in_a_filter_file(tmp_path: Path) -> None:
    file = plugin(tmp_path, "")
    before = work(tmp_path, specs=f"{file}:k=1").settings
    plugin(tmp_path, "x = 1")
    assert work(tmp_path, specs=f"{file}:k=1").settings != before


@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ("import os; os._exit(9)", 70, "without an answer"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", 70, "crashed (SIGSEGV)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", 70, "killed from outside"),
        ("import time; time.sleep(100)", 75, "longer than 1.5 s"),
        ("x = bytearray(10**9)\nwhile True: pass", 75, "more than 600 MB"),
    ],
)
def test_a_process_that_fails_is_one_record(
    tmp_path: Path, processes: ForkServer, body: str, code: int, words: str
) -> None:
    limits: dict[str, Any] = {"timeout": 1.5 if code == 75 and "MB" not in words else 300.0, "memory": 600.0}
    record = run_one(work(tmp_path, specs=harm(body), **limits), processes)
    assert record.code == code
    assert words in record.message
    assert str(LOG) in record.message
    assert not list(tmp_path.glob("*.json"))
    assert not list((tmp_path / ".attlog" / "scratch").iterdir())
    assert read_record(tmp_path, LOG.name) == record
    assert run_one(work(tmp_path), processes).code == 0


@pytest.mark.parametrize("change", ["import os; os.truncate({!r}, 1000)", "open({!r}, 'ab').write(b'x')"])
def test_a_log_that_is_cut_or_grows_while_it_is_mapped_is_unreadable(
    tmp_path: Path, processes: ForkServer, change: str
) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    record = run_one(work(tmp_path, log, specs=harm(change.format(str(log)))), processes)
    assert (record.code, record.key) == (66, "")
    assert "changed while it was read" in record.message
    assert not list(tmp_path.glob("*.json"))


def test_a_bug_is_told_with_its_traceback(tmp_path: Path, processes: ForkServer) -> None:
    body = "import attlog.report.page as page\ndef broken(*a, **k): raise ZeroDivisionError('x')\npage.render = broken"
    record = run_one(work(tmp_path, specs=harm(body)), processes)
    assert (record.code, "a bug in attlog" in record.message) == (70, True)
    assert "ZeroDivisionError" in record.trace


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, processes: ForkServer) -> None:
    (tmp_path / "file").write_text("x")
    assert run_one(work(tmp_path / "file" / "out"), processes).code == 73
    (tmp_path / "out" / f"{LOG.name}.html").mkdir(parents=True)
    record = run_one(work(tmp_path / "out"), processes)
    assert (record.code, record.folder_full) == (73, False)
    assert f"{LOG.name}.html: cannot be written" in record.message


@pytest.mark.slow
def test_the_death_of_the_forking_program_costs_its_children_alone(tmp_path: Path) -> None:
    with installed():
        processes = start_fork_server()
        assert run_one(work(tmp_path / "first"), processes).code == 0  # it loads the filters of its first log itself
        pid = tmp_path / "pid"
        kills_the_program = (
            f"import os, signal, time\nopen({str(pid)!r}, 'w').write(str(os.getpid()))\n"
            "os.kill(os.getppid(), signal.SIGKILL)\ntime.sleep(100)"
        )
        record = run_one(work(tmp_path, specs=harm(kills_the_program)), processes)
        assert record.code == 70
        assert "so is the process that started it" in record.message
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


def test_a_record_of_another_version_or_cut_short_is_none(tmp_path: Path) -> None:
    from attlog.batch.job import write_record

    write_record(tmp_path, Record("a", "a"))
    place = record_path(tmp_path, "a")
    whole = place.read_text()
    for damaged in (json.dumps(json.loads(whole) | {"schema": "attlog-record/99"}), whole[:20]):
        place.write_text(damaged)
        assert read_record(tmp_path, "a") is None


# One log in a process of its own where no program can fork: the same records, from fresh interpreters.


@pytest.fixture
def fresh_processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[ForkServer]:
    monkeypatch.delattr(os, "fork")
    for name in ("send_fds", "recv_fds"):
        monkeypatch.delattr(socket, name)
    with installed():
        kept = start_fork_server()
        yield kept
        kept.close()


def unmeasured(record: Record) -> Record:
    return replace(record, wall_s=0.0, cpu_s=0.0, peak_mb=0.0)


@pytest.mark.slow
def test_a_fresh_process_writes_what_a_forked_one_does(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    forking = start_fork_server()
    forked = run_one(work(tmp_path / "forked"), forking)
    forking.close()
    stages: list[str] = []
    without = request.getfixturevalue("fresh_processes")
    fresh = run_one(work(tmp_path / "fresh"), without, lambda told: stages.extend(map(str, told)))
    assert unmeasured(fresh) == unmeasured(forked)
    assert (fresh.code, "stage" in stages) == (0, True)


@pytest.mark.slow
def test_a_fresh_process_that_fails_is_one_record(tmp_path: Path, fresh_processes: ForkServer) -> None:
    record = run_one(work(tmp_path, specs=harm("import os; os._exit(9)")), fresh_processes)
    assert (record.code, "without an answer (exit status 9)" in record.message) == (70, True)
    slow = work(tmp_path, specs=harm("import time; time.sleep(100)"))._replace(timeout=3.0)
    record = run_one(slow, fresh_processes)
    assert (record.code, "longer than 3 s" in record.message) == (75, True)


def test_closing_ends_fresh_processes_too(tmp_path: Path, fresh_processes: ForkServer) -> None:
    body = f"import os, time\nopen({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid()))\ntime.sleep(100)"
    ended: list[object] = []

    def run() -> None:
        try:
            ended.append(run_one(work(tmp_path, specs=plugin(tmp_path, body)), fresh_processes))
        except Closed as closed:
            ended.append(closed)

    thread = threading.Thread(target=run)
    thread.start()
    pid = pid_in(tmp_path / "pid")
    fresh_processes.close()
    thread.join(10)
    assert [type(e) for e in ended] == [Closed]
    assert gone(pid)
    with pytest.raises(Closed):
        run_one(work(tmp_path), fresh_processes)


def test_the_lock_of_windows_refuses_a_second_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its call is played by this system's; a lock that another has is refused there as EACCES."""

    def locking(number: int, mode: int, count: int) -> None:
        assert (mode, count) == (2, 1)
        assert os.lseek(number, 0, os.SEEK_CUR) > 1000  # bytes that are locked could not be read
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise PermissionError(errno.EACCES, "Permission denied") from None

    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))
    monkeypatch.setattr(sys, "platform", "win32")
    with lock_folder(tmp_path) as warning:
        assert warning == ""
        with pytest.raises(OutputError, match=f"another batch is writing there .process {os.getpid()} on"):
            lock_folder(tmp_path).__enter__()
    with lock_folder(tmp_path):
        pass
