"""The four questions as one figure: a row for each filter, a column of dots with intervals for each question."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from attlog.present.contest import ColumnRanking, RankedValue, why_unranked
from attlog.present.names import CODES
from attlog.present.numbers import MINUS, SIGNED, duration, interval, number, quantity
from attlog.present.sentences.brief import NO_ANSWER, BriefAnswer, brief_answers
from attlog.present.sentences.lag import step_remark
from attlog.present.table.rows import is_baseline
from attlog.report.first_screen.scale import DotScale, log_scale, zero_scale
from attlog.report.look import Look
from attlog.result import EstimatorRow, Result

TITLES = {
    "accuracy": ("Accuracy", "part-flight"),
    "noise": ("Static noise", "part-rest"),
    "lag": ("Step response", "part-step"),
    "yaw_drift": ("Yaw drift", "part-drift"),
}
"""What a column is called, and where its figures stand."""
PLACES = {"rest": "at rest", "hover": "added in hover", "cruise": "added in flight", "idle": "added with motors idling"}


@dataclass(frozen=True, slots=True)
class Dot:
    """A row in a column: places are percentages of the width. ``text`` is a word where there is no value (no ``x``)."""

    text: str
    hint: str
    x: float | None = None
    low: float | None = None
    high: float | None = None
    best: bool = False
    pale: bool = False


@dataclass(frozen=True, slots=True)
class QuestionColumn:
    """A column. ``empty``: this log cannot answer it, the sentence says why. ``ticks``: place and label."""

    id: str
    title: str
    figures: str
    unit: str
    sentence: str
    empty: bool
    dots: list[Dot] = field(default_factory=list)
    ticks: list[tuple[float, str]] = field(default_factory=list)
    zero: float | None = None
    onboard: float | None = None


@dataclass(frozen=True, slots=True)
class FourQuestions:
    """Rows (ids, from top to bottom) and the four questions; ``nothing`` says why where none can be answered."""

    rows: list[str]
    questions: list[QuestionColumn]
    nothing: str = ""


def comparison(result: Result, look: Mapping[str, Look]) -> FourQuestions:
    """The figure of a result."""
    answers = brief_answers(result)
    rows = in_order(result, answers["accuracy"].column)
    rows = [row for row in rows if row.name in look]
    remarks = {"lag": step_remark(result)}
    found = [question(key, answers[key], rows, remarks.get(key, "")) for key in TITLES]
    nothing = ""
    if all(q.empty for q in found):
        why = dict.fromkeys(q.sentence.removeprefix(NO_ANSWER).rstrip(".") for q in found)
        nothing = f"{NO_ANSWER}{'; '.join(why)}."
    return FourQuestions([row.name for row in rows], reasons_once(found), nothing)


def reasons_once(found: list[QuestionColumn]) -> list[QuestionColumn]:
    """The columns; one that is empty for the reason of an earlier one names that instead."""
    first: dict[str, str] = {}
    out = []
    for one in found:
        title = first.setdefault(one.sentence, one.title)
        again = one.empty and title != one.title
        out.append(replace(one, sentence=f"{NO_ANSWER}same reason as {title.lower()}.") if again else one)
    return out


def in_order(result: Result, accuracy: ColumnRanking) -> list[EstimatorRow]:
    """The onboard attitude, filters by their accuracy, those without one, the gyro alone."""
    place = {j.row.name: i for i, j in enumerate(accuracy.judged)}

    def key(row: EstimatorRow) -> tuple[int, int]:
        group = 0 if row.name == "onboard" else 3 if is_baseline(row) else 1 if row.name in place else 2
        return group, place.get(row.name, 0)

    shown = [row for row in result.estimators if row.kind == "replay" or row.name == "onboard"]
    return sorted(shown, key=key)


def question(key: str, answer: BriefAnswer, rows: list[EstimatorRow], remark: str = "") -> QuestionColumn:
    """One column of all rows; ``remark`` follows its sentence where there is an answer."""
    column = answer.column
    title, figures = TITLES[key]
    sentence = f"{answer.text} {answer.onboard}".strip()
    if not column.filters or answer.text.startswith(NO_ANSWER):
        return QuestionColumn(key, title, figures, "", sentence, True)
    sentence = f"{sentence} {remark}".strip()
    scale = scale_of(column)
    dots = [dot(row, column, scale) for row in rows]
    onboard = next((d.x for d, row in zip(dots, rows, strict=True) if row.name == "onboard"), None)
    return QuestionColumn(
        key,
        title,
        figures,
        unit_text(key, column),
        sentence,
        False,
        dots,
        [(scale.place(t), f"{t:g}".replace("-", MINUS)) for t in scale.ticks],
        None if scale.log else scale.place(0.0),
        onboard,
    )


def unit_text(key: str, column: ColumnRanking) -> str:
    """What the numbers of a column are."""
    return {
        "accuracy": "tilt error, RMS °",
        "noise": f"{PLACES.get(column.window, column.window)}, °",
        "lag": "lag, ms",
        "yaw_drift": f"{'at rest' if 'rest' in column.metric else 'in flight'}, °/min",
    }[key]


def scale_of(column: ColumnRanking) -> DotScale:
    """A scale for the rows that are sound; for all where none is."""
    sound = [j for j in column.judged if j.row.status == "ok" and j.shown and (j.ranked or not j.replay)]
    sound = ([j for j in sound if j.replay] and sound) or [j for j in column.judged if j.shown]
    values, spans = [j.value for j in sound], [j.ends for j in sound]
    unit = column.judged[0].answer.unit
    return zero_scale(values, spans, unit) if unit in SIGNED else log_scale(values, spans)


def dot(row: EstimatorRow, column: ColumnRanking, scale: DotScale) -> Dot:
    """A row's value, or the word for what is missing.

    ``best`` also asks that no row which is significantly worse than another has a smaller value: on the time that two
    rows share they may rank otherwise than over all.
    """
    judged = column.of(row)
    if judged is None:
        absent = next((m for m in column.absent if m.row.name == row.name), None)
        word = "reference" if row.is_reference else CODES.get(absent.code if absent else "", ("n/a", ""))[0]
        word = row.status if row.status in ("diverged", "failed") else word
        return Dot(word, absent.reason if absent else row.reason)
    low, high = judged.ends
    mark = "" if scale.holds(judged.value) else "▸ " if judged.value > scale.high else "◂ "
    return Dot(
        mark + judged_number(judged),
        hint(judged),
        scale.place(judged.value),
        scale.place(low),
        scale.place(high),
        judged in column.best and not any(j.size < judged.size for j in column.ranked if j not in column.best),
        judged.replay and not judged.ranked,
    )


def judged_number(judged: RankedValue) -> str:
    """A value without its unit, as the table writes it."""
    return number(judged.value, judged.answer.unit)


def hint(judged: RankedValue) -> str:
    """The value with its interval, what it was measured on, and why it is not ranked."""
    answer = judged.answer
    text = f"{judged.name}: {quantity(judged.value, answer.unit)}"
    bounds = interval(answer.ci95, answer.unit)
    text += f" (95 %: {bounds})" if bounds else ""
    text += f", n {answer.n:,}" if answer.n else ""
    text += f", {duration(answer.seconds)}" if answer.seconds else ""
    return text + (f". Not ranked: {why_unranked(judged)}" if judged.replay and not judged.ranked else "")
