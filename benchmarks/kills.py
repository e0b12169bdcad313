"""kill -9 at random moments in a batch, then --resume: is the folder that of a run nobody disturbed?

    python benchmarks/kills.py LOG... [--kills 10] [--workers 2] [--seed 0] [--folder DIR] [--estimators gyro]

Each round resumes the batch and kills it (its process alone, as an out-of-memory killer does, or its whole session) up
to 2 s after a random number of further logs is done; at last it is resumed to its end. Compared is every file but the
lock, records without measured times.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

MEASURED = ("wall_s", "cpu_s", "peak_mb")


def command(logs: list[str], folder: Path, options: argparse.Namespace, *more: str) -> list[str]:
    own = ["-o", str(folder), "--jobs", str(options.workers), "--estimators", options.estimators]
    return [sys.executable, "-m", "attlog", "batch", *logs, *own, "--deterministic", "-v", *more]


def content(folder: Path) -> dict[str, object]:
    """What the folder tells, by file."""
    found: dict[str, object] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "lock"):
        if path.parent.name == "records":
            record = json.loads(path.read_bytes())
            found[str(path.relative_to(folder))] = {k: v for k, v in record.items() if k not in MEASURED}
        else:
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def killed(command: list[str], folder: Path, logs: int, seconds: float, session: bool) -> bool:
    """Start a batch and kill it so many seconds after so many new logs were done; whether it was still running."""
    wanted = len(records(folder)) + logs
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    while len(records(folder)) < wanted and run.poll() is None:
        time.sleep(0.01)
    try:
        run.wait(seconds)
        return False
    except subprocess.TimeoutExpired:
        (os.killpg if session else os.kill)(run.pid, signal.SIGKILL)
        run.wait()
        return True


def records(folder: Path) -> list[Path]:
    """The records that stand in a batch folder."""
    return list((folder / ".attlog/records").glob("*.json"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--estimators", default="gyro")
    parser.add_argument("--folder", type=Path, default=Path("kills"))
    options = parser.parse_args()
    draw = random.Random(options.seed)
    quiet, disturbed = options.folder / "quiet" / "out", options.folder / "disturbed" / "out"
    shutil.rmtree(options.folder, ignore_errors=True)

    started = time.monotonic()
    code = subprocess.run(command(options.logs, quiet, options), capture_output=True).returncode
    seconds = time.monotonic() - started
    print(f"undisturbed: exit code {code}, {seconds:.1f} s, {len(records(quiet))} records", flush=True)

    each = max(len(options.logs) * 2 // (3 * options.kills), 1)
    for kill in range(1, options.kills + 1):
        logs, after, session = draw.randint(0, each), draw.uniform(0.0, 2.0), draw.random() < 0.5
        if not killed(command(options.logs, disturbed, options, "--resume"), disturbed, logs, after, session):
            print("it had ended before")
        print(
            f"kill {kill}, {after:.2f} s after {logs} more logs ({'session' if session else 'process'}): "
            f"{len(records(disturbed))} records",
            flush=True,
        )
    before = {path.name: path.stat().st_mtime_ns for path in records(disturbed)}

    last = subprocess.run(command(options.logs, disturbed, options, "--resume"), capture_output=True, text=True)
    kept = sum(path.stat().st_mtime_ns == before.get(path.name) for path in records(disturbed))
    print(f"resumed: exit code {last.returncode}, {kept} of {len(before)} records as they were")
    one, other = content(quiet), content(disturbed)
    differing = sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
    print(f"{len(one)} files compared, {len(differing)} differ: {differing[:5]}")
    return 1 if differing or last.returncode != code else 0


if __name__ == "__main__":
    sys.exit(main())
