"""Shape of the package: which room may import which, what stays out of the start of the program."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import attlog

PACKAGE = Path(attlog.__file__).parent
ROOT = PACKAGE.parent
FLOW = (
    *("core", "formats", "flight", "estimators", "segments", "story", "reference", "external", "metrics", "health"),
    *(
        "result",
        "words",
        "report",
        "pipeline",
        "compare",
        "batch",
        "simulate",
        "reproduce",
        "testing",
        "assistants",
        "cli",
    ),
)
# Against the flow: compiled objects name the kernels to build, a result draws itself, and a filter that flew runs on a
# whole log.
UPWARDS = {
    *(("core", room) for room in ("formats", "estimators", "segments", "metrics", "simulate")),
    ("result", "report"),
    ("estimators", "pipeline"),
}
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}


def imports(path: Path) -> set[str]:
    """Modules of attlog that a file imports, anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in found if name in MODULES}


def room(module: str) -> str:
    return module.split(".")[1]


def test_rooms_import_only_what_comes_before_them() -> None:
    wrong = set()
    for module, path in MODULES.items():
        if path.parent == PACKAGE:
            continue
        for other in imports(path) - {"attlog"}:
            if FLOW.index(room(other)) > FLOW.index(room(module)) and (room(module), room(other)) not in UPWARDS:
                wrong.add(f"{module} imports {other}")
    assert not sorted(wrong)


def loaded(command: list[str], modules: set[str]) -> str:
    """Those of the modules that are imported after a command."""
    code = (
        f"import sys\nsys.argv = ['attlog', *{command!r}]\nfrom attlog.cli import main\n"
        "try:\n    main()\nexcept SystemExit as e:\n    assert not e.code, e.code\n"
        f"print('LOADED', *sorted({modules!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.rpartition("LOADED")[2].strip()


@pytest.mark.parametrize("command", [["--help"], ["analyze", "--help"], ["simulate", "--help"]], ids=" ".join)
def test_help_imports_nothing_heavy(command: list[str]) -> None:
    heavy = {
        "numpy",
        "scipy",
        "llvmlite",
        "numba",
        "pandas",
        "plotly",
        "pymavlink",
        "pyulog",
        "pyarrow",
        "attlog.simulate",
    }
    assert loaded(command, heavy) == ""


@pytest.mark.parametrize("command", [["info"], ["analyze", "--estimators", "gyro", "-o"]], ids=lambda words: words[0])
def test_a_command_imports_no_library_that_it_does_not_need(command: list[str], tmp_path: Path) -> None:
    heavy = {"numba", "pandas", "scipy.signal", "scipy.optimize", "pymavlink", "pyulog", "pyarrow"}
    heavy |= {"attlog.report.page"} if command == ["info"] else set()
    where = [str(tmp_path)] if command[-1] == "-o" else []
    assert loaded([*command, *where, str(ROOT / "sample_logs" / "px4_steps.ulg")], heavy) == ""


def test_project_files_name_no_machine() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    kinds = (".py", ".md", ".toml", ".html", ".js", ".css", "")
    files = [ROOT / name for name in listed.stdout.split() if Path(name).suffix in kinds]
    machine = re.compile("/" + "(work|root|farm)/")
    assert not [str(p) for p in files if p.is_file() and machine.search(p.read_text("utf-8", errors="ignore"))]


def test_every_page_that_is_cited_is_in_the_repository() -> None:
    outside = re.compile(r"\b(METRICS|DESIGN|LOGS|ESTIMATORS|PERFORMANCE|ECOSYSTEM|STYLE|MEKF|SMOOTHER)(\.md\b| \d)")
    folders = (PACKAGE.rglob("*.py"), (ROOT / "docs").glob("*.md"), (ROOT / "benchmarks").glob("*.py"))
    texts = {p: p.read_text(encoding="utf-8") for pages in (*folders, [ROOT / "README.md"]) for p in pages}
    assert not [f"{p.name}: {m.group()}" for p, text in texts.items() for m in outside.finditer(text)]
    cited = {(p.name, name) for p, text in texts.items() for name in re.findall(r"docs/(\w+\.md)", text)}
    assert not [pair for pair in cited if not (ROOT / "docs" / pair[1]).is_file()]


def test_every_path_of_the_page_about_the_house_exists() -> None:
    page = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    paths = {p for p in re.findall(r"`([\w./]+(?:\.py|\.js|\.toml|/))`", page) if not re.search("NAME|ROOM", p)}
    assert not [p for p in sorted(paths) if not (PACKAGE / p).exists() and not (ROOT / p).exists()]
