"""A comparison at a glance: rows are configurations, columns the four questions, each cell a difference to the first.

What a cell draws and what a sentence says are read off one :class:`DirectedDifference`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from statistics import median, median_low

from attlog.compare.differences.comparison import Comparison, Contrast, LogDifference, Question
from attlog.compare.differences.over_logs import commonest
from attlog.compare.differences.paired import Direction
from attlog.compare.differences.wording import DirectedDifference, directed, signed, span, subject_of
from attlog.compare.tables.matrix import first_value
from attlog.present.heading import DRIFT_AIR
from attlog.present.numbers import counted, listed, unit_sign

COLUMNS = {
    "inclination_rmse_deg": "Accuracy",
    "heading_rmse_deg": "Accuracy",
    "noise_tilt_deg": "Static noise",
    "lag_ms": "Step response",
    "step_error_deg.0.5s": "Step response",
    "drift_rest_deg_per_min": "Yaw drift",
    DRIFT_AIR: "Yaw drift",
}
"""The question that a metric answers; of several the one that most logs answer is drawn."""
MOST = 4
"""So many metrics have a column each, more of them share the four."""
NAMED = 3
"""So many configurations or questions are named in a sentence, others are counted."""
FAR = 4.0
"""A difference this many times the middle one runs out of its column."""
WIDE = 2.5
"""An interval this many times the middle one too."""
HALF = 45.0
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
    few = len(found.questions) + len(found.unanswered) <= MOST
    for question in found.questions:
        title = question.title if few else COLUMNS.get(question.metric, "")
        groups.setdefault(title, []).append(question)
    groups.pop("", None)
    columns = {title: _column(found, title, max(some, key=_weight)) for title, some in groups.items()}
    for name, why in found.unanswered.items():
        title = COLUMNS.get(name.partition("@")[0], name if few else "")
        if title and title not in columns:
            columns[title] = OverviewColumn(title, "", f"Cannot be determined: {why.rstrip('.')}.")
    order = [*dict.fromkeys(COLUMNS.values())]
    return sorted(columns.values(), key=lambda c: order.index(c.title) if c.title in order else len(order))


def headline(found: Comparison) -> list[str]:
    """What is significant over all logs: who is better than the first, and who is worse; else that nobody is."""
    first, *others = found.configurations
    most = NAMED if len(others) < NAMED else 1
    views = {c.label: _views(found, c.name) for c in others}
    said = []
    for direction in ("better", "worse"):
        who = []
        for label, each in views.items():
            parts = [f"{subject_of(q)} ({signed(v.value, q)})" for q, v in each if v.direction == direction]
            more = [f"{len(parts) - most} more"] if len(parts) > most else []
            who += [f"{label} in {listed([*parts[:most], *more])}"] if parts else []
        said += [f"Significantly {direction} than {first.label}: {'; '.join(who)}."] if who else []
    if said or not any(views.values()):
        return said
    return [f"No significant difference to {first.label} in any question."]


def _views(found: Comparison, name: str) -> list[tuple[Question, DirectedDifference]]:
    """The pooled differences of a configuration, question by question; of ``--metric all`` those of COLUMNS."""
    asked = [q for q in found.questions if q.main or q.metric in COLUMNS]
    pairs = [(q, c.over) for q in asked for c in q.contrasts if c.configuration == name and c.over is not None]
    return [(q, view) for q, over in pairs if (view := directed(q, over)) is not None]


def _weight(question: Question) -> tuple[int, int]:
    """How much a question has to show: significant differences, then logs."""
    overs = [c.over for c in question.contrasts if c.over is not None]
    return sum(over.direction in ("better", "worse") for over in overs), sum(over.logs for over in overs)


def _reason(found: Comparison, differences: Iterable[LogDifference]) -> str:
    """The commonest reason for no difference, without whose it is."""
    why = commonest(b.reason for b in differences) or "no log has a difference"
    for c in found.configurations:
        why = why.removeprefix(f"{c.name}: ")
    return f"Cannot be determined: {why.rstrip('.')}."


def _column(found: Comparison, title: str, question: Question) -> OverviewColumn:
    what = f"{question.title}, {scale_unit(question) or 'difference'}"
    if all(c.over is None for c in question.contrasts):
        return OverviewColumn(title, what, _reason(found, [b for c in question.contrasts for b in c.logs]))
    limit = _limit(question)
    first = first_value(found, question)
    own = unit_sign(question.unit)
    cells = [_cell(found, question, c, limit) for c in question.contrasts]
    called = {c.name: c.label for c in found.configurations}
    names = {
        d: [called[c.configuration] for c, cell in zip(question.contrasts, cells, strict=True) if cell.direction == d]
        for d in ("better", "worse")
    }
    far = (math.exp(-limit), math.exp(limit)) if question.scale == "ratio" else (-limit, limit)
    return OverviewColumn(
        title,
        what,
        _sentence(names["better"], names["worse"]),
        first + (own if own.startswith("°") else f" {own}" if own and first else ""),
        (end_label(far[0], question), end_label(far[1], question)),
        cells,
    )


def end_label(value: float, question: Question) -> str:
    """What an end of a scale is worth, without its unit; of a ratio from ten on the factor: ``÷40``, ``×40``."""
    if question.scale == "ratio" and not 0.1 < value < 10.0:
        return f"×{value:.3g}" if value > 1.0 else f"÷{1.0 / value:.3g}"
    return signed(value, question).removesuffix(scale_unit(question)).strip()


def scale_unit(question: Question) -> str:
    """The unit of a difference: percent of a ratio, else that of the metric."""
    return "%" if question.scale == "ratio" else unit_sign(question.unit)


def _sentence(better: Sequence[str], worse: Sequence[str]) -> str:
    """Who differs significantly, in at most twenty words."""

    def some(names: Sequence[str]) -> str:
        return listed(list(names)) if len(names) <= NAMED else counted(len(names), "configuration")

    parts = [f"{word}: {some(names)}" for names, word in ((better, "Better"), (worse, "Worse")) if names]
    return f"{'. '.join(parts)}." if parts else "No significant difference."


def _cell(found: Comparison, question: Question, contrast: Contrast, limit: float) -> OverviewCell:
    over = contrast.over
    view = None if over is None else directed(question, over)
    if view is None:
        return OverviewCell(say=_reason(found, contrast.logs))
    size = _on_scale(question, view.value)
    same = view.logs - view.better - view.worse
    count = view.better if size < 0.0 else view.worse if size > 0.0 else same
    text = "equal" if view.direction == "same" else signed(view.value, question)
    certain = "" if view.direction == "same" else f" ({span(view)})" if view.ci95 else ""
    said = {"better": "significantly better", "worse": "significantly worse", "same": "no difference"}
    return OverviewCell(
        view.direction,
        text,
        f"{count}/{counted(view.logs, 'log')}" if len(found.logs) > 1 else "",
        f"{text}{certain}, {said.get(view.direction, 'not significant')}",
        _place(size, limit),
        None if view.ci95 is None else (_drawn(question, view.ci95[0], limit), _drawn(question, view.ci95[1], limit)),
        0 if abs(size) <= limit else 1 if size > 0.0 else -1,
        abs(_place(min(view.floor, limit), limit) - 50.0),
        tuple(_drawn(question, b.value, limit) for b in contrast.logs if b.value is not None),
    )


def _on_scale(question: Question, value: float) -> float:
    """A difference where it is drawn: ratios by their logarithm."""
    if question.scale != "ratio":
        return value
    return math.log(value) if value > 0.0 else -math.inf


def _place(size: float, limit: float) -> float:
    """Percent of the cell's width; what lies outside of the scale stands at its end."""
    return round(50.0 + HALF * min(max(size / limit, -1.0), 1.0), 2)


def _drawn(question: Question, value: float, limit: float) -> float:
    return _place(_on_scale(question, value), limit)


def _limit(question: Question) -> float:
    """What the end of a column's scale is worth: neither differences nor intervals far from the middle one set it."""
    pooled = [c.over for c in question.contrasts if c.over is not None]
    sizes = [abs(_on_scale(question, o.value)) for o in pooled]
    middle = median_low(sizes)
    kept = [k for k, size in enumerate(sizes) if size <= FAR * middle] or list(range(len(sizes)))
    most = max(sizes[k] for k in kept)
    reach = [max(sizes[k], *(abs(_on_scale(question, e)) for e in pooled[k].ci95 or (0.0,))) for k in kept]
    longest = min(max(reach), WIDE * median_low(reach))
    return max(1.1 * most, 1.1 * longest, 2.0 * median(o.floor for o in pooled), 1e-6)
