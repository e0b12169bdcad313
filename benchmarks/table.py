"""What a line of the table is: what was measured, against which peer, what was aimed at and whether that was met."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from statistics import median

from measured import Pair


@dataclass(frozen=True)
class Target:
    """What a value should be at most or at least; ``earlier`` is an older aim for the same."""

    sign: str
    value: float
    unit: str = "x"
    earlier: float | None = None

    def met(self, value: float, aim: float) -> bool:
        return value <= aim if self.sign == "≤" else value >= aim

    def __str__(self) -> str:
        return f"{self.sign} {told(self.value, self.unit)}"


@dataclass(frozen=True)
class Measured:
    """A measurement: the value that is judged, what ours and the peer took in words, how many runs of each."""

    value: float
    ours: str
    peer: str = ""
    runs: int = 1
    note: str = ""


@dataclass(frozen=True)
class Task:
    """One line to be: ``measure`` does the work; ``large`` takes logs of 60 MB or a minute, and is left out by
    ``--quick``."""

    group: str
    what: str
    target: Target | None
    measure: Callable[[], Measured]
    large: bool = False


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    task: Task
    measured: Measured | None
    why_not: str = ""

    @property
    def missed(self) -> bool:
        target = self.task.target
        return self.measured is not None and target is not None and not target.met(self.measured.value, target.value)

    @property
    def verdict(self) -> str:
        """met, missed, not measured because ..., or nothing where nothing was aimed at."""
        target = self.task.target
        if self.measured is None:
            return f"not measured because {self.why_not}"
        if target is None:
            return ""
        words = "missed" if self.missed else "met"
        if target.earlier is not None and target.met(self.measured.value, target.earlier) == self.missed:
            words += f" (earlier aim {told(target.earlier, target.unit)}: {'met' if self.missed else 'missed'})"
        return words

    def cells(self) -> tuple[str, ...]:
        """what, ours, peer, ratio or value, target, verdict, runs."""
        m, target = self.measured, self.task.target
        unit = target.unit if target else "x"
        value = told(m.value, unit) if m and not math.isnan(m.value) else ""
        what = self.task.what + (f" ({m.note})" if m and m.note else "")
        aim = str(target) if target else ""
        return what, m.ours if m else "", m.peer if m else "", value, aim, self.verdict, str(m.runs) if m else ""


HEAD = ("what", "attlog", "against", "ratio or value", "target", "verdict", "runs")


def told(value: float, unit: str) -> str:
    """A value with its unit, three digits."""
    digits = f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
    return digits if unit == "x" else f"{digits} {unit}"


def seconds(x: float) -> str:
    """A time in words."""
    return f"{x:.2f} s" if x >= 0.3 else f"{1e3 * x:.3g} ms" if x >= 3e-4 else f"{1e9 * x:.0f} ns"


def of_pair(pair: Pair, peer: str, *, faster: bool = False, note: str = "") -> Measured:
    """What two works by turns tell: our time over the peer's, or, with ``faster``, the peer's over ours."""
    value = 1.0 / pair.ratio if faster else pair.ratio
    return Measured(value, seconds(median(pair.ours)), f"{peer} {seconds(median(pair.peer))}", len(pair.ours), note)


def rows(tasks: list[Task], quick: bool, minutes: float = math.inf) -> Iterator[Row]:
    """Measure one task after the other; what raises, and what is left after so many minutes, is not measured."""
    begin = time.monotonic()
    for task in tasks:
        if time.monotonic() - begin > 60 * minutes:
            yield Row(task, None, f"{minutes:g} minutes were over")
            continue
        if quick and task.large:
            yield Row(task, None, "--quick leaves large logs out")
            continue
        try:
            measured = task.measure()
        except (Exception, SystemExit) as error:  # a missing peer or a command that fails costs its row, not the table
            lines = str(error).strip().splitlines() or [type(error).__name__]
            yield Row(task, None, f"{type(error).__name__}: {lines[-1][:160]}")
            continue
        yield Row(task, None, measured.note) if math.isnan(measured.value) else Row(task, measured)


def as_text(row: Row) -> str:
    """A line for the terminal."""
    what, ours, peer, value, aim, verdict, runs = row.cells()
    return f"{what:58.58} {ours:>9}  {peer:76.76} {value:>9} {aim:>9}  {verdict}" + (f"  [{runs}]" if runs else "")


def as_markdown(found: list[Row]) -> str:
    """One table; a line in bold begins each group."""
    lines = ["| what | attlog | peer | ratio | aim |", "| --- | --- | --- | --- | --- |"]
    group = ""
    for row in found:
        if row.task.group != group:
            group = row.task.group
            lines.append(f"| **{group}** | | | | |")
        what, ours, peer, value, aim, verdict, _ = (cell.replace("|", "/") for cell in row.cells())
        ratio = value if row.task.target is None or row.task.target.unit == "x" else ""
        judged = ": ".join(part for part in (aim, verdict) if part)
        lines.append(f"| {what} | {ours} | {peer} | {ratio} | {judged} |")
    return "\n".join(lines) + "\n"
