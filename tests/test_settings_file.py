"""Files that people write: what cannot be read and what is no TOML is told with the file's name."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.errors import LogUnreadable, UsageError
from attlog.settings_file import text_of, toml_of


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
