"""Many logs into one folder: what is done stays done, and nothing is mixed or lost."""

from __future__ import annotations

import atexit
import functools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from attlog import Config
from attlog.batch.job import Job, Record, records
from attlog.batch.process import start_fork_server
from attlog.batch.run import BatchOutcome, Runner, local_runner, lock_folder, run_batch
from attlog.batch.sources import Source
from attlog.core.errors import OutputError, UsageError
from attlog.core.workers import ForkServer
from tests.conftest import SAMPLES

ARDUPILOT, PX4 = SAMPLES / "copter_yaw_turns.bin", SAMPLES / "px4_steps.ulg"


class Watching:
    """Remembers what it was told."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def planned(self, jobs: Sequence[Job]) -> None:
        pass

    def finished(self, record: Record) -> None:
        self.records.append(record)


@functools.cache
def kept() -> ForkServer:
    """One for all tests of this file: it takes a second to start."""
    found = start_fork_server()
    atexit.register(found.close)
    return found


def run(
    folder: Path, *logs: Path, workers: int = 1, runner: Runner | None = None, **more: Any
) -> tuple[BatchOutcome, list[Record]]:
    watching, config = Watching(), more.pop("config", Config(estimators=["gyro"]))
    sources = [Source(str(log)) for log in logs]
    how = runner or local_runner(workers, processes=kept())
    return run_batch(sources, folder, config, how, watching, deterministic=True, **more), watching.records


def content(folder: Path) -> dict[str, bytes]:
    """Every file that a user sees, and the records without what was measured."""
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    found.pop(".attlog/lock", None)
    for name in [n for n in found if n.startswith(".attlog/records/")]:
        kept = json.loads(found[name])
        found[name] = json.dumps({k: v for k, v in kept.items() if k not in ("wall_s", "cpu_s", "peak_mb")}).encode()
    return found


def cut(folder: Path, name: str, size: int = 300_000) -> Path:
    """A small log of its own."""
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_bytes(ARDUPILOT.read_bytes()[:size])
    return path


@pytest.mark.slow
def test_a_batch_is_the_same_with_one_worker_and_with_two(tmp_path: Path) -> None:
    logs = [ARDUPILOT, tmp_path / "none.ulg", PX4, cut(tmp_path / "a", "x.bin"), cut(tmp_path / "b", "x.bin")]
    (one, first), (two, _) = (run(tmp_path / str(n) / "out", *logs, workers=n) for n in (1, 2))
    assert content(tmp_path / "1/out") == content(tmp_path / "2/out")
    assert [e.name for e in two.records] == [ARDUPILOT.name, "none.ulg", PX4.name, "x.bin", "x.bin-2"]
    assert one.codes == two.codes == {0, 66}
    assert [r.log for r in first] == [str(log) for log in logs]
    names = {p.name for p in (tmp_path / "1/out").iterdir()}
    assert {"index.html", "x.bin.html", "x.bin-2.json"} <= names
    assert names & {"results.parquet", "results.csv"}


def test_a_folder_with_a_batch_is_neither_mixed_nor_lost(tmp_path: Path) -> None:
    first, second = cut(tmp_path / "a", "x.bin"), cut(tmp_path / "b", "x.bin")
    run(tmp_path / "out", first)
    before = content(tmp_path / "out")
    with pytest.raises(UsageError, match=r"holds a batch \(1 of 1 log reached.*--resume .*--fresh .*-o"):
        run(tmp_path / "out", first)
    assert content(tmp_path / "out") == before
    outcome, told = run(tmp_path / "out", second, first, resume=True)
    assert [(r.log, r.name, r.again) for r in told] == [(str(second), "x.bin-2", False), (str(first), "x.bin", True)]
    assert outcome.again == 1
    (tmp_path / "out" / "notes.txt").write_text("mine")
    outcome, told = run(tmp_path / "out", second, fresh=True)
    assert [(r.name, r.again) for r in told] == [("x.bin", False)]
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert sorted(p.name for p in (tmp_path / "out").glob("x*")) == ["x.bin.html", "x.bin.json"]
    assert [r.log for r in records(tmp_path / "out")] == [str(second)]


def test_a_log_that_fails_now_keeps_its_earlier_report_which_is_replaced_later(tmp_path: Path) -> None:
    log = cut(tmp_path / "a", "x.bin")
    run(tmp_path / "out", log)
    log.write_bytes(b"no log " * 100)
    outcome, _ = run(tmp_path / "out", log, resume=True)
    assert outcome.codes == {65}
    assert len(list((tmp_path / "out").glob("x*"))) == 2
    _, told = run(tmp_path / "out", log, resume=True)
    assert told[0].again
    cut(tmp_path / "a", "x.bin", 300_000)
    outcome, _ = run(tmp_path / "out", log, resume=True)
    assert outcome.codes == {0}


def test_a_run_without_any_report_keeps_index_and_table_of_an_earlier_one(tmp_path: Path) -> None:
    log, out = cut(tmp_path / "a", "x.bin"), tmp_path / "out"
    run(out, log)
    pages = [out / "index.html", *out.glob("results.*")]
    before = [page.read_bytes() for page in pages]
    log.unlink()
    outcome, _ = run(out, log, resume=True)
    assert outcome.codes == {66}
    assert "index.html of the earlier run is kept" in outcome.ended
    assert [page.read_bytes() for page in pages] == before
    outcome, _ = run(tmp_path / "never", log)
    assert (tmp_path / "never" / "index.html").exists(), "what failed is listed where nothing is lost"


def test_fresh_removes_nothing_where_a_report_was_replaced_by_a_file_of_another(tmp_path: Path) -> None:
    first, second, out = cut(tmp_path / "a", "x.bin"), cut(tmp_path / "b", "y.bin"), tmp_path / "out"
    run(out, first, second)
    (out / "y.bin.html").write_text("mine")
    before = content(out)
    with pytest.raises(OutputError, match=r"y\.bin\.html: exists and is not"):
        run(out, first, second, fresh=True)
    assert content(out) == before


def test_a_log_that_times_out_again_decides_the_exit_code_again(tmp_path: Path) -> None:
    log = cut(tmp_path / "a", "x.bin")
    for resume in (False, True, True):
        outcome, told = run(tmp_path / "out", log, resume=resume, timeout=0.001)
        assert (outcome.codes, told[0].known) == ({75}, False)


@pytest.mark.slow
def test_other_options_do_all_logs_again(tmp_path: Path) -> None:
    log = cut(tmp_path / "a", "x.bin")
    run(tmp_path / "out", log)
    outcome, _ = run(tmp_path / "out", log, resume=True, config=Config(estimators=["accel_mag"]))
    assert outcome.again == 0
    assert "accel_mag" in outcome.records[0].row["rows"]


def test_rooms_of_processes_that_were_killed_are_removed(tmp_path: Path) -> None:
    room = tmp_path / "out" / ".attlog" / "scratch" / "dead"
    room.mkdir(parents=True)
    (room / "half.html").write_text("x")
    for place in ("out/.index.html.0123456789ab", "out/.attlog/records/.x.bin.json.0123456789ab"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text("x")
    (tmp_path / "out" / ".mine.0123456789ab").write_text("x")
    run(tmp_path / "out", cut(tmp_path / "a", "x.bin"))
    assert not room.exists()
    assert [p.name for p in (tmp_path / "out").rglob(".*.0123456789ab")] == [".mine.0123456789ab"]


def test_two_batches_do_not_meet_in_one_folder(tmp_path: Path) -> None:
    with lock_folder(tmp_path / "out"):
        with pytest.raises(OutputError, match=rf"another batch is writing there \(process {os.getpid()} on .*-o"):
            run(tmp_path / "out", ARDUPILOT)
    with lock_folder(tmp_path / "out"):
        pass


def test_a_lock_ends_with_its_process_however_that_ends(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from attlog.batch.run import lock_folder\n"
        f"with lock_folder(Path({str(tmp_path)!r})):\n    print('held', flush=True); time.sleep(60)"
    )
    other = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdout.readline() == "held\n"
    with pytest.raises(OutputError, match=f"process {other.pid} on"), lock_folder(tmp_path):
        pass
    other.kill()
    other.communicate()
    with lock_folder(tmp_path):
        pass


@pytest.mark.slow
def test_a_batch_stops_where_the_disk_is_full(tmp_path: Path) -> None:
    """Nothing half-written, nothing lost, and no log is analysed in vain."""
    logs = [cut(tmp_path / "a", f"{k}.bin") for k in range(5)]
    run(tmp_path / "out", logs[0])
    before = content(tmp_path / "out")
    reached: list[str] = []

    def no_room(jobs: Sequence[Job]):
        for job in jobs:
            reached.append(job.name)
            if job.name == "2.bin":
                yield Record(job.source.name, job.name, code=73, message="attlog: no space", folder_full=True)
            else:
                yield next(iter(local_runner(1, processes=kept())([job])))

    outcome, _ = run(tmp_path / "out", *logs, resume=True, runner=no_room)
    assert reached == ["0.bin", "1.bin", "2.bin"]
    assert outcome.ended.startswith(f"stopped: {tmp_path / 'out'} takes no more files, 2 of 5 logs not reached")
    assert outcome.codes == {0, 73}
    after = content(tmp_path / "out")
    assert {name: after[name] for name in before if "0.bin" in name} == {
        name: data for name, data in before.items() if "0.bin" in name
    }
    assert run(tmp_path / "out", *logs, resume=True)[0].again == 2


@pytest.mark.slow
def test_a_report_keeps_its_name_for_the_life_of_its_folder(tmp_path: Path) -> None:
    first, second = cut(tmp_path / "a", "x.bin"), cut(tmp_path / "b", "x.bin")
    run(tmp_path / "out", first, second)
    shutil.rmtree(tmp_path / "out" / ".attlog" / "records")
    _, told = run(tmp_path / "out", second, first, resume=True)
    assert {r.log: r.name for r in told} == {str(first): "x.bin", str(second): "x.bin-2"}


@pytest.mark.slow
def test_a_log_that_lies_elsewhere_now_is_known_by_its_content(tmp_path: Path) -> None:
    first, second = cut(tmp_path / "a", "x.bin"), cut(tmp_path / "b", "x.bin", 310_000)
    run(tmp_path / "out", first, second)
    (tmp_path / "a").rename(tmp_path / "moved")
    moved, other = tmp_path / "moved" / "x.bin", cut(tmp_path / "c", "x.bin", 320_000)
    _, told = run(tmp_path / "out", other, moved, resume=True)
    assert {(r.log, r.name, r.again) for r in told} == {(str(moved), "x.bin", True), (str(other), "x.bin-3", False)}
    assert (tmp_path / "out" / "x.bin-2.html").exists()
    assert {r.log for r in records(tmp_path / "out")} == {str(moved), str(second), str(other)}
