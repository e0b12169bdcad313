"""A Dask scheduler and workers as processes of their own on loopback."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from tests.conftest import ROOT


@dataclass
class Cluster:
    """Started by its first worker or by ``start``; ``folder`` takes files and what the processes say."""

    folder: Path
    address: str = ""
    scheduler: subprocess.Popen[bytes] | None = None
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, **environment: str) -> Cluster:
        file = self.folder / "scheduler.json"
        self.scheduler = self._process(
            "dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--idle-timeout",
            "20 minutes",
            "--scheduler-file",
            str(file),
            **environment,
        )
        until = time.monotonic() + 30
        while not self.address:
            assert time.monotonic() < until, self.said()
            time.sleep(0.05)
            if file.exists() and file.read_text():
                self.address = json.loads(file.read_text())["address"]
        return self

    def worker(self, *options: str) -> subprocess.Popen[bytes]:
        """A worker for one log at a time, without a nanny to start it again; forgotten, it ends itself."""
        process = self._process(
            "dask_worker",
            self.address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--no-dashboard",
            "--lifetime",
            "20 minutes",
            "--death-timeout",
            "30",
            "--local-directory",
            str(self.folder),
            *options,
        )
        self.workers.append(process)
        return process

    def said(self) -> str:
        return (self.folder / "said.txt").read_text()

    def stop(self) -> None:
        for process in [*self.workers, self.scheduler]:
            if process is not None:
                process.send_signal(signal.SIGKILL)
                process.wait()

    def _process(self, module: str, *options: str, **environment: str) -> subprocess.Popen[bytes]:
        with (self.folder / "said.txt").open("ab") as said:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *options],
                stdout=said,
                stderr=said,
                cwd=self.folder,
                env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
            )
