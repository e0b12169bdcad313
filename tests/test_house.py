"""The house keeps its shape: who may import whom, and what stays out of the start of the program."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import attlog

PACKAGE = Path(attlog.__file__).parent
EVERYWHERE = {"errors", "limits", "output", "numbers"}
"""Without imports of their own from the package; anybody may use them."""
SENSORS = {"flight", "rotation", "earth"}
ANALYSIS = SENSORS | {
    "formats",
    "estimators",
    "segments",
    "reference",
    "audit",
    "metrics",
    "health",
    "config",
    "result",
}
MAY_IMPORT = {room: set() for room in EVERYWHERE} | {
    "rotation": set(),
    "earth": set(),
    "formats": set(),
    "flight": {"formats", "rotation", "earth"},
    "estimators": {"rotation"},
    "segments": SENSORS,
    "reference": SENSORS | {"segments", "estimators"},
    "audit": SENSORS | {"segments", "reference"},
    "metrics": SENSORS | {"segments", "reference", "estimators"},
    "config": {"estimators"},
    "result": {"flight", "segments", "reference", "metrics", "audit"},
    "schema": {"result"},
    "summary": {"flight", "segments"},
    "verdicts": {"result", "metrics"},
    "report": {"result", "metrics", "verdicts"},
    "testing": {"estimators", "rotation"},
    "analysis": ANALYSIS | {"summary", "verdicts"},
    "inspection": ANALYSIS | {"summary"},
    "extraction": ANALYSIS | {"summary", "analysis"},
    "cli": ANALYSIS | {"analysis", "summary", "inspection", "extraction", "report", "schema", "testing", "verdicts"},
}
LATE_UPWARDS = {("result", "report")}
"""The one import against the flow: ``Result.to_html``."""


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_rooms(path: Path) -> set[str]:
    """First names below ``attlog`` that a file imports, anywhere in it; TYPE_CHECKING blocks count too."""
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names = [f"{node.module}.{a.name}" for a in node.names] if node.module == "attlog" else [node.module]
        rooms |= {n.split(".")[1] for n in names if n.startswith("attlog.")}
    return {r for r in rooms if not r.startswith("__")}


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_file_imports_only_what_its_room_may(path: Path) -> None:
    room = room_of(path)
    if room in ("__init__", "__main__"):
        return
    assert room in MAY_IMPORT, f"{room}: a new room needs a row in this table"
    forbidden = imported_rooms(path) - MAY_IMPORT[room] - EVERYWHERE - {room}
    forbidden -= {target for source, target in LATE_UPWARDS if source == room}
    assert not forbidden, f"{path.relative_to(PACKAGE)} imports {sorted(forbidden)}"


@pytest.mark.parametrize("command", [["--help"], ["--version"], ["analyze", "--help"], ["estimators", "--help"]])
def test_help_imports_nothing_heavy(command: list[str]) -> None:
    heavy = {
        "numpy",
        "scipy",
        "numba",
        "pandas",
        "plotly",
        "pymavlink",
        "pyulog",
        "pyarrow",
        "vqf",
        "jinja2",

    }
    code = (
        f"import sys\nsys.argv = ['attlog', *{command!r}]\n"
        "from attlog.cli import main\n"
        "try:\n    main()\nexcept SystemExit as e:\n    assert not e.code, e.code\n"
        f"print('LOADED', sorted({heavy!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("LOADED []"), done.stdout[-300:]


def test_project_files_name_no_machine() -> None:
    root = PACKAGE.parent
    listed = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    texts = [
        root / f
        for f in listed.stdout.split()
        if (root / f).suffix in (".py", ".md", ".toml", ".html", ".js", ".css", "")
    ]
    roots = ["/" + name + "/" for name in ("work", "root", "farm")]
    found = [
        str(p) for p in texts if p.is_file() and any(r in p.read_text(encoding="utf-8", errors="ignore") for r in roots)
    ]
    assert not found
