"""The page of a tuning: how flat the optimum is, what was gained, gains to paste, what was judged where."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare.sweep.text import named, references_of
from attlog.compare.tables.settings_page import PageSection, SettingsPage, render
from attlog.compare.tune.search import FreeParameter
from attlog.compare.tune.text import document, gain_rows, judged_rows, part_rows, paste, sentences
from attlog.compare.tune.tune import Tuning
from attlog.present.numbers import counted, unit_sign
from attlog.report.figures.figure import PageFigure, listed

WORST_SHOWN = 1.5
"""Costs beyond this share above the spread of the better half are drawn at the upper edge."""


def tune_page(t: Tuning, about: Mapping[str, Any], firmware: Mapping[str, str]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    where = counted(len(t.logs), "log") if len(t.logs) > 1 else "one log"
    sections = list(_sections(t, about, firmware))
    whole = document(t, dict(about), dict(firmware))
    return render(SettingsPage("tune", f"{t.filter}: gains from {where}", whole, sections))


def _sections(t: Tuning, about: Mapping[str, Any], firmware: Mapping[str, str]) -> Iterator[PageSection]:
    tried = [_tried(t, f, k) for k, f in enumerate(t.free)]
    yield PageSection("How flat the optimum is", figures=tried, said=list(sentences(t, references_of(about))))
    yield PageSection("Gains, ready to paste", code="\n".join(paste(t, firmware)))
    yield PageSection("On what was left out", table=judged_rows(t), folded=True)
    yield PageSection("How much the gains depend on the logs", table=gain_rows(t), folded=True)
    yield PageSection("Each part, with gains that were not found on it", table=part_rows(t), folded=True)


def _tried(t: Tuning, f: FreeParameter, number: int) -> PageFigure:
    """The change of the objective over one gain, a dot for each setting that was tried."""
    changes = [100.0 * (math.exp(cost) - 1.0) for _, cost in t.found.tried]
    low, middle = min(changes), sorted(changes)[len(changes) // 2]
    gains = [float(setting[f.name]) for setting, _ in t.found.tried]
    unit = unit_sign(f.unit)
    again = [float(fold.found.setting[f.name]) for fold in t.folds]
    data = {
        "band": [min(again), max(again)],
        "x": listed(gains),
        "y": listed(changes),
        "log": f.log,
        "range": [f.low, f.high],
        "top": max(middle + WORST_SHOWN * (middle - low), low + 1.0),
        "best": [setting == t.found.setting for setting, _ in t.found.tried],
        "say": [f"{named(tried[0])}: {c:+.0f} %" for tried, c in zip(t.found.tried, changes, strict=True)],
        "axis": f"{f.name}, {unit}" if unit else f.name,
        "title": "objective, % of the default gains",
        "table": [[f.name, "objective [%]"], *([g, c] for g, c in zip(listed(gains), listed(changes), strict=True))],
    }
    caption = "Red: the gains found. Band: found with logs left out. Triangles: worse than the figure reaches."
    words = f"{named(t.found.setting)}: {min(changes):+.0f} %"
    return PageFigure(
        f"tried{number}",
        "tried",
        f"Every setting that was tried, by {f.name}",
        caption,
        300,
        data,
        len(t.free) == 1,
        words,
    )
