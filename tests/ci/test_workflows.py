"""The workflows of docs/ci.md and the action run step by step: green, red, without logs, with strange input."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from junitparser import JUnitXml

from attlog.compare import gate_file
from tests.ci.runner import EXPRESSION, Machine
from tests.conftest import ROOT, SAMPLES, few

PAGE = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)


def workflow(name: str) -> dict[str, Any]:
    (found,) = [d for d in map(yaml.safe_load, blocks("yaml")) if d.get("name") == name]
    return found


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """What a user commits: logs and gates as the page says, and a script that flies."""
    folder = tmp_path / "repository"
    (folder / "logs").mkdir(parents=True)
    shutil.copy(SAMPLES / "px4_steps.ulg", folder / "logs" / "a flight.ulg")
    (folder / "gates.toml").write_text(blocks("toml")[0])
    (folder / "fly_all.sh").write_text('#!/bin/bash\nmkdir -p "$1"\n')
    (folder / "fly_all.sh").chmod(0o755)
    return folder


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path / "machine")


def impossible(repository: Path) -> None:
    (repository / "gates.toml").write_text("[gates]\nlag_ms = { max = 5 }\ntilt_p95_deg = { max = 0.01 }\n")


@pytest.mark.slow
def test_ten_lines_are_green_with_the_report_attached(machine: Machine, repository: Path) -> None:
    assert len(blocks("yaml")[0].splitlines()) <= 10
    assert machine.workflow(workflow("attitude"), repository), machine.done
    artifact = machine.root / "artifacts" / "attlog-report"
    assert {"a flight.ulg.html", "a flight.ulg.json", "index.html", "junit.xml"} <= {p.name for p in artifact.iterdir()}
    assert machine.summary.startswith("## ✅ attlog: 1 log, no gate failed")
    assert not [line for d in machine.done for line in (d.out + d.err).splitlines() if line.startswith("::error")]
    assert machine.installed == [f"pip install --quiet {ROOT}[export,remote]"]


@pytest.mark.slow
def test_ten_lines_are_red_where_a_gate_fails_and_the_report_is_attached_all_the_same(
    machine: Machine, repository: Path
) -> None:
    impossible(repository)
    assert not machine.workflow(workflow("attitude"), repository)
    assert machine.done[-1].code == 1
    artifact = machine.root / "artifacts" / "attlog-report"
    suites = list(JUnitXml.fromfile(str(artifact / "junit.xml")))
    assert [(s.errors, s.failures > 3) for s in suites] == [(0, True)]
    assert machine.summary.startswith("## ❌ attlog: 1 of 1 log failed")
    marks = [line for line in machine.done[-1].err.splitlines() if line.startswith("::error ")]
    assert marks
    assert all("file=logs/a flight.ulg," in line and "tilt_p95_deg max=0.01" in line for line in marks)


@pytest.mark.slow
def test_logs_of_another_job(machine: Machine, repository: Path) -> None:
    document = workflow("simulated flights")
    (repository / "my_filter.py").write_text((ROOT / "attlog" / "estimators" / "filters" / "mahony.py").read_text())
    options = document["jobs"]["attitude"]["steps"][-1]["with"]
    assert options["options"] == "--estimators mekf,my_filter.py --reference truth"
    options["options"] = "--estimators mekf --reference truth"
    assert machine.workflow(document, repository), machine.done
    result = json.loads((machine.root / "artifacts" / "attlog-report" / "a flight.ulg.json").read_text())
    assert result["config"]["estimators"] == ["mekf"]
    assert result["reference"]["choice"] == "truth"


@pytest.mark.slow
def test_by_hand(machine: Machine, repository: Path) -> None:
    assert machine.workflow(workflow("attitude by hand"), repository), machine.done
    assert machine.summary.startswith("## ✅")
    assert (machine.root / "artifacts" / "attlog-report" / "index.html").exists()


@pytest.mark.slow
def test_gitlab(machine: Machine, repository: Path) -> None:
    (document,) = [d["attitude"] for d in map(yaml.safe_load, blocks("yaml")) if "attitude" in d]
    impossible(repository)
    script = "\n".join(document["script"])
    assert not machine.run("gitlab", script, repository, {"GITHUB_ACTIONS": "", "GITHUB_STEP_SUMMARY": ""}, {})
    assert JUnitXml.fromfile(str(repository / document["artifacts"]["reports"]["junit"]))
    assert (repository / "report" / "summary.md").read_text(encoding="utf-8").startswith("## ❌")
    assert "::error" not in machine.done[-1].err


@pytest.mark.slow
def test_beside_main(tmp_path: Path, repository: Path) -> None:
    document = workflow("attitude beside main")
    (repository / "beside-main.toml").write_text(next(b for b in blocks("toml") if 'baseline = "main"' in b))
    options = document["jobs"]["attitude"]["steps"][-1]["with"]
    options["options"] = "--estimators mahony --reference truth"
    main = Machine(tmp_path / "main")
    assert main.workflow(document, repository), main.done
    for gain, green in ((0.45, True), (3.0, False)):
        pull = Machine(tmp_path / f"pull{gain}", event="pull_request")
        shutil.copytree(main.root / "artifacts" / "attlog-report", pull.root / "artifacts" / "main-attlog-report")
        options["options"] = f"--estimators mahony:kp={gain} --reference truth"
        assert pull.workflow(document, repository) is green, (gain, pull.summary)
        assert any("run download 17" in line for line in pull.installed)
    assert "tilt\\_rmse\\_deg not worse than baseline" in pull.summary


@pytest.mark.slow
def test_the_action_takes_lines_patterns_and_versions(machine: Machine, repository: Path) -> None:
    shutil.copy(SAMPLES / "px4_hover.ulg", repository / "other.ulg")
    inputs = {
        "logs": "\n  logs/*.ulg  \n\nother.ulg\n",
        "options": "--estimators\ngyro",
        "version": "9.9",
        "artifact": "",
        "report": "my report",
    }
    green, outputs = machine.use("attlog/attlog@main", inputs, repository)
    assert green, machine.done
    assert machine.installed == ["pip install --quiet attlog[export,remote]==9.9"]
    assert outputs == {"report": "my report", "junit": "my report/junit.xml", "exit-code": "0"}
    assert {s.name for s in JUnitXml.fromfile(str(repository / "my report" / "junit.xml"))} == {
        "logs/a flight.ulg",
        "other.ulg",
    }
    assert list((machine.root / "artifacts").iterdir()) == []


@pytest.mark.parametrize(
    ("inputs", "code", "word"),
    few(
        [
            ({"logs": " \n "}, 2, "the input logs is empty"),
            ({"logs": "nowhere/*.ulg"}, 66, "no file matches"),
            ({"logs": "gates.toml"}, 65, "gates.toml"),
            ({"logs": "logs", "gates": "none.toml"}, 2, "none.toml: cannot be read"),
            ({"logs": "$(touch broken)`touch broken`;touch broken"}, 66, ""),
        ],
        1,
    ),
)
def test_what_goes_wrong_is_red_with_its_own_code(
    machine: Machine, repository: Path, inputs: dict[str, str], code: int, word: str
) -> None:
    green, _ = machine.use("attlog/attlog@main", inputs | {"version": "none", "artifact": ""}, repository)
    assert not green
    assert machine.done[-1].code == code, machine.done
    assert word in machine.done[-1].out + machine.done[-1].err
    assert not (repository / "broken").exists()


@pytest.mark.parametrize("text", blocks("toml"))
def test_every_gate_file_of_the_page_is_one(tmp_path: Path, text: str) -> None:
    assert tomllib.loads(text)["gates"]
    (tmp_path / "gates.toml").write_text(text)
    found = gate_file.read_gates(tmp_path / "gates.toml")
    assert found.gates or found.health


# The shape of the action and of the workflows that are shown: what GitHub's metadata and workflow syntax ask for.

ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
OF_ACTION = {"name", "author", "description", "inputs", "outputs", "runs", "branding"}
OF_STEP = {"name", "id", "if", "run", "shell", "env", "uses", "with", "working-directory", "continue-on-error"}
OF_JOB = {"name", "needs", "runs-on", "steps", "if", "env", "strategy", "permissions", "timeout-minutes"}
COLORS = {"white", "black", "yellow", "blue", "green", "orange", "red", "purple", "gray-dark"}
WORKFLOWS = [d for d in map(yaml.safe_load, blocks("yaml")) if "jobs" in d]


def check_steps(steps: list[dict[str, Any]]) -> None:
    for step in steps:
        assert set(step) <= OF_STEP, step
        assert ("run" in step) != ("uses" in step), step
        if "uses" in step:
            assert re.fullmatch(r"[\w-]+/[\w-]+@(v\d+|main)", step["uses"]), step
            assert "shell" not in step
        else:
            assert "with" not in step
            assert not EXPRESSION.search(step["run"]), "an expression in a script lets its text run"


def test_the_action_has_what_a_composite_action_needs() -> None:
    assert set(ACTION) <= OF_ACTION
    assert all(isinstance(ACTION[k], str) for k in ("name", "description"))
    assert set(ACTION["branding"]) == {"icon", "color"}
    assert ACTION["branding"]["color"] in COLORS
    assert ACTION["runs"].keys() == {"using", "steps"}
    assert ACTION["runs"]["using"] == "composite"
    check_steps(ACTION["runs"]["steps"])
    assert all("shell" in step for step in ACTION["runs"]["steps"] if "run" in step)
    for name, entry in ACTION["inputs"].items():
        assert re.fullmatch(r"[a-z][a-z-]*", name)
        assert set(entry) <= {"description", "required", "default", "deprecationMessage"}
        assert entry["description"]
        assert entry.get("required") is True or isinstance(entry["default"], str), "GitHub hands on texts"
    for name, entry in ACTION["outputs"].items():
        assert set(entry) == {"description", "value"}, name


def test_every_expression_of_the_action_names_something_that_is_there() -> None:
    text = (ROOT / "action.yml").read_text(encoding="utf-8")
    conditions = " ".join(str(step.get("if", "")) for step in ACTION["runs"]["steps"])
    used = " ".join(EXPRESSION.findall(text)) + " " + conditions
    assert set(re.findall(r"inputs\.([\w-]+)", used)) == set(ACTION["inputs"])
    ids = {step["id"]: step for step in ACTION["runs"]["steps"] if "id" in step}
    for step, output in re.findall(r"steps\.([\w-]+)\.outputs\.([\w-]+)", used):
        assert f'"{output}=' in ids[step]["run"]
    assert set(re.findall(r"\b(inputs|github|steps|env|secrets)\.", used)) <= {"inputs", "github", "steps"}


@pytest.mark.parametrize("document", WORKFLOWS, ids=lambda d: d["name"])
def test_a_workflow_of_the_page_has_what_github_needs(document: dict[Any, Any]) -> None:
    assert set(document) <= {"name", True, "permissions", "jobs"}  # YAML 1.1 takes the key on for a truth value
    events = document[True]
    assert set([events] if isinstance(events, str) else events) <= {"push", "pull_request"}
    for job in document["jobs"].values():
        assert set(job) <= OF_JOB
        assert job["runs-on"] == "ubuntu-latest"
        needs = job.get("needs", [])
        assert {needs} if isinstance(needs, str) else set(needs) <= set(document["jobs"])
        check_steps(job["steps"])
        for step in job["steps"]:
            if step.get("uses", "").startswith("attlog/"):
                assert set(step["with"]) <= set(ACTION["inputs"])
                assert all(name in step["with"] for name, entry in ACTION["inputs"].items() if entry.get("required"))
