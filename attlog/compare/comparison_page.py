"""A comparison at a glance: rows are configurations, columns the four questions, each cell a difference to the first.

What a cell draws and what a sentence says are read off one :class:`DirectedDifference`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, median_low
from typing import Any

from attlog.compare.comparison import Comparison, Contrast, LogDifference, PooledDifference, Question
from attlog.compare.paired import Direction
from attlog.compare.run import commonest_reason
from attlog.compare.tables import first_median_text, matrix_of_log, matrix_over_logs
from attlog.compare.wording import (
    STATUS_WORDS,
    DirectedDifference,
    direct_difference,
    interval_text,
    scale_title,
    signed_text,
    subject_of,
)
from attlog.core.plain import to_plain
from attlog.report import shell
from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import PageFigure
from attlog.report.figures.style import assign_colours
from attlog.words.numbers import counted, listed, unit_sign
from attlog.words.ranking import DRIFT_AIR

COLUMN_OF_METRIC = {
    "tilt_rmse_deg": "Accuracy",
    "heading_rmse_deg": "Accuracy",
    "noise_tilt_deg": "Static noise",
    "lag_ms": "Step response",
    "step_error_deg.0.5s": "Step response",
    "drift_rest_deg_per_min": "Yaw drift",
    DRIFT_AIR: "Yaw drift",
}
"""The question that a metric answers; of several the one that most logs answer is drawn."""
MAX_METRIC_COLUMNS = 4
"""So many metrics have a column each, more of them share the four."""
MAX_NAMED = 3
"""So many configurations or questions are named in a sentence, others are counted."""
FAR_RATIO = 4.0
"""A difference this many times the middle one runs out of its column."""
WIDE_RATIO = 2.5
"""An interval this many times the middle one too."""
HALF_WIDTH_PCT = 45.0
"""The ends of a column's scale stand so many percent of its width from the middle."""


@dataclass(frozen=True, slots=True)
class OverviewCell:
    """A configuration beside the first in one question. Places are percent of the cell's width, 50 is no difference.

    ``ends``: the 95 % interval; ``beyond``: -1 or 1 where the value lies outside of the scale; ``floor``: half of the
    width that counts as no difference; ``logs``: one place for each log. ``value`` empty: ``say`` tells why.
    """

    direction: Direction = "not significant"
    value: str = ""
    count: str = ""
    say: str = ""
    x: float = 50.0
    ends: tuple[float, float] | None = None
    beyond: int = 0
    floor: float = 0.0
    logs: tuple[float, ...] = ()


@dataclass(slots=True)
class OverviewColumn:
    """A question: ``what`` is drawn in which unit, ``sentence``, a cell for each configuration after the first.

    ``first``: the median of the first one's own values; ``ends``: what the ends of the scale are worth; ``cells`` are
    empty where no log answers it.
    """

    title: str
    what: str
    sentence: str
    first: str = ""
    ends: tuple[str, str] = ("", "")
    cells: list[OverviewCell] = field(default_factory=list)


def overview(found: Comparison) -> list[OverviewColumn]:
    """The columns: four, or one for each of few metrics that were asked for."""
    groups: dict[str, list[Question]] = {}
    few = len(found.questions) + len(found.unanswered) <= MAX_METRIC_COLUMNS
    for question in found.questions:
        title = question.title if few else COLUMN_OF_METRIC.get(question.metric, "")
        groups.setdefault(title, []).append(question)
    groups.pop("", None)
    columns = {title: _overview_column(found, title, max(some, key=_question_weight)) for title, some in groups.items()}
    for name, why in found.unanswered.items():
        title = COLUMN_OF_METRIC.get(name.partition("@")[0], name if few else "")
        if title and title not in columns:
            columns[title] = OverviewColumn(title, "", f"Cannot be determined: {why.rstrip('.')}.")
    order = [*dict.fromkeys(COLUMN_OF_METRIC.values())]
    return sorted(columns.values(), key=lambda c: order.index(c.title) if c.title in order else len(order))


def comparison_headline(found: Comparison) -> list[str]:
    """What is significant over all logs: who is better than the first, and who is worse; else that nobody is."""
    first, *others = found.configurations
    most = MAX_NAMED if len(others) < MAX_NAMED else 1
    views = {c.label: _pooled_views(found, c.name) for c in others}
    said = []
    for direction in ("better", "worse"):
        who = []
        for label, each in views.items():
            parts = [f"{subject_of(q)} ({signed_text(v.value, q)})" for q, v in each if v.direction == direction]
            more = [f"{len(parts) - most} more"] if len(parts) > most else []
            who += [f"{label} in {listed([*parts[:most], *more])}"] if parts else []
        said += [f"Significantly {direction} than {first.label}: {'; '.join(who)}."] if who else []
    if said or not any(views.values()):
        return said
    return [f"No significant difference to {first.label} in any question."]


def _pooled_views(found: Comparison, name: str) -> list[tuple[Question, DirectedDifference]]:
    """The pooled differences of a configuration, question by question; of ``--metric all`` those of COLUMNS."""
    asked = [q for q in found.questions if q.main or q.metric in COLUMN_OF_METRIC]
    pairs = [(q, c.over) for q in asked for c in q.contrasts if c.configuration == name and c.over is not None]
    return [(q, view) for q, over in pairs if (view := direct_difference(q, over)) is not None]


def _question_weight(question: Question) -> tuple[int, int]:
    """How much a question has to show: significant differences, then logs."""
    overs = [c.over for c in question.contrasts if c.over is not None]
    return sum(over.direction in ("better", "worse") for over in overs), sum(over.logs for over in overs)


def _no_difference_reason(found: Comparison, differences: Iterable[LogDifference]) -> str:
    """The commonest reason for no difference, without whose it is."""
    why = commonest_reason(b.reason for b in differences) or "no log has a difference"
    for c in found.configurations:
        why = why.removeprefix(f"{c.name}: ")
    return f"Cannot be determined: {why.rstrip('.')}."


def _overview_column(found: Comparison, title: str, question: Question) -> OverviewColumn:
    what = f"{question.title}, {scale_unit(question) or 'difference'}"
    if all(c.over is None for c in question.contrasts):
        return OverviewColumn(
            title, what, _no_difference_reason(found, [b for c in question.contrasts for b in c.logs])
        )
    limit = _scale_limit(question)
    first = first_median_text(found, question)
    own = unit_sign(question.unit)
    cells = [_overview_cell(found, question, c, limit) for c in question.contrasts]
    called = {c.name: c.label for c in found.configurations}
    names = {
        d: [called[c.configuration] for c, cell in zip(question.contrasts, cells, strict=True) if cell.direction == d]
        for d in ("better", "worse")
    }
    far = (math.exp(-limit), math.exp(limit)) if question.scale == "ratio" else (-limit, limit)
    return OverviewColumn(
        title,
        what,
        _column_sentence(names["better"], names["worse"]),
        first + (own if own.startswith("°") else f" {own}" if own and first else ""),
        (end_label(far[0], question), end_label(far[1], question)),
        cells,
    )


def end_label(value: float, question: Question) -> str:
    """What an end of a scale is worth, without its unit; of a ratio from ten on the factor: ``÷40``, ``×40``."""
    if question.scale == "ratio" and not 0.1 < value < 10.0:
        return f"×{value:.3g}" if value > 1.0 else f"÷{1.0 / value:.3g}"
    return signed_text(value, question).removesuffix(scale_unit(question)).strip()


def scale_unit(question: Question) -> str:
    """The unit of a difference: percent of a ratio, else that of the metric."""
    return "%" if question.scale == "ratio" else unit_sign(question.unit)


def _column_sentence(better: Sequence[str], worse: Sequence[str]) -> str:
    """Who differs significantly, in at most twenty words."""

    def some(names: Sequence[str]) -> str:
        return listed(list(names)) if len(names) <= MAX_NAMED else counted(len(names), "configuration")

    parts = [f"{word}: {some(names)}" for names, word in ((better, "Better"), (worse, "Worse")) if names]
    return f"{'. '.join(parts)}." if parts else "No significant difference."


def _overview_cell(found: Comparison, question: Question, contrast: Contrast, limit: float) -> OverviewCell:
    over = contrast.over
    view = None if over is None else direct_difference(question, over)
    if view is None:
        return OverviewCell(say=_no_difference_reason(found, contrast.logs))
    size = _on_scale(question, view.value)
    same = view.logs - view.better - view.worse
    count = view.better if size < 0.0 else view.worse if size > 0.0 else same
    text = "equal" if view.direction == "same" else signed_text(view.value, question)
    certain = "" if view.direction == "same" else f" ({interval_text(view)})" if view.ci95 else ""
    said = {"better": "significantly better", "worse": "significantly worse", "same": "no difference"}
    return OverviewCell(
        view.direction,
        text,
        f"{count}/{counted(view.logs, 'log')}" if len(found.logs) > 1 else "",
        f"{text}{certain}, {said.get(view.direction, 'not significant')}",
        _place_pct(size, limit),
        None
        if view.ci95 is None
        else (_value_place(question, view.ci95[0], limit), _value_place(question, view.ci95[1], limit)),
        0 if abs(size) <= limit else 1 if size > 0.0 else -1,
        abs(_place_pct(min(view.floor, limit), limit) - 50.0),
        tuple(_value_place(question, b.value, limit) for b in contrast.logs if b.value is not None),
    )


def _on_scale(question: Question, value: float) -> float:
    """A difference where it is drawn: ratios by their logarithm."""
    if question.scale != "ratio":
        return value
    return math.log(value) if value > 0.0 else -math.inf


def _place_pct(size: float, limit: float) -> float:
    """Percent of the cell's width; what lies outside of the scale stands at its end."""
    return round(50.0 + HALF_WIDTH_PCT * min(max(size / limit, -1.0), 1.0), 2)


def _value_place(question: Question, value: float, limit: float) -> float:
    return _place_pct(_on_scale(question, value), limit)


def _scale_limit(question: Question) -> float:
    """What the end of a column's scale is worth: neither differences nor intervals far from the middle one set it."""
    pooled = [c.over for c in question.contrasts if c.over is not None]
    sizes = [abs(_on_scale(question, o.value)) for o in pooled]
    middle = median_low(sizes)
    kept = [k for k, size in enumerate(sizes) if size <= FAR_RATIO * middle] or list(range(len(sizes)))
    most = max(sizes[k] for k in kept)
    reach = [max(sizes[k], *(abs(_on_scale(question, e)) for e in pooled[k].ci95 or (0.0,))) for k in kept]
    longest = min(max(reach), WIDE_RATIO * median_low(reach))
    return max(1.1 * most, 1.1 * longest, 2.0 * median(o.floor for o in pooled), 1e-6)


# A comparison as one self-contained page: what is significant, dots and intervals, tables, forest plots.

WEB_FOLDER = Path(__file__).parent / "web"


def render_comparison(found: Comparison) -> str:
    """The page as text: nothing in it is loaded from anywhere."""
    used = [line for line in found.logs if not line.code]
    figures = {
        q.id: _forest_figure(found, q, number)
        for number, q in enumerate(found.questions)
        if q.main and _has_difference(q)
    }
    slots = assign_colours([c.name for c in found.configurations])
    rows = [
        {"name": c.label, "slot": slot, "dash": "solid", "shown": True, "onboard": False, "lost": False}
        for c, slot in zip(found.configurations, slots, strict=True)
    ]
    return shell.render(
        "compare.html",
        WEB_FOLDER,
        rows=rows,
        figures=figures.values(),
        store=ArrayPacker(),
        document=to_plain(found),
        scripts=("folded.js",),
        styles=("compare.css",),
        found=found,
        names={c.name: c.label for c in found.configurations},
        slots={c.name: row["slot"] for c, row in zip(found.configurations, rows, strict=True)},
        plots=figures.values(),
        said=comparison_headline(found),
        columns=overview(found),
        troubles=status_words(found),
        onboard=sum(line.reference.startswith("onboard") for line in used),
        used=used,
        whole=matrix_over_logs(found),
        each=[(line, matrix_of_log(found, line)) for line in used],
        config=configurations_toml(found),
    )


def status_words(found: Comparison) -> dict[str, str]:
    """What became of configurations that are not compared on some logs, by name: ``diverged on 2 logs``."""
    said = {}
    for c in found.configurations:
        cells = [cells[c.name] for cells in found.questions[0].cells.values()] if found.questions else []
        states = [cell.status for cell in cells if cell.status != "ok"]
        parts = [f"{STATUS_WORDS.get(s, s)} on {counted(states.count(s), 'log')}" for s in dict.fromkeys(states)]
        if parts:
            said[c.name] = listed(parts)
    return said


def _has_difference(question: Question) -> bool:
    return any(b.value is not None for c in question.contrasts for b in c.logs)


def _forest_figure(found: Comparison, question: Question, number: int) -> PageFigure:
    """The forest plot of a question: logs with a value, and all of them below."""
    order = [c.name for c in found.configurations]
    called = {c.name: c.label for c in found.configurations}
    logs = [
        line.name
        for line in found.logs
        if any(b.log == line.name and b.value is not None for c in question.contrasts for b in c.logs)
    ]
    pooled = any(c.over is not None and c.over.logs > 1 for c in question.contrasts)
    lines = [*logs, "all logs"] if pooled else logs
    items: list[dict[str, Any]] = []
    rows: list[list[Any]] = [["log", "configuration", "first", "scale", "value", "low95", "high95", "significant"]]
    for c in question.contrasts:
        places: list[tuple[LogDifference | PooledDifference, int, str]]
        places = [(b, lines.index(b.log), b.log) for b in c.logs if b.value is not None]
        if c.over is not None and c.over.logs > 1:
            places.append((c.over, len(logs), "all logs"))
        for one, line, name in places:
            view = direct_difference(question, one)
            if view is None:
                continue
            ends: list[float | None] | None = list(one.ci95) if one.ci95 is not None else None
            say = f"{name}, {called[c.configuration]}: {signed_text(view.value, question)}" + (
                f" ({interval_text(view)})" if ends else ""
            )
            items.append(
                {
                    "r": order.index(c.configuration),
                    "line": line,
                    "v": one.value,
                    "ci": ends,
                    "all": line == len(logs),
                    "significant": one.direction in ("better", "worse"),
                    "say": say,
                }
            )
            rows.append(
                [name, c.configuration, order[0], question.scale, one.value, *(ends or [None, None]), one.direction]
            )
    words = "; ".join(item["say"] for item in items)
    height = 92 + 26 * len(lines) * max(1, (len(question.contrasts) + 1) // 2)
    data = {
        "items": items,
        "lines": lines,
        "all": pooled,
        "log": question.scale == "ratio",
        "table": rows,
        "axis": scale_title(question, called[order[0]]),
    }
    caption = (
        "Line: 95 % interval. Filled: significant. Diamond: all logs together. Lines that leave the figure are cut."
    )
    title = f"{question.title} beside {called[order[0]]}"
    return PageFigure(f"forest{number}", "forest", title, caption, height, data, True, words)


def configurations_toml(found: Comparison) -> str:
    """The configurations as a file that ``attlog compare`` reads."""
    import tomli_w

    parts = []
    for c in found.configurations:
        table: dict[str, Any] = {"name": c.name, "estimator": c.text.partition(":")[0]}
        if ".py" in c.text or ".csv" in c.text:
            table["estimator"] = c.text[: max(c.text.find(".py") + 3, c.text.find(".csv") + 4)]
        table |= {k: _toml_value(v) for k, v in (*c.parameters.items(), *c.before.items())}
        parts.append("[[configuration]]\n" + tomli_w.dumps(table))
    return "\n".join(parts)


def _toml_value(text: str) -> Any:
    try:
        numbers = [float(part) for part in text.split("/")]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers
