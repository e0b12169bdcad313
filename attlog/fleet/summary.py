"""What became of many logs, in ten lines or so: what was answered, what failed and why, where to look first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from attlog.compare.gate_rows import BASELINES
from attlog.fleet.entry import Entry
from attlog.fleet.trouble import with_gates
from attlog.present.numbers import counted, duration
from attlog.present.text import typeset

WORST, SHORTEST = 5, 30
QUESTIONS = ("closest", "quiet", "late", "drifting")
WHY = {
    2: "did not fit the options",
    65: "cannot be used",
    66: "cannot be read",
    70: "crashed or hit a bug",
    73: "could not be written",
    75: "took more time or memory than allowed",
}
"""What exit codes mean for a log."""


def summary(
    entries: Sequence[Entry], total: int, seconds: float, folder: Path, again: int = 0, width: int = 160
) -> Iterator[str]:
    """The lines, each at most ``width`` wide. ``again``: how many logs were done in an earlier run."""
    done = [entry for entry in entries if entry.row is not None]
    left = total - len(entries)
    yield (
        f"{counted(total, 'log')}: {counted(len(done), 'report')} in {folder}, {duration(seconds) or '0 s'}"
        + (f"; {again} done before" if again else "")
        + (f"; {left} not reached" if left else "")
    )
    if done:
        answered = {q: sum(_answers(entry, q) for entry in done) for q in QUESTIONS}
        yield (
            "  answered: " + ", ".join(f"{q} on {n}" for q, n in answered.items()) + f" of {counted(len(done), 'log')}"
        )
    failed = [entry for entry in entries if entry.row is None]
    for code, count in sorted(Counter(entry.code for entry in failed).items()):
        first = next(entry for entry in failed if entry.code == code)
        others = f" (and {count - 1} more)" if count > 1 else ""
        yield _cut(
            f"  {counted(count, 'log')} {WHY.get(code, 'failed')} (exit code {code}): {_reason(first)}", width, others
        )
    gates = sum(bool(entry.gates) for entry in entries)
    if gates:
        yield f"  gates failed on {gates} of {counted(len(done), 'log')}"
    said = [(with_gates(entry.row["trouble"], entry.gates), entry) for entry in done if entry.row is not None]
    worst = sorted((pair for pair in said if pair[0]["reasons"]), key=lambda pair: -pair[0]["score"])[:WORST]
    if worst:
        levels = Counter(told["level"] for told, _ in said)
        yield (
            f"  {counted(levels['serious'], 'log')} with serious trouble, {levels['look']} to look at; the worst:"
            if levels["serious"] or levels["look"]
            else "  no log with trouble; what was noticed most:"
        )
    for told, entry in worst:
        yield _cut(f"    {entry.name}: {typeset(told['reasons'][0]['text'])}", width)


def _answers(entry: Entry, question: str) -> bool:
    """Whether a filter has a number for a question on this log; the gyro alone is shown and answers nothing."""
    verdicts = entry.row["verdicts"] if entry.row is not None else []
    return any(v["question"] == question and any(_judged(bar[0]) for bar in v["bars"]) for v in verdicts)


def _judged(row: str) -> bool:
    return re.split("[@/]", row)[0] not in BASELINES and not row.startswith("onboard")


def _reason(entry: Entry) -> str:
    return typeset(" ".join(entry.message.split()))


def _cut(text: str, width: int, behind: str = "") -> str:
    room = max(width, SHORTEST) - len(behind)
    return (text if len(text) <= room else text[: room - 3].rstrip() + "...") + behind
