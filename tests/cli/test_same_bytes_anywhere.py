"""Same log, version and machine: the same JSON and page to the bit, wherever and however attlog runs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, SAMPLES

LOGS = ("copter_yaw_turns.bin", "cut.ulg")
HERE = {"PYTHONHASHSEED": "1", "TZ": "UTC", "LC_ALL": "C", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"}
THERE = {
    "PYTHONHASHSEED": "77",
    "TZ": "Asia/Kathmandu",
    "LC_ALL": "de_DE.UTF-8",
    "LANG": "tr_TR.UTF-8",
    "OPENBLAS_NUM_THREADS": "2",
    "COLUMNS": "40",
    "HOME": "/nowhere",
}


@pytest.mark.slow
def test_order_of_hashes_zone_locale_folder_and_jobs_change_no_bit(tmp_path: Path) -> None:
    written = []
    for folder, variables, jobs in ((tmp_path / "a", HERE, "1"), (tmp_path / "b" / "c d", THERE, "2")):
        folder.mkdir(parents=True)
        shutil.copy(SAMPLES / LOGS[0], folder)
        (folder / LOGS[1]).write_bytes((SAMPLES / "px4_steps.ulg").read_bytes()[:400_000])
        words = ["analyze", *LOGS, "-o", "out", "--estimators", "gyro,mahony", "--deterministic", "-q", "-j", jobs]
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        subprocess.run(
            [sys.executable, "-m", "attlog", *words],
            cwd=folder,
            env=os.environ | variables | {"PYTHONPATH": paths},
            check=True,
            capture_output=True,
        )
        written.append({p.name: p.read_bytes() for p in sorted((folder / "out").iterdir())})
    assert sorted(written[0]) == [f"{name}.{kind}" for name in sorted(LOGS) for kind in ("html", "json")]
    assert written[0] == written[1]
