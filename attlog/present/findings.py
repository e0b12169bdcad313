"""What is wrong with this log and what to do, as it is shown: a line for each finding, its evidence behind it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.present.numbers import moment
from attlog.present.text import typeset

if TYPE_CHECKING:
    from attlog.result import Finding, Result

SEVERITY = {
    "serious": ("Serious", "bad"),
    "warning": ("Warning", "warn"),
    "note": ("Note", "note"),
    "info": ("Note", "note"),
}
"""Severity, worst first: its label and style."""


@dataclass(frozen=True, slots=True)
class ShownFinding:
    """A finding as it is shown: its sentence in three parts, of which the second is when it was (may be empty).

    ``t`` s, None where it has no time; ``why``: evidence, and the cause, a line each.
    """

    label: str
    style: str
    before: str
    when: str
    after: str
    t: float | None
    action: str
    why: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.before}{self.when}{self.after}"

    @property
    def line(self) -> str:
        """The sentence and what to do."""
        return f"{self.text} {self.action}".strip()

    @property
    def is_note(self) -> bool:
        """Whether it changes nothing for the reader."""
        return self.style == "note"


def findings(result: Result) -> list[ShownFinding]:
    """The findings of a result as they are shown."""
    return shown_findings(result.findings)


def shown_findings(found: Iterable[Finding]) -> list[ShownFinding]:
    """Findings as they are shown, worst first."""
    order = {name: i for i, name in enumerate(SEVERITY)}
    return [_shown(finding) for finding in sorted(found, key=lambda f: order.get(f.severity, 9))]


def nothing_wrong(shown: list[ShownFinding], hidden: int = 0) -> str:
    """What stands where nothing is listed; ``hidden`` notes are not."""
    if shown:
        return ""
    notes = {0: "", 1: "; 1 note with -v"}.get(hidden, f"; {hidden} notes with -v")
    return f"No problem was found{notes}."


def _shown(finding: Finding) -> ShownFinding:
    label, style = SEVERITY.get(finding.severity, ("Note", "note"))
    text = typeset(finding.text)
    if finding.offset is not None and str(finding.offset) not in finding.text:
        text = f"{text.rstrip('.')}, at byte {finding.offset:,}."
    t = round(finding.t, 3) if finding.t is not None and math.isfinite(finding.t) else None
    told = any(f" {n} " in f" {text} " for n in (str(finding.count), f"{finding.count:,}"))
    times = f"{finding.count:,} times" if finding.count > 1 and not told else ""
    before, when, after = _timed(text, t, times)
    why = [typeset(line) for line in finding.evidence]
    why += [f"Cause: {typeset(finding.cause)}"] if finding.cause else []
    action = "" if finding.action in finding.text else typeset(finding.action)
    return ShownFinding(label, style, before, when, after, t, action, tuple(why))


def _timed(text: str, t: float | None, times: str) -> tuple[str, str, str]:
    """A sentence parted at its time, which is put at its end where it does not stand in it, with how often (times)."""
    if t is None:
        return (f"{text.rstrip('.')} ({times})." if times else text), "", ""
    for written in dict.fromkeys((moment(t), f"{t:.1f} s", f"{t:.1f}", f"{t:.0f} s", f"{t:.0f}")):
        found = re.search(rf"(?:(?<=at )|(?<=rom )|(?<=, )(?=[\d.]+ to )){re.escape(written)}(?![\d.]\d)", text)
        if found:
            after = text[found.end() :]
            return text[: found.start()], written, f"{after.rstrip('.')} ({times})." if times else after
    return f"{text.rstrip('.')} ({times + ', ' if times else ''}{'from' if times else 'at'} ", moment(t), ")."
