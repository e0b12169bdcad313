"""Which logs of a batch somebody should open first, and how each is called.

Crashes and losses of control come first, then attitudes that were wrong in flight, then other serious findings in
flight, then all else. Of each, real flights stand before logs that never flew, and these before simulated ones.
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

from attlog.batch.index_row import RANKS, Entry, light, sensors_of, trouble, with_gates
from attlog.words.answers import QUESTIONS
from attlog.words.flight import COMPARED_WITH
from attlog.words.numbers import counted, duration
from attlog.words.text import typeset

TITLES = {
    "crash": "crash or loss of control",
    "attitude": "wrong attitude in flight",
    "serious": "other serious finding in flight",
    "ground": "serious on the ground",
    "look": "to look at",
    "failed": "failed",
    "unjudged": "no attitude to judge",
    "none": "without trouble",
}
"""How urgent a log is, in words. A failed gate is a serious finding. A log that failed may hide anything, but there is
nothing to open; one of which nothing could be re-run hides less."""
LEVELS = tuple(TITLES)
FIRST = 5
"""So many logs are named to be opened first."""


@dataclass(frozen=True, slots=True)
class RankedLog:
    """One log as index and summary show it.

    ``level`` is one of LEVELS. ``reasons``: why somebody should look, the heaviest first; ``message``: why there is no
    report.
    """

    name: str
    log: str
    href: str
    level: str
    score: float
    reasons: list[dict[str, Any]]
    message: str
    row: dict[str, Any] | None

    @property
    def place(self) -> tuple[Any, ...]:
        """What logs are sorted by; equally bad ones stand by their names."""
        return (LEVELS.index(self.level), self._kind, -self.score, natural(self.name), self.log)

    @property
    def _kind(self) -> int:
        """0 of a real flight, 1 of a log in which nothing flew, 2 of a simulation."""
        flight = self.row["flight"] if self.row else {}
        return 2 if flight.get("simulated") else 0 if flight.get("airborne_s") or not self.row else 1

    @property
    def opens_first(self) -> bool:
        """Whether there is a report in which something is wrong."""
        return self.level not in ("failed", "unjudged", "none")

    @property
    def text(self) -> str:
        """What happened, in a sentence: the headline; of older results the heaviest reason; why there is no report."""
        headline = str(self.row.get("headline") or "") if self.row else ""
        return headline or (typeset(self.reasons[0]["text"]) if self.reasons else self.message)


def ordered(entries: Iterable[Entry]) -> list[RankedLog]:
    """The logs of a batch, those first that somebody should open first."""
    return sorted(map(ranked, entries), key=lambda log: log.place)


def ranked(entry: Entry) -> RankedLog:
    """One log: how urgently somebody should look, and the link to its report."""
    found = with_gates(entry.row["trouble"] if entry.row else trouble([]), entry.gates)
    return RankedLog(
        entry.name,
        entry.log,
        quote(os.fsencode(f"{entry.name}.html")) if entry.row else "",
        _level(found, entry.row),
        found["score"],
        found["reasons"],
        failure(entry),
        light(entry.row) if entry.row else None,
    )


def _level(found: dict[str, Any], row: dict[str, Any] | None) -> str:
    """Which of LEVELS a log with such trouble has."""
    if row is None:
        return "failed"
    if found["level"] == "none" and row["flight"].get("reference") is None:
        return "unjudged"
    rank = RANKS[found["rank"]]
    if rank in LEVELS:
        return rank
    return "ground" if found["level"] == "serious" else str(found["level"])


def natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts log9 before log10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", name.casefold())]


def failure(entry: Entry) -> str:
    """Why a log has no report, without its name, which stands beside it."""
    text = entry.message.removeprefix("attlog: ")
    for name in (entry.log, entry.name, re.split(r"[/\\]", entry.log)[-1]):
        text = text.removeprefix(f"{name}: ")
    return text


def short_names(names: Sequence[str]) -> list[str]:
    """Names without the words that all of them begin with; as they are where one of them would lose all its words.

    Words end at ``_ - .`` or a blank, so that no number is cut in two.
    """
    if len(names) < 2:
        return list(names)
    stems = [name.rpartition(".")[0] or name for name in names]
    first, last = min(stems), max(stems)  # what these two share, all between them share
    common = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(map(len, stems)))
    words = re.match(r".*[ _.-]", first[:common])
    cut = words.end() if words else 0
    return [name[cut:] for name in names] if all(re.search(r"\w", stem[cut:]) for stem in stems) else list(names)


# What became of many logs, in a screen: what was answered, what failed and why, where to look first.

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
    """Whether a filter has a value for a question on this log."""
    verdicts = entry.row["verdicts"] if entry.row is not None else []
    return any(v["question"] == question and v["answered"] for v in verdicts)


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
