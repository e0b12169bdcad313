"""Files beside a log that are named like modules of Python, or of packages that attlog uses, are never imported."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, few

NAMED_LIKE_MODULES = ("numpy", "signal", "struct", "pickle", "json", "socket", "subprocess", "multiprocessing")
RAN = "from pathlib import Path\nPath(__file__).with_suffix('.ran').touch()\nraise SystemExit(5)\n"
FILTER = """
import numpy as np
from attlog.estimators import Estimate
def run(t, gyr, acc, mag, aids, params):
    return Estimate(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
"""
DROPPED = "import sys; del sys.path[0]; "
"""As the installed command begins: without the flag ``-P``, which child processes of ``multiprocessing`` inherit."""
COMMAND = "from attlog.__main__ import main; main()"


@pytest.mark.parametrize(
    "words",
    few(
        [
            pytest.param(["info", "--verify", "log.ulg"], id="official reader"),
            pytest.param(["check-estimator", "mine.py"], id="filter of a file"),
            pytest.param(
                ["batch", "log.ulg", "-o", "out", "--estimators", "mine.py", "--reference", "onboard"], id="batch"
            ),
            pytest.param(
                ["compare", "log.ulg", "again.ulg", "gyro", "mahony", "-o", "out", "-j", "2"], id="several logs"
            ),
        ],
        1,
    ),
)
@pytest.mark.parametrize("start", [["-c", DROPPED + COMMAND], ["-m", "attlog"]], ids=["attlog", "-m attlog"])
def test_no_child_process_imports_a_file_of_the_current_folder(
    words: list[str], start: list[str], samples: Path, tmp_path: Path
) -> None:
    for name in NAMED_LIKE_MODULES:
        (tmp_path / f"{name}.py").write_text(RAN)
    (tmp_path / "mine.py").write_text(FILTER)
    for name in ("log.ulg", "again.ulg"):
        (tmp_path / name).symlink_to(samples / "px4_steps.ulg")
    done = subprocess.run(
        [sys.executable, *start, *words],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert [path.name for path in tmp_path.glob("*.ran")] == []
    assert "Traceback" not in done.stderr
    if words[0] != "check-estimator":  # whose verdict this filter, which ignores its sensors, does not get
        assert done.returncode == 0, done.stderr
