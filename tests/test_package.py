"""The sdist is complete, and the wheel built from it works by itself."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.conftest import ROOT, SAMPLES

pytestmark = pytest.mark.slow


def run(*command: str | Path, folder: Path, **environment: str) -> str:
    """What a command that must end well says."""
    done = subprocess.run(
        list(map(str, command)), cwd=folder, env=os.environ | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def tracked() -> list[str]:
    """What the repository holds; in a source folder without git, what there is to skip the test for."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no git here to say what belongs to the project")
    return run("git", "ls-files", folder=ROOT).splitlines()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An sdist of the repository, and the wheel that is built from the sdist alone."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("built")
    copy = folder / "copy"
    for name in tracked():
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)
    bundle = ROOT / "attlog" / "report" / "bundle"
    if bundle.is_dir():  # fetched at installation; building needs no network then
        shutil.copytree(bundle, copy / "attlog" / "report" / "bundle")
    python = [sys.executable, "-m", "hatchling", "build"]
    # What this environment imports is attlog's own source; the copy must not need it.
    run(*python, "-t", "sdist", "-d", folder, folder=copy, PYTHONPATH="")
    (sdist,) = folder.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "source", filter="data")
    (source,) = (folder / "source").iterdir()
    # Compiling the kernels takes minutes; tests/core/jit/test_build.py asks what becomes of them.
    run(*python, "-t", "wheel", "-d", folder, folder=source, PYTHONPATH="", ATTLOG_KERNELS="none")
    (wheel,) = folder.glob("*.whl")
    return sdist, wheel


def test_the_sdist_holds_every_file_of_the_project(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[0]) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    missing = [name for name in tracked() if name not in held and name != ".gitignore"]
    assert missing == []


def test_the_wheel_holds_every_file_of_the_package(built: tuple[Path, Path]) -> None:
    held = set(zipfile.ZipFile(built[1]).namelist())
    assert [name for name in tracked() if name.startswith("attlog/") and name not in held] == []
    assert [name for name in held if not name.startswith(("attlog/", "attlog-"))] == []


def test_the_wheel_works_without_the_source_and_without_a_warning(built: tuple[Path, Path], tmp_path: Path) -> None:
    target = tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-index"]
    run(*pip, "--target", target, built[1], folder=tmp_path)
    attlog = [sys.executable, "-W", "error", "-m", "attlog"]
    where = run(sys.executable, "-c", "import attlog; print(attlog.__file__)", folder=tmp_path, PYTHONPATH=str(target))
    assert Path(where.strip()).is_relative_to(target)
    log = SAMPLES / "copter_yaw_turns.bin"
    run(
        *attlog,
        "analyze",
        log,
        "--estimators",
        "gyro,mahony,ekf12",
        "-o",
        tmp_path,
        folder=tmp_path,
        PYTHONPATH=str(target),
    )
    result = json.loads((tmp_path / f"{log.name}.json").read_text(encoding="utf-8"))
    assert {"gyro", "mahony", "ekf12"} <= {row["name"] for row in result["estimators"] if row["status"] == "ok"}
    run(
        *attlog,
        "simulate",
        "rotation",
        "-o",
        "turned.ulg",
        "--set",
        "seconds=5",
        folder=tmp_path,
        PYTHONPATH=str(target),
    )
    run(*attlog, "info", "turned.ulg", folder=tmp_path, PYTHONPATH=str(target))
