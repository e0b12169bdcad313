"""Which logs of a batch somebody should open first, and how each is called.

Crashes and losses of control come first, then attitudes that were wrong in flight, then other serious findings in
flight, then all else. Of each, real flights stand before logs that never flew, and these before simulated ones.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from attlog.fleet.records.entry import Entry, light
from attlog.fleet.records.trouble import RANKS, trouble, with_gates
from attlog.present.text import typeset

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
