"""kill -9 at random moments in a batch, then --resume: is the folder that of a run nobody disturbed?

    python benchmarks/kills.py LOG... [--kills 10] [--workers 2] [--seed 0] [--folder DIR] [--estimators gyro]

Each round resumes the batch and kills it (its process alone, as an out-of-memory killer does, or its whole session)
at a moment drawn so that the kills fall into start, work and end; at last it is resumed to its end. Compared is every
file but the lock, records without measured times.
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
    own = ["-o", str(folder), "--workers", str(options.workers), "--estimators", options.estimators]
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


def killed(command: list[str], after: float, session: bool) -> bool:
    """Start a batch and kill it; whether it was still running."""
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        run.wait(after)
        return False
    except subprocess.TimeoutExpired:
        (os.killpg if session else os.kill)(run.pid, signal.SIGKILL)
        run.wait()
        return True


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
    run = subprocess.Popen(command(options.logs, quiet, options), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while run.poll() is None and not list((quiet / ".attlog/records").glob("*.json")):
        time.sleep(0.02)
    first = time.monotonic() - started
    code = run.wait()
    seconds = time.monotonic() - started
    print(f"undisturbed: exit code {code}, {seconds:.1f} s, {len(list((quiet / '.attlog/records').iterdir()))} records")

    done_before = kills = 0
    while kills < options.kills:
        after = first / 2 + draw.uniform(0.0, 2.0) * (seconds - first / 2) / options.kills
        session = draw.random() < 0.5
        if not killed(command(options.logs, disturbed, options, "--resume"), after, session):
            print(f"finished before kill {kills + 1}: begun again with --fresh")
            killed(command(options.logs, disturbed, options, "--fresh"), after, session)
        kills += 1
        records = len(list((disturbed / ".attlog/records").glob("*.json")))
        print(f"kill {kills} after {after:.2f} s ({'session' if session else 'process'}): {records} records")
        done_before = records

    last = subprocess.run(command(options.logs, disturbed, options, "--resume"), capture_output=True, text=True)
    again = last.stderr.count("done before")
    print(f"resumed: exit code {last.returncode}, {again} of {done_before} done before, not done again")
    one, other = content(quiet), content(disturbed)
    differing = sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
    print(f"{len(one)} files compared, {len(differing)} differ: {differing[:5]}")
    return 1 if differing or last.returncode != code else 0


if __name__ == "__main__":
    sys.exit(main())
