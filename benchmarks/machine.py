"""On what machine, with what software and how busy a table was measured."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from measured import versions

PACKAGES = ["numpy", "numba", "llvmlite", "pyulog", "pymavlink", "vqf", "plotly", "typer"]


def described() -> list[tuple[str, str]]:
    """What was asked of the machine and what it answered, for a table."""
    import attlog

    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    told = [
        ("measured", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"),
        ("attlog", f"{attlog.__version__}{_commit()}"),
        ("processor", f"{_processor()}, {usable} usable of {os.cpu_count()} cores"),
        ("memory", _memory()),
        ("system", f"{platform.system()} {platform.release()} {platform.machine()}"),
        ("Python", f"{platform.python_version()} ({platform.python_implementation()})"),
        ("packages", ", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items() if version)),
    ]
    return told


def load() -> str:
    """How busy the machine is: processes that want a core, means of 1, 5 and 15 minutes."""
    try:
        return ", ".join(f"{x:.1f}" for x in os.getloadavg())
    except OSError:
        return "not known"


def _processor() -> str:
    """The name of the processor, and the vectors it has."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "not known"
    facts = dict(line.split("\t", 1) for line in lines if "\t" in line)
    name = facts.get("model name", ": not known").split(":", 1)[1].strip()
    flags = facts.get("flags", "").split()
    best = next((f for f in ("avx512f", "avx2", "avx", "sse4_2") if f in flags), "")
    return f"{name}{f' ({best})' if best else ''}"


def _memory() -> str:
    """Memory of the machine."""
    if not hasattr(os, "sysconf") or sys.platform == "win32":
        return "not known"
    return f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"


def _commit() -> str:
    """The commit that is checked out here, with a word where files differ from it."""
    root = Path(__file__).resolve().parent.parent
    try:
        told = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*"], capture_output=True, text=True
        )
    except OSError:
        return ""
    return f", commit {told.stdout.strip()}" if told.returncode == 0 and told.stdout.strip() else ""
