"""Comparison as one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median, median_low
from typing import Any

from attlog.compare.comparison import Comparison, Question
from attlog.compare.paired import Difference
from attlog.compare.tables import WEB_FOLDER, MatrixRow, matrix
from attlog.compare.wording import STATUS_WORDS, change_text, direction_word, scale_unit, signed_text, titled
from attlog.core.plain import json_text, to_plain
from attlog.report import shell
from attlog.report.figures.figure import PageFigure
from attlog.report.figures.style import RowStyle, assign_colours
from attlog.words.numbers import counted, listed

# Differences and intervals beyond this multiple of the median one do not extend the scale of their row.
FAR_RATIO, WIDE_RATIO = 4.0, 2.5
# Half width of a row's scale, in percent of the cell's width.
HALF_WIDTH_PCT = 45.0


@dataclass(frozen=True, slots=True)
class Dot:
    """Difference drawn in its cell, in percent of the width from 0 to 100.

    50 is no difference. ``beyond``: -1 or 1 outside the scale. ``floor``: half width of the log's resolution. ``logs``:
    one place per log.
    """

    x: float
    ends: tuple[float, float] | None
    beyond: int
    floor: float
    logs: tuple[float, ...]
    say: str


def render_comparison(found: Comparison) -> str:
    """Return the page as text; it loads no other file."""
    figures = {
        q.id: _forest_figure(found, q, n) for n, q in enumerate(found.questions) if q.main and _has_difference(q)
    }
    slots = assign_colours([c.name for c in found.configurations])
    rows = [RowStyle(c.label, slot, "solid") for c, slot in zip(found.configurations, slots, strict=True)]
    whole = matrix(found)
    return shell.render(
        "compare.html",
        WEB_FOLDER,
        rows=rows,
        figures=figures.values(),
        document=json_text(to_plain(found)),
        scripts=("forest.js",),
        styles=("compare.css",),
        found=found,
        slots={c.name: row.slot for c, row in zip(found.configurations, rows, strict=True)},
        plots=figures.values(),
        troubles=status_words(found),
        onboard=sum(line.reference.startswith("onboard") for line in found.used),
        whole=[(row, dots(row), scale_ends(row)) for row in whole],
        each=[(line, matrix(found, line)) for line in found.used],
        config=configurations_toml(found),
        titled=titled,
    )


def status_words(found: Comparison) -> dict[str, str]:
    """Describe configurations that are missing on some logs: ``diverged on 2 logs``."""
    said = {}
    for c in found.configurations:
        cells = [cells[c.name] for cells in found.questions[0].cells.values()] if found.questions else []
        states = [cell.status for cell in cells if cell.status != "ok"]
        parts = [f"{STATUS_WORDS.get(s, s)} on {counted(states.count(s), 'log')}" for s in dict.fromkeys(states)]
        if parts:
            said[c.name] = listed(parts)
    return said


def dots(row: MatrixRow) -> list[Dot | None]:
    """Return the dot of each configuration after the first, None without a difference."""
    limit = _scale_limit(row)
    found: list[Dot | None] = []
    for cell, contrast in zip(row.cells, row.question.contrasts, strict=True):
        difference = cell.difference
        if difference is None or difference.value is None:
            found.append(None)
            continue
        size, ends = _on_scale(difference, difference.value), difference.ci95
        word = direction_word(row.question, difference.direction)
        said = {"": "not significant", "equal": "no difference"}.get(word, f"significantly {word}")
        found.append(
            Dot(
                _place_pct(size, limit),
                None if ends is None else (_place(difference, ends[0], limit), _place(difference, ends[1], limit)),
                0 if abs(size) <= limit else 1 if size > 0.0 else -1,
                _place_pct(min(difference.floor, limit), limit) - 50.0,
                tuple(_place(d, d.value, limit) for d in contrast.logs if d.value is not None),
                f"{change_text(row.question, difference)}, {said}",
            )
        )
    return found


def scale_ends(row: MatrixRow) -> tuple[str, str]:
    """Return the labels of both ends of a row's scale."""
    limit = _scale_limit(row)
    ends = (math.exp(-limit), math.exp(limit)) if row.question.scale == "ratio" else (-limit, limit)
    return end_label(ends[0], row.question), end_label(ends[1], row.question)


def end_label(value: float, question: Question) -> str:
    """Format the end of a scale; ratios from ten on as factors: ``÷40``, ``×40``."""
    if question.scale == "ratio" and not 0.1 < value < 10.0:
        return f"×{value:.3g}" if value > 1.0 else f"÷{1.0 / value:.3g}"
    return signed_text(value, question)


def _on_scale(difference: Difference, value: float) -> float:
    """Map a value to its scale, which is logarithmic for ratios."""
    if difference.scale != "ratio":
        return value
    return math.log(value) if value > 0.0 else -math.inf


def _place_pct(size: float, limit: float) -> float:
    return round(50.0 + HALF_WIDTH_PCT * min(max(size / limit, -1.0), 1.0), 2)


def _place(difference: Difference, value: float, limit: float) -> float:
    return _place_pct(_on_scale(difference, value), limit)


def _scale_limit(row: MatrixRow) -> float:
    """Return the limit of a row's scale, unaffected by outliers and wide intervals."""
    known = [d for d in (cell.difference for cell in row.cells) if d is not None and d.value is not None]
    sizes = [abs(_on_scale(d, d.value or 0.0)) for d in known]
    middle = median_low(sizes)
    kept = [k for k, size in enumerate(sizes) if size <= FAR_RATIO * middle] or list(range(len(sizes)))
    reach = [max(sizes[k], *(abs(_on_scale(known[k], e)) for e in known[k].ci95 or (known[k].even,))) for k in kept]
    longest = min(max(reach), WIDE_RATIO * median_low(reach))
    return max(1.1 * max(sizes[k] for k in kept), 1.1 * longest, 2.0 * median(d.floor for d in known), 1e-6)


def _has_difference(question: Question) -> bool:
    return any(d.value is not None for c in question.contrasts for d in c.logs)


def _forest_figure(found: Comparison, question: Question, number: int) -> PageFigure:
    """Draw the forest plot of a question, the pooled value last."""
    order, labels = [c.name for c in found.configurations], found.labels
    with_value = {d.log for c in question.contrasts for d in c.logs if d.value is not None}
    logs = [line.name for line in found.logs if line.name in with_value]
    pooled = any(c.over is not None and c.over.logs > 1 for c in question.contrasts)
    lines = [*logs, "all logs"] if pooled else logs
    items: list[dict[str, Any]] = []
    rows: list[list[Any]] = [["log", "configuration", "first", "scale", "value", "low95", "high95", "significant"]]
    for c in question.contrasts:
        drawn: list[tuple[Difference, int]] = [(d, lines.index(d.log)) for d in c.logs if d.value is not None]
        if c.over is not None and c.over.logs > 1:
            drawn.append((c.over, len(logs)))
        for d, line in drawn:
            ends: Sequence[float | None] = d.ci95 or (None, None)
            items.append(
                {
                    "r": order.index(c.configuration),
                    "line": line,
                    "v": d.value,
                    "ci": d.ci95,
                    "all": line == len(logs),
                    "significant": d.significant,
                    "say": f"{lines[line]}, {labels[c.configuration]}: {change_text(question, d)}",
                }
            )
            rows.append([lines[line], c.configuration, order[0], question.scale, d.value, *ends, d.direction])
    beside = f"beside {found.first.label}"
    data = {
        "items": items,
        "lines": lines,
        "all": pooled,
        "log": question.scale == "ratio",
        "table": rows,
        "axis": f"{beside}, {scale_unit(question)}" if scale_unit(question) else beside,
    }
    height = 92 + 26 * len(lines) * max(1, (len(question.contrasts) + 1) // 2)
    caption = (
        "Line: 95 % interval. Filled: significant. Diamond: all logs together. Lines that leave the figure are cut."
    )
    words = "; ".join(item["say"] for item in items)
    title = f"{question.title} {beside}"
    return PageFigure(f"forest{number}", "forest", title, caption, height, data, True, words)


def configurations_toml(found: Comparison) -> str:
    """Return the configurations as a file that ``attlog compare`` reads."""
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
