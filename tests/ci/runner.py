"""Runs workflows as GitHub does, step by step: the shell of each ``run``, composite actions, expressions, artifacts.

Only what comes from elsewhere is replaced: pip installs nothing (attlog is here already) but is recorded, ``gh``
copies an artifact, and the actions that GitHub itself offers do what they say with folders.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from tests.conftest import ROOT

EXPRESSION = re.compile(r"\$\{\{\s*(.*?)\s*\}\}")
SHIMS = {
    "python": 'if [ "$1 $2" = "-m pip" ]; then echo "pip ${@:3}" >> "$INSTALLED"; exit 0; fi\nexec "$PYTHON" "$@"\n',
    "pip": 'echo "pip $*" >> "$INSTALLED"\n',
    "attlog": 'exec "$PYTHON" -m attlog "$@"\n',
    "gh": 'echo "gh $*" >> "$INSTALLED"\nif [ "$2" = list ]; then echo 17; exit 0; fi\n'
    '[ "$3" = 17 ] || exit 1\nwhile [ $# -gt 0 ]; do\n'
    'case "$1" in --name) name="$2";; --dir) dir="$2";; esac; shift; done\n'
    'mkdir -p "$dir" && cp -r "$ARTIFACTS/main-$name/." "$dir"\n',
}


@dataclass(slots=True)
class Done:
    """A step that ran."""

    name: str
    code: int
    out: str
    err: str


@dataclass(slots=True)
class Machine:
    """A folder tree that stands for runners and their artifacts; ``event`` is what started the workflow."""

    root: Path
    event: str = "push"
    done: list[Done] = field(default_factory=list)
    conclusions: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("shims", "home", "artifacts", "temp"):
            (self.root / name).mkdir(parents=True)
        for name, script in SHIMS.items():
            (self.root / "shims" / name).write_text(f"#!/bin/bash\n{script}")
            (self.root / "shims" / name).chmod(0o755)
        (self.root / "installed").touch()
        (self.root / "summary.md").touch()

    @property
    def installed(self) -> list[str]:
        """What pip and gh were asked for."""
        return (self.root / "installed").read_text().splitlines()

    @property
    def summary(self) -> str:
        return (self.root / "summary.md").read_text(encoding="utf-8")

    def workflow(self, document: Mapping[str, Any], repository: Path) -> bool:
        """Run every job, in the order in which they need each other. Whether all were green."""
        for name, job in document["jobs"].items():
            needed = job.get("needs", [])
            assert all(self.conclusions[n] == "success" for n in ([needed] if isinstance(needed, str) else needed))
            workspace = self.root / name
            shutil.copytree(repository, workspace)
            green, _ = self.steps(job["steps"], workspace, {}, {})
            self.conclusions[name] = "success" if green else "failure"
        return all(c == "success" for c in self.conclusions.values())

    def steps(
        self, steps: list[Any], workspace: Path, inputs: dict[str, str], action: dict[str, str]
    ) -> tuple[bool, dict[str, Any]]:
        """Run the steps of a job or action. Whether all were green, and their outputs by id."""
        green, outputs = True, {}
        for step in steps:
            context = {
                "inputs": inputs,
                "steps": {k: {"outputs": v} for k, v in outputs.items()},
                "github": {"event_name": self.event, "token": "t", **action},
            }
            condition = str(step.get("if", "success()"))
            if "always()" not in condition:
                condition = f"success() && ({condition})"
            if not evaluated(condition, context, green):
                continue
            own: dict[str, str] = {}
            if "uses" in step:
                with_ = {k: filled(str(v), context) for k, v in step.get("with", {}).items()}
                good, own = self.use(step["uses"], with_, workspace)
            else:
                env = {k: filled(str(v), context) for k, v in step.get("env", {}).items()}
                good = self.run(str(step.get("name", "")), filled(step["run"], context), workspace, env, own)
            outputs[step.get("id", "")] = own
            green = green and good
        return green, outputs

    def run(self, name: str, script: str, workspace: Path, env: dict[str, str], outputs: dict[str, str]) -> bool:
        """Run the shell of a step as GitHub does."""
        (self.root / "temp" / "script.sh").write_text(script)
        told = self.root / "temp" / "output"
        told.write_text("")
        own = {
            "PATH": f"{self.root / 'shims'}:/usr/bin:/bin",
            "HOME": str(self.root / "home"),
            "PYTHON": sys.executable,
            "PYTHONPATH": str(ROOT),
            "INSTALLED": str(self.root / "installed"),
            "GITHUB_ACTIONS": "true",
            "ARTIFACTS": str(self.root / "artifacts"),
            "GITHUB_OUTPUT": str(told),
            "GITHUB_STEP_SUMMARY": str(self.root / "summary.md"),
            "GITHUB_WORKSPACE": str(workspace),
            "XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache")),
            "LANG": "C.UTF-8",
        }
        threads = {k: v for k, v in os.environ.items() if k.endswith("_NUM_THREADS")}
        command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", str(self.root / "temp" / "script.sh")]
        ran = subprocess.run(
            command,
            cwd=workspace,
            env=own | threads | env,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
            timeout=300,
        )
        self.done.append(Done(name, ran.returncode, ran.stdout, ran.stderr))
        outputs |= dict(line.split("=", 1) for line in told.read_text().splitlines())
        return ran.returncode == 0

    def use(self, action: str, with_: dict[str, str], workspace: Path) -> tuple[bool, dict[str, str]]:
        """An action: attlog's own from its file, GitHub's by what they say of themselves."""
        name, _, version = action.partition("@")
        assert version, f"{action}: no version"
        if name == "attlog/attlog":
            document = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
            known = document["inputs"]
            assert set(with_) <= set(known), f"unknown inputs {set(with_) - set(known)}"
            assert all(k in with_ for k, v in known.items() if v.get("required"))
            inputs = {k: v.get("default", "") for k, v in known.items()} | with_
            green, outputs = self.steps(document["runs"]["steps"], workspace, inputs, {"action_path": str(ROOT)})
            context = {"steps": {k: {"outputs": v} for k, v in outputs.items()}}
            return green, {k: filled(v["value"], context) for k, v in document["outputs"].items()}
        if name == "actions/upload-artifact":
            shutil.copytree(workspace / with_["path"], self.root / "artifacts" / with_["name"])
        elif name == "actions/download-artifact":
            shutil.copytree(self.root / "artifacts" / with_["name"], workspace / with_["path"], dirs_exist_ok=True)
        else:
            assert name in ("actions/checkout", "actions/setup-python"), name
        return True, {}


def filled(text: str, context: Mapping[str, Any]) -> str:
    """The text with its expressions put in."""
    return EXPRESSION.sub(lambda found: str(evaluated(found[1], context)), text)


def evaluated(expression: str, context: Mapping[str, Any], green: bool = True) -> Any:
    """The value of an expression: names, texts, ``== != && || !`` and the functions always and success."""
    tokens = re.findall(r"'[^']*'|[\w.-]+\(\)|[\w.-]+|==|!=|&&|\|\||[!()]", expression)
    words = {"&&": "and", "||": "or", "!": "not", "always()": "True", "success()": str(green)}

    def python(token: str) -> str:
        if token in words:
            return words[token]
        if token[0] == "'" or token in ("==", "!=", "(", ")"):
            return token
        value: Any = context
        for part in token.split("."):
            value = value.get(part, "") if isinstance(value, Mapping) else ""
        return repr(str(value))

    return eval(" ".join(map(python, tokens)), {"__builtins__": {}})
