"""What became of many logs, in a screen: what was answered, what failed and why, where to look first."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from attlog.compare.gates.rows import BASELINES
from attlog.fleet.pages.order import RankedLog, failure, ordered
from attlog.fleet.records.entry import Entry, sensors_of
from attlog.fleet.records.trouble import RANKS
from attlog.present.flight import COMPARED_WITH
from attlog.present.numbers import counted, duration
from attlog.present.sentences import QUESTIONS
from attlog.present.text import typeset

OPENED, SHORTEST, REASONS, LONGEST_REASON = 5, 30, 6, 160
FIRST_COLUMNS = 100
"""Columns over which headlines are laid out."""
WHY = {
    2: "did not fit the options",
    65: "cannot be used",
    66: "cannot be read",
    70: "crashed or hit a bug",
    73: "could not be written",
    75: "took more time or memory than allowed",
}
"""What exit codes mean for a log."""
FOUND = {
    "crash": "a crash or loss of control",
    "attitude": "a wrong attitude in flight",
    "serious": "another serious finding in flight",
}
"""RANKS in words."""


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
        references = Counter(str(entry.row["flight"].get("reference")) for entry in done if entry.row is not None)
        against = [f"{name} {references.pop(key)}" for key, name in COMPARED_WITH.items() if key in references]
        against += [f"nothing {references.total()}"] if references else []
        yield f"  compared with: {', '.join(against)} of {counted(len(done), 'log')}"
        answered = {name: sum(_answers(entry, q) for entry in done) for q, name in QUESTIONS.items()}
        yield (
            "  answered: " + ", ".join(f"{q} on {n}" for q, n in answered.items()) + f" of {counted(len(done), 'log')}"
        )
    yield from _failures(failed, width)
    gates = sum(bool(entry.gates) for entry in entries)
    if gates:
        yield f"  gates failed on {gates} of {counted(len(done), 'log')}"
    yield from _of_sensors(done)
    yield from _found(ordered(done), width)


def _found(logs: Sequence[RankedLog], width: int) -> Iterator[str]:
    """How many logs have what, and those that somebody should open first with what happened."""
    ranks = Counter(RANKS[log.rank] for log in logs)
    parts = [f"{name} in {counted(ranks[rank], 'log')}" for rank, name in FOUND.items() if ranks[rank]]
    rest = [log for log in logs if RANKS[log.rank] not in FOUND]
    parts += [f"{n} more {text}" for level, text in LESS.items() if (n := sum(log.level == level for log in rest))]
    if logs:
        yield from _wrapped(f"  found: {'; '.join(parts)}" if parts else "  found: no log with trouble", width, "    ")
    first = [log for log in logs if log.level != "none"][:OPENED]
    if first:
        yield "  open first:"
    for log in first:
        yield from _wrapped(f"    {log.name}: {log.text}", min(width, FIRST_COLUMNS), "      ")


def _of_sensors(done: Sequence[Entry]) -> Iterator[str]:
    """In how many logs sensors are off, and for how many there is something to set; nothing where there is neither."""
    told = [sensors_of(entry.row) for entry in done if entry.row is not None]
    faults, warnings, offers = (sum(bool(one[key]) for one in told) for key in ("faults", "warnings", "to_set"))
    parts = [f"faults in {counted(faults, 'log')}"] * bool(faults)
    parts += [f"warnings in {counted(warnings, 'log')}"] * bool(warnings)
    parts += [f"settings offered for {counted(offers, 'log')}"] * bool(offers)
    if parts:
        yield f"  sensors: {', '.join(parts)}"


LESS = {"serious": "with a serious finding on the ground", "look": "to look at"}


def _answers(entry: Entry, question: str) -> bool:
    """Whether a filter has a number for a question on this log; the gyro alone is shown and answers nothing."""
    verdicts = entry.row["verdicts"] if entry.row is not None else []
    return any(v["question"] == question and any(_is_filter(bar[0]) for bar in v["bars"]) for v in verdicts)


def _is_filter(row: str) -> bool:
    return re.split("[@/]", row)[0] not in BASELINES and not row.startswith("onboard")


def _failures(failed: Sequence[Entry], width: int) -> Iterator[str]:
    """A line for each reason, new ones first, then those of most logs; reasons that differ in numbers alone are one."""
    groups: dict[tuple[bool, int, str], list[Entry]] = {}
    for entry in failed:
        groups.setdefault((entry.known, entry.code, re.sub(r"\d+", "0", _reason(entry))), []).append(entry)
    by_size = sorted(groups.items(), key=lambda group: (group[0][0], -len(group[1]), group[0][1]))
    for (known, code, _), alike in by_size[:REASONS]:
        such = f"({'such as ' if len(alike) > 1 else ''}{alike[0].name})"
        reason = textwrap.shorten(_reason(alike[0]), LONGEST_REASON, placeholder=" ...")
        yield from _wrapped(f"  {_what(len(alike), code, known)}: {reason} {such}", width, "    ")
    others: Counter[tuple[bool, int]] = Counter()
    for (known, code, _), alike in by_size[REASONS:]:
        others[known, code] += len(alike)
    for (known, code), n in others.items():
        yield f"  {_what(n, code, known)} for other reasons"


def _what(n: int, code: int, known: bool) -> str:
    """How many logs ended with a code."""
    return f"{counted(n, 'log')} {WHY.get(code, 'failed')}{', as before' if known else f' (exit code {code})'}"


def _reason(entry: Entry) -> str:
    """Why a log failed, without its name."""
    return typeset(" ".join(failure(entry).split()))


def _wrapped(text: str, width: int, indent: str) -> list[str]:
    return textwrap.wrap(text, max(width, SHORTEST), subsequent_indent=indent, break_on_hyphens=False)
