"""Where logs come from: files, members of archives, URLs; copied whole to a temporary place or told why not."""

from __future__ import annotations

import functools
import gzip
import hashlib
import io
import os
import pickle
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from attlog.batch import archive, remote
from attlog.batch.sources import Source, find, sources
from attlog.cli.arguments import command_line
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from tests.batch.servers import Web, serving
from tests.conftest import SAMPLES

LOG = (SAMPLES / "copter_yaw_turns.bin").read_bytes()


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The temporary folder of the test, to see what is left there."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@functools.cache
def packed() -> bytes:
    """An archive as people make them: folders, a packed log, what a Mac adds, notes, names that want to break out."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("flights/a.bin", LOG)
        file.writestr("flights/b.bin.gz", gzip.compress(LOG))
        file.writestr("flights/notes.txt", "windy")
        file.writestr("__MACOSX/flights/._a.ulg", b"\0")
        file.writestr("../../escaped.bin", LOG)
        file.writestr("/etc/absolute.bin", LOG)
    return content.getvalue()


@pytest.fixture
def zipped(tmp_path: Path) -> Path:
    path = tmp_path / "day.zip"
    path.write_bytes(packed())
    return path


@pytest.fixture(scope="module")
def server() -> Iterator[Web]:
    with serving() as web:
        yield web


@pytest.fixture
def web(server: Web, monkeypatch: pytest.MonkeyPatch) -> Web:
    monkeypatch.setattr(remote, "WAITS_S", (0.0, 0.0))
    server.files = {"/logs/a.bin": LOG, "/logs/sub/b.ulg": LOG[:1000], "/logs/readme.txt": b"no log"}
    server.ranges, server.failures = True, 0
    server.asked.clear()
    return server


def names(found: list[Source], root: Path | str) -> list[str]:
    return [source.name.removeprefix(f"{root}/") for source in found]


def content(source: Source) -> bytes:
    """What a source gives, with what it says of itself checked against the bytes."""
    with source.local() as local:
        data = local.path.read_bytes()
        assert local.sha256 == hashlib.sha256(data).hexdigest()
        assert local.copied is None or local.copied[1] == len(data)
    return data


def failure(source: Source) -> AttlogError:
    with pytest.raises(AttlogError) as caught, source.local():
        pass
    return caught.value


def test_a_file_is_used_where_it_lies_and_stays(temporary: Path) -> None:
    path = SAMPLES / "copter_yaw_turns.bin"
    with Source(str(path)).local() as local:
        assert local.path == path
    assert content(Source(str(path))) == LOG
    assert not list(temporary.iterdir())


def test_an_archive_means_the_logs_in_it(zipped: Path) -> None:
    found, wrong = sources([zipped])
    assert names(found, zipped) == ["../../escaped.bin", "/etc/absolute.bin", "flights/a.bin", "flights/b.bin.gz"]
    assert (wrong, pickle.loads(pickle.dumps(found))) == ([], found)
    assert [s.file_name for s in found] == ["escaped.bin", "absolute.bin", "a.bin", "b.bin.gz"]
    assert {content(s) for s in found[:3]} == {LOG}


def test_a_member_is_named_as_it_is_shown(zipped: Path) -> None:
    for place in (zipped / "flights/a.bin", f"file://{zipped}/flights/a.bin"):
        assert names(sources([place])[0], zipped) == ["flights/a.bin"]
    assert names(sources([zipped / "flights/*"])[0], zipped) == ["flights/a.bin", "flights/b.bin.gz"]
    (wrong,) = sources([zipped / "flights/none.bin"])[1]
    assert "no flight log matches flights/none.bin" in str(wrong)


def test_folders_and_patterns_reach_into_archives(zipped: Path) -> None:
    assert len(sources([zipped.parent])[0]) == 4
    assert len(sources([zipped.parent / "*.zip"])[0]) == 4
    assert find([zipped])[0] == [zipped]  # commands that work on files know no archives


def test_a_member_never_lands_outside_the_temporary_folder_and_leaves_nothing(zipped: Path, temporary: Path) -> None:
    before = set(zipped.parent.rglob("*"))
    for source in sources([zipped])[0]:
        with source.local() as local:
            assert temporary in local.path.resolve().parents
    assert set(zipped.parent.rglob("*")) == before
    assert not list(temporary.iterdir())


def test_a_member_that_unpacks_to_too_much_is_refused_while_it_does(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "UNPACKED_ANYWAY_BYTES", 1 << 20)
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("bomb.ulg", bytes(30 << 20))
    error = failure(sources([path])[0][0])
    assert isinstance(error, LogUnusable)
    assert "unpacks to more than" in str(error)
    assert not list(temporary.iterdir())


def test_an_archive_of_too_many_files_is_refused(zipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_MEMBERS", 5)
    (wrong,) = sources([zipped])[1]
    assert "more than 5 files" in str(wrong)


def locked(path: Path, name: str) -> Path:
    """An archive of one member that is encrypted."""
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(name, LOG)
    raw = bytearray(path.read_bytes())
    raw[6] |= 1  # the flag in the member's own header, and in the directory
    raw[raw.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(raw)
    return path


def test_an_encrypted_member_is_one_failure_with_its_reason(tmp_path: Path) -> None:
    path = locked(tmp_path / "locked.zip", "00000012.BIN")
    error = failure(sources([path])[0][0])
    assert isinstance(error, LogUnusable)
    assert "unpack it with its password first" in str(error)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_members_of_one_name_are_two_logs_and_a_copy_is_none(tmp_path: Path) -> None:
    path, other = tmp_path / "cards.zip", LOG[: len(LOG) // 2]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for member, data in [("d/1.bin", LOG), ("d/1.bin", other), ("d/1 (2).bin", LOG[:5000]), ("d/1.bin", LOG)]:
            file.writestr(member, data)
    found, wrong = sources([path])
    assert wrong == []
    assert {source.member: len(content(source)) for source in found} == {
        "d/1.bin": len(LOG),
        "d/1 (2).bin": 5000,
        "d/1 (3).bin": len(other),
    }
    assert len({source.stamp() for source in found}) == 3
    assert content(sources([path / "d/1 (3).bin"])[0][0]) == other


def test_a_hidden_member_is_a_log_by_its_content_alone(tmp_path: Path) -> None:
    """``._a.ulg`` is what macOS adds; a log may be hidden by a synchronising program."""
    path = tmp_path / "hidden.zip"
    with zipfile.ZipFile(path, "w") as file:
        for member, data in [(".flight.bin", LOG), (".cards/1.bin", LOG), ("._a.ulg", b"\0" * 200)]:
            file.writestr(member, data)
    assert names(sources([path])[0], path) == [".cards/1.bin", ".flight.bin"]


def test_a_damaged_member_is_one_failure_and_the_others_are_read(zipped: Path, temporary: Path) -> None:
    raw = bytearray(zipped.read_bytes())
    raw[20_000] ^= 0xFF
    zipped.write_bytes(raw)
    found = sources([zipped])[0]
    assert len(found) == 4
    bad = next(s for s in found if s.member == "flights/a.bin")
    assert "damaged in its archive" in str(failure(bad))
    assert [content(s) for s in found if s.member.startswith(("..", "/"))] == [LOG, LOG]
    assert not list(temporary.iterdir())


def test_a_cut_archive_is_told(zipped: Path) -> None:
    zipped.write_bytes(zipped.read_bytes()[:-100])
    (wrong,) = sources([zipped])[1]
    assert isinstance(wrong, LogUnusable)
    assert "damaged zip archive" in str(wrong)
    assert names(sources([zipped.parent])[0], zipped.parent) == ["day.zip"]  # in a folder it is one row that fails


def test_control_characters_of_a_member_do_not_reach_the_terminal() -> None:
    assert Source("a.zip", "\x1b[31mred\n.ulg").name == "a.zip/?[31mred?.ulg"
    assert Source("a.zip", "..\\..\\con\x00.ulg").file_name == "con_.ulg"
    assert Source("a.zip", "x" * 400 + ".ulg").file_name.endswith(".ulg")
    assert Source("a.zip", "/").file_name == "log"


def test_a_log_behind_a_url_comes_whole(web: Web, temporary: Path) -> None:
    for way in ("/logs/a.bin", "/moved/logs/a.bin"):
        source = sources([web.url + way])[0][0]
        assert source.file_name == "a.bin"
        assert content(source) == LOG
    assert not list(temporary.iterdir())


def test_a_download_that_breaks_off_is_tried_again_twice(web: Web, temporary: Path) -> None:
    web.failures = 2
    assert content(Source(f"{web.url}/flaky/logs/a.bin")) == LOG
    web.failures = 3
    error = failure(Source(f"{web.url}/flaky/logs/a.bin"))
    assert (type(error), "cannot be downloaded" in str(error)) == (LogUnreadable, True)
    assert not list(temporary.iterdir())


@pytest.mark.parametrize(
    ("path", "words", "requests"),
    [("/none.bin", "no such file", 1), ("/secret", "answers 403", 1), ("/broken", "answers 500", 3)],
)
def test_what_a_server_refuses_is_told(web: Web, path: str, words: str, requests: int) -> None:
    error = failure(Source(web.url + path))
    assert error.exit_code == 66
    assert words in str(error)
    assert len(web.asked) == requests


def test_a_download_that_stalls_or_is_longer_than_any_log_is_given_up(
    web: Web, monkeypatch: pytest.MonkeyPatch, temporary: Path
) -> None:
    monkeypatch.setattr(remote, "STALLED_S", 0.3)
    monkeypatch.setattr(remote, "WAITS_S", ())
    assert "timed out" in str(failure(Source(f"{web.url}/stalled/logs/a.bin")))
    monkeypatch.setattr(remote, "MAX_UNPACKED_BYTES", 1000)
    assert "no log is so long" in str(failure(Source(f"{web.url}/logs/a.bin")))
    assert not list(temporary.iterdir())


def test_nobody_answers(web: Web) -> None:
    error = failure(Source("http://127.0.0.1:9/a.ulg"))
    assert error.exit_code == 66
    assert "cannot be downloaded" in str(error)
    with pytest.raises(LogUnreadable, match="cannot be downloaded"):
        Source("http://127.0.0.1:9/a.ulg").stamp()
    for place in ("http://127.0.0.1:9/logs/", "http://127.0.0.1:9/logs/**/*.ulg"):
        logs, (told,) = sources([place])
        assert logs == []
        assert "cannot be downloaded" in str(told)


def test_a_web_folder_and_a_pattern_mean_the_logs_listed(web: Web) -> None:
    for place in ("/logs/", "/logs/**"):
        found, wrong = sources([web.url + place])
        assert (names(found, web.url), wrong) == (["logs/a.bin", "logs/sub/b.ulg"], [])
    assert names(sources([f"{web.url}/logs/*.bin"])[0], web.url) == ["logs/a.bin"]
    (wrong,) = sources([f"{web.url}/logs/*.tlog"])[1]
    assert "nothing there" in str(wrong)


@pytest.mark.parametrize("ranges", [True, False])
def test_an_archive_behind_a_url_means_the_logs_in_it(web: Web, zipped: Path, ranges: bool, temporary: Path) -> None:
    web.ranges = ranges
    web.files["/day.zip"] = zipped.read_bytes()
    found, wrong = sources([f"{web.url}/day.zip"])
    assert len(found) == 4
    assert wrong == []
    assert content(found[2]) == LOG
    assert found[2].name == f"{web.url}/day.zip/flights/a.bin"
    assert not list(temporary.iterdir())


def test_passwords_and_signatures_are_not_shown() -> None:
    source = Source("https://me:pw@host/a.ulg?X-Amz-Signature=abc&X-Amz-Date=1&v=2")
    assert source.name == "https://host/a.ulg?v=2"
    assert source.file_name == "a.ulg_v=2"


@pytest.mark.parametrize(
    ("word", "shown"),
    [
        ("https://me:pw@host/a.ulg?sig=abc&sv=2", "https://host/a.ulg?sv=2"),
        ("--truth=https://me:pw@host/t.csv", "--truth=https://host/t.csv"),
        ("https://h/a?api_key=1&AWSAccessKeyId=2&Signature=3&v=4#pw", "https://h/a?v=4"),
        ("https://h/a?PASSWD=1&auth=2&client_secret=3", "https://h/a"),
        ("https://h/a?jwt=1&code=2&Policy=3&Key-Pair-Id=4&v=5", "https://h/a?v=5"),
        ("zip://a.ulg::https://me:pw@host/x.zip", "zip://a.ulg::https://host/x.zip"),
        ("http://me:pw@[::1", "http://…"),
        ("http://me:pw@[::1]:80/a.ulg", "http://[::1]:80/a.ulg"),
        ("abfs://container@account/a.ulg", "abfs://container@account/a.ulg"),
        ("webdav://me:pw@host/a.ulg", "webdav://host/a.ulg"),
        ("flights/a.ulg", "flights/a.ulg"),
    ],
)
def test_a_command_that_is_kept_shows_no_secret_of_a_url(
    monkeypatch: pytest.MonkeyPatch, word: str, shown: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["attlog", "analyze", "--key", "k.pem", word, "-q"])
    assert command_line() == f"attlog analyze {shown} -q"


@pytest.mark.parametrize(
    "place", ["http://[::1", "https://me:pw@[::1/a.zip", "HTTP://[::1/a.ulg", "zip://a::http://[::1"]
)
def test_what_is_no_url_is_one_sentence_without_its_text(place: str) -> None:
    found, wrong = sources([place])
    assert found == []
    assert "not a URL that can be read" in str(wrong[0])
    assert "pw" not in str(wrong[0])


@pytest.fixture
def memory() -> Iterator[Any]:
    import fsspec

    files = fsspec.filesystem("memory")
    files.store.clear()
    for name in ("/bucket/a.ulg", "/bucket/x/b.bin.gz", "/bucket/x/c.txt"):
        files.pipe(name, LOG)
    yield files
    files.store.clear()


def test_any_file_system_lists_folders_and_patterns(memory: Any) -> None:
    for place, found in {
        "memory://bucket": ["a.ulg", "x/b.bin.gz"],
        "memory://bucket/*.ulg": ["a.ulg"],
        "memory://bucket/**": ["a.ulg", "x/b.bin.gz"],
        "memory://bucket/x/c.txt": ["x/c.txt"],  # named itself: taken as it is
    }.items():
        logs, wrong = sources([place])
        assert [s.name.partition("/bucket/")[2] for s in logs] == found, place
        assert wrong == []
    assert content(sources(["memory://bucket/a.ulg"])[0][0]) == LOG
    assert "no such file" in str(failure(Source("memory://bucket/none.ulg")))


def test_content_cut_short_is_a_failure(memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = memory.info("/bucket/a.ulg") | {"size": len(LOG) + 1}
    monkeypatch.setattr(type(memory), "info", lambda self, path, **_: whole)
    monkeypatch.setattr(remote, "WAITS_S", ())
    assert "cut short" in str(failure(Source("memory://bucket/a.ulg")))


@pytest.mark.parametrize("missing", ["fsspec", "aiohttp"])
def test_what_to_install_is_said(web: Web, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    (wrong,) = sources([f"{web.url}/logs/"])[1]
    assert isinstance(wrong, UsageError)
    assert 'pip install "fsspec[http,s3,gcs]"' in str(wrong), "zsh takes brackets without quotes for a pattern"
    monkeypatch.undo()
    assert "Protocol not known" in str(sources(["nonsense://host/a"])[1][0])


def test_a_stamp_changes_with_the_content(tmp_path: Path, zipped: Path, web: Web, memory: Any) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(LOG)
    places = [Source(str(path)), Source(str(zipped), "flights/a.bin"), Source(f"{web.url}/logs/a.bin")]
    places.append(Source("memory://bucket/a.ulg"))
    before = [s.stamp() for s in places]
    assert all(before)
    assert before == [s.stamp() for s in places]
    path.write_bytes(LOG[:-1])
    web.files["/logs/a.bin"] = LOG[:-1]
    memory.pipe("/bucket/a.ulg", LOG[:-1])
    with zipfile.ZipFile(zipped, "w") as file:
        file.writestr("flights/a.bin", LOG[:-1])
    assert not set(before) & {s.stamp() for s in places}


# Which logs a name means: by content in folders and patterns, as it stands otherwise.


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


def names_found(found: list[Path], folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in found]


def test_a_folder_means_the_logs_in_it_known_by_content(folder: Path) -> None:
    logs, wrong = find([folder])
    assert names_found(logs, folder) == ["broken.ulg", "one/a.bin", "two/b"]
    assert wrong == []


def test_a_pattern_means_the_logs_it_matches(folder: Path) -> None:
    log = folder / "flight[1].ulg"  # looks like a pattern
    log.write_bytes(b"x")
    assert find([log, log]) == ([log], [])
    log.unlink()
    assert find([folder / "one/a.bin", folder / "one"])[0] == [folder / "one/a.bin"]
    assert names_found(find([folder / "*.*"])[0], folder) == ["broken.ulg"]
    assert names_found(find([folder / "**/*"])[0], folder) == ["broken.ulg", "one/a.bin", "two/b"]
    assert names_found(find([folder / "o*"])[0], folder) == ["one/a.bin"]


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
    assert names_found(logs, folder) == ["broken.ulg", "one/a.bin"]
    assert [str(error) for error in wrong] == [f"{closed}: cannot be read (Permission denied)"]
    for name in (closed, closed / "*.bin", closed / "**/*.ulg"):
        logs, (error,) = find([name])
        assert logs == []
        assert str(error) == f"{closed}: cannot be read (Permission denied)"


@pytest.mark.parametrize("url", ["https://example.org/a.ulg", "s3://bucket/a.ulg?X-Amz-Signature=secret", "ftp://h/*"])
def test_a_url_where_files_are_read_is_told_whole_and_with_what_reads_it(url: str) -> None:
    """A path has lost a slash of it: "https:/example.org/a.ulg: no such file"."""
    found, (wrong,) = find([Path(url)])
    assert found == []
    assert isinstance(wrong, UsageError)
    assert str(wrong).startswith(url.partition("?")[0] + ": is a URL")
    assert "analyze and batch read URLs" in str(wrong)
    assert "secret" not in str(wrong)
