"""Which logs a name means: by content in folders and patterns, as it stands otherwise."""

from __future__ import annotations

import gzip
import os
import shutil
from pathlib import Path

import pytest

from attlog.base.errors import LogUnreadable, UsageError
from attlog.fleet.sources.find import find, sources
from attlog.formats import recognise
from tests.conftest import SAMPLES


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A card: two logs, one of them packed under a strange name, a broken one, notes, a hidden folder."""
    for name in ("one/a.bin", "two/b", ".trash/c.bin"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
    shutil.copy(SAMPLES / "copter_yaw_turns.bin", tmp_path / "one/a.bin")
    shutil.copy(SAMPLES / "copter_yaw_turns.bin", tmp_path / ".trash/c.bin")
    (tmp_path / "two/b").write_bytes(gzip.compress((SAMPLES / "px4_hover.ulg").read_bytes()[:200_000]))
    (tmp_path / "broken.ulg").write_bytes(b"")
    (tmp_path / "firmware.bin").write_bytes(b"\x7fELF" + bytes(4000))
    (tmp_path / "notes.txt").write_text("windy")
    return tmp_path


def names(found: list[Path], folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in found]


def test_a_folder_means_the_logs_in_it_known_by_content(folder: Path) -> None:
    logs, wrong = find([folder])
    assert names(logs, folder) == ["broken.ulg", "one/a.bin", "two/b"]
    assert wrong == []


def test_a_pattern_means_the_logs_it_matches(folder: Path) -> None:
    assert names(find([folder / "*.*"])[0], folder) == ["broken.ulg"]
    assert names(find([folder / "**/*"])[0], folder) == ["broken.ulg", "one/a.bin", "two/b"]
    assert names(find([folder / "o*"])[0], folder) == ["one/a.bin"]


def test_a_file_whose_name_looks_like_a_pattern_is_itself(tmp_path: Path) -> None:
    log = tmp_path / "flight[1].ulg"
    log.write_bytes(b"x")
    assert find([log]) == ([log], [])


def test_a_log_that_is_named_twice_comes_once(folder: Path) -> None:
    log = folder / "one/a.bin"
    assert find([log, folder / "one", log])[0] == [log]


def test_what_finds_nothing_is_told_and_loses_no_other(folder: Path) -> None:
    (folder / "empty").mkdir()
    missing = folder / "none.ulg"
    logs, wrong = find([folder / "empty", folder / "x*.ulg", folder / "*.txt", Path("-"), missing])
    assert logs == [missing]  # reading it says that it is not there
    assert [type(e) for e in wrong] == [LogUnreadable, LogUnreadable, LogUnreadable, UsageError]
    words = ("without a flight log", "no file matches", "none of the 1 files", "memory-mapped")
    assert all(word in str(e) for word, e in zip(words, wrong, strict=True))


@pytest.fixture
def closed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in the card that nobody may list; what an administrator runs could, hence not by its mode."""
    list_, place = os.scandir, folder / "two"

    def refuse(path: str | os.PathLike[str] = ".") -> object:
        if str(path).rstrip("/") == str(place):
            raise PermissionError(13, "Permission denied", str(place))
        return list_(path)

    monkeypatch.setattr(os, "scandir", refuse)
    return place


def test_a_folder_that_cannot_be_read_is_told_and_hides_no_other(folder: Path, closed: Path) -> None:
    logs, wrong = find([folder])
    assert names(logs, folder) == ["broken.ulg", "one/a.bin"]
    assert [str(error) for error in wrong] == [f"{closed}: cannot be read (Permission denied)"]
    for name in (closed, closed / "*.bin", closed / "**/*.ulg"):
        logs, (error,) = find([name])
        assert logs == []
        assert str(error) == f"{closed}: cannot be read (Permission denied)"


def test_a_name_that_no_system_takes_is_left_to_reading(tmp_path: Path) -> None:
    logs, wrong = sources([tmp_path / ("x" * 300)])
    assert (len(logs), wrong) == (1, [])
    with pytest.raises(LogUnreadable, match="File name too long"):
        recognise(logs[0].place)


def test_a_file_that_cannot_be_read_counts_where_logs_have_such_names(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, count: int) -> bytes:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("attlog.formats.compression.first_bytes", refuse)
    assert names(find([folder])[0], folder) == ["broken.ulg", "firmware.bin", "one/a.bin"]


def test_a_link_to_nothing_among_logs_is_told_where_it_has_the_name_of_one(folder: Path) -> None:
    whole = find([str(folder)])
    (folder / "more.txt").symlink_to(folder / "gone.txt")
    (folder / "lost.ulg").symlink_to(folder / "moved.ulg")
    logs, wrong = find([str(folder)])
    assert logs == whole[0]
    assert [str(error) for error in wrong] == [f"{folder / 'lost.ulg'}: is a link to nothing"]


@pytest.mark.parametrize("url", ["https://example.org/a.ulg", "s3://bucket/a.ulg?X-Amz-Signature=secret", "ftp://h/*"])
def test_a_url_where_files_are_read_is_told_whole_and_with_what_reads_it(url: str) -> None:
    """A path has lost a slash of it: "https:/example.org/a.ulg: no such file"."""
    found, (wrong,) = find([Path(url)])
    assert found == []
    assert isinstance(wrong, UsageError)
    assert str(wrong).startswith(url.partition("?")[0] + ": is a URL")
    assert "analyze and batch read URLs" in str(wrong)
    assert "secret" not in str(wrong)
