"""What is written is what is read: results as files."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import attlog
from attlog.base.errors import LogUnreadable, UsageError
from attlog.base.plain import plain, rounded
from attlog.result import SCHEMA, Answer, EstimatorRow, Result
from tests.conftest import SAMPLES, few
from tests.health.assessments.made import MADE

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
        ("attlog-result/99", "a newer attlog wrote it"),
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
        (b'{"schema": "attlog-result/5",\n "log": {"a": [1, 2', "line 2, column .* cut off"),
        (b'{"schema": ]}', "line 1, column 12"),
        (b"[1, 2]", "no schema"),
        (b'"text"', "no schema"),
        (b"\xff\xfe{}", "no UTF-8 text at byte 0"),
        (b'{"schema": NaN}', "NaN is no number of JSON"),
        (b"[" * 200_000, "not a result"),
        (b'{"schema": "attlog-result/5"}', "attlog: is missing"),
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
        with pytest.raises(LogUnreadable, match="cannot be read"):
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


def test_every_answer_reads_back_whole_though_the_file_tells_it_once(tmp_path: Path) -> None:
    result = attlog.evaluate(attlog.prepare(SAMPLES / "copter_yaw_turns.bin"), ["mahony", "madgwick"])
    result.to_json(tmp_path / "a.json")
    back, made = answers(Result.load(tmp_path / "a.json")), answers(result)
    assert back.keys() == made.keys()
    assert [key for key in made if plain(back[key]) != rounded(plain(made[key]), 10)] == []
    document = json.loads((tmp_path / "a.json").read_text())
    row = document["estimators"][1]["metrics"]
    assert row["airborne"]["lag_ms"] == {"value": row["all"]["lag_ms"]["value"], "as_in": "all"}
    assert (tmp_path / "a.json").stat().st_size < 230_000
    lag, gain = (document["evidence"][row["all"][name]["evidence"]] for name in ("lag_ms", "step_gain"))
    assert lag["n"] == gain["n"] == made["mahony", "all", "lag_ms"].n
    assert document["sentences"][lag["method"]] == made["mahony", "all", "lag_ms"].method


def test_numbers_of_answers_are_written_to_a_ten_billionth(tmp_path: Path) -> None:
    result = Result({"version": "1"}, "", {}, {"name": "x.ulg", "t0": 1 / 3})
    answer = Answer(2 / 3, "deg", "all", 1, ci95=(1e-7 / 3, 1e7 / 3), detail={"slopes": [1 / 7]})
    result.estimators = [EstimatorRow("mahony", "replay", "mahony", "ok", metrics={"all": {"total_rmse_deg": answer}})]
    document = json.loads(result.to_json(tmp_path / "a.json"))
    written = document["estimators"][0]["metrics"]["all"]["total_rmse_deg"]
    assert written == {"value": 0.6666666667, "ci95": [3.333333333e-08, 3333333.333], "evidence": 0}
    assert document["evidence"] == [{"n": 1, "detail": {"slopes": [0.1428571429]}}]
    assert document["log"]["t0"] == 1 / 3
    assert Result.load(tmp_path / "a.json").to_json() == (tmp_path / "a.json").read_text()


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        ({"as_in": "hover"}, "as_in: there is no such answer in 'hover'"),
        ({"as_in": "rest"}, "as_in: there is no such answer in 'rest'"),
        ({"as_in": "idle"}, "as_in: there is no such answer in 'idle'"),
        ({"value": 1.0, "as_in": "all"}, "value: differs from that in 'all'"),
        ({"value": 1.0, "reason": 1000}, "reason: there is no sentence 1000"),
        ({"value": 1.0, "method": -1}, "method: there is no sentence -1"),
        ({"value": 1.0, "evidence": 100_000}, "evidence: there is no evidence 100000"),
        ({"value": 1.0, "evidence": -1}, "evidence: there is no evidence -1"),
    ],
)
def test_what_an_answer_points_to_must_be_there(
    written: Path, tmp_path: Path, answer: dict[str, Any], says: str
) -> None:
    document = json.loads(written.read_text())
    document["estimators"][0]["metrics"]["rest"]["noise_roll_deg"] = answer
    (tmp_path / "x.json").write_text(json.dumps(document))
    with pytest.raises(UsageError, match=rf"estimators\[0\].metrics.rest.noise_roll_deg.{says}"):
        Result.load(tmp_path / "x.json")


def test_evidence_that_is_no_number_is_an_unknown_key(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text())
    document["estimators"][0]["metrics"]["rest"]["noise_roll_deg"] = {"value": 1.0, "evidence": "first"}
    (tmp_path / "x.json").write_text(json.dumps(document))
    with pytest.raises(UsageError, match=r"unknown key estimators.*noise_roll_deg.evidence"):
        Result.load(tmp_path / "x.json")


def test_a_file_of_schema_4_reads_the_same(written: Path, tmp_path: Path) -> None:
    """Schema 4 had sentences by their number and answers by an earlier window, and no evidence that answers share."""
    whole = json.loads(written.read_text())
    evidence = whole.pop("evidence")
    for row in whole["estimators"]:
        for answers_ in row["metrics"].values():
            for answer in answers_.values():
                answer |= evidence[answer.pop("evidence")] if "evidence" in answer else {}
                if "unit_values" in answer:
                    answer["units"] = answer["units"] | {"values": answer.pop("unit_values")}
    (tmp_path / "old.json").write_text(json.dumps(whole | {"schema": "attlog-result/4"}))
    found = Result.load(tmp_path / "old.json")
    assert found.schema == "attlog-result/4"
    assert found.to_dict() == Result.load(written).to_dict()


def test_a_file_of_schema_3_reads_the_same(tmp_path: Path) -> None:
    """Schema 3 told every field, defaults and definitions included, and fields that are gone."""
    result = attlog.evaluate(attlog.prepare(SAMPLES / "copter_steps_stabilize.bin"), ["mahony"])
    result.health = []  # of which schema 3 knew nothing
    gone = {"comparisons": [], "health": [], "definitions": result.definitions}
    old = json.dumps(plain(result) | gone | {"schema": "attlog-result/3"}, indent=1)
    (tmp_path / "old.json").write_text(old)
    found = Result.load(tmp_path / "old.json")
    assert found.schema == "attlog-result/3"
    assert found.to_dict() == result.to_dict()


def test_the_schema_names_the_version_that_is_read() -> None:
    from attlog.result.schema import schema

    assert schema()["properties"]["schema"] == {"const": SCHEMA}
    assert "traces" not in schema()["properties"]


def test_verdicts_of_the_schema_before_are_read_in_todays_words(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text())
    today = {"good": "ok", "warn": "warning", "bad": "fault", "cannot_judge": "unknown"}
    document["schema"] = "attlog-result/4"
    document["audit"] = [{"name": "field", "verdict": before, "text": "x"} for before in today]
    document["verdicts"] = [{**v, "question": "late"} for v in document["verdicts"][:1]]
    file = tmp_path / "older.json"
    file.write_text(json.dumps(document))
    found = Result.load(file)
    assert [c.verdict for c in found.audit] == list(today.values())
    assert [v.question for v in found.verdicts] == ["lag"]
    assert found.estimators == Result.load(written).estimators  # what the file leaves out is restored as well


def test_problems_of_older_results_are_read_as_findings(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text())
    document.pop("findings", None)
    document["schema"] = "attlog-result/4"
    document["problems"] = [
        {"code": "field", "severity": "error", "text": "It is weak.", "t": 3.0, "remedy": "Calibrate it.", "means": "x"}
    ]
    file = tmp_path / "older.json"
    file.write_text(json.dumps(document))
    (found,) = Result.load(file).findings
    assert (found.kind, found.severity, found.t, found.action) == ("field", "serious", 3.0, "Calibrate it.")


def test_assessments_of_sensors_read_back_and_defaults_stay_out(written: Path, tmp_path: Path) -> None:
    result = Result.load(written)
    result.health = list(MADE)
    text = result.to_json(tmp_path / "a.json", deterministic=True)
    told = json.loads(text)["health"]
    assert told[-1] == {
        "sensor": "GPS.0",
        "question": "gnss_delay",
        "verdict": "unknown",
        "text": "The flight has too few turns.",
    }
    again = Result.load(tmp_path / "a.json")
    assert again.health == MADE
    assert again.to_json(deterministic=True) == text


def test_a_document_without_assessments_reads_as_none(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text(encoding="utf-8"))
    document.pop("health", None)
    for schema in (SCHEMA, "attlog-result/4"):
        (tmp_path / "a.json").write_text(json.dumps(document | {"schema": schema}), encoding="utf-8")
        assert Result.load(tmp_path / "a.json").health == []
    document["health"] = [{"sensor": "MAG.0", "question": "x", "verdict": "great", "text": "x."}]
    (tmp_path / "a.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(UsageError, match="health"):
        Result.load(tmp_path / "a.json")


def test_the_schema_tells_what_an_assessment_holds() -> None:
    from attlog.result.schema import schema

    parts = schema()["$defs"]
    assert parts["Assessment"]["properties"]["verdict"]["enum"] == ["ok", "warning", "fault", "unknown"]
    assert set(parts["Setting"]["properties"]) == {"name", "old", "new", "unit"}
    assert set(parts["Assessment"]["required"]) == {"sensor", "question", "verdict", "text"}


def test_an_answer_without_a_value_does_not_say_that_it_is_not_ranked():
    """Nobody can rank it: answers that share their reason share their evidence, whatever was left out."""
    from attlog.result.document import Shared

    shared = Shared()
    own = [shared.taken_from({"code": "no_reference", "reason": "none", **more}) for more in ({"ranked": False}, {})]
    assert own == [{"code": "no_reference", "evidence": 0}] * 2
    assert shared.lists() == {"sentences": ["none"], "evidence": [{"reason": 0}]}
    ranked = shared.taken_from({"value": 1.0, "ranked": False})
    assert shared.lists()["evidence"][ranked["evidence"]] == {"ranked": False}


@pytest.mark.parametrize(("number", "why"), [(1, "newer"), (-99, "analyse the log again")])
def test_the_very_next_schema_is_refused_as_that_of_a_newer_version(number, why):
    from attlog.result.document import SCHEMA_NAME, SCHEMA_NUMBER
    from attlog.result.reading import read

    text = f'{{"schema": "{SCHEMA_NAME}{max(SCHEMA_NUMBER + number, 0)}"}}'
    with pytest.raises(UsageError, match=why):
        read(attlog.Result, text.encode(), "x.json")
