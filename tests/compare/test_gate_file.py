"""Gate files: what they mean, and everything that is wrong with one at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from attlog.compare.baseline import Baseline, BaselineResult, read_baseline, read_baselines
from attlog.compare.gate_file import read_gates
from attlog.compare.gates import Gate, GateLimit, Gates, LimitKind, SensorGate, judge_gates
from attlog.core.errors import UsageError
from attlog.metrics.metric import Answer
from attlog.result import SCHEMA
from tests.compare.made import filtered, result
from tests.words.made import lag


def gates(folder: Path, text: str) -> Gates:
    file = folder / "gates.toml"
    file.write_text(text, encoding="utf-8")
    return read_gates(file)


def told(folder: Path, text: str) -> list[str]:
    with pytest.raises(UsageError) as caught:
        gates(folder, text)
    return [line.replace(str(folder / "gates.toml"), "F") for line in str(caught.value).splitlines()]


def test_a_file_of_every_kind_of_gate(tmp_path: Path) -> None:
    found = gates(
        tmp_path,
        """
        [gates]
        strict = false
        baseline = "runs/main.jsonl"
        tilt_p95_deg = { max = 2.0, filters = ["mekf", "soft-*"], window = "airborne" }
        lag_ms = [{ max = 5 }, { min = 1, max = 10, filters = "onboard", optional = true }]
        heading_rmse_deg = { max_ratio_to_onboard = 1.2, max_above_baseline = 0.5 }
        noise_tilt_deg = { baseline = "other.json" }
        total_rmse_deg = { baseline = true, window = "20:30.5" }
        """,
    )
    ours = tmp_path / "runs/main.jsonl"
    assert found == Gates(
        (
            Gate("tilt_p95_deg", (GateLimit("max", 2.0),), "airborne", ("mekf", "soft-*"), False, ours),
            Gate("lag_ms", (GateLimit("max", 5.0),), baseline=ours),
            Gate("lag_ms", (GateLimit("min", 1.0), GateLimit("max", 10.0)), None, ("onboard",), True, ours),
            Gate(
                "heading_rmse_deg",
                (GateLimit("max_ratio_to_onboard", 1.2), GateLimit("max_above_baseline", 0.5)),
                baseline=ours,
            ),
            Gate("noise_tilt_deg", (GateLimit("baseline", 0.0),), baseline=tmp_path / "other.json"),
            Gate("total_rmse_deg", (GateLimit("baseline", 0.0),), "20:30.5", baseline=ours),
        ),
        strict=False,
    )


@pytest.mark.parametrize(
    "text", ['"step_error_deg.0.5s" = { max = 3 }', "step_error_deg.0.5s = { max = 3 }", "step_error_deg.0.5s.max = 3"]
)
def test_dots_of_a_metric_need_no_quotes(tmp_path: Path, text: str) -> None:
    (gate,) = gates(tmp_path, f"[gates]\n{text}").gates
    assert gate == Gate("step_error_deg.0.5s", (GateLimit("max", 3.0),))
    assert gates(tmp_path, "[gates.drift_air_deg_per_min.truth]\nmax = 2").gates[0].metric.endswith(".truth")
    assert len(gates(tmp_path, "[[gates.lag_ms]]\nmax = 2\n[[gates.lag_ms]]\nmax = 3").gates) == 2


def test_everything_that_is_wrong_is_told_at_once_with_its_line(tmp_path: Path) -> None:
    found = told(
        tmp_path,
        """gate = 1
[gates]
strict = "yes"
baseline = 3
tilt_p95 = { max = 2.0 }
lag_ms = [{ max = 5, windw = "rest" }, { max = true, min = -1, window = "airborn" }]
heading_rmse_deg = 5
coverage_pct = { max_ratio_to_onboard = 1 }
total_rmse_deg = {}
noise_tilt_deg = { baseline = true }
step_gain = { min = 2, max = 1, filters = [], optional = "yes" }
drift_rest_deg_per_min = { max = nan, max_ratio_to_onboard = 0 }
allan_bias_deg_per_h = []
""",
    )
    for start, word in (
        ("F, line 1: ", "unknown key gate; did you mean gates?"),
        ("F, line 3: ", "strict: must be a valid boolean (got 'yes')"),
        ("F, line 4: ", "baseline: must be a valid string (got 3)"),
        ("F, line 5: ", "did you mean tilt_p95_deg?"),
        ("F, line 6: lag_ms", "did you mean window?"),
        ("F, line 6: lag_ms", "there is no window airborn; did you mean airborne?"),
        ("F, line 6: lag_ms", "min: must be greater than or equal to 0 (got -1)"),
        ("F, line 6: lag_ms", "max: must be a number (got True)"),
        ("F, line 7: heading_rmse_deg", "write heading_rmse_deg = { max = 2.0 }"),
        ("F, line 8: coverage_pct", "more is better"),
        ("F, line 9: total_rmse_deg", "has no limit"),
        ("F, line 10: noise_tilt_deg", "needs a baseline"),
        ("F, line 11: step_gain", "filters: must be a list of names or patterns (got [])"),
        ("F, line 11: step_gain", "optional: must be a valid boolean (got 'yes')"),
        ("F, line 11: step_gain", "min=2 is above max=1"),
        ("F, line 12: drift_rest_deg_per_min", "max: must be a finite number"),
        ("F, line 12: drift_rest_deg_per_min", "max_ratio_to_onboard: must be greater than 0"),
        ("F, line 13: allan_bias_deg_per_h", "is []"),
    ):
        assert any(line.startswith(start) and word in line for line in found), (start, word, found)
    assert len(found) == 18


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", r"holds no \[gates\]"),
        ("[gates]", "holds no gate"),
        ("[gates]\nstrict = true", "holds no gate"),
        ("[gate]\nlag_ms = 1", r"did you mean gates\?"),
        ("[gates\n", "not valid TOML"),
        ("gates = 3", r"holds no \[gates\]"),
    ],
)
def test_a_file_without_gates_is_refused(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(UsageError, match=word):
        gates(tmp_path, text)


def test_a_file_that_cannot_be_read_or_is_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.toml: no such file"):
        read_gates(tmp_path / "none.toml")
    (tmp_path / "x").write_bytes(b"[gates]\n\xff")
    with pytest.raises(UsageError, match="byte 8"):
        read_gates(tmp_path / "x")


# ``[gates.health]``: what it may say, and what is wrong with it, each with its line.


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_limits_verdicts_sensors_and_what_unknown_means_are_read(tmp_path):
    text = """
[gates]
lag_ms = { max = 5 }
[gates.health]
compass_offset = { max = 5 }
vibration_level = [{ verdict = "warning", sensors = "IMU.*" }, { min = -1, max = 30, unknown = "pass" }]
"""
    found = read_gates(written(tmp_path / "gates.toml", text))
    assert [gate.metric for gate in found.gates] == ["lag_ms"]
    assert found.health == (
        SensorGate("compass_offset", (GateLimit("max", 5.0),)),
        SensorGate("vibration_level", (), "warning", ("IMU.*",)),
        SensorGate("vibration_level", (GateLimit("min", -1.0), GateLimit("max", 30.0)), unknown_passes=True),
    )


def test_what_is_wrong_is_said_at_once_with_its_line_and_what_comes_near(tmp_path: Path) -> None:
    lines = (
        ("compas_offset = { max = 5 }", "there is no such question about a sensor; did you mean compass_offset?"),
        ("compass_offset = { max = -1 }", "max: must be greater than or equal to 0 (got -1)"),
        ("notch = { maxx = 1 }", "maxx"),
        ('vibration_level = { verdict = "fault" }', "verdict"),
        ('gnss_delay = { max = 1, unknown = "skip" }', "unknown"),
        ("gnss_quality = { max = 1, min = 2 }", "min=2 is above max=1"),
        ("field = { sensors = [] , max = 1 }", "must be a list of names"),
        ('compass_motors = { sensors = ["MAG.0"] }', "has no limit; give one of min, max, verdict"),
        ("declination = 5", 'is 5; write declination = { verdict = "warning" }'),
    )
    said = told(tmp_path, "[gates]\nlag = { max = 1 }\n[gates.health]\n" + "\n".join(line for line, _ in lines))
    assert said[0].startswith("F, line 2: ")
    for number, (_, word) in enumerate(lines, 4):
        assert any(text.startswith(f"F, line {number}: ") and word in text for text in said), (number, word, said)
    assert len(said) == 10


def test_a_table_that_is_none_is_refused(tmp_path):
    with pytest.raises(UsageError, match="write compass_offset"):
        read_gates(written(tmp_path / "gates.toml", "[gates]\nhealth = 3\n"))


# An earlier run to compare with: a result, one a line, a folder; and which result belongs to a log.


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
    found = read_baseline(three(tmp_path, form))
    assert lag_of(found.of({"name": "renamed.ulg", "sha256": "c" * 64})) == (3.0, True)
    assert lag_of(found.of({"name": 't"wo.ulg', "sha256": "b" * 64})) == (2.0, True)
    assert lag_of(found.of({"name": "one.ulg", "sha256": "f" * 64})) == (1.0, False)
    answer = found.of({"name": "new.ulg", "sha256": "f" * 64})
    assert isinstance(answer, str)
    assert "has no result of this log" in answer


@pytest.mark.parametrize("limit", ["max_ratio_to_baseline", "max_above_baseline", "baseline"])
def test_the_same_numbers_are_not_beyond_their_own_file(tmp_path: Path, limit: LimitKind) -> None:
    """A file has fewer digits than the run that is judged: of 40 values about half are rounded down."""
    value = {"max_ratio_to_baseline": 1.0, "max_above_baseline": 0.0, "baseline": 0.0}[limit]
    gate = Gate("lag_ms", (GateLimit(limit, value),), baseline=tmp_path)
    for k in range(40):
        now = result(filtered({"airborne": {"lag_ms": Answer(1.0 + 1.0 / (k + 7.0), "ms", "airborne")}}), sha="a" * 64)
        now.log |= {"name": "one.ulg", "sha256": "a" * 64}
        (tmp_path / "one.json").write_text(now.to_json())
        (found,) = judge_gates(Gates((gate,), False), now, {tmp_path: read_baseline(tmp_path)})
        assert (found.status, found.excused) == ("passed", False)


def test_a_single_result_is_compared_with_any_log(tmp_path: Path) -> None:
    (tmp_path / "main.json").write_text(document("one.ulg", "a", 1.0))
    found = read_baseline(tmp_path / "main.json")
    assert lag_of(found.of({"name": "one.ulg", "sha256": "a" * 64})) == (1.0, True)
    assert lag_of(found.of({"name": "new.ulg", "sha256": "b" * 64})) == (1.0, False)


def test_a_log_without_hash_and_a_long_configuration_are_found_too(tmp_path: Path) -> None:
    plain = json.loads(document("one.ulg", "a", 1.0))
    plain["config"] = {"filler": "x" * 100_000}
    plain["log"] = {"sha256": None, "name": "one.ulg"}
    (tmp_path / "main.json").write_text(json.dumps(plain))
    assert lag_of(read_baseline(tmp_path / "main.json").of({"name": "one.ulg", "sha256": None})) == (1.0, False)


def test_what_is_no_result_is_refused_all_at_once(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text('{"a": 1}\n')
    (tmp_path / "empty").mkdir()
    wanted = [tmp_path / "x.json", tmp_path / "empty", tmp_path / "none.json", tmp_path / "x.json", None]
    with pytest.raises(UsageError) as caught:
        read_baselines(wanted)
    lines = str(caught.value).splitlines()
    assert [
        word in line
        for word, line in zip(("is no result", "is a folder without", "cannot be read"), lines, strict=True)
    ] == [True] * 3


def test_a_result_that_was_damaged_later_is_a_reason_and_no_crash(tmp_path: Path) -> None:
    file = tmp_path / "main.json"
    file.write_text(document("one.ulg", "a", 1.0))
    found = read_baseline(file)
    file.write_text(file.read_text()[:300])
    assert "cannot be read" in str(found.of({"name": "one.ulg"}))
    newer = Baseline("x", by_name={"one.ulg": found.by_name["one.ulg"]})
    file.write_text(document("one.ulg", "a", 1.0).replace(SCHEMA, "attlog-result/99"))
    assert "a newer attlog wrote it" in str(newer.of({"name": "one.ulg"}))


def test_a_folder_with_one_result_says_nothing_of_other_logs(tmp_path: Path) -> None:
    (tmp_path / "one.ulg.json").write_text(document("one.ulg", "a", 1.0))
    found = read_baseline(tmp_path)
    assert lag_of(found.of({"name": "one.ulg", "sha256": "a" * 64})) == (1.0, True)
    assert isinstance(found.of({"name": "new.ulg", "sha256": "b" * 64}), str)
