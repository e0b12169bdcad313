"""``attlog batch`` as a service that watches a folder, and on a cluster: real processes, real signals."""

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

ONE, TWO = SAMPLES / "copter_yaw_turns.bin", SAMPLES / "px4_hover.ulg"
OPTIONS = ("--estimators", "gyro", "--deterministic")
PATIENCE_S = 120.0


class Process:
    """An attlog command that runs."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.said_in = folder / f"said{time.monotonic_ns()}.txt"
        with self.said_in.open("wb") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "attlog", *arguments],
                stdout=said, stderr=said, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
            )  # fmt: skip

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

    def cpu_s(self) -> float:
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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


def copied_slowly(source: Path, place: Path, seconds: float) -> None:
    """As a download comes: a piece now and then."""
    data = source.read_bytes()
    pieces = 12
    with place.open("wb", buffering=0) as file:
        for k in range(pieces):
            file.write(data[len(data) * k // pieces : len(data) * (k + 1) // pieces])
            time.sleep(seconds / pieces)


@pytest.mark.slow
def test_a_service_takes_what_arrives_leaves_downloads_alone_and_ends_when_asked(
    tmp_path: Path, start: Callable[..., Process]
) -> None:
    share, out = tmp_path / "share", tmp_path / "out"
    share.mkdir()
    service = start("batch", "--watch", str(share), "-o", str(out), "--settle", "1.5", *OPTIONS)
    service.wait_for(lambda: "watching" in service.said)
    copied_slowly(ONE, share / "a.bin", 6)  # four looks, none of them long enough after the last piece
    assert "arrived" not in service.said
    copied_slowly(TWO, share / "b.ulg.part", 1)
    service.wait_for((out / "a.bin.json").is_file)
    (share / "b.ulg.part").rename(share / "b.ulg")
    service.wait_for((out / "b.ulg.json").is_file)
    service.wait_for(lambda: "b.ulg" in (out / "index.html").read_text() or service.said.count(" MB") == 2)
    time.sleep(3)
    before = service.cpu_s()
    time.sleep(4)
    assert service.cpu_s() - before < 0.2  # measured 0.01
    assert service.end(signal.SIGTERM) == 0
    assert "2 reports of 2 logs" in service.said
    assert "b.ulg.part" not in service.said
    kept = files(out)
    again = start("batch", str(share), "--watch", "-o", str(out), "--settle", "0", *OPTIONS)
    again.wait_for(lambda: "watching" in again.said)
    time.sleep(4)
    assert again.end(signal.SIGINT) == 130
    assert "arrived" not in again.said
    assert files(out) == kept
    direct = start("batch", str(share), "-o", str(tmp_path / "direct"), *OPTIONS)
    assert direct.process.wait(PATIENCE_S) == 0
    reports = {name: data for name, data in files(tmp_path / "direct").items() if not name.startswith(("index", "res"))}
    assert {name: kept[name] for name in reports} == reports


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 0), (signal.SIGKILL, -signal.SIGKILL)])
def test_a_service_that_is_ended_in_the_middle_leaves_nothing_half_done(
    tmp_path: Path, start: Callable[..., Process], number: int, code: int
) -> None:
    share, out = tmp_path / "share", tmp_path / "out"
    share.mkdir()
    (share / "a.bin").write_bytes(ONE.read_bytes())
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(60)\nfrom attlog.estimators.filters.gyro import *\n")
    service = start("batch", "--watch", str(share), "-o", str(out), "--settle", "0", "--estimators", "slow.py")
    service.wait_for(lambda: "1 arrived" in service.said)
    time.sleep(1)
    assert service.end(number) == code
    assert files(out) == {}
    again = start("batch", "--watch", str(share), "-o", str(out), "--settle", "0", *OPTIONS)
    again.wait_for((out / "a.bin.json").is_file)
    assert again.end(signal.SIGTERM) == 0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [(["https://host/logs/"], 2, "folders and patterns of this machine"), (["none"], 66, "no such folder")],
)
def test_what_cannot_be_watched_is_refused(attlog, tmp_path: Path, arguments: list[str], code: int, words: str) -> None:
    done = attlog("batch", "--watch", *arguments, "-o", str(tmp_path / "out"))
    assert done.code == code
    assert words in done.err


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
    running = start(
        "batch", str(SAMPLES), "-o", "out", "--scheduler", dask.address, "--estimators", str(slow)
    )  # fmt: skip
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
