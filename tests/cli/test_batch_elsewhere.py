"""``attlog batch`` on a cluster: real processes, real signals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT, SAMPLES
from tests.fleet.dask_processes import Cluster

pytestmark = pytest.mark.usefixtures("interruptible")

OPTIONS = ("--estimators", "gyro", "--deterministic")
PATIENCE_S = 120.0


class Process:
    """An attlog command that runs."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.said_in = folder / f"said{time.monotonic_ns()}.txt"
        with self.said_in.open("wb") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "attlog", *arguments],
                stdout=said,
                stderr=said,
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
            )

    @property
    def said(self) -> str:
        return self.said_in.read_text()

    def wait_for(self, condition: Callable[[], object]) -> None:
        until = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.process.poll() is None, self.said
            assert time.monotonic() < until, self.said
            time.sleep(0.05)

    def end(self, number: int) -> int:
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    started: list[Process] = []

    def begin(*arguments: str) -> Process:
        started.append(Process(tmp_path, *arguments))
        return started[-1]

    yield begin
    for one in started:
        one.process.kill()
        one.process.wait()


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
def test_a_cluster_gives_the_same_folder_as_this_machine(
    dask: Cluster, tmp_path: Path, start: Callable[..., Process]
) -> None:
    """Reports, JSON, index and table of results, byte for byte."""
    (tmp_path / "no.ulg").write_bytes(b"no log")
    places = [str(SAMPLES), str(tmp_path / "no.ulg")]
    there = start("batch", *places, "-o", "there/out", "--scheduler", dask.address, *OPTIONS)
    assert there.process.wait(PATIENCE_S) == 65, there.said
    here = start("batch", *places, "-o", "here/out", *OPTIONS)
    assert here.process.wait(PATIENCE_S) == 65, here.said
    one, other = files(tmp_path / "there/out"), files(tmp_path / "here/out")
    assert len(one) == 12
    assert one == other
    again = start("batch", *places, "-o", "there/out", "--scheduler", dask.address, "--resume", *OPTIONS)
    assert again.process.wait(PATIENCE_S) == 0  # the unusable log is known
    assert "5 done before; 1 failed before" in again.said
    assert files(tmp_path / "there/out") == one


@pytest.mark.slow
def test_ctrl_c_cancels_what_the_cluster_has(dask: Cluster, tmp_path: Path, start: Callable[..., Process]) -> None:
    from distributed import Client

    slow = tmp_path / "slow.py"
    slow.write_text("import time\ntime.sleep(60)\nfrom attlog.estimators.filters.gyro import *\n")
    running = start("batch", str(SAMPLES), "-o", "out", "--scheduler", dask.address, "--estimators", str(slow))
    with Client(dask.address, set_as_default=False) as client:

        def tasks() -> int:
            return client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks))

        running.wait_for(lambda: tasks() > 3)
        assert running.end(signal.SIGINT) == 130
        until = time.monotonic() + 10
        while tasks():
            assert time.monotonic() < until
            time.sleep(0.1)
    assert "Traceback" not in running.said
    assert "interrupted" in running.said


@pytest.mark.slow
def test_no_scheduler_is_one_sentence_in_seconds(tmp_path: Path, start: Callable[..., Process]) -> None:
    running = start("batch", str(SAMPLES), "-o", "out", "--scheduler", "tcp://127.0.0.1:9", *OPTIONS)
    assert running.process.wait(30) == 75
    assert "no Dask scheduler answers there" in running.said
    assert "Traceback" not in running.said


@pytest.mark.slow
def test_an_address_that_is_none_is_one_sentence(tmp_path: Path, start: Callable[..., Process]) -> None:
    running = start("batch", str(SAMPLES), "-o", "out", "--scheduler", "local", *OPTIONS)
    assert running.process.wait(30) == 2
    assert "it looks like tcp://host:8786" in running.said
    assert "Traceback" not in running.said
