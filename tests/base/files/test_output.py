"""Files appear whole or not at all, with the rights of any other new file."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from attlog.base.errors import OutputError
from attlog.base.files.output import staged, write_atomic, write_together, writing

POSIX = pytest.mark.skipif(os.name != "posix", reason="rights as POSIX knows them")


@POSIX
@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_rights_are_those_of_a_plain_open(umask: int, tmp_path: Path) -> None:
    before = os.umask(umask)
    try:
        (tmp_path / "plain").write_bytes(b"")
        write_atomic(tmp_path / "ours", b"x")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "ours")]
    assert modes[0] == modes[1]


@POSIX
def test_umask_is_never_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread that creates a file in that moment would get the rights 0o666."""

    def forbidden(_: int) -> int:
        raise AssertionError("umask belongs to the whole process")

    monkeypatch.setattr(os, "umask", forbidden)
    write_atomic(tmp_path / "file", "text")
    assert (tmp_path / "file").read_text() == "text"


def test_an_old_file_survives_a_failure_and_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OutputError, match="No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupt_leaves_no_temporary_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomic(tmp_path / "report.html", "new")
    assert list(tmp_path.iterdir()) == []


def test_several_writers_of_one_file_leave_one_whole_file(tmp_path: Path) -> None:
    path, contents = tmp_path / "a", [bytes([k]) * 200_000 for k in range(8)]
    writers = [threading.Thread(target=write_atomic, args=(path, content)) for content in contents]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_written_bit_by_bit_appears_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file"
    with writing(path) as file:
        file.write(b"first ")
        assert not path.exists()
        file.write(b"second")
    assert path.read_bytes() == b"first second"

    def fails_halfway() -> None:
        with writing(path) as file:
            file.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails_halfway()
    assert path.read_bytes() == b"first second"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_files_that_belong_together_are_all_new_or_all_old(tmp_path: Path) -> None:
    one, other = tmp_path / "a.html", tmp_path / "a.json"
    write_together({one: "old", other: b"old"})
    (tmp_path / "folder").mkdir()
    for missing in (tmp_path / "folder", one / "below"):
        with pytest.raises(OutputError):
            write_together({one: "new", other: "new", missing: "new"})
        assert (one.read_text(), other.read_text()) == ("old", "old")
    write_together({one: "new", other: "new"})
    assert (one.read_text(), other.read_text()) == ("new", "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.html", "a.json", "folder"]


def test_files_of_a_stage_move_together_and_errors_name_their_places(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("old")

    def refused() -> None:
        with staged(tmp_path) as stage:
            write_atomic(stage / "a.json", "new")
            (stage / "b").mkdir()
            write_atomic(stage / "b", "new")

    def interrupted() -> None:
        with staged(tmp_path) as stage:
            write_atomic(stage / "a.json", "new")
            raise KeyboardInterrupt

    with pytest.raises(OutputError, match=f"^{tmp_path}/b: cannot be written"):
        refused()
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_text() == "old"
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.json", "old")]


@POSIX
def test_a_terminal_is_written_into_and_not_replaced() -> None:
    ours, theirs = os.openpty()
    path = Path(os.ttyname(theirs))
    write_atomic(path, "hello")
    assert os.read(ours, 5) == b"hello"
    assert stat.S_ISCHR(path.stat().st_mode)
    os.close(ours)
    os.close(theirs)


@POSIX
def test_a_pipe_that_nobody_reads_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="nobody reads this pipe"):
        write_atomic(tmp_path / "pipe", "hello")
    with pytest.raises(OutputError, match="is a device, a pipe or a socket"), staged(tmp_path) as stage:
        (stage / "pipe").write_text("hello")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@POSIX
def test_a_socket_is_refused_and_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # its whole path may be longer than a socket's name can be
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        with pytest.raises(OutputError):
            write_atomic(Path("socket"), "hello")
    assert stat.S_ISSOCK(Path("socket").stat().st_mode)


@pytest.mark.skipif(not os.path.islink("/dev/stdout"), reason="standard output has no name here")
def test_the_name_of_standard_output_means_what_stands_behind_it(tmp_path: Path) -> None:
    run = (
        "import sys; from pathlib import Path; from attlog.base.files.output import write_atomic;"
        "print('first', flush=True);"
        "write_atomic(Path('/dev/stdout'), 'second'); write_atomic(Path('/dev/fd/1'), ' third')"
    )
    with (tmp_path / "all").open("w") as out:
        subprocess.run([sys.executable, "-c", run], stdout=out, check=True)
    assert (tmp_path / "all").read_text() == "first\nsecond third"
    assert os.path.islink("/dev/stdout")


def test_what_utf8_cannot_hold_is_written_as_an_escape(tmp_path: Path) -> None:
    write_atomic(tmp_path / "file", "a\udcffb")
    assert (tmp_path / "file").read_text(encoding="utf-8") == "a\\udcffb"


def test_the_json_moves_last_of_what_belongs_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever finds it finds its page as well."""
    moved: list[str] = []
    replace = Path.replace

    def noted(self: Path, target: Path) -> Path:
        moved.append(self.name)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", noted)
    with staged(tmp_path) as stage:
        for name in ("a.json", "a.html", "a.param"):
            (stage / name).write_text(name)
    assert moved == ["a.html", "a.param", "a.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(moved)
