"""A comparison as one self-contained page: what is significant, dots and intervals, tables, forest plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from attlog.base.plain import plain
from attlog.compare.differences.comparison import Comparison, LogDifference, PooledDifference, Question
from attlog.compare.differences.sentences import STATUS
from attlog.compare.differences.wording import directed, scale_title, signed, span
from attlog.compare.tables.matrix import of_log, over_all
from attlog.compare.tables.overview import headline, overview
from attlog.present.numbers import counted, listed
from attlog.report import shell
from attlog.report.figures.figure import PageFigure
from attlog.report.look import colours_of
from attlog.report.pack import Store

OWN = Path(__file__).parents[1] / "web"


def render(found: Comparison) -> str:
    """The page as text: nothing in it is loaded from anywhere."""
    used = [line for line in found.logs if not line.code]
    figures = {q.id: _forest(found, q, number) for number, q in enumerate(found.questions) if q.main and _drawn(q)}
    slots = colours_of([c.name for c in found.configurations])
    rows = [
        {"name": c.label, "slot": slot, "dash": "solid", "shown": True, "onboard": False, "lost": False}
        for c, slot in zip(found.configurations, slots, strict=True)
    ]
    return shell.render(
        "compare.html",
        OWN,
        rows=rows,
        figures=figures.values(),
        store=Store(),
        document=plain(found),
        scripts=("folded.js",),
        styles=("compare.css",),
        found=found,
        names={c.name: c.label for c in found.configurations},
        slots={c.name: row["slot"] for c, row in zip(found.configurations, rows, strict=True)},
        plots=figures.values(),
        said=headline(found),
        columns=overview(found),
        troubles=troubles(found),
        onboard=sum(line.reference.startswith("onboard") for line in used),
        used=used,
        whole=over_all(found),
        each=[(line, of_log(found, line)) for line in used],
        config=as_toml(found),
    )


def troubles(found: Comparison) -> dict[str, str]:
    """What became of configurations that are not compared on some logs, by name: ``diverged on 2 logs``."""
    said = {}
    for c in found.configurations:
        cells = [cells[c.name] for cells in found.questions[0].cells.values()] if found.questions else []
        states = [cell.status for cell in cells if cell.status != "ok"]
        parts = [f"{STATUS.get(s, s)} on {counted(states.count(s), 'log')}" for s in dict.fromkeys(states)]
        if parts:
            said[c.name] = listed(parts)
    return said


def _drawn(question: Question) -> bool:
    return any(b.value is not None for c in question.contrasts for b in c.logs)


def _forest(found: Comparison, question: Question, number: int) -> PageFigure:
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
            view = directed(question, one)
            if view is None:
                continue
            ends: list[float | None] | None = list(one.ci95) if one.ci95 is not None else None
            say = f"{name}, {called[c.configuration]}: {signed(view.value, question)}" + (
                f" ({span(view)})" if ends else ""
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


def as_toml(found: Comparison) -> str:
    """The configurations as a file that ``attlog compare`` reads."""
    import tomli_w

    parts = []
    for c in found.configurations:
        table: dict[str, Any] = {"name": c.name, "estimator": c.text.partition(":")[0]}
        if ".py" in c.text or ".csv" in c.text:
            table["estimator"] = c.text[: max(c.text.find(".py") + 3, c.text.find(".csv") + 4)]
        table |= {k: _value(v) for k, v in (*c.parameters.items(), *c.before.items())}
        parts.append("[[configuration]]\n" + tomli_w.dumps(table))
    return "\n".join(parts)


def _value(text: str) -> Any:
    try:
        numbers = [float(part) for part in text.split("/")]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers
