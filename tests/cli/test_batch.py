"""``attlog batch`` as a user runs it: exit codes, what is said, interrupts and kills."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.batch.dask_processes import Cluster
from tests.batch.test_run import content, cut
from tests.cli.test_exit_codes import expect
from tests.conftest import ROOT, SAMPLES

pytestmark = pytest.mark.usefixtures("interruptible")

LOG = SAMPLES / "copter_yaw_turns.bin"
GYRO = ("--estimators", "gyro", "--deterministic")


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A log that takes no time."""
    return cut(tmp_path / "logs", "small.bin")


def test_a_batch_writes_reports_index_and_table_and_sums_up(attlog, small, tmp_path):
    (small.parent / "bad.ulg").write_bytes(b"x" * 500)
    done = attlog("batch", small.parent, "-o", tmp_path / "out", *GYRO)
    expect(done, 65, "bad.ulg: not a flight log")
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert {"small.bin.html", "small.bin.json", "index.html", ".attlog"} <= names
    lines = done.out.splitlines()
    assert lines[0].startswith(f"2 logs: 1 report in {tmp_path / 'out'}, ")
    assert lines[1] == "  compared with: truth 1"
    assert lines[2] == "  answered: accuracy 0, noise 0, lag 0, yaw drift 0"  # by the gyro alone
    assert lines[3] == "  1 log cannot be used (exit code 65):"
    assert lines[4].startswith("    not a flight log")
    assert lines[-1] == f"index: {tmp_path / 'out' / 'index.html'}"
    assert len(lines) <= 10


@pytest.mark.slow
def test_a_result_tells_the_command_that_makes_it_alone(attlog, small, tmp_path):
    import json

    given = ("--window", "rest", "--gyro-bias", "none", "--estimators", "gyro")
    attlog("batch", small, "-o", tmp_path / "a", "--jobs", "2", "--timeout", "50", *given)
    document = json.loads((tmp_path / "a" / "small.bin.json").read_bytes())
    assert document["command"] == f"attlog analyze {small} --estimators gyro --window rest --gyro-bias none"


@pytest.mark.slow
def test_a_folder_with_a_batch_asks_what_to_do(attlog, small, tmp_path):
    assert attlog("batch", small, "-o", tmp_path / "out", *GYRO).code == 0
    expect(attlog("batch", small, "-o", tmp_path / "out", *GYRO), 2, "--resume", "--fresh", "-o")
    expect(attlog("batch", small, "-o", tmp_path / "out", *GYRO, "--resume", "--fresh"), 2, "one or the other")
    done = attlog("batch", small, "-o", tmp_path / "out", *GYRO, "--resume", "-v")
    expect(done, 0, "small.bin: done before")
    assert "; 1 done before" in done.out


@pytest.mark.slow
def test_a_finished_batch_counts_what_failed_before_and_tells_what_fails_anew(attlog, small, tmp_path):
    """A nightly job with one unusable log ended with 65 every night and printed the same line."""
    (small.parent / "bad.ulg").write_bytes(b"x" * 500)
    again = ("batch", small.parent, "-o", tmp_path / "out", *GYRO, "--resume")
    expect(attlog(*again), 65, "bad.ulg: not a flight log")
    done = attlog(*again, "--junit", tmp_path / "known.xml")
    assert (done.code, done.err) == (0, "")
    assert "; 1 done before; 1 failed before" in done.out
    assert "1 log cannot be used, as before:" in done.out
    assert 'errors="1"' not in (tmp_path / "known.xml").read_text()
    assert "<skipped message=" in (tmp_path / "known.xml").read_text()
    assert "bad.ulg: not a flight log" in attlog(*again, "-v").err
    (small.parent / "new.ulg").write_bytes(b"y" * 500)
    done = attlog(*again)
    expect(done, 65, "new.ulg: not a flight log")
    assert "bad.ulg" not in done.err
    (small.parent / "bad.ulg").write_bytes(b"z" * 500)
    expect(attlog(*again), 65, "bad.ulg: not a flight log")


@pytest.mark.slow
def test_a_log_that_takes_too_long_each_night_ends_with_75_each_night(attlog, samples, tmp_path):
    again = ("batch", samples / "copter_yaw_turns.bin", "-o", tmp_path / "out", "--resume", "--timeout", "0.05")
    expect(attlog(*again), 75, "took longer than 0.05 s")
    expect(attlog(*again), 75, "took longer than 0.05 s")


def test_what_a_batch_cannot_do_has_its_exit_code(attlog, small, tmp_path):
    out = tmp_path / "out"
    expect(attlog("batch", tmp_path / "*.ulg", "-o", out), 66, "no file matches this pattern")
    expect(attlog("batch", small, "-o", small), 73, "cannot be written")
    expect(attlog("batch", small, "-o", out, "--estimators", "mahonny"), 2, "mahony")
    expect(attlog("batch", small, "-o", out, "--params", tmp_path / "none.param"), 66, "none.param")
    assert not out.exists()


def started(*words: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "attlog", "batch", *map(str, words)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, cwd=ROOT
    )


def until(condition, seconds: float = 60.0) -> None:
    ends = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < ends, "it never came to that"
        time.sleep(0.02)


def children_of(log: Path) -> list[int]:
    """Processes that have a file of this name open, or mapped."""
    found = []
    for place in Path("/proc").glob("[0-9]*/maps"):
        try:
            if str(log) in place.read_text():
                found.append(int(place.parent.name))
        except OSError:
            continue
    return found


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_batch_is_consistent_and_goes_on(tmp_path, how):
    logs = [cut(tmp_path / "logs", f"{k}.bin") for k in range(3)]
    sleeps = tmp_path / "sleeps.py"
    sleeps.write_text(
        "import time, pathlib\n"
        f"if pathlib.Path({str(tmp_path / 'out/1.bin.json')!r}).exists():\n    time.sleep(100)\n"
        "from attlog.estimators.filters.gyro import *\n"
    )
    run = started(*logs, "-o", tmp_path / "out", "--estimators", sleeps, "--jobs", 1)
    until((tmp_path / "out/1.bin.json").exists)
    time.sleep(1)
    run.send_signal(how)
    _, err = run.communicate(timeout=20)
    assert run.returncode == 130
    assert "interrupted; 2 of 3 reports are in" in err
    assert "--resume" in err
    assert "Traceback" not in err
    assert "2 logs" in (tmp_path / "out/index.html").read_text()
    assert (tmp_path / "out/results.parquet").exists() or (tmp_path / "out/results.csv").exists()
    assert not children_of(logs[2])


@pytest.mark.slow
def test_a_batch_that_is_killed_goes_on_and_ends_as_if_nothing_had_been(tmp_path):
    """The process alone, and all it started; see benchmarks/kills.py for ten kills at random moments."""
    logs = [cut(tmp_path / "logs", f"{k}.bin", 250_000 + 10_000 * k) for k in range(6)]
    quiet, out = tmp_path / "quiet/out", tmp_path / "killed/out"
    run = started(*logs, "-o", quiet, *GYRO, "--jobs", 2)
    run.communicate(timeout=120)
    assert run.returncode == 0
    for k, wanted in enumerate((0, 1, 3)):
        run = started(*logs, "-o", out, *GYRO, "--jobs", 2, "--resume")
        until(lambda wanted=wanted: len(list((out / ".attlog/records").glob("*.json"))) >= wanted and out.exists())
        (os.kill if k else os.killpg)(run.pid, signal.SIGKILL)
        run.communicate(timeout=20)
    before = {p.name: p.stat().st_mtime_ns for p in (out / ".attlog/records").glob("*.json")}
    run = started(*logs, "-o", out, *GYRO, "--jobs", 2, "--resume", "-v")
    _, err = run.communicate(timeout=120)
    assert run.returncode == 0
    assert err.count("done before") == len(before) >= 3
    after = {p.name: p.stat().st_mtime_ns for p in (out / ".attlog/records").glob("*.json")}
    assert {name: after[name] for name in before} == before
    assert content(out) == content(quiet)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="limits are set by the shell")
def test_a_disk_that_is_full_stops_the_batch_and_leaves_nothing_half_written(tmp_path):
    """A file size limit stands for the disk: no file may grow beyond 300 kB, which a report does."""
    logs = [cut(tmp_path / "logs", f"{k}.bin") for k in range(2)]
    words = " ".join(map(str, [sys.executable, "-m", "attlog", "batch", *logs, "-o", tmp_path / "out", *GYRO]))
    done = subprocess.run(["bash", "-c", f"ulimit -f 300; exec {words}"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 73
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list((tmp_path / "out").glob("[01].bin*"))
    assert not list((tmp_path / "out/.attlog/scratch").iterdir())


@pytest.mark.rights
def test_a_folder_that_may_not_be_written_is_73(attlog, small, tmp_path):
    (tmp_path / "out").mkdir(mode=0o500)
    expect(attlog("batch", small, "-o", tmp_path / "out", *GYRO), 73, "cannot be written")


# ``attlog batch`` on a cluster of real processes.


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.fixture(scope="module")
def dask(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed")
    running = Cluster(tmp_path_factory.mktemp("dask")).start()
    for _ in range(2):
        running.worker()
    yield running
    running.stop()


@pytest.mark.slow
def test_a_cluster_gives_the_same_folder_as_this_machine(attlog, dask: Cluster, tmp_path: Path) -> None:
    """Reports, JSON, index and table of results, byte for byte."""
    (tmp_path / "no.ulg").write_bytes(b"no log")
    batch = ("batch", SAMPLES, tmp_path / "no.ulg", *GYRO)
    there = ("-o", tmp_path / "there/out", "--scheduler", dask.address)
    assert attlog(*batch, *there).code == attlog(*batch, "-o", tmp_path / "here/out").code == 65
    one, other = files(tmp_path / "there/out"), files(tmp_path / "here/out")
    assert len(one) == 12
    assert one == other
    again = attlog(*batch, *there, "--resume")
    assert (again.code, "5 done before; 1 failed before" in again.out) == (0, True)  # the unusable log is known
    assert files(tmp_path / "there/out") == one
