"""Order the logs of a batch by urgency, and summarise them on a terminal.

Crashes and losses of control come first, then wrong attitudes in flight, then other serious findings in flight, then
the rest; within each, real flights before logs that never flew, and these before simulations.
"""

from __future__ import annotations

import os
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from attlog.batch.index_row import REASON_POINTS, Reason, sensors_of
from attlog.batch.job import Record
from attlog.words.answers import QUESTIONS
from attlog.words.flight import COMPARED_WITH
from attlog.words.numbers import counted, duration
from attlog.words.text import typeset

# Levels of urgency, the most urgent first. A failed gate is a serious finding. A log without a report may hide
# anything, but has no page to open. A log without a reference hides less.
TITLES = {
    "crash": "crash or loss of control",
    "attitude": "wrong attitude in flight",
    "serious": "other serious finding in flight",
    "ground": "serious but not in flight",
    "look": "to look at",
    "failed": "failed",
    "unjudged": "no attitude to judge",
    "none": "without trouble",
}
LEVELS = tuple(TITLES)
# A log is serious, or worth a look, if its heaviest reason has this many points.
SERIOUS_POINTS, LOOK_POINTS = 40.0, 10.0
# Number of logs listed under "open first".
OPEN_FIRST = 5


@dataclass(frozen=True, slots=True)
class IndexRow:
    """One log in index and summary; ``reasons``: to look at it, the heaviest first, failed gates among them."""

    record: Record
    reasons: list[Reason]

    @property
    def level(self) -> str:
        """One of LEVELS."""
        if not self.row:
            return "failed"
        serious = [reason for reason in self.reasons if reason.points >= SERIOUS_POINTS]
        found = {r.kind if r.kind in LEVELS else "serious" for r in serious if r.in_flight}
        if found or serious:
            return min(found, key=LEVELS.index, default="ground")
        if self.reasons and self.reasons[0].points >= LOOK_POINTS:
            return "look"
        return "unjudged" if self.flight.get("reference") is None else "none"

    @property
    def score(self) -> float:
        """Sum of points."""
        return round(sum(reason.points for reason in self.reasons), 1)

    @property
    def why(self) -> str:
        """Heaviest reason that the text does not give, without the final stop; empty without one."""
        others = (reason.text for reason in self.reasons if reason.kind != "crash" and reason.text != self.text)
        return next(others, "").rstrip(".")

    @property
    def name(self) -> str:
        """Name of the report."""
        return self.record.name

    @property
    def row(self) -> dict[str, Any]:
        """Numbers of the log, empty without a report."""
        return self.record.row

    @property
    def flight(self) -> dict[str, Any]:
        """Facts of the flight, empty without a report."""
        return self.row["flight"] if self.row else {}

    @property
    def href(self) -> str:
        """Relative URL of the report, empty without one."""
        return quote(os.fsencode(f"{self.name}.html")) if self.row else ""

    @property
    def message(self) -> str:
        """Reason why there is no report."""
        return failure_reason(self.record)

    @property
    def opens_first(self) -> bool:
        """True for a report with a reason to look at it."""
        return self.level not in ("failed", "unjudged", "none")

    @property
    def text(self) -> str:
        """Headline, else the heaviest reason, else why there is no report."""
        headline = str(self.row.get("headline") or "")
        return headline or (typeset(self.reasons[0].text) if self.reasons else self.message)

    @property
    def sort_key(self) -> tuple[Any, ...]:
        """Sort key: level, kind of flight (real, on the ground, simulated), score, name."""
        kind = 2 if self.flight.get("simulated") else 0 if self.flight.get("airborne_s") or not self.row else 1
        return (LEVELS.index(self.level), kind, -self.score, natural_sort_key(self.name), self.record.log)


def index_rows(found: Iterable[Record]) -> list[IndexRow]:
    """Return the logs of a batch, the most urgent first."""
    rows = []
    for record in found:
        why = [Reason("gate", "gate", REASON_POINTS["gate", "serious"], text, in_flight=True) for text in record.gates]
        why += [Reason(**reason) for reason in record.row.get("reasons", [])]
        rows.append(IndexRow(record, sorted(why, key=lambda reason: -reason.points)))
    return sorted(rows, key=lambda row: row.sort_key)


def natural_sort_key(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts log9 before log10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", name.casefold())]


def failure_reason(record: Record) -> str:
    """Return why a log has no report, without its name."""
    text = record.message.removeprefix("attlog: ")
    for name in (record.log, record.name, re.split(r"[/\\]", record.log)[-1]):
        text = text.removeprefix(f"{name}: ")
    return text


def short_names(names: Sequence[str]) -> list[str]:
    """Remove the leading words common to all names.

    Names stay unchanged if one would lose all its words. Words end at ``_ - .`` or a blank, so that no number is cut in
    two.
    """
    if len(names) < 2:
        return list(names)
    stems = [name.rpartition(".")[0] or name for name in names]
    first, last = min(stems), max(stems)  # a prefix of the first and last in sorted order is common to all
    common = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(map(len, stems)))
    words = re.match(r".*[ _.-]", first[:common])
    cut = words.end() if words else 0
    return [name[cut:] for name in names] if all(re.search(r"\w", stem[cut:]) for stem in stems) else list(names)


# Summary of a batch on one screen: answers, failures with reasons, logs to open first.

K = TypeVar("K", str, tuple[bool, int])

# Narrowest text (columns), number of failure reasons, widest headline (columns).
MIN_COLUMNS, MAX_REASONS, HEADLINE_COLUMNS = 30, 5, 100
# What an exit code means for a log.
MEANINGS = {
    2: "did not fit the options",
    65: "cannot be used",
    66: "cannot be read",
    70: "crashed or hit a bug",
    73: "could not be written",
    75: "took more time or memory than allowed",
}


def summary(
    found: Sequence[Record], total: int, seconds: float, folder: Path, again: int = 0, width: int = 160
) -> Iterator[str]:
    """Yield summary lines of at most ``width`` columns.

    ``again``: number of logs finished in an earlier run.
    """
    done = [record for record in found if record.row]
    failed = [record for record in found if not record.row]
    left, known = total - len(found), sum(record.known for record in failed)
    yield (
        f"{counted(total, 'log')}: {counted(len(done), 'report')} in {folder}, {duration(seconds) or '0 s'}"
        + (f"; {again} done before" if again else "")
        + (f"; {known} failed before" if known else "")
        + (f"; {left} not reached" if left else "")
    )
    if done:
        references = Counter(str(record.row["flight"].get("reference")) for record in done)
        against = [f"{key} {references.pop(key)}" for key in COMPARED_WITH if key in references]
        against += [f"nothing {references.total()}"] if references else []
        yield f"  compared with: {', '.join(against)}"
        answered = Counter(v["question"] for record in done for v in record.row["verdicts"] if v["answered"])
        yield "  answered: " + ", ".join(f"{name} {answered[question]}" for question, name in QUESTIONS.items())
    yield from _failures(failed, width)
    gates = sum(bool(record.gates) for record in found)
    if gates:
        yield f"  gates failed on {gates} of {counted(len(done), 'log')}"
    sensors = [sensors_of(record.row) for record in done]
    faults, warnings, offers = (sum(bool(one[key]) for one in sensors) for key in ("faults", "warnings", "to_set"))
    parts = [f"faults in {counted(faults, 'log')}"] * bool(faults)
    parts += [f"warnings in {counted(warnings, 'log')}"] * bool(warnings)
    parts += [f"settings offered for {counted(offers, 'log')}"] * bool(offers)
    if parts:
        yield f"  sensors: {', '.join(parts)}"
    yield from _urgent(index_rows(done), width)


def _urgent(rows: Sequence[IndexRow], width: int) -> Iterator[str]:
    """Yield the number of logs per level, and the logs to open first."""
    levels = Counter(row.level for row in rows)
    parts = [f"{text} {levels[level]}" for level, text in TITLES.items() if levels[level]]
    if parts:
        yield from _wrapped(f"  found: {', '.join(parts)}", width, "    ")
    first = [row for row in rows[:OPEN_FIRST] if row.opens_first]
    if first:
        yield "  open first:"
    for row in first:
        why = f" ({row.why})" if row.why else ""
        yield from _wrapped(f"    {row.name}: {row.text}{why}", min(width, HEADLINE_COLUMNS), "      ")


def _failures(failed: Sequence[Record], width: int) -> Iterator[str]:
    """Yield failures by exit code, new ones first, with one line per reason.

    Reasons that differ only in numbers are one.
    """
    left = MAX_REASONS
    for (known, code), ended in _grouped(failed, lambda record: (record.known, record.code)):
        reasons = _grouped(ended, lambda record: re.sub(r"\d+", "0", _reason(record)))
        shown, left = reasons[:left], max(left - len(reasons), 0)
        what = f"{counted(len(ended), 'log')} {MEANINGS.get(code, 'failed')}"
        what += ", as before" if known else f" (exit code {code})"
        yield f"  {what}" + ("" if not shown else ":" if len(shown) == len(reasons) else ", such as:")
        for _, alike in shown:
            yield f"    {_why(alike, width - 4)}"


def _why(alike: Sequence[Record], width: int) -> str:
    """Return the shared reason of failed logs and the first log's name."""
    name, most = alike[0].name, max(width, MIN_COLUMNS) // 3
    name = name if len(name) <= most else f"{name[: most - 3]}..."
    such = f" ({name} and {len(alike) - 1} more)" if len(alike) > 1 else f" ({name})"
    return textwrap.shorten(_reason(alike[0]), max(width - len(such), MIN_COLUMNS), placeholder=" ...") + such


def _grouped(found: Sequence[Record], key: Callable[[Record], K]) -> list[tuple[K, list[Record]]]:
    """Group records by key: new failures before known ones, large groups before small ones."""
    groups: dict[K, list[Record]] = {}
    for record in found:
        groups.setdefault(key(record), []).append(record)
    return sorted(groups.items(), key=lambda group: (group[1][0].known, -len(group[1]), group[0]))


def _reason(record: Record) -> str:
    """Return the first sentence of a log's failure, without its name."""
    return typeset(" ".join(failure_reason(record).split()).partition(". ")[0])


def _wrapped(text: str, width: int, indent: str) -> list[str]:
    return textwrap.wrap(text, max(width, MIN_COLUMNS), subsequent_indent=indent, break_on_hyphens=False)
