"""What the documents show works: the notebook runs, and every command of the README exists."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest

import attlog
from tests.conftest import ROOT, SAMPLES


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In an empty folder, as after an installation without the repository."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads((ROOT / "docs" / "library.ipynb").read_text(encoding="utf-8"))
    names: dict[str, object] = {}
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    assert len(cells) > 5
    for number, cell in enumerate(cells):
        exec(compile(cell, f"cell {number}", "exec"), names)


def test_the_notebook_imports_what_its_extra_installs() -> None:
    notebook = json.loads((ROOT / "docs" / "library.ipynb").read_text(encoding="utf-8"))
    code = "\n".join("".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code")
    imported = {name.partition(".")[0] for name in re.findall(r"^(?:import|from) ([\w.]+)", code, re.M)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extra = project["optional-dependencies"]["notebook"]
    installed = {re.split(r"[<>=\[ ]", word)[0] for word in [*project["dependencies"], *extra]}
    assert imported - installed - set(sys.stdlib_module_names) == {"attlog"}
    assert {"ipykernel", "nbformat"} <= installed  # the kernel, and what plotly draws a figure with
    assert "sample_logs" not in code


USER_PAGES = [
    p.relative_to(ROOT).as_posix() for p in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/*.md")]
]


def named() -> dict[str, set[str]]:
    """What the pages name within their sentences, as `attlog COMMAND --option`: options by command, with the place."""
    found: dict[str, set[str]] = {}
    for page in USER_PAGES:
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


# Every command and every Python example that the documents show is run, in a folder that holds what they name.

DOCUMENTS = sorted(p.relative_to(ROOT).as_posix() for p in [*ROOT.glob("docs/*.md"), *ROOT.glob("*.md")])
DOCUMENTS.remove("CHANGELOG.md")

ELSEWHERE = {
    "make demo": "changes the installation; .ci/run installs and calls make",
    "make check": "changes the installation; .ci/run installs and calls make",
    "make test": "changes the installation; .ci/run installs and calls make",
    "make example": "changes the repository; a test compares the versions",
    "make fuzz": "ten minutes; tests/fuzz runs some seconds of it",
    "python3 -m venv": "changes the installation; tests/test_package.py installs the wheel",
    "venv/bin/pip install": "changes the installation; tests/test_package.py installs the wheel",
    "pip install": "changes the installation; tests/test_package.py installs the wheel",
    "attlog --install-completion": "changes the user's shell; tests/cli/test_options.py",
    "attlog sweep copter_4.5.7_gps_delay.BIN": "its log is not in the repository; tests/compare/test_what_if.py",
    "attlog compare copter_mag_fault.bin": "its log is not in the repository; tests/compare/test_what_if.py",
    "attlog mcp": "waits for an assistant; tests/assistants/test_mcp.py is one",
    "attlog batch s3://": "needs a cluster; tests/batch/test_cluster.py runs one",
}
"""Commands that begin so are not run here, and why."""

SHORTER = {
    "attlog reproduce all": "attlog reproduce lyu --seeds 1",
    "attlog reproduce all -o reports": "attlog reproduce lyu --seeds 1 -o reports",
    "attlog reproduce xu --seeds 20 --logs flights/*.ulg": "attlog reproduce xu --seeds 1 --logs flights/*.ulg",
    "attlog sweep *.bin mahony kp=0.1..2/12log ki=0..0.05/6": "attlog sweep *.bin mahony kp=0.1..2/3log ki=0..0.05/2",
    "attlog sweep flights/ mahony kp=0.1..2/12log ki=0..0.05/6 mag_form=heading,vector --metric tilt_rmse_deg "
    "--metric noise_tilt_deg@hover": "attlog sweep flights/ mahony kp=0.1..2/2log ki=0..0.05/2 mag_form=heading,vector "
    "--metric tilt_rmse_deg --metric noise_tilt_deg@hover",
    "attlog tune flights/ vqf tau_acc=0.5..10log tau_mag=1..30log --objective tilt=1,noise=0.5,step=0.5": "attlog tune "
    "flights/*.bin vqf tau_acc=0.5..10log --objective tilt=1,noise=0.5,step=0.5",
    "attlog sweep flights/*.ulg EKF2_GPS_DELAY=20..250/12": "attlog sweep flights/*.ulg EKF2_GPS_DELAY=20..250/2",
    "attlog simulate hover --seeds 1..20 -j 2 -o flights": "attlog simulate hover --seeds 1..2 -j 2 -o flights",
}
"""Commands that would run for minutes, and the same with fewer repetitions."""


def blocks(document: str, *languages: str) -> list[str]:
    """The code blocks of those languages, in order."""
    text = (ROOT / document).read_text(encoding="utf-8")
    return [body for language, body in re.findall(r"^```(\w*)\n(.*?)^```", text, re.S | re.M) if language in languages]


def commands(document: str) -> list[str]:
    """The commands of a document, without their comments."""
    lines = [line for block in blocks(document, "console", "sh") for line in block.splitlines()]
    return [text for line in lines if (text := re.sub(r"\s+#.*", "", line).strip())]


def here(command: str) -> bool:
    """Whether the command is run here."""
    return not any(command.startswith(begin) for begin in ELSEWHERE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that the documents name: logs, folders of logs, results, settings."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copytree(SAMPLES, folder / "sample_logs")
    (folder / "reports").mkdir()
    shutil.copy(ROOT / "reports" / "example.html", folder / "reports")
    (folder / "bin").mkdir()
    program = folder / "bin" / "attlog"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m attlog "$@"\n')
    program.chmod(0o755)
    made = {
        "flight.ulg": SAMPLES / "px4_steps.ulg",
        "flight.bin": SAMPLES / "copter_steps_stabilize.bin",
        "flights/one.bin": SAMPLES / "copter_steps_stabilize.bin",
        "flights/two.bin": SAMPLES / "copter_yaw_turns.bin",
        "flights/deep/three.ulg": SAMPLES / "px4_hover.ulg",
        "flights/four.ulg": SAMPLES / "px4_hover.ulg",
        "logs/six.bin": SAMPLES / "copter_yaw_turns.bin",
    }
    for name, source in made.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, folder / name)
    with zipfile.ZipFile(folder / "more.zip", "w") as archive:
        archive.write(SAMPLES / "copter_steps_stabilize.tlog", "seven.tlog")
    (folder / "filters.toml").write_text(blocks("docs/compare.md", "toml")[0])
    (folder / "new.param").write_text("COMPASS_OFS_X,10\n")
    (folder / "new.params").write_text("1\t1\tEKF2_MAG_NOISE\t0.1\t9\n")
    (folder / "gates.toml").write_text('[gates]\n"drift_air_deg_per_min.onboard" = { max = 1000.0 }\n')
    before = [
        "attlog analyze flight.ulg --estimators gyro,mahony -o before",
        "attlog analyze flight.ulg --estimators gyro,mahony:kp=0.5 -o after",
        "attlog batch logs --estimators gyro,mahony -o old && attlog batch logs --estimators gyro,mahony -o new",
        "mkdir old/year && cp logs/six.bin old/year/five.bin",
        "attlog extract flight.ulg --estimates mahony -o extracted && cp extracted/*mahony*.csv estimate.csv",
        "cp before/flight.ulg.json reports/earlier.ulg.json",
        "cp -r before reports-0.2 && cp -r after reports-0.3",
        "attlog new my_filter.py",
    ]
    for line in before:
        shell(line, folder)
    (folder / "my_filter.py").rename(folder / "made_before.py")
    return folder


def shell(line: str, folder: Path) -> None:
    """Run one line as a user's shell would; it must end well."""
    environment = dict(
        os.environ, PATH=f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", PYTHONPATH=str(ROOT), NO_COLOR="1"
    )
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], cwd=folder, env=environment, capture_output=True, text=True
    )
    # A reader that stops early (head) ends the writer with 73; 1 of diff says that something differs.
    well = {0, 73} if "|" in line else {0, 1} if line.startswith("attlog diff") else {0}
    assert done.returncode in well, f"{line}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr, f"{line}\n{done.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize("document", [d for d in DOCUMENTS if any(map(here, commands(d)))])
def test_every_command_runs(document: str, folder: Path) -> None:
    for name in ("my_filter.py", "mine.toml", "out"):
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    if "attlog new my_filter.py" not in commands(document):
        shutil.copy(folder / "made_before.py", folder / "my_filter.py")
    if document == "README.md":  # which shows its examples by subject, not in order
        shutil.copy(folder / "made_before.py", folder / "my_filter.py")
    for command in filter(here, commands(document)):
        if command.startswith("attlog new"):
            (folder / "my_filter.py").unlink(missing_ok=True)
        shell(SHORTER.get(command, command), folder)


@pytest.mark.slow
@pytest.mark.parametrize("document", [d for d in DOCUMENTS if blocks(d, "python")])
def test_every_python_example_runs(document: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np

    monkeypatch.chdir(folder)
    shutil.copy(folder / "made_before.py", folder / "my_filter.py")
    if document == "docs/batch.md":
        shell("rm -rf out; attlog batch flights --estimators gyro,mahony -o out", folder)
    t = np.arange(0.0, 2.0, 0.01)
    own: dict[str, object] = {
        "t": t,
        "gyr": np.zeros((200, 3)),
        "acc": np.tile([0.0, 0.0, -9.81], (200, 1)),
        "mag": np.tile([0.2, 0.0, 0.4], (200, 1)),
    }
    names = {} if document == "docs/python.md" else own  # a first page has nothing undefined
    for number, block in enumerate(blocks(document, "python")):
        exec(compile(block, f"{document}, example {number + 1}", "exec"), names)


def test_commands_that_are_not_run_here_are_still_shown_somewhere() -> None:
    shown = [command for document in DOCUMENTS for command in commands(document)]
    assert [begin for begin in ELSEWHERE if not any(command.startswith(begin) for command in shown)] == []
    assert [command for command in SHORTER if command not in shown] == []


# The documents read alike on GitHub and as pages that mkdocs builds: links, headings they point to, tables, lists.

PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "sample_logs/*.md", "benchmarks/*.md")
    for path in ROOT.glob(pattern)
)


def prose(path: Path) -> list[str]:
    """The lines outside code blocks; what stands in a block is left as an empty line."""
    lines, inside = [], False
    for line in path.read_text(encoding="utf-8").splitlines():
        fence = line.lstrip().startswith(("```", "~~~"))
        lines.append("" if fence or inside else line)
        inside ^= fence
    assert not inside, f"{path}: a code block has no end"
    return lines


def headings(path: Path) -> Iterator[str]:
    """The texts of a page's headings as they are shown."""
    for line in prose(path):
        found = re.match(r"#{1,6}\s+(.*?)\s*#*$", line)
        if found:
            yield re.sub(r"[`*]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", found[1]))


def anchors(path: Path) -> set[str]:
    """What a link may name of a page: anchors that are alike on GitHub (each space a hyphen) and of Python-Markdown
    (runs of them one hyphen, ASCII alone)."""
    told = list(headings(path))
    github = [re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in told]
    built = [re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", each).strip().lower()) for each in told]
    once = Counter(github)
    return {name for name, other in zip(github, built, strict=True) if name == other and once[name] == 1}


def links(path: Path) -> list[str]:
    """Targets of links and images that lie in the repository."""
    text = re.sub(r"`[^`\n]*`", "", "\n".join(prose(path)))
    found = re.findall(r"\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)", text)
    return [target for target in found if not re.match(r"[a-z]+:", target)]


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_to_a_file_and_every_anchor_to_a_heading(page: str) -> None:
    path, lost = ROOT / page, []
    for link in links(path):
        name, _, anchor = unquote(link).partition("#")
        target = path.parent / name if name else path
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    assert lost == []


def test_the_example_report_and_its_picture_are_of_this_version() -> None:
    page = (ROOT / "reports" / "example.html").read_text(encoding="utf-8")
    assert f"Made by attlog {attlog.__version__}. " in page, "make example"
    picture = (ROOT / "docs" / "report.png").read_bytes()
    assert b"tEXtSoftware\x00attlog %b" % attlog.__version__.encode() in picture, "make example"
