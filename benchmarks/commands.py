"""Print what whole commands cost against a process of the official library that does less.

CPU seconds (user + system) of child processes, the smallest of ``--repeats``, both in
the same run of this script. The long log is made from a sample log by repetition.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from readers import SAMPLES, repeated

ATTLOG = [sys.executable, "-m", "attlog"]
TYPER = """
import typer
app = typer.Typer()
@app.command()
def one(): "First."
@app.command()
def two(): "Second."
app()
"""
PYULOG = "import sys; from pyulog import ULog; ULog(sys.argv[1])"
PYULOG_INFO = "import sys; sys.argv[0] = 'ulog_info'; from pyulog.info import main; main()"


def cpu_seconds(command: list[str], repeats: int) -> float:
    """The smallest CPU time of a command in ``repeats`` runs after one that warms caches."""
    times = []
    for _ in range(repeats + 1):
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            raise SystemExit(f"{' '.join(command)} ended with {child.returncode}")
        times.append(usage.ru_utime + usage.ru_stime)
    return min(times[1:])


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--megabytes", type=float, default=60, help="size of the long log")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        long = repeated(SAMPLES / "px4_steps.ulg", folder / "long.ulg", int(options.megabytes * 1e6))
        short = SAMPLES / "px4_steps.ulg"
        python = [sys.executable, "-c"]
        rows = [
            ("attlog --help", [*ATTLOG, "--help"], "typer --help, two commands", [*python, TYPER, "--help"], "<=", 1.2),
            (
                "attlog info, sample", [*ATTLOG, "info", str(short)],
                "ulog_info", [*python, PYULOG_INFO, str(short)], "<=", 1 / 1.2,
            ),
            (
                f"attlog analyze, {options.megabytes:g} MB", [*ATTLOG, "analyze", str(long), "-o", name],
                "load with pyulog", [*python, PYULOG, str(long)], "<=", 1 / 1.2,
            ),
        ]  # fmt: skip
        print(f"{'command':<26}{'s':>8}  {'peer':<28}{'s':>8}{'ratio':>8}  target")
        for what, ours, peer, theirs, sign, target in rows:
            a, b = cpu_seconds(ours, options.repeats), cpu_seconds(theirs, options.repeats)
            met = "met" if a / b <= target else "missed"
            print(f"{what:<26}{a:8.2f}  {peer:<28}{b:8.2f}{a / b:8.2f}  {sign} {target:.2f} {met}")


if __name__ == "__main__":
    main()
