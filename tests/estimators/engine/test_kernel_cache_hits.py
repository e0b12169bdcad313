"""A kernel that was compiled once is loaded by the next process, not compiled again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CODE = """
from attlog.estimators import get
from attlog.estimators.engine import loop
print(sum(loop.kernel(get('gyro')).stats.cache_hits.values()))
"""


def test_the_second_process_loads_what_the_first_compiled(tmp_path: Path) -> None:
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "LOCALAPPDATA": str(tmp_path)}
    environment.pop("ATTLOG_NO_JIT", None)
    hits = [
        subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    assert [h.strip() for h in hits] == ["0", "1"]
