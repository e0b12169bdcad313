"""The scripts of the action and of docs/ci.md run in bash: green, red, without logs, with strange input."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from junitparser import JUnitXml

from attlog.compare import gate_file
from tests.conftest import ROOT, SAMPLES, few

PAGE = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
EXPRESSION = re.compile(r"\$\{\{\s*(.*?)\s*\}\}")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)


@dataclass(slots=True)
class Done:
    """What a script left: exit code, everything printed, outputs of the step, summary of the job."""

    code: int
    said: str
    outputs: dict[str, str] = field(default_factory=dict)
    summary: str = ""


class Repository:
    """What a user commits: logs and gates as the page says. pip installs nothing but is recorded."""

    def __init__(self, root: Path) -> None:
        self.root, self.shims, self.beside = root / "repository", root / "shims", root
        (self.root / "logs").mkdir(parents=True)
        shutil.copy(SAMPLES / "px4_steps.ulg", self.root / "logs" / "a flight.ulg")
        (self.root / "gates.toml").write_text(blocks("toml")[0])
        record = 'echo "pip $*" >> "$INSTALLED"'
        self.shims.mkdir()
        for name, script in {
            "python": f'if [ "$1 $2" = "-m pip" ]; then shift 2; {record}; exit 0; fi\nexec "{sys.executable}" "$@"',
            "pip": record,
            "attlog": f'exec "{sys.executable}" -m attlog "$@"',
        }.items():
            (self.shims / name).write_text(f"#!/bin/bash\n{script}\n")
            (self.shims / name).chmod(0o755)

    def run(self, script: str, env: dict[str, str], on_github: bool = True) -> Done:
        """Run the shell of a step as GitHub does, or as any other system."""
        output, summary = self.beside / "output", self.beside / "summary.md"
        output.write_text("")
        summary.write_text("")
        own = {k: v for k, v in os.environ.items() if not k.startswith("GITHUB_")}
        own |= {"PATH": f"{self.shims}:/usr/bin:/bin", "PYTHONPATH": str(ROOT), "INSTALLED": str(self.beside / "pip")}
        if on_github:
            own |= {"GITHUB_ACTIONS": "true", "GITHUB_OUTPUT": str(output), "GITHUB_STEP_SUMMARY": str(summary)}
            own |= {"GITHUB_WORKSPACE": str(self.root)}
        command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script]
        ran = subprocess.run(command, cwd=self.root, env=own | env, capture_output=True, text=True, timeout=300)
        outputs = dict(line.split("=", 1) for line in output.read_text().splitlines())
        return Done(ran.returncode, ran.stdout + ran.stderr, outputs, summary.read_text(encoding="utf-8"))

    def step(self, name: str, **inputs: str) -> Done:
        """Run a step of the action; its scripts take inputs by the environment alone."""
        (step,) = [s for s in ACTION["runs"]["steps"] if s["name"] == name]
        values = {f"inputs.{k}": inputs.get(k, v.get("default", "")) for k, v in ACTION["inputs"].items()}
        values["github.action_path"] = str(ROOT)
        return self.run(step["run"], {k: EXPRESSION.sub(lambda f: values[f[1]], v) for k, v in step["env"].items()})

    @property
    def installed(self) -> list[str]:
        return (self.beside / "pip").read_text().splitlines()


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    return Repository(tmp_path)


@pytest.mark.parametrize(("version", "what"), [("", f"{ROOT}[export,remote]"), ("9.9", "attlog[export,remote]==9.9")])
def test_the_action_installs_the_version_asked_for_else_its_own(
    repository: Repository, version: str, what: str
) -> None:
    assert repository.step("Install attlog", version=version).code == 0
    assert repository.installed == [f"pip install --quiet {what}"]


@pytest.mark.slow
def test_a_run_is_green_with_its_report_and_red_where_a_gate_fails(repository: Repository) -> None:
    inputs = {
        "logs": "\n  logs/*.ulg  \n\n",
        "gates": "gates.toml",
        "options": "--estimators\nmekf,gyro",
        "report": "my report",
    }
    done = repository.step("Analyse", **inputs)
    assert done.code == 0, done.said
    assert done.outputs == {"report": "my report", "junit": "my report/junit.xml", "exit-code": "0"}
    assert done.summary.startswith("## ✅ attlog: 1 log, no gate failed")
    assert "::error" not in done.said
    report = repository.root / "my report"
    assert {"a flight.ulg.html", "a flight.ulg.json", "index.html", "junit.xml"} <= {p.name for p in report.iterdir()}
    (repository.root / "gates.toml").write_text("[gates]\nlag_ms = { max = 5 }\ntilt_p95_deg = { max = 0.01 }\n")
    done = repository.step("Analyse", **inputs)
    assert (done.code, done.outputs["exit-code"]) == (1, "1")
    assert done.summary.startswith("## ❌ attlog: 1 of 1 log failed")
    assert [(s.errors, s.failures > 0) for s in JUnitXml.fromfile(str(report / "junit.xml"))] == [(0, True)]
    marks = [line for line in done.said.splitlines() if line.startswith("::error ")]
    assert marks
    assert all("file=logs/a flight.ulg," in line and "tilt_p95_deg max=0.01" in line for line in marks)


@pytest.mark.slow
@pytest.mark.parametrize("system", ["GitHub by hand", "GitLab"])
def test_the_commands_of_the_page_run_on_any_system(repository: Repository, system: str) -> None:
    documents = {d.get("name", "GitLab"): d for d in map(yaml.safe_load, blocks("yaml"))}
    if system == "GitLab":
        script = "\n".join(documents["GitLab"]["attitude"]["script"])
    else:
        steps = documents["attitude by hand"]["jobs"]["attitude"]["steps"]
        script = "\n".join(step["run"] for step in steps if "run" in step)
    done = repository.run(script, {}, on_github=system != "GitLab")
    assert done.code == 0, done.said
    own = repository.root / "report" / "summary.md"
    assert (done.summary or own.read_text(encoding="utf-8")).startswith("## ✅")
    assert JUnitXml.fromfile(str(repository.root / "report" / "junit.xml"))
    assert "::error" not in done.said


@pytest.mark.parametrize(
    ("inputs", "code", "word"),
    few(
        [
            ({"logs": " \n "}, 2, "the input logs is empty"),
            ({"logs": "nowhere/*.ulg"}, 66, "no file matches"),
            ({"logs": "gates.toml"}, 65, "gates.toml"),
            ({"logs": "logs", "gates": "none.toml"}, 2, "none.toml: no such file"),
            ({"logs": "$(touch broken)`touch broken`;touch broken"}, 66, ""),
        ],
        1,
    ),
)
def test_what_goes_wrong_is_red_with_its_own_code(
    repository: Repository, inputs: dict[str, str], code: int, word: str
) -> None:
    done = repository.step("Analyse", **inputs)
    assert done.code == code, done.said
    assert word in done.said
    assert not (repository.root / "broken").exists()


@pytest.mark.parametrize("text", blocks("toml"))
def test_every_gate_file_of_the_page_is_one(tmp_path: Path, text: str) -> None:
    assert tomllib.loads(text)["gates"]
    (tmp_path / "gates.toml").write_text(text)
    found = gate_file.read_gates(tmp_path / "gates.toml")
    assert found.gates or found.health


# The shape of the action and of the workflows that are shown: what GitHub's metadata and workflow syntax ask for.

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
