"""A paper run again: claims with verdicts, figures, tables, settings; and the verdicts of intervals.

Each paper has a file with ``paper(options) -> Paper``; page, JSON and terminal show a Paper and know no paper. Texts
are plain (``deg``, ``m/s^2``, ``-1``): page and terminal typeset them. A claim about a size holds where the whole 95 %
interval is on its side, does not hold where it is on the other, and cannot be judged where the interval includes the
limit. Ratios are paired: both numbers of a pair come from the same seed, and the interval is of the mean of their
logarithms.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from attlog.compare.paired import pool_values
from attlog.core.errors import UsageError, suggestion
from attlog.core.plain import IN_JSON, to_plain
from attlog.words.numbers import between, interval, listed, quantity

Array = NDArray[np.float64]
Verdict = Literal["holds", "holds in part", "does not hold", "cannot be judged"]
PAPER_SCHEMA = "attlog-paper/1"
# Verdicts of several claims.
VERDICT_PLURALS: dict[Verdict, str] = {
    "holds": "hold",
    "holds in part": "hold in part",
    "does not hold": "do not hold",
    "cannot be judged": "cannot be judged",
}
# Name of the line of true values, drawn in black.
TRUTH_LINE = "truth"


@dataclass(frozen=True, slots=True)
class PaperNumber:
    """One measured number: mean or ratio over ``n`` independent flights (seeds or logs), 95 % interval or None.

    ``unit`` as in :mod:`attlog.words.numbers` (``deg``, ``s``, ``pct``, ``ratio``); ``value`` None: not measurable.
    """

    what: str
    value: float | None
    unit: str
    ci95: tuple[float, float] | None = None
    n: int = 1


@dataclass(frozen=True, slots=True)
class Claim:
    """A sentence of a paper and its verdict.

    ``says``: in our words. ``where``: figure, table or section. ``paper``: the number it prints, if any.
    ``measured``: how it was measured here. ``numbers``: results, the first ``shown`` the decisive ones. ``by``: by
    how much it holds or not, in short sentences.
    """

    id: str
    says: str
    where: str
    measured: str
    numbers: tuple[PaperNumber, ...]
    verdict: Verdict
    by: str
    paper: str = ""
    shown: int = 1


@dataclass(frozen=True, slots=True)
class FigureLine:
    """A line of a figure: ``x`` and ``y`` (n,), broken by NaN; lines of one name share colour and legend.

    ``low`` and ``high`` (n,): ends of intervals of the points of a figure of kind ``points``.
    """

    name: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    panel: int = 0
    low: Sequence[float] | Array | None = None
    high: Sequence[float] | Array | None = None


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure redrawn from our own run; ``kind``: ``curves`` (dense lines) or ``points`` (with intervals).

    ``x_title`` and each of ``panels`` (titles of stacked y axes) end with their unit after a comma (``time, s``).
    ``ticks``: names of x = 0, 1, 2 ...; ``x_log``: logarithmic x (points only). ``where``: the paper's figure.
    """

    id: str
    where: str
    title: str
    caption: str
    x_title: str
    panels: tuple[str, ...]
    lines: tuple[FigureLine, ...] = field(metadata={IN_JSON: False})
    kind: Literal["curves", "points"] = "curves"
    ticks: tuple[str, ...] = ()
    height: int = 380
    x_log: bool = False


@dataclass(frozen=True, slots=True)
class PaperTable:
    """Numbers in rows, as text; the first column names the row."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class PaperSetting:
    """A setting of the run; ``origin``: whether the paper states it."""

    name: str
    value: str
    origin: Literal["paper", "ours"]


def settings(paper: Mapping[str, str], ours: Mapping[str, str]) -> tuple[PaperSetting, ...]:
    """Return settings by name: those that the paper states, then those that it leaves open."""
    stated = [PaperSetting(name, value, "paper") for name, value in paper.items()]
    return (*stated, *(PaperSetting(name, value, "ours") for name, value in ours.items()))


@dataclass(frozen=True, slots=True)
class Paper:
    """One paper run again; ``key`` names it (``lyu``), ``citation`` is that of docs/references.md, shortened."""

    key: str
    title: str
    citation: str
    settings: tuple[PaperSetting, ...]
    claims: tuple[Claim, ...]
    figures: tuple[PaperFigure, ...]
    tables: tuple[PaperTable, ...] = ()
    notes: tuple[str, ...] = ()
    seeds: int = 0
    logs: tuple[str, ...] = ()
    schema: str = PAPER_SCHEMA
    attlog: dict[str, str] = field(default_factory=dict)
    command: str = ""


def tally_verdicts(paper: Paper) -> str:
    """Return the number of claims by verdict: ``1 holds, 3 hold in part``."""
    counts = Counter(claim.verdict for claim in paper.claims)
    return ", ".join(
        f"{counts[verdict]} {verdict if counts[verdict] == 1 else plural}"
        for verdict, plural in VERDICT_PLURALS.items()
        if counts[verdict]
    )


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """Number of seeds (0, 1, ...) and processes, and logs for the paper with real flights."""

    seeds: int = 20
    processes: int = 1
    logs: tuple[Path, ...] = ()


def paper_json(paper: Paper, indent: int | None = None) -> str:
    """Return claims, numbers, tables, settings; of the figures their texts, not their points."""
    return json.dumps(to_plain(paper), ensure_ascii=False, allow_nan=False, indent=indent) + "\n"


def mean(what: str, values: Sequence[float], unit: str) -> PaperNumber:
    """Return the mean of a number over seeds with Student's interval; seeds without one (NaN) do not count."""
    return _pooled_number(what, [v for v in values if math.isfinite(v)], unit)


def difference(what: str, ours: Sequence[float], other: Sequence[float], unit: str) -> PaperNumber:
    """Return the mean of ``ours - other``, seed by seed."""
    return mean(what, [a - b for a, b in zip(ours, other, strict=True)], unit)


def ratio(what: str, ours: Sequence[float], other: Sequence[float], unit: str = "ratio") -> PaperNumber:
    """Return the geometric mean of ``ours / other``, seed by seed; pairs with a value <= 0 do not count."""
    pairs = [(a, b) for a, b in zip(ours, other, strict=True) if a > 0.0 and b > 0.0]
    logs = _pooled_number(what, [math.log(a / b) for a, b in pairs], unit)
    if logs.value is None:
        return logs
    ends = None if logs.ci95 is None else (math.exp(logs.ci95[0]), math.exp(logs.ci95[1]))
    return PaperNumber(what, math.exp(logs.value), unit, ends, logs.n)


# Measure of a seed: what, then the row of the filter and the conditions.
Key = tuple[str | float, ...]
# Results of one seed; NaN: not measurable.
Measures = dict[Key, float]


@dataclass(frozen=True, slots=True)
class Seeds:
    """Results of all seeds, seed by seed; a seed without a measure does not count in it."""

    found: Sequence[Measures]

    def of(self, *key: str | float) -> list[float]:
        """Return a measure of each seed."""
        return [measures[key] for measures in self.found if key in measures]

    def mean(self, what: str, unit: str, *key: str | float) -> PaperNumber:
        """Return the mean of a measure."""
        return mean(what, self.of(*key), unit)

    def ratio(self, what: str, ours: Key, other: Key) -> PaperNumber:
        """Return the geometric mean of the ratio of two measures."""
        return ratio(what, self.of(*ours), self.of(*other))

    def difference(self, what: str, unit: str, ours: Key, other: Key) -> PaperNumber:
        """Return the mean difference of two measures."""
        return difference(what, self.of(*ours), self.of(*other), unit)

    def share(self, what: str, *keys: Key) -> PaperNumber:
        """Return the percentage of measures that are not 0."""
        return share_of_seeds(what, [value != 0.0 for key in keys for value in self.of(*key)])


def geometric_mean(values: Sequence[float], unit: str = "deg") -> PaperNumber:
    """Return the geometric mean of positive values with its interval."""
    return ratio("", values, [1.0] * len(values), unit)


def mean_text(values: Sequence[float], unit: str) -> str:
    """Return the mean over seeds for a table."""
    return quantity(mean("", values, unit).value, unit)


def numbers_text(numbers: Sequence[PaperNumber]) -> str:
    """Return numbers with their intervals in words."""
    return listed([quantity(n.value, n.unit) + (f" ({interval(n.ci95, n.unit)})" if n.ci95 else "") for n in numbers])


def smallest_and_largest(numbers: Sequence[PaperNumber]) -> tuple[PaperNumber, PaperNumber]:
    """Return the smallest and the largest of the numbers that could be measured."""
    known = [n for n in numbers if n.value is not None] or list(numbers)
    return min(known, key=lambda n: n.value or 0.0), max(known, key=lambda n: n.value or 0.0)


def range_text(numbers: Sequence[PaperNumber], unit: str) -> str:
    """Return the range of numbers in words: ``0.93 to 0.94×``, or one where they look alike."""
    low, high = smallest_and_largest(numbers)
    return between(quantity(low.value, unit), quantity(high.value, unit))


def put_first(first: Sequence[PaperNumber], numbers: Sequence[PaperNumber]) -> tuple[PaperNumber, ...]:
    """Return the numbers of a claim, ``first`` ahead of the others."""
    return (*first, *(n for n in numbers if n not in first))


def share_of_seeds(what: str, hits: Sequence[bool]) -> PaperNumber:
    """Return the percentage of hits among seeds with Wilson's interval (1927)."""
    n = len(hits)
    if n == 0:
        return PaperNumber(what, None, "pct", None, 0)
    p, z2 = sum(hits) / n, 1.959964**2
    middle, half = (
        (p + z2 / (2 * n)) / (1 + z2 / n),
        math.sqrt(z2 * (p * (1 - p) / n + z2 / (4 * n * n))) / (1 + z2 / n),
    )
    return PaperNumber(what, 100 * p, "pct", (100 * max(0.0, middle - half), 100 * min(1.0, middle + half)), n)


def below(number: PaperNumber, limit: float) -> Verdict:
    """Return the verdict on a number being smaller than a limit."""
    if number.value is None or number.ci95 is None:
        return "cannot be judged"
    low, high = number.ci95
    return "holds" if high < limit else "does not hold" if low >= limit else "cannot be judged"


def above(number: PaperNumber, limit: float) -> Verdict:
    """Return the verdict on a number being larger than a limit."""
    if number.value is None or number.ci95 is None:
        return "cannot be judged"
    low, high = number.ci95
    return "holds" if low > limit else "does not hold" if high <= limit else "cannot be judged"


def combine_verdicts(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the verdict on a claim of several parts: common to all, or in part.

    Without a part that holds, one that does not decides: "A and B" is false when A is.
    """
    found = set(verdicts)
    if len(found) == 1:
        return verdicts[0]
    if found & {"holds", "holds in part"}:
        return "holds in part"
    return "does not hold" if "does not hold" in found else "cannot be judged"


def combine_readings(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the verdict on a claim under several readings of what the paper leaves open.

    In part where it holds under some; false only where it is under each.
    """
    found = set(verdicts)
    if len(found) == 1:
        return verdicts[0]
    return "holds in part" if found & {"holds", "holds in part"} else "cannot be judged"


def _pooled_number(what: str, values: Sequence[float], unit: str) -> PaperNumber:
    if not values:
        return PaperNumber(what, None, unit, None, 0)
    if len(values) == 1:
        return PaperNumber(what, float(values[0]), unit)
    found = pool_values(values, [None] * len(values))
    return PaperNumber(what, found.value, unit, found.ci95, len(values))


PAPER_NAMES = ("lyu", "fan", "huang", "xu")
# Papers that use real flights as well.
PAPERS_WITH_LOGS = {"xu"}


def select_papers(names: list[str]) -> list[str]:
    """Return the papers named, ``all`` for all of them, each once. UsageError for other names."""
    for name in names:
        if name != "all" and name not in PAPER_NAMES:
            raise UsageError(f"no paper {name}{suggestion(name, [*PAPER_NAMES, 'all'])}")
    return [name for name in PAPER_NAMES if name in names or "all" in names]


def reproduce(name: str, options: PaperOptions, command: str = "") -> Paper:
    """Run one paper's experiments."""
    from attlog.core.machine import versions

    found = cast(Paper, import_module(f"attlog.reproduce.{name}").paper(options))
    return replace(found, attlog={k: str(v) for k, v in versions().items()}, command=command)
