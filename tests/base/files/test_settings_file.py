"""Files that people write: what cannot be read and what is no TOML is told with the file's name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from attlog.analysis.config import Config
from attlog.base.errors import LogUnreadable, UsageError
from attlog.base.files.settings_file import text_of, toml_of
from attlog.flight.parameters.file import read_file as read_parameters


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_bytes(b"\xef\xbb\xbfa = 1\n")
    assert toml_of(text_of(file), file) == {"a": 1}


def test_a_file_that_is_not_there_and_a_folder_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(LogUnreadable, match="cannot be read"):
            text_of(path)


def test_what_is_no_text_is_told_with_its_byte(tmp_path: Path) -> None:
    file = tmp_path / "b.toml"
    file.write_bytes(b"a = 1\n\xff\xfe")
    with pytest.raises(UsageError, match=r"b\.toml: no UTF-8 text at byte 6"):
        text_of(file)


def test_what_is_no_toml_is_told_with_its_line() -> None:
    with pytest.raises(UsageError, match=r"c\.toml: not valid TOML: .*line 2"):
        toml_of("a = 1\nb = = 2\n", Path("c.toml"))


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "pipe"])
def test_what_may_never_end_is_refused_at_once(device: str, tmp_path: Path) -> None:
    path = Path(device)
    if device == "pipe":
        path = tmp_path / "pipe"
        os.mkfifo(path)
    for read in (text_of, read_parameters):
        with pytest.raises(UsageError, match="no file but a device or a pipe"):
            read(path)


def test_a_file_beyond_what_people_write_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.toml"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    for read in (text_of, read_parameters):
        with pytest.raises(UsageError, match="larger than 8 MB"):
            read(path)


@pytest.mark.parametrize("text", ["a = " + "[" * 50_000, "a = " + "9" * 6000, "a = 0000-01-01"])
def test_toml_that_breaks_its_reader_is_no_toml(text: str) -> None:
    with pytest.raises(UsageError, match=r"d\.toml: not valid TOML"):
        toml_of(text, Path("d.toml"))


@pytest.mark.parametrize("text", ["declination = nan", "declination = -181", "score_from = inf", "input_delay = nan"])
def test_settings_outside_what_they_can_be_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "e.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=text.split()[0]):
        Config.load(path)


def test_a_parameter_file_is_held_to_the_limits_of_parameters(tmp_path: Path) -> None:
    path = tmp_path / "f.param"
    path.write_text("EKF2_MAG_DECL,1e39\nANYTHING,1e30\n")
    with pytest.raises(UsageError, match=r"line 1: EKF2_MAG_DECL is 1e.39; the declination lies within"):
        read_parameters(path)
