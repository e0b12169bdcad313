"""Every command and every Python example that the documents show is run, in a folder that holds what they name."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.conftest import ROOT, SAMPLES

DOCUMENTS = sorted(p.relative_to(ROOT).as_posix() for p in [*ROOT.glob("docs/*.md"), *ROOT.glob("*.md")])
DOCUMENTS.remove("CHANGELOG.md")

ELSEWHERE = {
    "make demo": "changes the installation; .ci/run installs and calls make",
    "make check": "changes the installation; .ci/run installs and calls make",
    "make test": "changes the installation; .ci/run installs and calls make",
    "make fuzz": "ten minutes; tests/fuzz runs some seconds of it",
    "python3 -m venv": "changes the installation; tests/test_package.py installs the wheel",
    "venv/bin/pip install": "changes the installation; tests/test_package.py installs the wheel",
    "pip install": "changes the installation; tests/test_package.py installs the wheel",
    "attlog --install-completion": "changes the user's shell; tests/cli/shared/test_completion.py",
    "attlog batch s3://": "needs a cluster; tests/fleet/schedulers/test_cluster.py runs one",
}
"""Commands that begin so are not run here, and why."""

SHORTER = {
    "attlog reproduce all": "attlog reproduce lyu --seeds 1",
    "attlog reproduce all -o reports": "attlog reproduce lyu --seeds 1 -o reports",
    "attlog reproduce xu --seeds 20 --logs flights/*.ulg": "attlog reproduce xu --seeds 1 --logs flights/*.ulg",
    "attlog sweep *.bin mahony kp=0.1..2/12log ki=0..0.05/6": "attlog sweep *.bin mahony kp=0.1..2/3log ki=0..0.05/2",
    "attlog sweep flights/ mahony kp=0.1..2/12log ki=0..0.05/6 mag_form=heading,vector --metric inclination_rmse_deg "
    "--metric noise_tilt_deg@hover": "attlog sweep flights/ mahony kp=0.1..2/2log ki=0..0.05/2 mag_form=heading,vector "
    "--metric inclination_rmse_deg --metric noise_tilt_deg@hover",
    "attlog tune flights/ vqf tau_acc=0.5..10log tau_mag=1..30log --objective tilt=1,noise=0.5,step=0.5": "attlog tune "
    "flights/*.bin vqf tau_acc=0.5..10log --objective tilt=1,noise=0.5,step=0.5",
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
    names: dict[str, object] = {
        "t": t,
        "gyr": np.zeros((200, 3)),
        "acc": np.tile([0.0, 0.0, -9.81], (200, 1)),
        "mag": np.tile([0.2, 0.0, 0.4], (200, 1)),
    }
    for number, block in enumerate(blocks(document, "python")):
        exec(compile(block, f"{document}, example {number + 1}", "exec"), names)


def test_commands_that_are_not_run_here_are_still_shown_somewhere() -> None:
    shown = [command for document in DOCUMENTS for command in commands(document)]
    assert [begin for begin in ELSEWHERE if not any(command.startswith(begin) for command in shown)] == []
    assert [command for command in SHORTER if command not in shown] == []
