"""How much memory does a process hold?

The limit of ``--memory`` is kept by looking at this number, not by RLIMIT_AS: an address space counts libraries,
mapped logs and reserved room that never becomes memory (a gigabyte before the first log), and an allocation that is
refused inside a filter would end as a failed row of a report that looks whole. A process that is ended leaves no
result at all.
"""

from __future__ import annotations

import os

from attlog.base.errors import UsageError


def resident_mb(pid: int) -> float:
    """Resident memory of a process and of those that it started, which run filters from files, in MB (10^6 bytes).

    Mapped pages of its log count; 0 for one that is gone. UsageError where the system has no /proc and psutil is not
    installed.
    """
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            own = int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        return own + sum(map(resident_mb, _children(pid)))
    except (FileNotFoundError, ProcessLookupError, IndexError):
        if os.path.exists("/proc/self/statm"):
            return 0.0
    try:
        import psutil
    except ImportError:
        raise UsageError("--memory needs the package psutil on this system: pip install psutil") from None
    try:
        process = psutil.Process(pid)
        return float(sum(one.memory_info().rss for one in (process, *process.children(recursive=True)))) / 1e6
    except psutil.Error:
        return 0.0


def _children(pid: int) -> list[int]:
    """The processes that a process started, as far as the system keeps a list of them."""
    try:
        with open(f"/proc/{pid}/task/{pid}/children", "rb") as file:
            return [int(number) for number in file.read().split()]
    except (OSError, ValueError):
        return []
