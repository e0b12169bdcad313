"""What a gate says of a row, in one sentence."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.compare.gates.limits import GateLimit, LimitVerdict
from attlog.metrics.answer import Answer
from attlog.present.numbers import quantity, unit_sign
from attlog.result import EstimatorRow
from attlog.segments.model import WINDOWS


def no_row(pattern: str, names: Sequence[str]) -> str:
    """A pattern that means no row."""
    return f"no row is called {pattern}; the rows are {', '.join(names) if names else 'none'}"


def no_filter(names: Sequence[str]) -> str:
    """A gate that names no rows, on a log where it means none."""
    held = f"the rows are {', '.join(names)}; name them under filters if they are meant" if names else "it has no row"
    return f"the result has no filter to be judged: {held}"


def lost(row: EstimatorRow) -> str:
    """A row that failed or diverged."""
    return f"{row.name} {row.status}{f': {row.reason}' if row.reason else ''}"


def unanswered(row: EstimatorRow, metric: str, window: str | None, answer: Answer | None) -> str:
    """Why nothing can be judged; empty where there is a value that can."""
    name, place = row.name, f" ({answer.window if answer is not None else window or 'any window'})"
    if row.status == "not_judged":
        return f"{name} cannot be judged: {row.reason}"
    if answer is not None:
        return "" if answer.value is not None else f"{name}: no {metric}{place}: {answer.reason}"
    if row.is_reference:
        return f"{name} is what the others are compared with: it has no {metric}{place}"
    if window is not None and window not in row.metrics:
        how = "" if window in WINDOWS else f"; analyse with --window {window}"
        return f"{name}: the result has no window {window}{how}"
    return f"{name}: {metric} means nothing there{place}"


def measured(
    row: str, metric: str, window: str, answer: Answer, limit: GateLimit, other: Answer | None, verdict: LimitVerdict
) -> str:
    """A value beside its limit."""
    unit, sign, shown = answer.unit, with_unit(answer.unit), quantity(answer.value, answer.unit)
    if limit.kind in ("min", "max"):
        word = "least" if limit.kind == "min" else "most"
        value = beyond_limit_text(float(answer.value or 0.0), limit.value, shown, sign)
        return f"{row}: {metric} {value} ({window}), at {word} {limit.value:g}{sign}"
    what = "onboard" if limit.against == "onboard" else "the baseline"
    text = f"{row}: {metric} {shown} ({window}), {what} {quantity(None if other is None else other.value, unit)}"
    if "ratio" in limit.kind:
        text += f": {_ratio(verdict.size, verdict.other, limit.value)}, at most {limit.value:g} times"
    elif "above" in limit.kind:
        more = verdict.size - (verdict.other or 0.0)
        text += f": {beyond_limit_text(more, limit.value, f'{more:+.3g}{sign}', sign)}, at most {limit.value:+g}{sign}"
    else:
        text += ": not to be worse" if verdict.passed else ": worse"
    return text + (" (no significant difference)" if verdict.excused else "")


def _ratio(size: float, other: float | None, limit: float) -> str:
    if not other:
        return "nothing to divide by"
    return beyond_limit_text(size / other, limit, f"{size / other:.2f}", "") + " times"


def beyond_limit_text(value: float, limit: float, text: str, unit: str) -> str:
    """The text of a value; with as many digits as it takes to see on which side of the limit its size lies."""
    size = abs(value)
    if size == limit or abs(size - limit) > 0.1 * limit:
        return text
    digits = next((d for d in range(2, 15) if _side(float(f"{size:.{d}g}"), limit) == _side(size, limit)), 15)
    return f"{value:.{digits}g}{unit}"


def _side(value: float, limit: float) -> int:
    return (value > limit) - (value < limit)


def with_unit(unit: str) -> str:
    """A unit as it stands behind a number."""
    sign = unit_sign(unit)
    return sign if not sign or sign.startswith("°") else f" {sign}"
