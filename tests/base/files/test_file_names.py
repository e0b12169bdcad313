"""Names that strangers chose become names of files: inside the folder, on any system, each once."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog.base.files.file_names import LONGEST, file_name, file_names

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
    assert 0 < len(name.encode("utf-8")) <= LONGEST
    assert name.isprintable()
    assert name[0] not in " .-"
    assert name[-1] not in " ."
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        assert path.parts == (name,)
        assert not path.is_absolute()
    assert not PureWindowsPath(name).is_reserved()
    assert not set(name) & set('<>:"/\\|?*')
    assert file_name(name) == name


@pytest.mark.parametrize(
    "text", ["vehicle_imu", "flight (1).ulg.gz", "Flug über Köln.bin", "飛行.ulg", "a@b=c,d+[1]", "x..y"]
)
def test_names_without_fault_stay_as_they_are(text: str) -> None:
    assert file_name(text) == text


def test_long_names_that_begin_alike_stay_apart_and_keep_their_ending() -> None:
    one, other = file_name("x" * 300 + "a.ulg.gz"), file_name("x" * 300 + "b.ulg.gz")
    assert one != other
    assert one.endswith(".ulg.gz")
    assert len(os.fsencode(one)) <= LONGEST


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


def test_many_equal_names_take_no_quadratic_time() -> None:
    assert file_names(["log.bin"] * 100_000)[-1] == "log.bin-100000"
