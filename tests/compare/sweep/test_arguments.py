"""Logs, filter and axes are recognised without an option."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import UsageError
from attlog.compare.sweep.arguments import search_request


def test_the_last_word_that_is_no_axis_is_the_filter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a=1.bin").touch()
    Path("mine.py").touch()
    found = search_request(["a=1.bin", "b.ulg", "mahony@xu-2:ki=0.1", "kp=1,2"], "x")
    assert (found.logs, found.filter, found.axes) == (
        [Path("a=1.bin"), Path("b.ulg")],
        "mahony@xu-2:ki=0.1",
        ["kp=1,2"],
    )
    assert search_request(["a=1.bin", "mine.py", "kp=1"], "x").filter == "mine.py"


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    log = tmp_path / "x.bin"
    log.touch()
    for words, says in (([], "a log and a filter are"), (["kp=1"], "are missing"), (["mahony", "kp=1"], "is missing"),
                        ([str(tmp_path), str(log), "kp=1"], "after the logs")):  # fmt: skip
        with pytest.raises(UsageError, match=says):
            search_request(words, "attlog sweep x.bin mahony kp=1")
