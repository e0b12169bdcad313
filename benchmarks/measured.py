"""How everything here is measured: CPU seconds by turns, memory of children, functions in a process of their own.

What is compared runs by turns in the same minutes, as often as the other, so that a busy machine slows both; medians.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Threads that wait for each other burn CPU time that no work was done in."""
AS_INSTALLED = {"PYTHONDONTWRITEBYTECODE": ""}
"""Installed packages are compiled to bytecode; a clone whose bytecode is never kept would be compiled at each start,
against peers that are not."""
SAMPLED_S = 0.005


@dataclass(frozen=True)
class Child:
    """What a command cost: CPU seconds (user and system), most memory of its own at a time and most memory resident
    (MB; NaN where the system does not tell), its standard output."""

    cpu_s: float
    anonymous_mb: float
    resident_mb: float
    output: str


@dataclass
class Pair:
    """CPU seconds of two works that ran by turns."""

    ours: list[float] = field(default_factory=list)
    peer: list[float] = field(default_factory=list)

    @property
    def ratio(self) -> float:
        """Median of ours over median of the peer's."""
        return median(self.ours) / median(self.peer)

    @property
    def best_ratio(self) -> float:
        """Smallest of ours over smallest of the peer's: what other processes disturb least."""
        return min(self.ours) / min(self.peer)


def by_turns(ours: Callable[[], float], peer: Callable[[], float], runs: int = 5, seconds: float = 60.0) -> Pair:
    """Both works, each turn both and the other one first; fewer turns than ``runs`` (one at least) once ``seconds``
    have passed."""
    pair, begin = Pair(), time.monotonic()
    for turn in range(runs):
        for own in (True, False) if turn % 2 == 0 else (False, True):
            (pair.ours if own else pair.peer).append((ours if own else peer)())
        if (time.monotonic() - begin) * (turn + 2) / (turn + 1) > seconds:
            break
    return pair


def cpu(work: Callable[[], object]) -> float:
    """CPU seconds of this process while it works, never 0."""
    begin = time.process_time()
    work()
    return max(time.process_time() - begin, 1e-6)


def child(command: list[str], *, environment: Mapping[str, str] | None = None, codes: tuple[int, ...] = (0,)) -> Child:
    """Run a command to its end; SystemExit with its last words where its exit code is not one of ``codes``."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **ONE_THREAD, **AS_INSTALLED, **(environment or {})},
    )
    said: dict[str, str] = {}
    readers = [
        threading.Thread(target=lambda name=name, stream=stream: said.update({name: stream.read()}))
        for name, stream in (("out", process.stdout), ("err", process.stderr))
    ]
    for reader in readers:
        reader.start()
    anonymous = _peak_of(process.pid, readers)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    for reader, stream in zip(readers, (process.stdout, process.stderr), strict=True):
        reader.join()
        stream.close()  # type: ignore[union-attr]
    if process.returncode not in codes:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}: {said['err'][-2000:]}")
    resident = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e6 / 1024)
    return Child(usage.ru_utime + usage.ru_stime, anonymous, resident, said["out"])


def _peak_of(pid: int, readers: list[threading.Thread]) -> float:
    """Most anonymous memory (MB) that was seen while the process had its outputs open."""
    most = float("nan")
    while any(reader.is_alive() for reader in readers):
        found = anonymous_mb(pid) + sum(mb for each in children(pid) if (mb := anonymous_mb(each)) == mb)
        most = found if most != most or found > most else most
        readers[0].join(SAMPLED_S)
        if not readers[0].is_alive():
            readers[1].join(SAMPLED_S)
    return most


def children(pid: int) -> Iterator[int]:
    """The processes that a process started, and theirs: a log that is mapped is read under a watching one."""
    for place in Path("/proc").glob(f"{pid}/task/*/children"):
        try:
            found = [int(each) for each in place.read_text().split()]
        except OSError:
            continue
        for each in found:
            yield each
            yield from children(each)


def anonymous_mb(pid: int | None = None) -> float:
    """Memory of a process that is not backed by a file (MB): pages of a mapped log do not count, the system may drop
    them at any time. NaN where there is no /proc."""
    try:
        status = Path(f"/proc/{pid or os.getpid()}/status").read_text()
    except OSError:
        return float("nan")
    return next((int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("RssAnon")), 0.0)


def apart(work: Callable[P, T], *given: P.args, **named: P.kwargs) -> T:
    """What a function of a module returns in a fresh process, where nothing is imported or compiled yet."""
    with environment(**ONE_THREAD, **AS_INSTALLED), ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *given, **named).result()


@contextmanager
def environment(**values: str) -> Iterator[None]:
    """Variables that processes started meanwhile see."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


@contextmanager
def quiet() -> Iterator[None]:
    """Official libraries print about what they do not like."""
    import io
    from contextlib import redirect_stderr, redirect_stdout

    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        yield


def versions(names: list[str]) -> dict[str, Any]:
    """Installed versions of packages, None for one that is missing."""
    from importlib import metadata

    found: dict[str, Any] = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found
