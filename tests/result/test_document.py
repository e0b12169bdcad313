"""What is written is what is read: results as files."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core.errors import LogUnreadable, UsageError
from attlog.core.plain import to_plain
from attlog.metrics.statistics import UnitValues
from attlog.result import SCHEMA, Answer, EstimatorRow, Result
from attlog.result.document import SCHEMA_NAME, SCHEMA_NUMBER, as_written
from tests.conftest import SAMPLES, few
from tests.health.made import MADE

LOGS = [p for p in sorted(SAMPLES.iterdir()) if p.suffix in (".ulg", ".bin", ".tlog")]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("result") / "log.json"
    attlog.evaluate(attlog.prepare(SAMPLES / "copter_steps_stabilize.bin"), ["mahony", "gyro"]).to_json(path)
    return path


@pytest.mark.parametrize("log", few(LOGS, 1), ids=lambda p: p.name)
@pytest.mark.parametrize("reference", ["auto", "none"])
def test_a_result_reads_back_to_the_same_text(log: Path, reference: str, tmp_path: Path) -> None:
    result = attlog.evaluate(attlog.prepare(log, {"reference": reference}), ["mahony", "madgwick"], cost=True)
    for deterministic in (False, True):
        text = result.to_json(tmp_path / "a.json", deterministic)
        assert Result.load(tmp_path / "a.json").to_json(deterministic=deterministic) == text


def test_what_is_read_are_the_same_dataclasses(written: Path) -> None:
    found = Result.load(written)
    row = next(r for r in found.estimators if r.name == "mahony")
    answer = row.metrics["rest"]["noise_roll_deg"]
    assert isinstance(answer.ci95, tuple)
    assert answer.ci95[0] < (answer.value or 0.0) < answer.ci95[1]
    assert row.parameters["kp"].origin == "default"
    assert found.segments[0].seconds > 0
    assert found.table("rest").loc["mahony", "noise_roll_deg"] == answer.value
    assert found.traces == []


def test_a_report_can_be_written_from_a_file(written: Path, tmp_path: Path) -> None:
    Result.load(written).to_html(tmp_path / "again.html")
    assert "mahony" in (tmp_path / "again.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("schema", "says"),
    [
        ("attlog-result/0", "analyse the log again"),
        (f"{SCHEMA_NAME}{SCHEMA_NUMBER - 1}", "analyse the log again"),
        (f"{SCHEMA_NAME}{SCHEMA_NUMBER + 1}", "a newer attlog wrote it"),
        ("attlog-result/x", "analyse the log again"),
        ("other/2", "no schema"),
        (None, "no schema"),
    ],
)
def test_another_schema_is_refused_in_words(written: Path, tmp_path: Path, schema: str | None, says: str) -> None:
    document = json.loads(written.read_text()) | {"schema": schema}
    other = tmp_path / "other.json"
    other.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=says) as refused:
        Result.load(other)
    assert "other.json" in str(refused.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "line 1, column 1 .the file ends there"),
        (b'{"schema": "attlog-result/7",\n "log": {"a": [1, 2', "line 2, column .* cut off"),
        (b'{"schema": ]}', "line 1, column 12"),
        (b"[1, 2]", "no schema"),
        (b'"text"', "no schema"),
        (b"\xff\xfe{}", "no UTF-8 text at byte 0"),
        (b'{"schema": NaN}', "NaN is no number of JSON"),
        (b"[" * 200_000, "not a result"),
        (b'{"schema": "attlog-result/7"}', "attlog: is missing"),
    ],
)
def test_what_is_no_result_is_refused_with_the_place(tmp_path: Path, content: bytes, says: str) -> None:
    file = tmp_path / "x.json"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=says):
        Result.load(file)


def test_a_file_cut_anywhere_is_refused(written: Path, tmp_path: Path) -> None:
    text = written.read_text().rstrip()
    file = tmp_path / "cut.json"
    for share in (0.1, 0.5, 0.9, 0.999):
        file.write_text(text[: int(share * len(text))])
        with pytest.raises(UsageError, match="not valid JSON"):
            Result.load(file)


def test_a_file_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.json", tmp_path):
        with pytest.raises(LogUnreadable, match=r"cannot be read|no such file"):
            Result.load(path)


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (("estimators", 0, "name"), 3, r"estimators\[0\].name: must be a valid string"),
        (("estimators", 0, "causal"), 1, r"estimators\[0\].causal: must be a valid boolean"),
        (("segments", 0, "t0"), "1", r"segments\[0\].t0: must be a number"),
        (("estimators", 0, "metrics", "all", "noise_roll_deg", "ci95"), [1.0], r"ci95\[1\]: is missing"),
        (("estimators", 0, "metrics", "all", "noise_roll_deg", "extra"), 1, "unknown key estimators.*deg.extra"),
        (("segments", 0), [], r"segments\[0\]: must be a table"),
        (("verdicts",), {}, "verdicts: must be a valid array"),
        (("attlog", "numpy"), 1, "attlog.numpy: must be a valid string"),
    ],
)
def test_a_wrong_value_is_told_with_its_place(
    written: Path, tmp_path: Path, path: tuple[str | int, ...], value: object, says: str
) -> None:
    document: Any = json.loads(written.read_text())
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=says):
        Result.load(file)


def test_a_missing_key_is_told_with_its_place(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text())
    del document["reference"]["source"]
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=r"reference\.source: is missing"):
        Result.load(file)


def test_reading_a_result_imports_nothing_heavy(written: Path) -> None:
    code = (
        f"import sys\nfrom attlog.result import Result\nResult.load({str(written)!r})\n"
        "print(sorted({'pandas', 'numba', 'scipy', 'plotly', 'pymavlink', 'pyulog', 'jinja2'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_a_null_for_a_number_is_no_number(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text())
    document["reference"]["rate_hz"] = None
    (tmp_path / "null.json").write_text(json.dumps(document))
    found = Result.load(tmp_path / "null.json")
    assert found.reference is not None
    assert math.isnan(found.reference.rate_hz)
    assert found.to_dict()["reference"]["rate_hz"] is None


def test_a_result_without_anything_but_its_log_reads_back(tmp_path: Path) -> None:
    Result({"version": "1"}, "", {}, {"name": "x.ulg"}).to_json(tmp_path / "x.json")
    assert len((tmp_path / "x.json").read_text()) < 120
    assert Result.load(tmp_path / "x.json") == Result({"version": "1"}, "", {}, {"name": "x.ulg"})


def answers(found: Result) -> dict[tuple[str, str, str], Answer]:
    return {(r.name, w, m): a for r in found.estimators for w, kept in r.metrics.items() for m, a in kept.items()}


def test_every_answer_reads_back_whole(tmp_path: Path) -> None:
    result = attlog.evaluate(attlog.prepare(SAMPLES / "copter_yaw_turns.bin"), ["mahony", "madgwick"])
    result.to_json(tmp_path / "a.json")
    back, made = answers(Result.load(tmp_path / "a.json")), answers(result)
    assert back.keys() == made.keys()
    for key, answer in made.items():
        read, written = back[key], as_written(answer)
        same = ("unit", "window", "n", "method", "code", "reason", "ranked", "coverage_pct")
        assert [getattr(read, k) for k in same] == [getattr(answer, k) for k in same], key
        assert (read.value, read.ci95, read.each) == (written.value, written.ci95, written.each), key
        assert to_plain(read.units) == to_plain(written.units)
        assert [r.t0 for r in read.records] == pytest.approx([r.t0 for r in answer.records], rel=1e-5)
    assert (tmp_path / "a.json").stat().st_size < 400_000


def test_an_answer_is_written_without_what_its_place_gives_and_with_six_digits() -> None:
    given = Answer(2 / 3, "ms", "all", 1, ci95=(1e-7 / 3, 1e7 / 3), each=[1 / 7])
    none = Answer(None, "ms", "rest", code="no_rest", reason="No rest.")
    row = EstimatorRow("vqf", "replay", "vqf", "ok", metrics={"all": {"lag_ms": given}, "rest": {"lag_ms": none}})
    result = Result({}, "", {}, {"t0": 1 / 3}, estimators=[row])
    assert result.to_dict()["estimators"][0]["metrics"] == {
        "all": {"lag_ms": {"value": 0.666667, "n": 1, "ci95": [3.33333e-08, 3333330.0], "each": [0.14286]}},
        "rest": {"lag_ms": {"code": "no_rest", "reason": "No rest."}},
    }
    assert result.to_dict()["log"]["t0"] == 1 / 3


def test_an_answer_that_was_read_equals_what_was_written() -> None:
    units = UnitValues("lag_event", np.array([10, 20]), np.array([1 / 3, 2 / 3]))
    made = Answer(1 / 3, "ms", "all", 2, ci95=(1 / 7, 2 / 3), each=[1 / 3, 2 / 3], units=units)
    row = EstimatorRow("vqf", "replay", "vqf", "ok", metrics={"all": {"lag_ms": made}})
    text = Result({}, "", {}, {}, estimators=[row]).to_json()
    read = Result.read(text.encode(), "x.json").estimators[0].metrics["all"]["lag_ms"]
    assert read != made
    assert to_plain(read) == to_plain(as_written(made)) == to_plain(as_written(read))


def test_the_schema_names_the_version_that_is_read() -> None:
    from attlog.result.schema import schema

    assert schema()["properties"]["schema"] == {"const": SCHEMA}
    assert "traces" not in schema()["properties"]


def test_assessments_of_sensors_read_back_and_defaults_stay_out(written: Path, tmp_path: Path) -> None:
    result = Result.load(written)
    result.checks = list(MADE)
    text = result.to_json(tmp_path / "a.json", deterministic=True)
    told = json.loads(text)["checks"]
    assert told[-1] == {
        "sensor": "GPS.0",
        "question": "gnss_delay",
        "verdict": "unknown",
        "text": "The flight has too few turns.",
    }
    again = Result.load(tmp_path / "a.json")
    assert again.checks == MADE
    assert again.to_json(deterministic=True) == text


def test_a_document_without_assessments_reads_as_none(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text(encoding="utf-8"))
    document.pop("checks", None)
    (tmp_path / "a.json").write_text(json.dumps(document), encoding="utf-8")
    assert Result.load(tmp_path / "a.json").checks == []
    document["checks"] = [{"sensor": "MAG.0", "question": "x", "verdict": "great", "text": "x."}]
    (tmp_path / "a.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(UsageError, match="checks"):
        Result.load(tmp_path / "a.json")


def test_the_schema_tells_what_an_assessment_holds() -> None:
    from attlog.result.schema import schema

    parts = schema()["$defs"]
    assert parts["Check"]["properties"]["verdict"]["enum"] == ["ok", "warning", "fault", "unknown"]
    assert set(parts["Setting"]["properties"]) == {"name", "old", "new", "unit"}
    assert set(parts["Check"]["required"]) == {"question", "verdict", "text"}
