"""How Python is started, and from where: out of a zip file, without docstrings and assertions."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT


def run(*arguments: object, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Python with these arguments, which finds attlog in ``path``."""
    return subprocess.run(
        [sys.executable, "-P", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(path)},
        capture_output=True,
        text=True,
    )


def test_out_of_a_zip_file_it_says_what_to_do(tmp_path: Path) -> None:
    """Templates, scenarios and machine code are read as files; ``--help`` worked, ``analyze`` blamed the output."""
    with zipfile.ZipFile(tmp_path / "attlog.zip", "w") as archive:
        for path in (ROOT / "attlog" / "__init__.py", ROOT / "attlog" / "__main__.py"):
            archive.write(path, path.relative_to(ROOT).as_posix())
    done = run("-m", "attlog", "info", "x.ulg", path=tmp_path / "attlog.zip")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "attlog: does not run out of a zip file: install it (pip install), or unpack it\n"


@pytest.mark.slow
def test_without_docstrings_and_assertions_the_numbers_are_the_same(samples: Path, tmp_path: Path) -> None:
    """``python -OO``: what is said of a filter is its file's docstring and lost, no number and no check is."""

    def numbers(*options: str) -> Any:
        folder = tmp_path / "".join(options)
        log = samples / "copter_yaw_turns.bin"
        command = ["-m", "attlog", "analyze", log, "-q", "--deterministic", "--estimators", "gyro,mahony", "-o", folder]
        done = run(*options, *command)
        assert done.returncode == 0, done.stderr
        document = json.loads((folder / "copter_yaw_turns.bin.json").read_text(encoding="utf-8"))
        rows = [(row["name"], row["metrics"], row.get("parameters")) for row in document["estimators"]]
        return rows, document["evidence"]

    assert numbers("-OO") == numbers("-B")
    assert run("-OO", "-m", "attlog", "analyze", "--imu", "99", samples / "copter_yaw_turns.bin").returncode == 2
