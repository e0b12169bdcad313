"""An earlier run to compare with: a result, one a line, a folder; and which result belongs to a log."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from attlog.base.errors import UsageError
from attlog.compare.gates.baseline import Baseline, BaselineResult, read, read_all
from attlog.compare.gates.gates import Gate, Gates, judge
from attlog.compare.gates.limits import GateLimit, Kind
from attlog.metrics.answer import Answer
from attlog.result import SCHEMA
from tests.compare.made import filtered, result
from tests.present.made import lag


def document(name: str, sha: str, value: float) -> str:
    return result(filtered(lag(value)), sha=sha * 64, log={"name": name, "sha256": sha * 64}).to_json()


def lag_of(found: BaselineResult | str) -> tuple[float, bool]:
    assert isinstance(found, BaselineResult)
    return found.result.estimators[0].metrics["airborne"]["lag_ms"].value or 0.0, found.same_log


def three(folder: Path, form: str) -> Path:
    texts = [document("one.ulg", "a", 1.0), document('t"wo.ulg', "b", 2.0), document("three.ulg", "c", 3.0)]
    if form == "lines":
        file = folder / "all.jsonl"
        file.write_text("".join(json.dumps(json.loads(t), ensure_ascii=False) + "\n" for t in texts), encoding="utf-8")
        return file
    (folder / "deep").mkdir()
    for k, text in enumerate(texts):
        (folder / "deep" / f"{k}.json").write_text(text, encoding="utf-8")
    (folder / "other.json").write_text("{}")
    (folder / "notes.txt").write_text("x")
    return folder


@pytest.mark.parametrize("form", ["lines", "folder"])
def test_results_belong_to_a_log_by_its_bytes_and_else_by_its_name(tmp_path: Path, form: str) -> None:
    found = read(three(tmp_path, form))
    assert lag_of(found.of({"name": "renamed.ulg", "sha256": "c" * 64})) == (3.0, True)
    assert lag_of(found.of({"name": 't"wo.ulg', "sha256": "b" * 64})) == (2.0, True)
    assert lag_of(found.of({"name": "one.ulg", "sha256": "f" * 64})) == (1.0, False)
    answer = found.of({"name": "new.ulg", "sha256": "f" * 64})
    assert isinstance(answer, str)
    assert "has no result of this log" in answer


@pytest.mark.parametrize("limit", ["max_ratio_to_baseline", "max_above_baseline", "baseline"])
def test_the_same_numbers_are_not_beyond_their_own_file(tmp_path: Path, limit: Kind) -> None:
    """A file has fewer digits than the run that is judged: of 40 values about half are rounded down."""
    value = {"max_ratio_to_baseline": 1.0, "max_above_baseline": 0.0, "baseline": 0.0}[limit]
    gate = Gate("lag_ms", (GateLimit(limit, value),), baseline=tmp_path)
    for k in range(40):
        now = result(filtered({"airborne": {"lag_ms": Answer(1.0 + 1.0 / (k + 7.0), "ms", "airborne")}}), sha="a" * 64)
        now.log |= {"name": "one.ulg", "sha256": "a" * 64}
        (tmp_path / "one.json").write_text(now.to_json())
        (found,) = judge(Gates((gate,), False), now, {tmp_path: read(tmp_path)})
        assert (found.status, found.excused) == ("passed", False)


def test_a_single_result_is_compared_with_any_log(tmp_path: Path) -> None:
    (tmp_path / "main.json").write_text(document("one.ulg", "a", 1.0))
    found = read(tmp_path / "main.json")
    assert lag_of(found.of({"name": "one.ulg", "sha256": "a" * 64})) == (1.0, True)
    assert lag_of(found.of({"name": "new.ulg", "sha256": "b" * 64})) == (1.0, False)


def test_a_log_without_hash_and_a_long_configuration_are_found_too(tmp_path: Path) -> None:
    plain = json.loads(document("one.ulg", "a", 1.0))
    plain["config"] = {"filler": "x" * 100_000}
    plain["log"] = {"sha256": None, "name": "one.ulg"}
    (tmp_path / "main.json").write_text(json.dumps(plain))
    assert lag_of(read(tmp_path / "main.json").of({"name": "one.ulg", "sha256": None})) == (1.0, False)


def test_what_is_no_result_is_refused_all_at_once(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text('{"a": 1}\n')
    (tmp_path / "empty").mkdir()
    wanted = [tmp_path / "x.json", tmp_path / "empty", tmp_path / "none.json", tmp_path / "x.json", None]
    with pytest.raises(UsageError) as caught:
        read_all(wanted)
    lines = str(caught.value).splitlines()
    assert [
        word in line
        for word, line in zip(("is no result", "is a folder without", "cannot be read"), lines, strict=True)
    ] == [True] * 3


def test_a_result_that_was_damaged_later_is_a_reason_and_no_crash(tmp_path: Path) -> None:
    file = tmp_path / "main.json"
    file.write_text(document("one.ulg", "a", 1.0))
    found = read(file)
    file.write_text(file.read_text()[:300])
    assert "cannot be read" in str(found.of({"name": "one.ulg"}))
    newer = Baseline("x", by_name={"one.ulg": found.by_name["one.ulg"]})
    file.write_text(document("one.ulg", "a", 1.0).replace(SCHEMA, "attlog-result/99"))
    assert "a newer attlog wrote it" in str(newer.of({"name": "one.ulg"}))


def test_a_folder_with_one_result_says_nothing_of_other_logs(tmp_path: Path) -> None:
    (tmp_path / "one.ulg.json").write_text(document("one.ulg", "a", 1.0))
    found = read(tmp_path)
    assert lag_of(found.of({"name": "one.ulg", "sha256": "a" * 64})) == (1.0, True)
    assert isinstance(found.of({"name": "new.ulg", "sha256": "b" * 64}), str)
