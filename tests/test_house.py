"""The house keeps its shape: who may import whom, and what stays out of the start of the program."""

from __future__ import annotations

import ast
import functools
import re
import subprocess
import sys
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import attlog

PACKAGE = Path(attlog.__file__).parent
EVERYWHERE = {"base", "kernels"}
"""Importable by all; they import only each other."""
ROW = re.compile(r"^\| `([\w.]+)` \| [^|]+ \| ([^|]*)\|$", re.MULTILINE)
HOUSE = (PACKAGE.parent / "docs" / "house.md").read_text(encoding="utf-8")
ROOMS_TABLE = HOUSE.partition("## Rooms")[2].partition("## ")[0]
MAY_IMPORT = {room: set(re.findall(r"`([\w.]+)`", others)) for room, others in ROW.findall(ROOMS_TABLE)}
"""What each row of the docs' table may import, beside EVERYWHERE and itself."""
LATE_UPWARDS = {("result", "report")}
"""The one import against the flow: of ``Result.to_html`` and ``Result.figure``."""


def module_of(path: Path) -> str:
    """The dotted name of a file below ``attlog``; a package's ``__init__`` is the package."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


@functools.cache
def parsed(path: Path) -> ast.Module:
    """A file's syntax."""
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def imported(path: Path) -> set[str]:
    """Dotted modules below ``attlog`` that a file imports, anywhere in it; TYPE_CHECKING blocks count too."""
    found: set[str] = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found |= {f"{node.module}.{a.name}" for a in node.names}
    known = {n.removeprefix("attlog.") for n in found if n.startswith("attlog.")}
    return {m for n in known for m in (n, n.rpartition(".")[0]) if m in MODULES}


MODULES = {module_of(p): p for p in sorted(PACKAGE.rglob("*.py"))}


def within(module: str, rooms: set[str]) -> bool:
    return any(module == room or module.startswith(room + ".") for room in rooms)


def room_of(module: str) -> str:
    """The longest row of the table that the module stands in."""
    return max((room for room in MAY_IMPORT if within(module, {room})), key=len, default="")


def test_a_file_imports_only_what_its_room_may() -> None:
    wrong = {}
    for module in MODULES.keys() - {"__init__", "__main__"}:
        room = room_of(module)
        assert room, f"{module}: a new room needs a row in this table"
        allowed = MAY_IMPORT[room] | EVERYWHERE | {room} | {up for source, up in LATE_UPWARDS if source == room}
        imports = imported(MODULES[module])
        if forbidden := {m for m in imports if m != room.partition(".")[0] and not within(m, allowed)}:
            wrong[module] = sorted(forbidden)
    assert not wrong


def test_the_table_of_rooms_names_every_file() -> None:
    assert len(MAY_IMPORT) > 30
    assert not [m for m in MODULES if m not in ("__init__", "__main__") and not room_of(m)]
    unknown = {name for others in MAY_IMPORT.values() for name in others} | set(MAY_IMPORT)
    assert not [name for name in unknown if name not in MODULES]


def test_no_folder_holds_more_than_fifteen_files() -> None:
    """A reader guesses the file from the question; the filters are a list, one file each."""
    files = Counter(path.parent for path in MODULES.values() if path.parent.name != "filters")
    assert not {str(folder): n for folder, n in files.items() if n > 15}


def test_no_class_name_stands_for_two_things() -> None:
    trees = [parsed(path) for path in MODULES.values()]
    names = Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))
    assert not [name for name, times in names.items() if times > 1]


def test_the_rooms_form_no_circle() -> None:
    graph = {room.partition(".")[0]: set() for room in MAY_IMPORT}
    for room, others in MAY_IMPORT.items():
        own = room.partition(".")[0]
        graph[own] |= {other.partition(".")[0] for other in others} - {own}
    TopologicalSorter(graph).prepare()


def test_the_files_form_no_circle() -> None:
    """Late imports count as well; only the one of ``LATE_UPWARDS`` is allowed. A package's ``__init__`` gathers."""
    gather = {m for m, p in MODULES.items() if p.name == "__init__.py"}
    graph = {
        module: {m for m in imported(path) - gather - {module} if (module, m.partition(".")[0]) not in LATE_UPWARDS}
        for module, path in MODULES.items()
        if module not in gather
    }
    TopologicalSorter(graph).prepare()


FIRMWARE_WORDS = re.compile(r"PX4|ArduPilot|AHRS_|COMPASS_|SDLOG|LOG_[BD]|INS_|EKF2_|\b(dataflash|ulog|tlog)\b")
ABOVE_FLIGHT = ("segments", "reference", "metrics", "health", "present", "report", "analysis", "inspection", "summary")


def test_knowledge_of_firmwares_ends_at_flight() -> None:
    """No sentence, parameter name or comparison above ``flight`` names a firmware or a format; docstrings may."""
    wrong = {}
    above = [m for m in MODULES if within(m, set(ABOVE_FLIGHT))]
    for module in above:
        nodes = list(ast.walk(parsed(MODULES[module])))
        said = {id(n.value) for n in nodes if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
        texts = [n.value for n in nodes if isinstance(n, ast.Constant) and id(n) not in said]
        if found := [t for t in texts if isinstance(t, str) and FIRMWARE_WORDS.search(t)]:
            wrong[module] = found
    assert len(above) > 100
    assert not wrong


@pytest.mark.parametrize(
    "command", [["--help"], ["--version"], ["analyze", "--help"], ["health", "--help"], ["estimators", "--help"]]
)
def test_help_imports_nothing_heavy(command: list[str]) -> None:
    heavy = {"numpy", "scipy", "numba", "pandas", "plotly", "pymavlink", "pyulog", "pyarrow", "vqf", "jinja2"}
    code = (
        f"import sys\nsys.argv = ['attlog', *{command!r}]\n"
        "from attlog.cli import main\n"
        "try:\n    main()\nexcept SystemExit as e:\n    assert not e.code, e.code\n"
        f"print('LOADED', sorted({heavy!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("LOADED []"), done.stdout[-300:]


NEEDED_BY_NONE = {
    "attlog.compare",
    "attlog.batch.ci",
    "attlog.batch.ci",
    "pandas",
    "plotly",
    "pymavlink",
    "pyulog",
    "rich",
}
NEEDED_BY_NONE |= {"attlog.batch.archive", "scipy.optimize", "scipy.signal"}
NEEDED_BY_NONE |= {"urllib.request", "xml"}
NOT_IN_INFO = {"attlog.cli.commands.analyze", "attlog.estimators.filters", "attlog.estimators.registry"}
NOT_IN_INFO |= {"attlog.metrics.noise"}
NOT_IN_INFO |= {"attlog.report", "attlog.result", "jinja2", "llvmlite", "numba", "scipy"}
NOT_IN_INFO |= {"attlog.core.jit.compile", "json", "logging", "tempfile"}
NEEDED_BY_NONE |= {"pydantic", "importlib.metadata", "email", "socket"}


@pytest.mark.parametrize(
    ("command", "not_needed"),
    [
        (["info"], NOT_IN_INFO),
        (["analyze", "--estimators", "gyro"], {"attlog.cli.commands.sweep", "attlog.estimators.filters.eskf"}),
    ],
    ids=["info", "analyze"],
)
def test_a_command_imports_only_what_it_uses(command: list[str], not_needed: set[str], tmp_path: Path) -> None:
    """Not gates where none are asked for, no terminal's colours where the output is a pipe."""
    log = PACKAGE.parent / "sample_logs" / "px4_steps.ulg"
    where = [] if command == ["info"] else ["-o", str(tmp_path)]
    code = (
        f"import sys\nsys.argv = ['attlog', *{command!r}, {str(log)!r}, *{where!r}]\n"
        "from attlog.cli import main\n"
        "try:\n    main()\nexcept SystemExit as e:\n    assert not e.code, e.code\n"
        f"print('LOADED', sorted({(NEEDED_BY_NONE | not_needed)!r} & set(sys.modules)))"
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


def test_every_definition_that_is_cited_stands_in_the_repository() -> None:
    """No code or page cites a document that a reader of the repository cannot open."""
    outside = re.compile(r"\b(METRICS|DESIGN|LOGS|ESTIMATORS|PERFORMANCE|ECOSYSTEM|STYLE|MEKF|SMOOTHER)(\.md\b| \d)")
    root = PACKAGE.parent
    pages = [
        *PACKAGE.rglob("*.py"),
        *(root / "docs").glob("*.md"),
        *(root / "benchmarks").glob("*.py"),
        root / "README.md",
    ]
    cited = [
        f"{p.relative_to(root)}: {m.group()}" for p in pages for m in outside.finditer(p.read_text(encoding="utf-8"))
    ]
    assert not cited
    named = {(p, m) for p in pages for m in re.findall(r"docs/(\w+\.md)", p.read_text(encoding="utf-8"))}
    assert not [(p.name, page) for p, page in named if not (root / "docs" / page).is_file()]


def test_every_path_of_the_page_about_the_house_exists() -> None:
    """What to touch is found where the page says, below ``attlog`` or the root; NAME, FIRMWARE and ROOM are any."""
    paths = {
        path
        for path in re.findall(r"`([\w./]+(?:\.py|\.js|\.toml|/))`", HOUSE)
        if not re.search("NAME|FIRMWARE|ROOM", path)
    }
    assert len(paths) > 40
    assert not [p for p in sorted(paths) if not (PACKAGE / p).exists() and not (PACKAGE.parent / p).exists()]
