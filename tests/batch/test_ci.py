"""Gates over a run of logs: judged from files, told to the systems that ask."""

from __future__ import annotations

import io
import os
import zlib
from pathlib import Path

import pytest
import xmlschema
from junitparser import Error, Failure, JUnitXml, Skipped

from attlog.batch import ci
from attlog.batch.ci import MAX_SUMMARY_BYTES, GatedLog, Gating, github_commands, publish, read_gating, summary
from attlog.batch.job import Record
from attlog.compare.gates import GateLimit, Gates, SensorGate
from attlog.core.errors import OutputError, UsageError
from attlog.result import Result
from attlog.words.text import escape_markdown
from tests.batch.made import NASTY, gated, outcome, some
from tests.compare.made import result
from tests.health.made import MADE
from tests.words.made import lag, row

GATES = "[gates]\nlag_ms = { max = 5 }\n"


def gate_file(folder: Path, text: str = GATES) -> Path:
    (folder / "gates.toml").write_text(text)
    return folder / "gates.toml"


def crossed(gating: Gating, folder: Path, found: Result) -> GatedLog:
    """Judge a result through its file."""
    found.to_json(folder / "x.json")
    return gating.judge(Record("x.ulg", "x"), folder)


def test_files_are_judged_and_kept_in_the_order_asked_for(tmp_path: Path) -> None:
    found = read_gating(gate_file(tmp_path))
    assert found is not None
    for name, value in (("b", 9.0), ("a", 1.0)):
        result(row("mekf", lag(value))).to_json(tmp_path / f"{name}.json")
        found.judge(Record(f"{name}.ulg", name), tmp_path)
    found.judge(Record("c.ulg", "c", code=65, message="nothing to analyse"), tmp_path)
    assert [(j.log, j.failed, j.broken) for j in found.in_order(["a", "b", "c", "never"])] == [
        ("a.ulg", 0, False),
        ("b.ulg", 1, False),
        ("c.ulg", 0, True),
    ]
    assert found.logs["b"].sentences == ("mekf: lag_ms +9 ms (airborne), at most 5 ms",)
    (tmp_path / "cut.json").write_text("{")
    for name in ("none", "cut"):  # a result that cannot be read never passes
        broken = found.judge(Record(f"{name}.ulg", name), tmp_path)
        assert (broken.broken, broken.code) == (True, 66)


def test_strict_has_the_last_word_on_the_command_line(tmp_path: Path) -> None:
    crashed = result(row("mekf", lag(1.0)), row("mine", {}, status="failed", reason="ImportError"))
    for text, strict, failed in (
        (GATES, None, 2),
        (GATES, False, 1),
        (GATES + "strict = false\n", None, 1),
        (GATES + "strict = false\n", True, 2),
    ):
        found = read_gating(gate_file(tmp_path, text), strict)
        assert found is not None
        assert crossed(found, tmp_path, crashed).failed == failed, (text, strict)
    alone = read_gating(None, True)
    assert alone is not None
    assert crossed(alone, tmp_path, crashed).sentences == ("mine failed: ImportError",)
    assert read_gating(None) is None
    assert read_gating(None, False) is None


def test_baselines_are_read_beforehand(tmp_path: Path) -> None:
    text = '[gates]\nbaseline = "main.json"\nlag_ms = { max_above_baseline = 2 }\n'
    with pytest.raises(UsageError, match=r"main\.json: cannot be read"):
        read_gating(gate_file(tmp_path, text))
    result(row("mekf", lag(1.0))).to_json(tmp_path / "main.json")
    found = read_gating(gate_file(tmp_path, text))
    assert found is not None
    assert crossed(found, tmp_path, result(row("mekf", lag(2.0)))).failed == 0
    assert crossed(found, tmp_path, result(row("mekf", lag(9.0)))).failed == 1


def test_everybody_who_asks_is_told(tmp_path: Path) -> None:
    out, err, step = io.StringIO(), io.StringIO(), tmp_path / "step.md"
    step.write_text("before\n")
    publish(some(), tmp_path / "j.xml", True, environment={}, out=out, err=err)
    assert len(list(JUnitXml.fromfile(str(tmp_path / "j.xml")))) == 4
    assert out.getvalue().startswith("## ❌ attlog: 3 of 4 logs failed")
    assert err.getvalue() == ""
    out = io.StringIO()
    publish(
        some(),
        environment={"GITHUB_ACTIONS": "true", "GITHUB_STEP_SUMMARY": str(step)},
        summary_to=True,
        out=out,
        err=err,
    )
    assert out.getvalue() == ""
    lines = err.getvalue().splitlines()
    assert [line.startswith("::error ") for line in lines] == [True] * 4
    assert lines[0].endswith("::gone.ulg: cannot be read%0A(no such file)")
    assert "c: lag_ms 45 ms (airborne), at most 5 ms" in lines[1]
    assert step.read_text(encoding="utf-8").startswith("before\n## ❌")
    out, err = io.StringIO(), io.StringIO()
    publish(some(), environment={"GITHUB_STEP_SUMMARY": str(step)}, out=out, err=err)
    assert out.getvalue() == err.getvalue() == ""


def test_every_file_that_cannot_be_written_is_reported_and_others_are_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=r"(?s)j\.xml: cannot be written.*s\.md: cannot be written"):
        publish(some(), tmp_path / "file" / "j.xml", tmp_path / "file" / "s.md", environment={})
    with pytest.raises(OutputError):
        publish(some(), tmp_path / "file" / "j.xml", tmp_path / "s.md", environment={})
    assert (tmp_path / "s.md").exists()


@pytest.mark.parametrize(("place", "output"), [("out", "out"), ("out/main.json", "out"), (".", "out"), ("out", ".")])
def test_a_baseline_that_the_run_writes_to_is_refused(tmp_path: Path, place: str, output: str) -> None:
    (tmp_path / "out").mkdir()
    result(row("mekf", lag(1.0))).to_json(tmp_path / "out" / "main.json")
    file = gate_file(tmp_path, f'[gates]\nbaseline = "{place}"\nlag_ms = {{ max_above_baseline = 2 }}\n')
    with pytest.raises(UsageError, match="compared with themselves"):
        read_gating(file, output=tmp_path / output)
    assert read_gating(file, output=tmp_path.parent / "elsewhere") is not None


def test_gates_of_sensors_fail_a_log_and_are_cases_of_its_suite(tmp_path: Path) -> None:
    made = Result({}, "", {}, {}, checks=list(MADE))
    gates = Gates(
        strict=False,
        health=(
            SensorGate("compass_offset", (GateLimit("max", 5.0),)),
            SensorGate("vibration_level", worst="ok"),
            SensorGate("gnss_delay", worst="ok", unknown_passes=True),
        ),
    )
    found = crossed(Gating(gates), tmp_path, made)
    assert (found.failed, found.passed, found.skipped) == (1, 1, 1)
    assert found.sentences == ("MAG.0: compass_offset 24.0 µT, at most 5 µT",)
    text = zlib.decompress(found.suite).decode()
    assert 'name="MAG.0: health.compass_offset max=5"><failure' in text
    assert 'name="IMU.0: health.vibration_level verdict=ok"/>' in text
    assert 'name="GPS.0: health.gnss_delay verdict=ok"><skipped' in text


# Annotations: escaped, the worst first, no more than GitHub shows.


def test_escapes_are_those_of_workflow_commands() -> None:
    (line,) = list(github_commands([gated("a,b:c%", outcome("r,1:2%\r\n\x1b", sentence="50% off,\r\nfar: off"))]))
    assert line == (
        "::error title=attlog%2C r%2C1%3A2%25%0D%0A%3A lag_ms@airborne max=5::a,b:c%25: 50%25 off,%0D%0Afar: off"
    )


def test_of_many_failures_the_worst_ten_are_shown_each_log_first_and_the_rest_is_counted() -> None:
    logs = [gated(f"{k}.ulg", outcome("a", excess=k + 2.0), outcome("b", excess=50.0 + k)) for k in range(8)]
    lines = list(github_commands(logs))
    assert [line.startswith("::error") for line in lines] == [True] * 10 + [False]
    assert [line.rpartition("::")[2].partition(":")[0] for line in lines[:10]] == [
        *(f"{k}.ulg" for k in range(7, -1, -1)),
        "7.ulg",
        "6.ulg",
    ]
    assert lines[-1].startswith("::notice title=attlog::16 failures in 8 logs, of which the worst 10 are marked")


def test_a_log_in_the_repository_is_the_annotated_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.ulg").write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    inside = gated("logs/a.ulg", outcome("a"))
    (line,) = list(github_commands([inside]))
    assert line.startswith("::error file=logs/a.ulg,title=")
    (line,) = list(github_commands([inside], tmp_path / "logs"))
    assert line.startswith("::error file=a.ulg,title=")
    (line,) = list(github_commands([gated("/elsewhere/a.ulg", outcome("a"))]))
    assert line.startswith("::error title=")


# JUnit files: valid for Jenkins, read by another program, whatever the names of logs hold.

OURS = Path(__file__).with_name("junit.xsd")
SCHEMAS = [OURS, *(Path(p) for p in [os.environ.get("ATTLOG_JUNIT_XSD", "")] if p)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    ci.write_junit(tmp_path / "junit.xml", some())
    return tmp_path / "junit.xml"


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda path: path.name)
def test_the_file_is_valid(file: Path, schema: Path) -> None:
    xmlschema.validate(file, schema)
    assert not xmlschema.is_valid(file.read_text("utf-8").replace("<testcase ", "<test ", 1), schema)


def test_another_program_reads_what_was_judged(file: Path) -> None:
    suites = {suite.name: suite for suite in JUnitXml.fromfile(str(file))}
    good, bad, gone = suites["good.ulg"], suites["bad.ulg"], suites["gone.ulg"]
    assert [(s.tests, s.failures, s.errors, s.skipped) for s in (good, bad, gone)] == [
        (3, 0, 0, 1),
        (4, 2, 0, 0),
        (1, 0, 1, 0),
    ]
    assert good.time == pytest.approx(12.346)
    told = {case.name: case.result for case in bad}
    (failure,) = told["c: lag_ms@airborne max=5"]
    assert isinstance(failure, Failure)
    assert (failure.type, failure.message) == ("limit", "c: lag_ms 45 ms (airborne), at most 5 ms")
    assert told["analysis"] == told["b: lag_ms@airborne max=5"] == []
    assert {case.classname for case in bad} == {"bad.ulg"}
    (skipped,) = next(case.result for case in good if case.name.startswith("b:"))
    assert isinstance(skipped, Skipped)
    (error,) = next(case.result for case in gone)
    assert isinstance(error, Error)
    assert (error.type, error.message) == ("exit code 66", "gone.ulg: cannot be read")
    assert "(no such file)" in error.text


def test_nothing_in_a_name_breaks_the_file(file: Path) -> None:
    expected = NASTY.translate({0: None, 0x1B: None, 0xD800: None, 0xFFFE: None})
    (nasty,) = [suite for suite in JUnitXml.fromfile(str(file)) if "<i>" in suite.name]
    assert nasty.name == expected
    assert next(case.result for case in nasty if case.result)[0].text == f"{expected}: worse\nthan that"


# The Markdown summary: worst first, escaped, within GitHub's limit.


def test_failures_stand_in_a_table_broken_logs_and_the_worst_first() -> None:
    rows = [line for line in summary(some()).splitlines() if line.startswith("| ")][2:]
    assert rows[0] == "| gone.ulg |  | analysis | cannot be read (no such file) |"
    assert rows[1].startswith("| bad.ulg | c | lag\\_ms@airborne max=5 | c: lag\\_ms 45 ms")
    assert rows[2].startswith("| bad.ulg | a |")
    assert len(rows) == 4


def test_a_name_is_neither_markup_nor_html_nor_a_cell() -> None:
    text = escape_markdown(NASTY)
    assert "<" not in text
    assert text.startswith("a\\|b&lt;i&gt;&amp;\"'\\`\\*\\_\\[x\\](y) ")
    assert all(
        line.count(" | ") == 3 for line in summary(some()).splitlines() if line.startswith("| ") and "---" not in line
    )


def test_a_long_summary_stays_within_the_limit_and_counts_what_is_left() -> None:
    logs = [gated(f"{k}.ulg", *(outcome(f"f{n}", sentence="x" * 200) for n in range(60))) for k in range(200)]
    text = summary(logs)
    assert 0.9 * MAX_SUMMARY_BYTES < len(text.encode()) < MAX_SUMMARY_BYTES
    shown = text.count("xxx |")
    assert f"... and {12_000 - shown:,} more failures: the reports of these logs show them." in text
    few = summary(logs[:1])
    assert "... and 10 more failures" in few  # of one log so many are kept
