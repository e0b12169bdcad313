"""What became of many logs, in a screen: what was answered, what failed and why, where to look first."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from attlog.compare.gates.rows import BASELINES
from attlog.fleet.pages.order import FIRST, TITLES, RankedLog, failure, ordered
from attlog.fleet.records.entry import Entry, sensors_of
from attlog.present.flight import COMPARED_WITH
from attlog.present.numbers import counted, duration
from attlog.present.sentences import QUESTIONS
from attlog.present.text import typeset

K = TypeVar("K", str, tuple[bool, int])

SHORTEST, REASONS = 30, 5
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
        against = [f"{key} {references.pop(key)}" for key in COMPARED_WITH if key in references]
        against += [f"nothing {references.total()}"] if references else []
        yield f"  compared with: {', '.join(against)}"
        answered = {name: sum(_answers(entry, q) for entry in done) for q, name in QUESTIONS.items()}
        yield "  answered: " + ", ".join(f"{q} {n}" for q, n in answered.items())
    yield from _failures(failed, width)
    gates = sum(bool(entry.gates) for entry in entries)
    if gates:
        yield f"  gates failed on {gates} of {counted(len(done), 'log')}"
    yield from _of_sensors(done)
    yield from _found(ordered(done), width)


def _found(logs: Sequence[RankedLog], width: int) -> Iterator[str]:
    """How many logs have what, and those that somebody should open first with what happened."""
    levels = Counter(log.level for log in logs)
    parts = [f"{text} {levels[level]}" for level, text in TITLES.items() if levels[level]]
    if parts:
        yield from _wrapped(f"  found: {', '.join(parts)}", width, "    ")
    first = [log for log in logs[:FIRST] if log.opens_first]
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


def _answers(entry: Entry, question: str) -> bool:
    """Whether a filter has a number for a question on this log; the gyro alone is shown and answers nothing."""
    verdicts = entry.row["verdicts"] if entry.row is not None else []
    return any(v["question"] == question and any(_is_filter(bar[0]) for bar in v["bars"]) for v in verdicts)


def _is_filter(row: str) -> bool:
    return re.split("[@/]", row)[0] not in BASELINES and not row.startswith("onboard")


def _failures(failed: Sequence[Entry], width: int) -> Iterator[str]:
    """How logs ended, new failures first, and a line for each reason; those that differ in numbers alone are one."""
    left = REASONS
    for (known, code), ended in _grouped(failed, lambda entry: (entry.known, entry.code)):
        reasons = _grouped(ended, lambda entry: re.sub(r"\d+", "0", _reason(entry)))
        shown, left = reasons[:left], max(left - len(reasons), 0)
        what = f"{counted(len(ended), 'log')} {WHY.get(code, 'failed')}"
        what += ", as before" if known else f" (exit code {code})"
        yield f"  {what}" + ("" if not shown else ":" if len(shown) == len(reasons) else ", such as:")
        for _, alike in shown:
            yield f"    {_why(alike, width - 4)}"


def _why(alike: Sequence[Entry], width: int) -> str:
    """The reason of logs that failed alike, and the first one's name, in one line."""
    name, most = alike[0].name, max(width, SHORTEST) // 3
    name = name if len(name) <= most else f"{name[: most - 3]}..."
    such = f" ({name} and {len(alike) - 1} more)" if len(alike) > 1 else f" ({name})"
    return textwrap.shorten(_reason(alike[0]), max(width - len(such), SHORTEST), placeholder=" ...") + such


def _grouped(entries: Sequence[Entry], key: Callable[[Entry], K]) -> list[tuple[K, list[Entry]]]:
    """Entries of one key together, those of most logs first; what failed before comes after what is new."""
    groups: dict[K, list[Entry]] = {}
    for entry in entries:
        groups.setdefault(key(entry), []).append(entry)
    return sorted(groups.items(), key=lambda group: (group[1][0].known, -len(group[1]), group[0]))


def _reason(entry: Entry) -> str:
    """Why a log failed, in one sentence without its name."""
    return typeset(" ".join(failure(entry).split()).partition(". ")[0])


def _wrapped(text: str, width: int, indent: str) -> list[str]:
    return textwrap.wrap(text, max(width, SHORTEST), subsequent_indent=indent, break_on_hyphens=False)
