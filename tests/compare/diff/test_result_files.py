"""Which results of two folders belong together."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import LogUnreadable, LogUnusable, UsageError
from attlog.compare.diff.result_files import found
from tests.compare.made import result


def folder(path: Path, **logs: str) -> Path:
    path.mkdir()
    for name, sha in logs.items():
        result(sha=sha).to_json(path / f"{name}.json")
    return path


def test_files_of_one_name_belong_together_and_renamed_ones_by_their_log(tmp_path: Path) -> None:
    old = folder(tmp_path / "old", a="1", b="2", gone="3")
    new = folder(tmp_path / "new", a="9", c="2", come="4")
    pairs = found(old, new).pairs
    both = {name: [None if r is None else r.log["sha256"] for r in pair] for name, pair in pairs.items()}
    assert both == {"a.json": ["1", "9"], "b.json": ["2", "2"], "gone.json": ["3", None], "come.json": [None, "4"]}


def test_a_broken_file_of_a_folder_is_told_and_the_others_are_compared(tmp_path: Path) -> None:
    old, new = folder(tmp_path / "old", a="1", b="2"), folder(tmp_path / "new", a="1", b="2")
    text = (new / "b.json").read_text()
    (new / "b.json").write_text(text[: len(text) // 2])
    (new / "notes.json").write_text('{"no": "result"}')
    answer = found(old, new)
    assert [type(e) for e in answer.wrong] == [LogUnusable]
    assert "b.json" in str(answer.wrong[0])
    assert answer.pairs["a.json"][1] is not None
    assert "notes.json" not in answer.pairs


def test_what_cannot_be_compared_is_told_apart(tmp_path: Path) -> None:
    one = folder(tmp_path / "one", a="1")
    (tmp_path / "none").mkdir()
    (tmp_path / "x.json").write_text("[]")
    with pytest.raises(LogUnreadable, match="without a result"):
        found(one, tmp_path / "none")
    with pytest.raises(LogUnreadable, match="cannot be read"):
        found(one / "a.json", tmp_path / "missing.json")
    with pytest.raises(LogUnusable, match="no schema"):
        found(one / "a.json", tmp_path / "x.json")
    with pytest.raises(UsageError, match="two files or two folders"):
        found(one, tmp_path / "x.json")
