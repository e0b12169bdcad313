"""What is written is what is read: results as files."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core.errors import LogUnreadable, UsageError
from attlog.core.plain import rounded_document, to_plain
from attlog.metrics.statistics import UnitValues
from attlog.result import SCHEMA, Answer, EstimatorRow, Result
from attlog.result.document import as_written
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


def digits(answer: Answer) -> dict[str, Any]:
    """The plain answer with six significant digits, five of what stands behind it."""
    return {k: rounded_document(v, 5 if k in ("each", "detail", "units") else 6) for k, v in to_plain(answer).items()}


def test_every_answer_reads_back_whole_though_the_file_tells_it_once(tmp_path: Path) -> None:
    result = attlog.evaluate(attlog.prepare(SAMPLES / "copter_yaw_turns.bin"), ["mahony", "madgwick"])
    result.to_json(tmp_path / "a.json")
    back, made = answers(Result.load(tmp_path / "a.json")), answers(result)
    assert back.keys() == made.keys()
    assert [key for key in made if digits(made[key]) != to_plain(back[key])] == []
    document = json.loads((tmp_path / "a.json").read_text())
    row = document["estimators"][1]["metrics"]
    assert document["usual"]["airborne"]["lag_ms"] == "all"
    assert "lag_ms" not in row["airborne"]
    assert (tmp_path / "a.json").stat().st_size < 150_000
    of = {name: row["all"][name].get("evidence", document["usual"]["all"][name]) for name in ("lag_ms", "step_gain")}
    lag, gain = (document["evidence"][number] for number in of.values())
    assert lag["n"] == gain["n"] == made["mahony", "all", "lag_ms"].n
    assert document["sentences"][lag["method"]] == made["mahony", "all", "lag_ms"].method


def test_answers_have_six_digits_and_what_stands_behind_them_five(tmp_path: Path) -> None:
    result = Result({"version": "1"}, "", {}, {"name": "x.ulg", "t0": 1 / 3})
    answer = Answer(2 / 3, "deg", "all", 1, ci95=(1e-7 / 3, 1e7 / 3), detail={"slopes": [1 / 7]})
    result.estimators = [EstimatorRow("mahony", "replay", "mahony", "ok", metrics={"all": {"total_rmse_deg": answer}})]
    document = json.loads(result.to_json(tmp_path / "a.json"))
    written = document["estimators"][0]["metrics"]["all"]["total_rmse_deg"]
    assert written == {"value": 0.666667, "ci95": [3.33333e-08, 3333330.0], "detail": 0}
    assert document["usual"] == {"all": {"total_rmse_deg": 0}}
    assert document["evidence"] == [{"n": 1}]
    assert document["details"] == [{"slopes": [0.14286]}]
    assert document["log"]["t0"] == 1 / 3
    assert Result.load(tmp_path / "a.json").to_json() == (tmp_path / "a.json").read_text()


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        ({"as_in": "hover"}, "as_in: there is no such answer in 'hover'"),
        ({"as_in": "rest"}, "as_in: there is no such answer in 'rest'"),
        ({"as_in": "idle"}, "as_in: there is no such answer in 'idle'"),
        ({"value": 1.0, "as_in": "all"}, "value: differs from that in 'all'"),
        ({"value": 1.0, "evidence": 0, "reason": 1000}, "reason: there is no sentence 1000"),
        ({"value": 1.0, "evidence": 0, "detail": 1000}, "detail: there is no detail 1000"),
        ({"value": 1.0, "evidence": 0, "units": 1000}, "units: there is no entry of units 1000"),
        ({"value": 1.0, "evidence": 0, "method": -1}, "method: there is no sentence -1"),
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


OLDER = {
    "all": {
        "lag_ms": {"value": 1.5, "ci95": [1.0, 2.0], "each": [1.25, 1.75], "unit_values": [1.25, 1.75], "evidence": 0},
        "lag_roll_ms": {"code": "no_events", "evidence": 1},
    },
    "airborne": {"lag_ms": {"value": 1.5, "as_in": "all"}, "lag_roll_ms": {"code": "no_events", "as_in": "all"}},
}
"""Answers as schema 5 had them: units and detail in their evidence, no usual evidence."""
EVIDENCE = [
    {"n": 2, "seconds": 4.0, "method": 1, "detail": {"gain": 1.0}, "units": {"kind": "lag_event", "ids": [10, 20]}},
    {"reason": 0},
]


@pytest.mark.parametrize("schema", [4, 5])
def test_an_older_file_reads_the_same(tmp_path: Path, schema: int) -> None:
    """Schema 4 had sentences by their number and answers by an earlier window, and no evidence that answers share."""
    metrics: dict[str, Any] = json.loads(json.dumps(OLDER))
    if schema == 4:
        for answer in metrics["all"].values():
            answer |= EVIDENCE[answer.pop("evidence")]
        whole = metrics["all"]["lag_ms"]
        whole["units"] = whole["units"] | {"values": whole.pop("unit_values")}
    row = {"name": "vqf", "kind": "replay", "estimator": "vqf", "status": "ok", "metrics": metrics}
    document = {"attlog": {}, "command": "", "config": {}, "log": {}, "estimators": [row]}
    document |= {"schema": f"attlog-result/{schema}", "sentences": ["No steps.", "fit"]}
    document |= {"evidence": EVIDENCE} if schema == 5 else {}
    (tmp_path / "old.json").write_text(json.dumps(document))
    found = Result.load(tmp_path / "old.json")
    assert found.schema == f"attlog-result/{schema}"
    units = UnitValues("lag_event", np.array([10, 20]), np.array([1.25, 1.75]))
    lag = Answer(1.5, "ms", "all", 2, 4.0, (1.0, 2.0), "fit", detail={"gain": 1.0}, each=[1.25, 1.75], units=units)
    none = Answer(None, "ms", "all", code="no_events", reason="No steps.")
    for window in OLDER:
        told = found.estimators[0].metrics[window]
        assert told == {k: replace(a, window=window) for k, a in (("lag_ms", lag), ("lag_roll_ms", none))}
        assert to_plain(told["lag_ms"].units) == to_plain(units)
    (tmp_path / "new.json").write_text(found.to_json())
    assert found.to_dict()["schema"] == SCHEMA
    assert Result.load(tmp_path / "new.json").estimators == found.estimators


def test_a_row_without_an_answer_that_others_have_reads_back_without_it(tmp_path: Path) -> None:
    lag, over = Answer(1.5, "ms", "all", 2), Answer(1.0, "%", "all", 3)
    answers = {"lag_ms": lag, "overshoot_pct": over}
    rows = [EstimatorRow(n, "replay", n, "ok", metrics={"all": dict(answers)}) for n in ("gyro", "vqf", "mekf")]
    del rows[2].metrics["all"]["lag_ms"]
    rows[1].metrics["all"]["overshoot_pct"] = replace(over, n=7)
    rows[2].metrics["hover"] = {"lag_ms": replace(lag, window="hover")}
    result = Result({}, "", {}, {}, estimators=rows)
    document = json.loads(result.to_json(tmp_path / "a.json"))
    assert [row["metrics"]["all"] for row in document["estimators"]] == [
        {"lag_ms": {"value": 1.5}, "overshoot_pct": {"value": 1.0}},
        {"lag_ms": {"value": 1.5}, "overshoot_pct": {"value": 1.0, "evidence": 2}},
        {"lag_ms": None, "overshoot_pct": {"value": 1.0}},
    ]
    assert Result.load(tmp_path / "a.json").estimators == rows
    assert Result.load(tmp_path / "a.json").to_json() == (tmp_path / "a.json").read_text()


def test_an_answer_that_was_read_equals_what_was_written() -> None:
    units = UnitValues("lag_event", np.array([10, 20]), np.array([1 / 3, 2 / 3]))
    made = Answer(1 / 3, "ms", "all", 2, ci95=(1 / 7, 2 / 3), each=[1 / 3, 2 / 3], units=units)
    row = EstimatorRow("vqf", "replay", "vqf", "ok", metrics={"all": {"lag_ms": made}})
    text = Result({}, "", {}, {}, estimators=[row]).to_json()
    read = Result.read(text.encode(), "x.json").estimators[0].metrics["all"]["lag_ms"]
    assert read != made
    assert to_plain(read) == to_plain(as_written(made)) == to_plain(as_written(read))


def test_a_file_of_schema_3_reads_the_same(tmp_path: Path) -> None:
    """Schema 3 told every field, defaults and definitions included, and fields that are gone."""
    result = attlog.evaluate(attlog.prepare(SAMPLES / "copter_steps_stabilize.bin"), ["mahony"])
    result.health = []  # of which schema 3 knew nothing
    gone = {"comparisons": [], "health": [], "definitions": result.definitions}
    old = json.dumps(to_plain(result) | gone | {"schema": "attlog-result/3"}, indent=1)
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
    assert own == [{"evidence": 0}] * 2
    assert shared.lists() == {"sentences": ["none"], "evidence": [{"code": "no_reference", "reason": 0}]}
    ranked = shared.taken_from({"value": 1.0, "ranked": False})
    assert shared.lists()["evidence"][ranked["evidence"]] == {"ranked": False}


@pytest.mark.parametrize(("number", "why"), [(1, "newer"), (-99, "analyse the log again")])
def test_the_very_next_schema_is_refused_as_that_of_a_newer_version(number, why):
    from attlog.result.document import SCHEMA_NAME, SCHEMA_NUMBER
    from attlog.result.reading import read

    text = f'{{"schema": "{SCHEMA_NAME}{max(SCHEMA_NUMBER + number, 0)}"}}'
    with pytest.raises(UsageError, match=why):
        read(attlog.Result, text.encode(), "x.json")
