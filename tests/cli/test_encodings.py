"""What the terminal's encoding lacks, and file names that are not UTF-8, end no run."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.conftest import few


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "darwin", reason="its file systems keep UTF-8 names only")
@pytest.mark.parametrize(("encoding", "sign"), few([("ascii", b" deg"), ("cp1252", "°".encode("cp1252"))], 1))
def test_analyze_works_where_signs_and_names_cannot_be_shown(samples, tmp_path, encoding, sign):
    log = os.path.join(os.fsencode(tmp_path), b"a\xff.bin")
    shutil.copy(samples / "copter_steps_stabilize.bin", log)
    done = subprocess.run(
        [sys.executable, "-m", "attlog", "analyze", "--no-color", "--estimators", "gyro", "-o", str(tmp_path), log],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )
    assert done.returncode == 0, done.stderr[-500:]
    assert b"a\\xff.bin" in done.stdout
    assert sign in done.stdout
    assert b"\x1b" not in done.stdout
    assert [line for line in done.stdout.splitlines() if line != line.rstrip()] == []
    document = json.loads((tmp_path / "a_.bin.json").read_text(encoding="utf-8"))
    assert os.fsencode(document["log"]["name"]) == b"a\xff.bin"
    assert (tmp_path / "a_.bin.html").stat().st_size > 10_000
