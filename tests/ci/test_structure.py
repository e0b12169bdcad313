"""The shape of the action and of the workflows that are shown: what GitHub's metadata and workflow syntax ask for."""

from __future__ import annotations

import re
from typing import Any

import pytest
import yaml

from tests.ci.runner import EXPRESSION
from tests.ci.test_workflows import blocks
from tests.conftest import ROOT

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


def test_there_is_a_workflow_of_every_kind() -> None:
    assert [d["name"] for d in WORKFLOWS] == [
        "attitude",
        "simulated flights",
        "attitude by hand",
        "attitude beside main",
    ]
