"""Files that arrive: each once when it has settled, downloads in progress never."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest

from attlog.base.errors import LogUnreadable, UsageError
from attlog.fleet.schedulers.arrivals import Arrivals, on_its_way

SETTLE = 5.0


def look(arrivals: Arrivals, now: float) -> list[str]:
    return [path.name for path, _ in arrivals.settled(now)]


@pytest.fixture
def arrivals(tmp_path: Path) -> Arrivals:
    (tmp_path / "out").mkdir()
    return Arrivals([str(tmp_path)], SETTLE, without=tmp_path / "out")


def test_a_file_is_given_once_when_it_has_settled(arrivals: Arrivals, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    assert [look(arrivals, now) for now in (0, 4.9, 5, 6, 100)] == [[], [], ["a"], [], []]
    assert arrivals.pending == 0


def test_a_file_that_grows_is_left_alone_until_it_stops(arrivals: Arrivals, tmp_path: Path) -> None:
    log = tmp_path / "a"
    for now in range(20):
        with log.open("ab") as file:
            file.write(b"more")
        assert look(arrivals, now) == []
    assert arrivals.pending == 1
    assert [look(arrivals, now) for now in (21, 23.9, 24)] == [[], [], ["a"]]


def test_a_file_whose_size_is_set_at_once_settles_by_its_time(arrivals: Arrivals, tmp_path: Path) -> None:
    """As copies to a network drive are made: the whole size first, then the content."""
    log = tmp_path / "a"
    log.write_bytes(bytes(1000))
    for now in range(10):
        os.utime(log, ns=(now, now))
        assert look(arrivals, now) == []
    assert look(arrivals, 14) == ["a"]


def test_a_changed_file_is_given_again(arrivals: Arrivals, tmp_path: Path) -> None:
    log = tmp_path / "a"
    log.write_bytes(b"1")
    look(arrivals, 0)
    assert look(arrivals, 5) == ["a"]
    log.write_bytes(b"22")
    assert [look(arrivals, now) for now in (6, 11)] == [[], ["a"]]
    before = log.stat()
    (tmp_path / ".new").write_bytes(b"33")
    os.utime(tmp_path / ".new", ns=(before.st_atime_ns, before.st_mtime_ns))
    (tmp_path / ".new").replace(log)  # same size, same time, another file
    assert [look(arrivals, now) for now in (12, 17)] == [[], ["a"]]


def test_what_is_asked_for_again_comes_when_it_has_settled(arrivals: Arrivals, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    look(arrivals, 0)
    assert look(arrivals, 5) == ["a"]
    arrivals.again(tmp_path / "a")
    assert [look(arrivals, now) for now in (6, 11)] == [[], ["a"]]


@pytest.mark.parametrize(
    "name",
    ["a.ulg.part", "Unconfirmed 1.crdownload", "a.tmp", "a.ulg.filepart", ".a.ulg.x7Gh2Q", "a.ulg~", "A.PARTIAL"],
)
def test_names_of_downloads_in_progress_are_left_alone(arrivals: Arrivals, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"1")
    assert [look(arrivals, now) for now in (0, 5, 500)] == [[], [], []]
    assert on_its_way(name)
    (tmp_path / name).rename(tmp_path / "whole.ulg")
    assert [look(arrivals, now) for now in (501, 506)] == [[], ["whole.ulg"]]


def test_a_place_kept_beside_a_part_is_left_alone(arrivals: Arrivals, tmp_path: Path) -> None:
    for name in ("a.ulg", "a.ulg.part"):
        (tmp_path / name).write_bytes(b"1")
    assert [look(arrivals, now) for now in (0, 50)] == [[], []]
    (tmp_path / "a.ulg.part").replace(tmp_path / "a.ulg")
    assert [look(arrivals, now) for now in (51, 56)] == [[], ["a.ulg"]]


def test_an_empty_file_is_given_after_a_minute(arrivals: Arrivals, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"")
    assert [look(arrivals, now) for now in (0, 50, 60)] == [[], [], ["a"]]


def test_a_file_that_vanishes_and_comes_back_settles_anew(arrivals: Arrivals, tmp_path: Path) -> None:
    log = tmp_path / "a"
    log.write_bytes(b"1")
    assert look(arrivals, 0) == []
    shutil.move(log, tmp_path / ".away")
    assert look(arrivals, 4) == []
    shutil.move(tmp_path / ".away", log)
    assert [look(arrivals, now) for now in (6, 11)] == [[], ["a"]]


def test_the_output_and_hidden_folders_and_circles_are_not_looked_into(arrivals: Arrivals, tmp_path: Path) -> None:
    for place in ("out/a", ".hidden/b", "deep/er/c"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes(b"1")
    (tmp_path / "deep" / "circle").symlink_to(tmp_path)
    look(arrivals, 0)
    assert look(arrivals, 5) == ["c"]


def test_a_pattern_is_looked_at_again_and_again(tmp_path: Path) -> None:
    arrivals = Arrivals([str(tmp_path / "*" / "*.ulg")], SETTLE)
    assert look(arrivals, 0) == []
    (tmp_path / "day").mkdir()
    for name in ("a.ulg", "a.txt"):
        (tmp_path / "day" / name).write_bytes(b"1")
    look(arrivals, 1)
    assert look(arrivals, 6) == ["a.ulg"]


def test_a_drive_that_goes_away_is_waited_for(tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    arrivals = Arrivals([str(drive)], SETTLE)
    (drive / "a").write_bytes(b"1")
    look(arrivals, 0)
    assert look(arrivals, 5) == ["a"]
    drive.rename(tmp_path / "away")
    assert look(arrivals, 6) == []
    (tmp_path / "away").rename(drive)
    (drive / "b").write_bytes(b"1")
    assert [look(arrivals, now) for now in (7, 12)] == [[], ["b"]]


def test_what_cannot_be_watched_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="of this machine"):
        Arrivals(["https://host/logs/"], SETTLE)
    with pytest.raises(LogUnreadable, match="no such folder"):
        Arrivals([str(tmp_path / "none")], SETTLE)


def test_a_look_at_a_thousand_files_takes_little(arrivals: Arrivals, tmp_path: Path) -> None:
    for k in range(1000):
        (tmp_path / f"{k}.ulg").write_bytes(b"1")
    arrivals.settled(0)
    started = time.process_time()
    arrivals.settled(1)
    assert time.process_time() - started < 0.2  # measured 0.01
