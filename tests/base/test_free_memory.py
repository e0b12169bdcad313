"""What the system tells of memory: the least of machine, control group and the process's own limit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from attlog.base.memory import free_bytes


@pytest.fixture
def system(tmp_path: Path) -> tuple[Path, Path]:
    """A machine of 8 GB of which 5 are free, in a group that may take 4 and holds 3, one of them pages of files."""
    proc, group = tmp_path / "proc", tmp_path / "cgroup"
    (proc / "self").mkdir(parents=True)
    group.mkdir()
    (proc / "meminfo").write_text("MemTotal: 8000000 kB\nMemAvailable: 5000000 kB\nSwapFree: 1000 kB\n")
    (group / "memory.max").write_text("4000000000\n")
    (group / "memory.current").write_text("3000000000\n")
    (group / "memory.stat").write_text("anon 2000000000\nfile 1000000000\n")
    return proc, group


def test_the_least_of_what_is_told_counts(system: tuple[Path, Path]) -> None:
    proc, group = system
    assert free_bytes(proc, group) == 2_000_000_000
    (group / "memory.max").write_text("max\n")
    assert free_bytes(proc, group) == 5_001_000 * 1024


def test_where_nothing_is_told_nothing_is_known(tmp_path: Path) -> None:
    assert free_bytes(tmp_path, tmp_path) is None


@pytest.mark.skipif(sys.platform != "linux", reason="limits as Linux knows them")
def test_the_limit_of_address_space_counts() -> None:
    code = (
        "import resource; from attlog.base.memory import free_bytes\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30)); print(free_bytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (1 << 28) < int(done.stdout) < (1 << 30)
