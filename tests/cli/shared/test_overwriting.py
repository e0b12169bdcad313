"""What a command writes is never what it reads, nor a flight log; devices and pipes stay what they are."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import SAMPLES

pytestmark = pytest.mark.usefixtures("interruptible")

LOG = SAMPLES / "copter_yaw_turns.bin"
GYRO = ("--estimators", "gyro", "--reference", "onboard", "-q")
POSIX = pytest.mark.skipif(os.name != "posix", reason="devices and pipes as POSIX knows them")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log that could be lost."""
    return Path(shutil.copy(LOG, tmp_path / "flight.md"))


@pytest.mark.parametrize("option", ["--junit", "--summary"])
@pytest.mark.parametrize("which", ["this log", "another log", "a link to it"])
def test_no_output_takes_the_place_of_a_log(
    attlog: Callable[..., Any], log: Path, tmp_path: Path, option: str, which: str
) -> None:
    read, written = log, log
    if which == "another log":
        read = Path(shutil.copy(LOG, tmp_path / "other.bin"))
    elif which == "a link to it":
        written = tmp_path / "link.md"
        written.symlink_to(log)
    done = attlog("batch", read, *GYRO, "-o", tmp_path / "out", option, written)
    assert done.code == 2
    assert "would be overwritten" in done.err
    assert log.read_bytes() == LOG.read_bytes()
    assert not (tmp_path / "out").exists()


def test_no_output_takes_the_place_of_another_input(attlog: Callable[..., Any], tmp_path: Path) -> None:
    gates = tmp_path / "gates.toml"
    gates.write_text("[gates]\nlag_ms = { max = 5 }\n")
    assert attlog("batch", LOG, *GYRO, "-o", tmp_path / "out", "--gates", gates, "--junit", gates).code == 2
    estimate = tmp_path / "mine.csv"
    estimate.write_text("time_s,roll_deg\n")
    words = ("batch", LOG, "--estimators", f"gyro,{estimate}", "--junit", estimate, "-o", tmp_path / "out")
    assert attlog(*words).code == 2
    assert attlog("diff", estimate, gates, "-o", estimate).code == 2
    assert attlog("diff", gates, estimate, "-o", estimate).code == 2
    assert estimate.read_text() == "time_s,roll_deg\n"
    assert gates.read_text().startswith("[gates]")


def test_what_a_command_wrote_before_is_replaced(attlog: Callable[..., Any], tmp_path: Path) -> None:
    for _ in range(2):
        assert attlog("extract", LOG, "ATT", "-q", "-o", tmp_path / "att.csv").code == 0
    assert (tmp_path / "att.csv").stat().st_size > 1000


@POSIX
def test_a_pipe_is_written_into_and_stays(attlog: Callable[..., Any], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()), daemon=True)
    place = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # so that the writer meets a reader, whoever is first
    reader.start()
    assert attlog("batch", LOG, *GYRO, "-o", tmp_path / "out", "--junit", pipe).code == 0
    os.close(place)
    reader.join(10)
    assert read[0].endswith("</testsuites>\n")
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("name", ["", ".", "..", "../../elsewhere", "a/b", "x" * 300, "/abs"])
def test_a_comparison_stays_in_its_folder(attlog: Callable[..., Any], tmp_path: Path, name: str) -> None:
    done = attlog("compare", LOG, "gyro", "mahony", "-o", tmp_path / "out", "--name", name)
    assert done.code == 2
    assert not (tmp_path / "out").exists()


@POSIX
@pytest.mark.parametrize("command", ["info", "health", "analyze", "batch", "compare", "extract"])
def test_a_pipe_in_place_of_a_log_is_refused_at_once(attlog: Callable[..., Any], tmp_path: Path, command: str) -> None:
    pipe = tmp_path / "log.ulg"
    os.mkfifo(pipe)
    more = ["gyro", "mahony"] if command == "compare" else []
    place = [] if command == "info" else ["-o", tmp_path / "out"]
    done = attlog(command, pipe, *more, *place)
    assert done.code == 66
    assert "is no regular file" in done.err


@POSIX
def test_a_pipe_in_a_folder_of_results_is_passed_over(attlog: Callable[..., Any], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "result.json")
    done = attlog("table", tmp_path)
    assert done.code == 66
    assert "without a batch or a result" in done.err


def test_what_is_no_log_is_refused_before_it_is_read(attlog: Callable[..., Any], tmp_path: Path) -> None:
    """The image of a disk, here a file of which only the size is there: hashing it would take hours."""
    image = tmp_path / "disk.ulg"
    with image.open("wb") as file:
        file.truncate(1 << 40)
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in signals]
    for command in ("analyze", "batch"):
        assert attlog(command, image, "-o", tmp_path / "out").code == 65
    assert [signal.getsignal(number) for number in signals] == before  # another process has watched the mapped file
    settings = tmp_path / "settings.toml"
    os.link(image, settings)
    assert attlog("analyze", LOG, "--config", settings).code == 2


@pytest.mark.parametrize("command", ["info", "health", "analyze", "extract"])
def test_a_log_that_no_memory_can_hold_is_no_bug(
    attlog: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    def too_much(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 193. GiB for an array")

    monkeypatch.setattr("attlog.formats.open", too_much)
    done = attlog(command, LOG, *([] if command == "info" else ["-o", tmp_path / "out"]))
    assert done.code == 75
    assert "memory ran out" in done.err
    assert "bug" not in done.err


@pytest.mark.parametrize(
    "words", [["analyze", ""], ["diff", "", ""], ["table", ""], ["analyze", LOG, "-o", ""], ["batch", LOG, "--junit="]]
)
def test_an_unset_variable_means_no_folder(
    attlog: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[Any]
) -> None:
    monkeypatch.chdir(tmp_path)
    done = attlog(*words)
    assert (done.code, "an empty word" in done.err) == (2, True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["analyze", "batch", "compare"])
def test_a_window_is_judged_before_any_log_is_read(attlog: Callable[..., Any], tmp_path: Path, command: str) -> None:
    more = ["gyro", "mahony"] if command == "compare" else []
    done = attlog(command, LOG, *more, "--window", "5:1", "-o", tmp_path / "out")
    assert done.code == 2
    assert done.err.startswith("attlog: --window '5:1': use all")
    assert not (tmp_path / "out").exists()
