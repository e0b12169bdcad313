"""What became of many logs, in ten lines or so: what was answered, what failed and why, where to look first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from attlog.compare.gates.rows import BASELINES
from attlog.fleet.records.entry import Entry
from attlog.fleet.records.trouble import with_gates
from attlog.present.numbers import counted, duration
from attlog.present.text import typeset

WORST, SHORTEST, REASONS = 5, 30, 6
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
    failed = [entry for entry in entries if entry.row is None]
    left, known = total - len(entries), sum(entry.known for entry in failed)
    yield (
        f"{counted(total, 'log')}: {counted(len(done), 'report')} in {folder}, {duration(seconds) or '0 s'}"
        + (f"; {again} done before" if again else "")
        + (f"; {known} failed before" if known else "")
        + (f"; {left} not reached" if left else "")
    )
    if done:
        answered = {q: sum(_answers(entry, q) for entry in done) for q in QUESTIONS}
        yield (
            "  answered: " + ", ".join(f"{q} on {n}" for q, n in answered.items()) + f" of {counted(len(done), 'log')}"
        )
    yield from _failures(failed, width)
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
        headline = entry.row.get("headline") if entry.row is not None else ""
        yield _cut(f"    {entry.name}: {headline or typeset(told['reasons'][0]['text'])}", width)


def _answers(entry: Entry, question: str) -> bool:
    """Whether a filter has a number for a question on this log; the gyro alone is shown and answers nothing."""
    verdicts = entry.row["verdicts"] if entry.row is not None else []
    return any(v["question"] == question and any(_judged(bar[0]) for bar in v["bars"]) for v in verdicts)


def _judged(row: str) -> bool:
    return re.split("[@/]", row)[0] not in BASELINES and not row.startswith("onboard")


def _failures(failed: Sequence[Entry], width: int) -> Iterator[str]:
    """A line for each reason, new ones first, then those of most logs; reasons that differ in numbers alone are one."""
    groups: dict[tuple[bool, int, str], list[Entry]] = {}
    for entry in failed:
        groups.setdefault((entry.known, entry.code, re.sub(r"\d+", "0", _reason(entry))), []).append(entry)
    ordered = sorted(groups.items(), key=lambda group: (group[0][0], -len(group[1]), group[0][1]))
    for (known, code, _), alike in ordered[:REASONS]:
        others = f" (and {len(alike) - 1} more)" if len(alike) > 1 else ""
        what = f"{counted(len(alike), 'log')} {WHY.get(code, 'failed')}"
        said = ", as before" if known else f" (exit code {code})"
        yield _cut(f"  {what}{said}: {alike[0].log}: {_reason(alike[0])}", width, others)
    rest = [entry for _, alike in ordered[REASONS:] for entry in alike]
    if rest:
        yield f"  {counted(len(rest), 'log')} failed for {counted(len(ordered) - REASONS, 'other reason')}"


def _reason(entry: Entry) -> str:
    """Why a log failed, without its name."""
    return typeset(" ".join(entry.message.removeprefix(f"{entry.log}: ").split()))


def _cut(text: str, width: int, behind: str = "") -> str:
    room = max(width, SHORTEST) - len(behind)
    return (text if len(text) <= room else text[: room - 3].rstrip() + "...") + behind
