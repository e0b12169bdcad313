"""``attlog diff``: exit codes, formats, old schemas."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from attlog.base.plain import plain
from attlog.result import Result
from tests.compare.made import filtered, result
from tests.present.made import lag


@pytest.fixture
def two(tmp_path: Path) -> tuple[Path, Path]:
    paths = tmp_path / "old.json", tmp_path / "new.json"
    for path, value in zip(paths, (1.0, 9.0), strict=True):
        result(filtered(lag(value))).to_json(path)
    return paths


def test_equal_is_0_and_a_difference_is_1(attlog, two: tuple[Path, Path]) -> None:
    same = attlog("diff", two[0], two[0])
    assert (same.code, same.err) == (0, "")
    assert "no difference" in same.out
    done = attlog("diff", *two)
    assert done.code == 1
    assert "lag_ms" in done.out
    assert "worse" in done.out
    assert attlog("diff", *two, "--tolerance", "lag_ms=8").code == 0
    assert attlog("diff", *two, "--tolerance", "lag_ms=7.9").code == 1
    assert attlog("diff", *two, "--window", "airborne").code == 1


def test_formats_go_to_the_terminal_or_to_a_file(attlog, two: tuple[Path, Path], tmp_path: Path) -> None:
    found = json.loads(attlog("diff", *two, "--json").out)
    assert found["schema"] == "attlog-diff/2"
    assert found["logs"][0]["moved"][0]["new"] == 9.0
    done = attlog("diff", *two, "--format", "md", "-o", tmp_path / "x.md")
    assert (done.code, done.out) == (1, "")
    assert r"| mahony | airborne | lag\_ms |" in (tmp_path / "x.md").read_text(encoding="utf-8")


def test_a_folder_gets_the_page_and_its_json(attlog, two: tuple[Path, Path], tmp_path: Path) -> None:
    done = attlog("diff", *two, "-o", tmp_path / "out")
    assert done.code == 1
    assert "lag_ms" in done.out
    assert "diff.html" in done.out
    assert json.loads((tmp_path / "out/diff.json").read_text(encoding="utf-8"))["count"] == 1
    assert "old.json to new.json" in (tmp_path / "out/diff.html").read_text(encoding="utf-8")


def test_wrong_usage_is_2_and_files_that_cannot_be_used_are_65_and_66(
    attlog, two: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "no.json").write_text("{}")
    for arguments, code, word in (
        ((*two, "--format", "xml"), 2, "'md'"),
        ((*two, "--tolerance", "lagms=1"), 2, "did you mean lag_ms"),
        ((*two, "--window", "flight"), 2, "airborne"),
        ((two[0], tmp_path), 2, "two folders"),
        ((two[0], tmp_path / "no.json"), 65, "no schema"),
        ((two[0], tmp_path / "none.json"), 66, "cannot be read"),
    ):
        done = attlog("diff", *arguments)
        assert (done.code, word in done.err, done.out) == (code, True, ""), (arguments, done)


def test_a_result_of_an_older_schema_is_compared(attlog, two: tuple[Path, Path]) -> None:
    document = plain(Result.load(two[0])) | {"schema": "attlog-result/1"}
    for key in ("worst", "ranked"):
        del document[key]
    del document["log"]["params"]
    document["segments"] = [{"kind": "run", "t0": 0.0, "t1": 1.0, "why": ""}]
    for answer in document["estimators"][0]["metrics"]["airborne"].values():
        for key in ("floor", "each", "records", "taken_out"):
            del answer[key]
    two[0].write_text(json.dumps(document))
    done = attlog("diff", *two)
    assert (done.code, "lag_ms" in done.out) == (1, True), done
