"""A batch on a Dask cluster: a real scheduler and real workers, as processes on loopback."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from attlog import Config
from attlog.batch import cluster, process
from attlog.batch.cluster import cluster_runner
from attlog.batch.job import MEASURED, Job, Record, read_record, settings_key
from attlog.batch.process import run_one
from attlog.batch.report_files import report_names
from attlog.batch.sources import sources
from attlog.core.errors import ClusterError, UsageError
from tests.batch.dask_processes import Cluster
from tests.conftest import SAMPLES

pytest.importorskip("distributed")
ALONE: dict[str, Any] = dict.fromkeys(MEASURED, 0.0)
PLUGIN = "import os, time\n{}\nfrom attlog.estimators.filters.gyro import *\n"


@pytest.fixture(scope="module")
def dask(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Two workers that all tests share."""
    running = Cluster(tmp_path_factory.mktemp("dask")).start()
    for _ in range(2):
        running.worker()
    yield running
    running.stop()


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Cluster]:
    """A cluster that a test may break."""
    (tmp_path / "dask").mkdir()
    running = Cluster(tmp_path / "dask")
    yield running
    running.stop()


def works(folder: Path, count: int = 5, specs: str = "gyro", places: Any = (SAMPLES,)) -> list[Job]:
    """Job for the samples, over and over under other names."""
    logs, wrong = sources(places)
    assert wrong == []
    logs = [logs[k % len(logs)] for k in range(count)]
    config = Config(estimators=specs.split(","))
    settings = settings_key(config, deterministic=True)
    names = report_names(Path(log.file_name) for log in logs)
    return [Job(log, name, folder, config, settings, deterministic=True) for log, name in zip(logs, names, strict=True)]


def same(record: Record) -> Record:
    return replace(record, **ALONE)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.slow
def test_a_cluster_gives_what_this_machine_gives_also_when_a_worker_is_killed(own: Cluster, tmp_path: Path) -> None:
    """Five logs on two workers, one killed by signal 9 after the first: same files, same records."""
    own.start()
    own.worker()
    victim = own.worker()
    todo = works(tmp_path / "there", 5)
    found = []
    for record in cluster_runner(own.address)(todo):
        if not found:
            victim.kill()
        found.append(record)
    here = [run_one(work._replace(folder=tmp_path / "here")) for work in todo]
    assert {r.name for r in found} == {r.name for r in here}
    assert sorted(map(same, found), key=lambda r: r.name) == sorted(map(same, here), key=lambda r: r.name)
    assert {r.code for r in found} == {0}
    assert files(tmp_path / "there") == files(tmp_path / "here")
    assert len(files(tmp_path / "there")) == 10
    assert [same(read_record(tmp_path / "there", r.name)) for r in here] == [same(r) for r in here]


@pytest.mark.slow
def test_a_log_that_takes_its_workers_along_is_a_row_and_the_others_are_done(own: Cluster, tmp_path: Path) -> None:
    own.start(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0")
    own.worker()
    own.worker()
    killer = tmp_path / "killer.py"
    # The filter's process, that of the log, the one that started it, the worker.
    above = 'int(open(f"/proc/{pid}/stat").read().rsplit(")")[-1].split()[1])'
    killer.write_text(
        PLUGIN.format(f"pid = os.getppid()\nfor _ in range(2): pid = {above}\nos.kill(pid, 9)\ntime.sleep(60)")
    )
    todo = works(tmp_path / "out", 5)
    todo[1] = todo[1]._replace(config=Config(estimators=[str(killer)]))
    found = {r.name: r for r in cluster_runner(own.address, at_once=2)(todo)}
    assert [found[w.name].code for w in todo] == [0, 70, 0, 0, 0]
    assert "the workers that had it died" in found[todo[1].name].message
    assert "Traceback" not in found[todo[1].name].message


@pytest.mark.slow
def test_what_fails_in_a_task_fails_as_here(dask: Cluster, tmp_path: Path) -> None:
    (tmp_path / "no.ulg").write_bytes(b"no log")
    todo = works(tmp_path / "out", 2, places=[tmp_path / "no.ulg", tmp_path / "missing.ulg"])
    there = sorted(map(same, cluster_runner(dask.address)(todo)), key=lambda r: r.name)
    here = sorted((same(run_one(work)) for work in todo), key=lambda r: r.name)
    assert [r.code for r in there] == [66, 65]
    assert there == here


@pytest.mark.slow
def test_a_log_that_workers_do_not_see_is_sent_along(
    dask: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    todo = works(tmp_path / "there", 4)
    monkeypatch.setattr(cluster, "file_sign", lambda _: "another file")
    found = list(cluster_runner(dask.address)(todo))
    assert sorted((r.name, r.code) for r in found) == [(w.name, 0) for w in todo]
    for work in todo:
        run_one(work._replace(folder=tmp_path / "here"))
    assert files(tmp_path / "there") == files(tmp_path / "here")
    assert {r.log for r in found} == {w.source.name for w in todo}


@pytest.mark.slow
def test_resume_asks_the_cluster_for_nothing_that_is_done(dask: Cluster, tmp_path: Path) -> None:
    todo = [work._replace(resume=True) for work in works(tmp_path, 3)]
    run_one(todo[0])
    assert sorted((r.name, r.again) for r in cluster_runner(dask.address)(todo)) == [
        (w.name, w is todo[0]) for w in todo
    ]
    assert all(r.again for r in cluster_runner("tcp://127.0.0.1:9")(todo))


@pytest.mark.slow
def test_who_stops_reading_cancels_the_rest(dask: Cluster, tmp_path: Path) -> None:
    """Also a task that runs ends, its child with it, long before its 60 s."""
    from distributed import Client

    sleeper = tmp_path / "sleeper.py"
    marks = tmp_path / "marks"
    marks.mkdir()
    sleeper.write_text(PLUGIN.format(f"open(f'{marks}/{{os.getpid()}}', 'w').close()\ntime.sleep(60)"))
    todo = works(tmp_path / "out", 8)
    todo[1:] = [work._replace(config=Config(estimators=[str(sleeper)])) for work in todo[1:]]
    reading = cluster_runner(dask.address)(todo)
    assert next(reading).code == 0
    until = time.monotonic() + 60
    while not list(marks.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.1)
    reading.close()
    assert not list((tmp_path / "out").glob("px4*"))
    with Client(dask.address, set_as_default=False) as client:
        until = time.monotonic() + 10
        while client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)):
            assert time.monotonic() < until
            time.sleep(0.1)
    while any(Path(f"/proc/{mark.name}").exists() for mark in marks.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.1)


def test_a_worker_whose_disk_is_full_stops_no_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (work,) = works(tmp_path, 1)
    full = Record(work.source.name, work.name, code=73, message="attlog: no space", folder_full=True)
    monkeypatch.setattr(cluster, "run_one", lambda *_, **__: full)
    record, _ = cluster.run_task(cluster.__version__, pickle.dumps(work), "")
    assert record is not None
    assert (record.code, record.folder_full) == (73, False)
    assert "of the worker" in record.message


def test_nobody_at_the_address_is_told_in_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with pytest.raises(ClusterError, match="no Dask scheduler answers there") as caught:
        list(cluster_runner("tcp://127.0.0.1:9")(works(tmp_path, 1)))
    assert caught.value.exit_code == 75
    with pytest.raises(UsageError, match="looks like tcp://host:8786"):
        list(cluster_runner("nonsense://x:1")(works(tmp_path, 1)))


@pytest.mark.slow
def test_a_scheduler_without_workers_is_told(own: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "NO_WORKER_TIMEOUT_S", 0.3)
    monkeypatch.setattr(cluster, "CHECK_S", 0.1)
    heard: list[str] = []
    with pytest.raises(ClusterError, match="no worker for 0 s"):
        list(cluster_runner(own.start().address, say=heard.append)(works(tmp_path, 1)))
    assert "waiting for one" in heard[0]


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_told_and_what_is_done_stays(own: Cluster, tmp_path: Path) -> None:
    own.start()
    own.worker()
    todo = works(tmp_path / "out", 5)
    reading = cluster_runner(own.address)(todo)
    first = next(reading)
    assert own.scheduler is not None
    own.scheduler.kill()
    with pytest.raises(ClusterError, match="the scheduler is gone"):
        list(reading)
    assert read_record(tmp_path / "out", first.name) == first


@pytest.mark.slow
def test_another_version_or_python_on_a_worker_is_told(
    dask: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    todo = works(tmp_path, 1)
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "__version__", "99.0")
        with pytest.raises(UsageError, match=r"worker tcp://.* has attlog .* and this side 99.0"):
            list(cluster_runner(dask.address)(todo))
    monkeypatch.setattr(cluster, "PYTHON", "3.99")
    with pytest.raises(UsageError, match=r"runs Python 3\.\d+ and this side 3\.99"):
        list(cluster_runner(dask.address)(todo))


@pytest.mark.slow
def test_a_filter_file_that_workers_do_not_see_is_told_once(
    dask: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers have a folder of their own, where a relative name means another file."""
    (tmp_path / "mine.py").write_text(PLUGIN.format("pass"))
    monkeypatch.chdir(tmp_path)
    todo = works(tmp_path / "out", 2, specs="mine.py")
    with pytest.raises(UsageError, match=r"a worker does not see mine\.py"):
        list(cluster_runner(dask.address)(todo))


def test_the_json_of_a_log_that_comes_back_is_written_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who waits for it finds the page as well."""
    order: list[str] = []
    monkeypatch.setattr(process, "write_atomic", lambda path, data, kind: order.append(path.name))
    work: Any = SimpleNamespace(folder=tmp_path, name="a", keep=False, source=SimpleNamespace(place="a.ulg"))
    record = Record("a.ulg", "a")
    assert cluster._store(work, record, {"a.json": b"", "a.html": b"", "z.js": b""}) is record
    assert order == ["a.html", "z.js", "a.json"]
