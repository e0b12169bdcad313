"""Files appear whole or not at all, with the rights of any other new file."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog.core.errors import LogUnreadable, OutputError, UsageError
from attlog.core.files import (
    MAX_NAME_BYTES,
    MAX_TEMPORARY_LETTERS,
    STAGING_NAME,
    csv_cell,
    file_name,
    file_names,
    is_private_folder,
    open_atomic,
    parse_toml,
    private_folder,
    read_settings_text,
    remove_unfinished,
    staging_folder,
    write_all_atomic,
    write_atomic,
)
from attlog.core.own_files import FileKind
from attlog.flight.parameters import read_parameter_file as read_parameters

# A kind that every file is of.
ANY = FileKind("a file", check=lambda _: True)
POSIX = pytest.mark.skipif(os.name != "posix", reason="rights as POSIX knows them")


def test_an_old_file_survives_a_failure_and_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OutputError, match="No space left"):
        write_atomic(path, "new", ANY)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_written_bit_by_bit_appears_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file"
    with open_atomic(path, ANY) as file:
        file.write(b"first ")
        assert not path.exists()
        file.write(b"second")
    assert path.read_bytes() == b"first second"

    def fails_halfway() -> None:
        with open_atomic(path, ANY) as file:
            file.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails_halfway()
    assert path.read_bytes() == b"first second"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_files_that_belong_together_are_all_new_or_all_old(tmp_path: Path) -> None:
    one, other = tmp_path / "a.html", tmp_path / "a.json"
    write_all_atomic({one: "old", other: b"old"})
    (tmp_path / "folder").mkdir()
    for missing in (tmp_path / "folder", one / "below"):
        with pytest.raises(OutputError):
            write_all_atomic({one: "new", other: "new", missing: "new"}, ANY)
        assert (one.read_text(), other.read_text()) == ("old", "old")
    write_all_atomic({one: "new", other: "new"}, ANY)
    assert (one.read_text(), other.read_text()) == ("new", "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.html", "a.json", "folder"]


def test_files_of_a_stage_move_together_and_errors_name_their_places(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("old")

    def refused() -> None:
        with staging_folder(tmp_path) as stage:
            write_atomic(stage / "a.json", "new")
            (stage / "b").mkdir()
            write_atomic(stage / "b", "new")

    def interrupted() -> None:
        with staging_folder(tmp_path) as stage:
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
    with pytest.raises(OutputError, match="the pipe has no reader"):
        write_atomic(tmp_path / "pipe", "hello")
    with pytest.raises(OutputError, match="is a device, a pipe or a socket"), staging_folder(tmp_path) as stage:
        (stage / "pipe").write_text("hello")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@pytest.mark.skipif(not os.path.islink("/dev/stdout"), reason="standard output has no name here")
def test_the_name_of_standard_output_means_what_stands_behind_it(tmp_path: Path) -> None:
    run = (
        "import sys; from pathlib import Path; from attlog.core.files import write_atomic;"
        "print('first', flush=True);"
        "write_atomic(Path('/dev/stdout'), 'second'); write_atomic(Path('/dev/fd/1'), ' third')"
    )
    with (tmp_path / "all").open("w") as out:
        subprocess.run([sys.executable, "-c", run], stdout=out, check=True)
    assert (tmp_path / "all").read_text() == "first\nsecond third"
    assert os.path.islink("/dev/stdout")


def test_the_json_moves_last_of_what_belongs_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever finds it finds its page as well."""
    moved: list[str] = []
    replace = Path.replace

    def noted(self: Path, target: Path) -> Path:
        moved.append(self.name)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", noted)
    with staging_folder(tmp_path) as stage:
        for name in ("a.json", "a.html", "a.param"):
            (stage / name).write_text(name)
    assert moved == ["a.html", "a.param", "a.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(moved)


# What killed processes left of files is removed, and nothing else.

HEX = "0123456789ab"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in (
        f".a.html.{HEX}",
        f".{'b' * MAX_TEMPORARY_LETTERS}.{HEX}",
        f".c.html.{HEX}0",
        ".hidden",
        f"a.html.{HEX}",
        ".a.html.0123",
    ):
        (tmp_path / name).write_text("x")
    (tmp_path / f".{STAGING_NAME}.{HEX}" / "inner").mkdir(parents=True)
    (tmp_path / f".other.{HEX}").mkdir()
    return tmp_path


def left(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_without_names_the_unfinished_of_any_file_goes(folder: Path) -> None:
    before = left(folder)
    remove_unfinished(folder)
    assert before - left(folder) == {
        f".a.html.{HEX}",
        f".{'b' * MAX_TEMPORARY_LETTERS}.{HEX}",
        f".{STAGING_NAME}.{HEX}",
    }


def test_a_link_to_a_folder_is_not_followed(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").write_text("x")
    (tmp_path / f".{STAGING_NAME}.{HEX}").symlink_to(kept)
    remove_unfinished(tmp_path)
    assert (kept / "file").exists()


# Names that strangers chose become names of files: inside the folder, on any system, each once.

HOSTILE = (
    "../../evil",
    "/etc/passwd",
    "..",
    ".",
    "",
    " ",
    "C:\\evil",
    "\\\\host\\share",
    "a\x00b",
    "a\nb",
    "\x1b[31mX",
    "con",
    "NUL.txt",
    "com1",
    "Lpt9.tar.gz",
    "aux ",
    ".bashrc",
    "-rf",
    "name.",
    "name ",
    "a\u202egpj.exe",
    "\udcff",
    "x" * 300,
    "é" * 200,
    "\U0001f681" * 100,
    "a/" * 200,
    "prn.",
    "conin$",
)


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_name_makes_one_file_in_the_folder_and_nowhere_else(text: str, tmp_path: Path) -> None:
    place = tmp_path / "out" / "in"
    place.mkdir(parents=True)
    name = file_name(text)
    (place / f"{name}.csv").write_text("x")
    assert [p.name for p in place.iterdir()] == [f"{name}.csv"]
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == [f"{name}.csv"]


@given(st.text(max_size=300))
@settings(max_examples=300, deadline=None)
def test_any_name_is_one_plain_part_of_a_path_on_every_system(text: str) -> None:
    name = file_name(text)
    assert 0 < len(name.encode("utf-8")) <= MAX_NAME_BYTES
    assert name.isprintable()
    assert name[0] not in " .-"
    assert name[-1] not in " ."
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        assert path.parts == (name,)
        assert not path.is_absolute()
    assert not PureWindowsPath(name).is_reserved()
    assert not set(name) & set('<>:"/\\|?*')
    assert file_name(name) == name


def test_what_collides_is_numbered_in_the_order_given() -> None:
    assert file_names(["foo_0", "foo_1", "foo_1"]) == ["foo_0", "foo_1", "foo_1-2"]
    assert file_names(["A", "a", "a-2", "ä", "a\u0308"]) == ["A", "a-2", "a-2-2", "ä", "a\u0308-2"]
    assert file_names(["a/b", "a:b"]) == ["a_b", "a_b-2"]
    assert file_names(["x"], taken=["X"]) == ["x-2"]


@given(st.lists(st.text("aA/-2.\u0308", max_size=4), max_size=30))
@settings(max_examples=200, deadline=None)
def test_no_two_names_are_one_on_a_file_system_without_case(texts: list[str]) -> None:
    names = file_names(texts)
    assert len({name.casefold() for name in names}) == len(texts)
    assert names == file_names(texts)


# What is run again later lies where nobody else can put anything.


@pytest.fixture
def homes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache and a temporary folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def test_the_users_cache_is_taken(homes: Path) -> None:
    found = private_folder("templates", "1")
    assert found == homes / "cache" / "attlog" / "templates" / "1"
    assert found.is_dir()


def test_a_folder_below_one_that_others_can_write_to_is_refused_unless_its_sticky_bit_is_set(tmp_path: Path) -> None:
    """Whoever may write there may put a folder of his own in the place of the user's."""
    shared = tmp_path / "shared"
    folder = shared / "cache" / "attlog" / "kernels" / "1"
    assert is_private_folder(folder)
    for mode, found in [(0o777, False), (0o1777, True), (0o757, False), (0o755, True)]:
        shared.chmod(mode)
        assert is_private_folder(folder) == found, oct(mode)
    shared.chmod(0o777)
    (tmp_path / "link").symlink_to(shared)
    assert not is_private_folder(tmp_path / "link" / "cache" / "attlog" / "kernels" / "1")


def test_none_is_found_where_nothing_can_be_written(homes: Path) -> None:
    (homes / "cache").write_text("no folder")
    (homes / f"attlog-templates-{os.getuid()}").write_text("no folder")
    assert private_folder("templates", "1") is None


# Files that people write: what cannot be read and what is no TOML is told with the file's name.


def test_a_file_that_is_not_there_and_a_folder_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(LogUnreadable, match=r"cannot be read|no such file"):
            read_settings_text(path)


def test_what_is_no_toml_is_told_with_its_line() -> None:
    with pytest.raises(UsageError, match=r"c\.toml: not valid TOML: .*line 2"):
        parse_toml("a = 1\nb = = 2\n", Path("c.toml"))


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "pipe"])
def test_what_may_never_end_is_refused_at_once(device: str, tmp_path: Path) -> None:
    path = Path(device)
    if device == "pipe":
        path = tmp_path / "pipe"
        os.mkfifo(path)
    for read in (read_settings_text, read_parameters):
        with pytest.raises(UsageError, match="no file but a device or a pipe"):
            read(path)


def test_a_file_beyond_what_people_write_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.toml"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    for read in (read_settings_text, read_parameters):
        with pytest.raises(UsageError, match="larger than 8 MB"):
            read(path)


# CSV cells: a spreadsheet shows them and runs none.


@pytest.mark.parametrize(
    "text",
    [
        "=1+1",
        "+1+1",
        "-1+1",
        "@SUM(A1)",
        " =1",
        '"=1',
        '=HYPERLINK("http://x")',
        "＝1+1",
        "=cmd|' /C calc'!A0",
        "-2+3+cmd|' /C calc'!A0",
        "--1",
        "+-1",
        "-1 -1",
        "-1_0",
        "-٣",
    ],
)
def test_what_a_spreadsheet_would_run_begins_with_an_apostrophe(text: str) -> None:
    assert csv_cell(text) == f"'{text}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("\t=1", "'\t'=1"),
        ("\n=1", "'\n'=1"),
        ("\r=1", "'\n'=1"),
        ("a\r=cmd|x", "a\n'=cmd|x"),
        ("a\r\n@x", "a\n'@x"),
        ("a;=1", "a;'=1"),
        ('a;"=1', "a;'\"=1"),
        ("a; -5", "a; -5"),
        ("a;-5+cmd|x", "a;'-5+cmd|x"),
        ("a;;\t+x", "a;;\t'+x"),
        ("two\nlines; three", "two\nlines; three"),
        ("\ufeff=1", "\ufffd=1"),
    ],
)
def test_so_does_what_is_a_cell_with_another_separator(text: str, expected: str) -> None:
    assert csv_cell(text) == expected


def test_nothing_in_a_cell_steers_a_terminal() -> None:
    assert csv_cell("a\x1b]0;x\x07\x9b31m\u202e\udcffb") == "a\ufffd]0;x\ufffd\ufffd31m\ufffd\ufffdb"
