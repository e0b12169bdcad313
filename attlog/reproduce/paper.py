"""What a paper claims and what was found here: the claims with their verdicts, figures, tables, settings.

One file per paper has ``paper(options) -> Paper``; page, JSON and terminal show a Paper and know no paper.
Texts are plain (``deg``, ``m/s^2``, ``-1``): the page and the terminal typeset them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base.plain import IN_JSON

Array = NDArray[np.float64]
Verdict = Literal["holds", "holds in part", "does not hold", "cannot be judged"]
SCHEMA = "attlog-paper/1"
MANY: dict[Verdict, str] = {
    "holds": "hold",
    "holds in part": "hold in part",
    "does not hold": "do not hold",
    "cannot be judged": "cannot be judged",
}
"""Each verdict as it is said of several claims."""
TRUTH = "truth"
"""The name of a line that shows what really was; it is drawn in black."""


@dataclass(frozen=True, slots=True)
class PaperNumber:
    """One measured number: mean or ratio over ``n`` independent flights (seeds or logs), 95 % interval or None.

    ``unit`` as in :mod:`attlog.present.numbers` (``deg``, ``s``, ``pct``, ``ratio``); ``value`` None: not measurable.
    """

    what: str
    value: float | None
    unit: str
    ci95: tuple[float, float] | None = None
    n: int = 1


@dataclass(frozen=True, slots=True)
class Claim:
    """A sentence of a paper and what became of it.

    ``says`` in our words; ``where`` figure, table or section; ``paper`` the number it prints, empty where it prints
    none; ``measured`` how it was measured here; ``numbers`` what was, the ``shown`` first ones those that tell most;
    ``by`` by how much it holds or not, in short sentences.
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
    """A line of a figure: ``x`` and ``y`` (n,), NaN breaks it; lines of one name share colour and legend.

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
    """A figure redrawn from our own run. ``kind``: ``curves`` (dense lines) or ``points`` (with intervals).

    ``x_title`` and each of ``panels`` (titles of the y axes, stacked, sharing x) end with their unit after a comma
    (``time, s``). ``ticks``: names of x = 0, 1, 2 ... in place of numbers; ``x_log``: equal factors are equally far
    apart (points only). ``where``: the paper's figure.
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
    """A setting of the run; ``origin``: ``paper`` where the paper states it, ``ours`` where it does not."""

    name: str
    value: str
    origin: Literal["paper", "ours"]


@dataclass(frozen=True, slots=True)
class Paper:
    """One paper run again. ``key`` names it (``lyu``); ``citation`` is that of docs/references.md, shortened."""

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
    schema: str = SCHEMA
    attlog: dict[str, str] = field(default_factory=dict)
    command: str = ""


def tally(paper: Paper) -> str:
    """How many claims have which verdict: ``1 holds, 3 hold in part``."""
    counts = Counter(claim.verdict for claim in paper.claims)
    return ", ".join(
        f"{counts[verdict]} {verdict if counts[verdict] == 1 else plural}"
        for verdict, plural in MANY.items()
        if counts[verdict]
    )


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """What a run may be told: how many seeds (0, 1, ... are flown), how many processes, logs for the paper that wants
    some."""

    seeds: int = 20
    processes: int = 1
    logs: tuple[Path, ...] = ()
