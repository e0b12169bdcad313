"""One child process per log where no program can fork (Windows): a fresh interpreter for each.

It costs 1 s of imports per log. What is told goes as lines of JSON over the child's standard output; the work comes
over its standard input, whose end means that the parent is gone. Not ``multiprocessing``: that would import the
caller's main program in each child, and may start none inside a worker of Dask, which is daemonic.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from attlog.fleet.records.work import Work

START = "import sys; sys.path[:] = {path!r}; from attlog.fleet.processes.fresh import main; main()"


class Fresh:
    """A process at work on one log."""

    def __init__(self, work: Work, room: Path, environment: Mapping[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", START.format(path=sys.path)],
            env=environment,
            start_new_session=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._told: SimpleQueue[dict[str, Any]] = SimpleQueue()
        threading.Thread(target=self._listen, args=(pickle.dumps((work, str(room))),), daemon=True).start()

    def _listen(self, order: bytes) -> None:
        """Hear what is told until the process ends, in a thread: not every system can wait for a pipe and a clock."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):  # it died before it could read: told below
            self._process.stdin.write(order)
            self._process.stdin.flush()
        used: dict[str, Any] = {}
        with self._process.stdout as told:
            for line in told:
                with suppress(ValueError):  # a line that a dying process broke off
                    message = json.loads(line)
                    if "cpu_s" in message:
                        used = message
                    elif message:
                        self._told.put(message)
        self._told.put({"exit": self._process.wait()} | used)
        with suppress(OSError):
            self._process.stdin.close()

    def messages(self, pause: float) -> Iterator[dict[str, Any]]:
        """What is told, with an empty message after each ``pause`` seconds of silence; ``exit`` is the last."""
        message: dict[str, Any] = {}
        while "exit" not in message:
            try:
                message = self._told.get(timeout=pause)
            except Empty:
                message = {}
            yield message

    def kill(self) -> None:
        """End the process now; its ``exit`` is told as ever."""
        self._process.kill()

    def __enter__(self) -> Fresh:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._process.wait()


def main() -> None:
    """The child: read the work, do it, tell what becomes of it and what it took."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is interrupted, and decides
    from attlog.fleet.processes.child import analyse, quietly

    orders, out = os.fdopen(os.dup(0), "rb"), os.dup(1)

    def tell(told: dict[str, Any]) -> None:
        with suppress(OSError):  # nobody hears any more
            os.write(out, b"\n" + json.dumps(told).encode() + b"\n")

    def end_with_the_parent() -> None:
        os.read(orders.fileno(), 1)
        os._exit(1)

    tell({"pid": os.getpid()})  # of a launcher, which some systems put in between, the parent knows another
    work, room = pickle.load(orders)
    threading.Thread(target=end_with_the_parent, daemon=True).start()
    quietly(Path(room))
    status = 70
    try:
        analyse(work, Path(room), tell)
        tell({"cpu_s": time.process_time(), "peak_mb": _peak_mb()})
        status = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _peak_mb() -> float:
    """The most memory that this process held, in MB (10^6 bytes); 0 where the system does not tell."""
    try:
        import resource
    except ImportError:
        try:
            import psutil
        except ImportError:
            return 0.0
        return float(getattr(psutil.Process().memory_info(), "peak_wset", 0)) / 1e6
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return held * (1 if sys.platform == "darwin" else 1024) / 1e6
