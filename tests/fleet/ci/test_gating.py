"""Gates over a run of logs: judged from files, told to the systems that ask."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from junitparser import JUnitXml

from attlog.base.errors import OutputError, UsageError
from attlog.compare.gates.gates import Gates
from attlog.compare.gates.limits import GateLimit
from attlog.compare.gates.sensors import SensorGate
from attlog.fleet.ci.gating import Gating, gating
from attlog.fleet.ci.publish import publish
from attlog.result import Result
from tests.compare.made import result
from tests.fleet.gated import some
from tests.health.assessments.made import MADE
from tests.present.made import lag, row

GATES = "[gates]\nlag_ms = { max = 5 }\n"


def gate_file(folder: Path, text: str = GATES) -> Path:
    (folder / "gates.toml").write_text(text)
    return folder / "gates.toml"


def test_files_are_judged_and_kept_in_the_order_asked_for(tmp_path: Path) -> None:
    found = gating(gate_file(tmp_path))
    assert found is not None
    for name, value in (("b", 9.0), ("a", 1.0)):
        result(row("mekf", lag(value))).to_json(tmp_path / f"{name}.json")
        found.file(f"{name}.ulg", name, tmp_path / f"{name}.json")
    found.broken("c.ulg", "c", 65, "nothing to analyse")
    assert [(j.log, j.failed, j.broken) for j in found.in_order(["a", "b", "c", "never"])] == [
        ("a.ulg", 0, False),
        ("b.ulg", 1, False),
        ("c.ulg", 0, True),
    ]
    assert [j.name for j in found.in_order()] == ["b", "a", "c"]
    assert found.logs["b"].sentences == ("mekf: lag_ms +9 ms (airborne), at most 5 ms",)


def test_a_result_that_cannot_be_read_is_an_error_and_never_passed(tmp_path: Path) -> None:
    found = gating(gate_file(tmp_path))
    assert found is not None
    assert found.file("a.ulg", "a", tmp_path / "none.json").broken
    (tmp_path / "cut.json").write_text("{")
    assert found.file("b.ulg", "b", tmp_path / "cut.json").code == 66


def test_strict_has_the_last_word_on_the_command_line(tmp_path: Path) -> None:
    crashed = result(row("mekf", lag(1.0)), row("mine", {}, status="failed", reason="ImportError"))
    for text, strict, failed in (
        (GATES, None, 2),
        (GATES, False, 1),
        (GATES + "strict = false\n", None, 1),
        (GATES + "strict = false\n", True, 2),
    ):
        found = gating(gate_file(tmp_path, text), strict)
        assert found is not None
        assert found.result("x", "x", crashed).failed == failed, (text, strict)
    alone = gating(None, True)
    assert alone is not None
    assert alone.result("x", "x", crashed).sentences == ("mine failed: ImportError",)
    assert gating(None) is None
    assert gating(None, False) is None


def test_baselines_are_read_beforehand(tmp_path: Path) -> None:
    text = '[gates]\nbaseline = "main.json"\nlag_ms = { max_above_baseline = 2 }\n'
    with pytest.raises(UsageError, match=r"main\.json: cannot be read"):
        gating(gate_file(tmp_path, text))
    result(row("mekf", lag(1.0))).to_json(tmp_path / "main.json")
    found = gating(gate_file(tmp_path, text))
    assert found is not None
    assert found.result("x", "x", result(row("mekf", lag(2.0)))).failed == 0
    assert found.result("x", "x", result(row("mekf", lag(9.0)))).failed == 1


def test_everybody_who_asks_is_told(tmp_path: Path) -> None:
    out, err, step = io.StringIO(), io.StringIO(), tmp_path / "step.md"
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
    assert err.getvalue().count("::error ") == 4
    assert step.read_text(encoding="utf-8").startswith("## ❌")
    out, err = io.StringIO(), io.StringIO()
    publish(some(), environment={"GITHUB_STEP_SUMMARY": str(step)}, out=out, err=err)
    assert out.getvalue() == err.getvalue() == ""


def test_a_file_that_cannot_be_written_keeps_nobody_else_waiting(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    out = io.StringIO()
    with pytest.raises(OutputError):
        publish(some(), tmp_path / "file" / "j.xml", tmp_path / "s.md", environment={}, out=out)
    assert (tmp_path / "s.md").exists()


def test_every_file_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=r"(?s)j\.xml: cannot be written.*s\.md: cannot be written"):
        publish(some(), tmp_path / "file" / "j.xml", tmp_path / "file" / "s.md", environment={})


@pytest.mark.parametrize(("place", "output"), [("out", "out"), ("out/main.json", "out"), (".", "out"), ("out", ".")])
def test_a_baseline_that_the_run_writes_to_is_refused(tmp_path: Path, place: str, output: str) -> None:
    (tmp_path / "out").mkdir()
    result(row("mekf", lag(1.0))).to_json(tmp_path / "out" / "main.json")
    file = gate_file(tmp_path, f'[gates]\nbaseline = "{place}"\nlag_ms = {{ max_above_baseline = 2 }}\n')
    with pytest.raises(UsageError, match="compared with themselves"):
        gating(file, output=tmp_path / output)
    assert gating(file, output=tmp_path.parent / "elsewhere") is not None


def test_gates_of_sensors_fail_a_log_and_stand_in_its_suite_like_others() -> None:
    made = Result({}, "", {}, {}, health=list(MADE))
    gates = Gates(
        strict=False,
        health=(
            SensorGate("compass_offset", (GateLimit("max", 5.0),)),
            SensorGate("vibration_level", worst="ok"),
            SensorGate("gnss_delay", worst="ok", unknown_passes=True),
        ),
    )
    found = Gating(gates).result("a.bin", "a.bin", made)
    assert (found.failed, found.passed, found.skipped) == (1, 1, 1)
    assert found.sentences == ("MAG.0: compass_offset 24.0 µT, at most 5 µT",)
    assert found.suite is not None
    text = found.suite.text()
    assert 'name="MAG.0: health.compass_offset max=5"><failure' in text
    assert 'name="IMU.0: health.vibration_level verdict=ok"/>' in text
    assert 'name="GPS.0: health.gnss_delay verdict=ok"><skipped' in text
