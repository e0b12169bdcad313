"""What the documents show works: the notebook runs, and every command of the README exists."""

from __future__ import annotations

import json
import re
import shlex

import pytest

from tests.conftest import ROOT


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "docs")
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads((ROOT / "docs" / "library.ipynb").read_text(encoding="utf-8"))
    names: dict[str, object] = {}
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    assert len(cells) > 5
    for number, cell in enumerate(cells):
        exec(compile(cell, f"cell {number}", "exec"), names)


def test_the_notebook_is_committed_as_it_ran_with_its_pictures() -> None:
    path = ROOT / "docs" / "library.ipynb"
    cells = [c for c in json.loads(path.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    assert [c["execution_count"] for c in cells] == list(range(1, len(cells) + 1))
    outputs = [o for c in cells for o in c["outputs"]]
    assert [o for o in outputs if o["output_type"] == "error" or o.get("name") == "stderr"] == []
    assert sum("image/png" in o.get("data", {}) for o in outputs) == 2
    assert path.stat().st_size < 300_000
    texts = [json.dumps(o) for o in outputs if "image/png" not in o.get("data", {})]
    assert not [t for t in texts if re.search(r"/(home|root|tmp|work)/", t)]


def commands(document: str) -> list[str]:
    text = (ROOT / document).read_text(encoding="utf-8")
    blocks = re.findall(r"```console\n(.*?)```", text, re.S)
    lines = [line.split("#")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("attlog ")]


@pytest.mark.parametrize("line", commands("README.md"))
def test_every_option_of_the_readme_exists(attlog, line: str) -> None:
    _, command, *arguments = shlex.split(line)
    help_text = attlog(command, "--help").out
    for option in (a for a in arguments if a.startswith("-") and a != "-"):
        assert option in help_text, (command, option)


PAGES = [
    p.relative_to(ROOT).as_posix() for p in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/*.md")]
]


def named() -> dict[str, set[str]]:
    """What the pages name within their sentences, as `attlog COMMAND --option`: options by command, with the place."""
    found: dict[str, set[str]] = {}
    for page in PAGES:
        prose = re.sub(r"^```.*?^```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.S | re.M)
        for command, rest in re.findall(r"`attlog ([a-z-]+)( [^`]*)?`", prose):
            options = re.findall(r"(?<=\s)--[a-z][a-z-]*", rest)
            found.setdefault(command, set()).update(f"{page}: {option}" for option in options or [""])
    return found


@pytest.mark.parametrize("command", sorted(named()))
def test_every_command_and_option_that_a_sentence_names_exists(attlog, command: str) -> None:
    """Those in code blocks are run by ``test_docs_commands.py``."""
    told = attlog(command, "--help")
    assert told.code == 0, named()[command]
    assert [each for each in named()[command] if each.partition(": ")[2] not in told.out] == []
