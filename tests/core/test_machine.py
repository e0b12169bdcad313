"""What the system tells of memory: the least of machine, control group and the process's own limit."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from attlog.core import machine
from attlog.core.machine import available_bytes


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
    assert available_bytes(proc, group) == 2_000_000_000
    (group / "memory.max").write_text("max\n")
    assert available_bytes(proc, group) == 5_001_000 * 1024


@pytest.mark.skipif(sys.platform != "linux", reason="limits as Linux knows them")
def test_the_limit_of_address_space_counts() -> None:
    code = (
        "import resource; from attlog.core.machine import available_bytes\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30)); print(available_bytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (1 << 28) < int(done.stdout) < (1 << 30)


# Memory goes back to the system after a step over many samples.

glibc = pytest.mark.skipif(
    not sys.platform.startswith("linux") or machine._malloc_trim() is None,
    reason="only glibc gives memory back when told",
)


def resident_mb() -> float:
    found = re.search(r"RssAnon:\s+(\d+)", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found.group(1)) / 1024


@glibc
def test_what_is_freed_between_what_is_kept_leaves_the_process() -> None:
    # Below the size that the C library maps by itself at first, and each followed by one that stays.
    pieces = [np.ones(12_000) for _ in range(1_000)]
    held = pieces[::2][-250:], pieces[-1]
    before = resident_mb()
    del pieces
    assert machine.release_memory(machine.MIN_TRIMMED_SAMPLES)
    assert resident_mb() < before - 40
    assert held[1][0] == 1.0
