"""First screen of a report: flight strip, and four columns of dots.

Positions are percentages of the width, so that both fit any screen.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import median
from typing import NamedTuple

import numpy as np

from attlog.report.figures.figure import time_range
from attlog.report.figures.style import RowStyle
from attlog.result import EstimatorRow, Result
from attlog.words.answers import NO_ANSWER, AnswerLine, answer_lines
from attlog.words.events import ShownEvent, shown_events
from attlog.words.names import AGREEMENT_TITLE, CODES, is_against_onboard
from attlog.words.numbers import MINUS, SIGNED, duration, interval, moment, number, quantity
from attlog.words.ranking import ColumnRanking, RankedValue, is_baseline, reason_unranked

Span = tuple[float, float]

# Values beyond this multiple of the median are drawn at the edge.
FAR_FACTOR = 4.0
# Smallest distance between ticks, % of the width: labels do not touch in a narrow column.
MIN_TICK_DISTANCE_PCT = 22.0
# Interval ends may extend the scale by this factor beyond values.
MAX_END_FACTOR = 2.5
# Margin at both ends, % of the width.
MARGIN_PCT = 3.0
# Smallest range of a scale about zero, so that half a millisecond looks small.
MIN_RANGE = {"ms": 10.0, "deg/min": 1.0}
TICK_STEPS = (1.0, 2.0, 5.0)
# Start of a sentence about values that are not ranked.
NOT_RANKED = re.compile(r"Not ranked \((?P<reason>[^()]*)\)")


class DotScale(NamedTuple):
    """Scale from ``low`` to ``high``, logarithmic for sizes, about zero for signed values."""

    low: float
    high: float
    log: bool

    def place(self, value: float) -> float:
        """Return the position of a value, % of the width, clipped to the scale."""
        low, high = (math.log10(self.low), math.log10(self.high)) if self.log else (self.low, self.high)
        if self.log:
            value = math.log10(value) if value > 0.0 else low
        share = (value - low) / (high - low)
        return round(min(max(MARGIN_PCT + (100.0 - 2.0 * MARGIN_PCT) * share, 0.5), 99.5), 2)

    def holds(self, value: float) -> bool:
        """Return whether a value is on the scale."""
        return self.low <= value <= self.high

    @property
    def ticks(self) -> list[float]:
        """Two to four round ticks: 1, 2 or 5 times a power of ten."""
        found: list[float] = []
        for tick in _decades(self.low, self.high) if self.log else _steps(self.low, self.high):
            if not found or self.place(tick) - self.place(found[-1]) >= MIN_TICK_DISTANCE_PCT:
                found.append(tick)
        return found


def log_scale(values: Sequence[float], spans: Sequence[Span]) -> DotScale:
    """Return a logarithmic scale for sizes and intervals; an interval from zero is cut."""
    good = [v for v in values if v > 0.0] or [1.0]
    ends = [x for span in spans for x in span if x > 0.0]
    low, high = min(good), max(good)
    low, high = max(min([low, *ends]), 0.2 * low), min(max([high, *ends]), 5.0 * high)
    while high < 2.0 * low:  # nearly equal values must not fill the column
        low, high = low / 1.2, high * 1.2
    return DotScale(low, high, True)


def zero_scale(values: Sequence[float], spans: Sequence[Span], unit: str) -> DotScale:
    """Return a linear scale with zero for signed values; outliers do not extend it."""
    ends = [x for span in spans for x in span]
    most = max(MIN_RANGE.get(unit, 0.0) / 2.0, FAR_FACTOR * median([abs(x) for x in ends or values]))
    near = [x for x in [*values, 0.0] if abs(x) <= most] + [x for x in ends if abs(x) <= MAX_END_FACTOR * most]
    low, high = min(near), max(near)
    short = MIN_RANGE.get(unit, 1.0) - (high - low)
    return DotScale(low - max(short, 0.0) / 2.0, high + max(short, 0.0) / 2.0, False)


def _decades(low: float, high: float) -> list[float]:
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found: list[float] = []
    for steps in (TICK_STEPS[:1], TICK_STEPS[::2], TICK_STEPS):
        found = [s * 10.0**p for p in powers for s in steps if low <= s * 10.0**p <= high]
        if len(found) >= 2:
            break
    return found if len(found) <= 4 else found[:: math.ceil(len(found) / 4)]


def _steps(low: float, high: float) -> list[float]:
    rough = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(rough))
    step = next((s * power for s in TICK_STEPS if s * power >= rough), 10.0 * power)
    first = math.ceil(low / step)
    return [i * step for i in range(first, math.floor(high / step) + 1)]


# Figure of the four questions: one row per filter, one column of dots with intervals per question.

# Title of a column, and the part of the page with its figures.
TITLES = {
    "accuracy": ("Accuracy", "part-flight"),
    "noise": ("Static noise", "part-rest"),
    "lag": ("Step response", "part-step"),
    "yaw_drift": ("Yaw drift", "part-drift"),
}
NOISE_PLACES = {
    "rest": "at rest",
    "hover": "added in hover",
    "cruise": "added in flight",
    "idle": "added with motors idling",
}


@dataclass(frozen=True, slots=True)
class Dot:
    """Dot of a row in a column, positions in % of the width.

    Without a value (no ``x``) ``text`` is a word.
    """

    text: str
    hint: str
    x: float | None = None
    low: float | None = None
    high: float | None = None
    best: bool = False
    pale: bool = False


@dataclass(frozen=True, slots=True)
class QuestionColumn:
    """Column of a question.

    ``empty``: no filter has an answer, ``sentence`` gives the reason. ``ticks``: position and label.
    """

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


class FourQuestions(NamedTuple):
    """Row ids from top to bottom, and the four questions.

    ``nothing``: why no question has an answer.
    """

    rows: list[str]
    questions: list[QuestionColumn]
    nothing: str = ""


def compare_filters(result: Result, look: Mapping[str, RowStyle]) -> FourQuestions:
    """Return the columns of dots of a result."""
    answers = answer_lines(result)
    rows = filters_in_order(result, answers["accuracy"].column)
    rows = [row for row in rows if row.name in look]
    found = [question_column(key, answers[key], rows) for key in TITLES]
    found[0] = replace(found[0], title=accuracy_title(result))
    nothing = ""
    if all(q.empty for q in found):
        why = dict.fromkeys(line.text.removeprefix(NO_ANSWER).rstrip(".") for line in answers.values())
        nothing = f"{NO_ANSWER}{'; '.join(why)}."
    return FourQuestions([row.name for row in rows], repeat_reasons_once(found), nothing)


def accuracy_title(result: Result) -> str:
    """Return the title of the first question: against the onboard attitude it is agreement."""
    return AGREEMENT_TITLE if is_against_onboard(result) else TITLES["accuracy"][0]


def repeat_reasons_once(found: list[QuestionColumn]) -> list[QuestionColumn]:
    """Replace a repeated reason of an empty or unranked column by the earlier column's title."""
    first: dict[str, str] = {}
    out = []
    for one in found:
        unranked = NOT_RANKED.match(one.sentence)
        reason = unranked["reason"] if unranked and not one.empty else one.sentence
        title = first.setdefault(reason, one.title)
        same = f"same reason as {title.lower()}"
        sentence = one.sentence
        if title != one.title and one.empty:
            sentence = f"{NO_ANSWER}{same}."
        elif title != one.title and unranked and len(reason) > len(same):
            sentence = f"Not ranked ({same}){sentence[unranked.end() :]}"
        out.append(replace(one, sentence=sentence))
    return out


def filters_in_order(result: Result, accuracy: ColumnRanking) -> list[EstimatorRow]:
    """Sort rows: onboard and its re-run, filters by accuracy, filters without one, gyro."""
    place = {j.row.name: i for i, j in enumerate(accuracy.judged)}

    def key(row: EstimatorRow) -> tuple[int, int]:
        if row.kind != "replay":
            return 0, row.name != "onboard"
        return 3 if is_baseline(row) else 1 if row.name in place else 2, place.get(row.name, 0)

    shown = [row for row in result.estimators if row.kind != "onboard" or row.name == "onboard"]
    return sorted(shown, key=key)


def question_column(key: str, answer: AnswerLine, rows: list[EstimatorRow]) -> QuestionColumn:
    """Return the column of a question."""
    column = answer.column
    title, figures = TITLES[key]
    if not column.filters or not answer.answered:
        return QuestionColumn(key, title, figures, "", answer.sentence, True)
    scale = scale_of(column)
    dots = [filter_dot(row, column, scale) for row in rows]
    onboard = next((d.x for d, row in zip(dots, rows, strict=True) if row.name == "onboard"), None)
    return QuestionColumn(
        key,
        title,
        figures,
        unit_text(key, column),
        answer.beside_values,
        False,
        dots,
        [(scale.place(t), f"{t:g}".replace("-", MINUS)) for t in scale.ticks],
        None if scale.log else scale.place(0.0),
        onboard,
    )


def unit_text(key: str, column: ColumnRanking) -> str:
    """Return quantity and unit of a column."""
    return {
        "accuracy": "tilt error, RMS °",
        "noise": f"{NOISE_PLACES.get(column.window, column.window)}, °",
        "lag": "lag, ms",
        "yaw_drift": f"{'at rest' if 'rest' in column.metric else 'in flight'}, °/min",
    }[key]


def scale_of(column: ColumnRanking) -> DotScale:
    """Return a scale for the sound rows of a column, else for all."""
    sound = [j for j in column.judged if j.row.status == "ok" and j.shown and (j.ranked or not j.replay)]
    sound = ([j for j in sound if j.replay] and sound) or [j for j in column.judged if j.shown]
    values, spans = [j.value for j in sound], [j.ends for j in sound]
    unit = column.judged[0].answer.unit
    return zero_scale(values, spans, unit) if unit in SIGNED else log_scale(values, spans)


def filter_dot(row: EstimatorRow, column: ColumnRanking, scale: DotScale) -> Dot:
    """Return the dot of a row, or the word for its missing value.

    ``best`` also requires that no significantly worse row has a smaller value: rows are ranked on shared time, values
    cover all time.
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
        dot_hint(judged),
        scale.place(judged.value),
        scale.place(low),
        scale.place(high),
        judged in column.best and not any(j.size < judged.size for j in column.ranked if j not in column.best),
        judged.replay and not judged.ranked,
    )


def judged_number(judged: RankedValue) -> str:
    """Format a value without its unit, as in the table."""
    return number(judged.value, judged.answer.unit)


def dot_hint(judged: RankedValue) -> str:
    """Return value, interval, evidence, and why it is not ranked."""
    answer = judged.answer
    text = f"{judged.name}: {quantity(judged.value, answer.unit)}"
    bounds = interval(answer.ci95, answer.unit)
    text += f" (95 %: {bounds})" if bounds else ""
    text += f", n {answer.n:,}" if answer.n else ""
    text += f", {duration(answer.seconds)}" if answer.seconds else ""
    return text + (f". Not ranked: {reason_unranked(judged)}" if judged.replay and not judged.ranked else "")


# Flight strip: height, airborne time, flight modes, and events as marks that link to the figures.
#


# Height of the curve, in its own units.
STRIP_HEIGHT = 60
MIN_HEIGHT_M = 1.0
# Heights above this are rounded to whole metres.
WHOLE_METRES_FROM_M = 2.0
# Labels are placed for a screen of this width; a phone shows only those of serious events.
STRIP_WIDTH_PX, LETTER_PX, GAP_PX = 830.0, 6.6, 8.0
LABEL_LEVELS = 3
# Half the width of the label of the largest height, and how many of these it may stand beside its peak.
HALF_HEIGHT_LABEL_PX, MAX_SHIFTS = 20.0, 4.0
MAX_MARKS = 40
# Event kinds with a mark although they are no problem.
ROUTINE = ("armed", "liftoff", "landing")
GRADES = {"bad": 2, "warn": 1}


@dataclass(slots=True)
class StripMark:
    """Event at ``x`` % with style, sentence, label and level of the label.

    ``left``: the label ends at ``x``. ``event``: the event, whose figure the mark links to.
    """

    t: float
    x: float
    style: str
    text: str
    label: str = ""
    level: int = 0
    left: bool = False
    event: ShownEvent | None = None


@dataclass(slots=True)
class FlightStrip:
    """Strip of a flight.

    ``curve``: path of the height, empty where unknown. ``modes``, ``air``: spans.
    """

    curve: str
    top: str
    start: str
    end: str
    peak: float = 50.0
    air: list[tuple[float, float]] = field(default_factory=list)
    modes: list[tuple[float, float, str]] = field(default_factory=list)
    marks: list[StripMark] = field(default_factory=list)
    words: str = ""


def flight_strip(result: Result) -> FlightStrip:
    """Return the strip of a result."""
    start, end = time_range(result)
    line = result.log.get("timeline") or {}

    def place(t: float) -> float:
        return round(min(max(100.0 * (t - start) / (end - start), 0.0), 100.0), 2)

    air = [(place(a), place(b)) for a, b in line.get("airborne") or []]
    modes = [
        (place(a), place(b), fitting_name(str(name), place(b) - place(a))) for a, b, name in line.get("modes") or []
    ]
    curve, top, highest = height_curve(result, start, end)
    marks = [StripMark(e.t, place(e.t), e.style, e.text, e.label, event=e) for e in marked_events(shown_events(result))]
    peak = clear_of_marks(min(max(place(highest), 3.0), 97.0), [mark.x for mark in marks])
    place_labels(marks, peak if top else None)
    words = f"{duration(end - start)} of log" + (f", up to {top}" if top else "")
    return FlightStrip(curve, top, moment(start, 0), moment(end, 0), peak, air, modes, marks, words)


def height_curve(result: Result, start: float, end: float) -> tuple[str, str, float]:
    """Return the path of the height, and its maximum in flight as text with its time, s.

    Texts are empty where the height is unknown: a barometer that never flew shows the weather. The largest height is
    rounded as in the headline, and missing if the log has no ground level.
    """
    trace = next((t for t in result.traces if t.figure == "height"), None)
    flights = (result.log.get("timeline") or {}).get("airborne") or []
    if trace is None or not flights or not np.isfinite(trace.columns["height"]).any():
        return "", "", start
    t, y = np.asarray(trace.t, np.float64), np.asarray(trace.columns["height"], np.float64)
    flying = np.zeros(len(t), bool)
    for a, b in flights:
        flying |= (t >= a) & (t <= b)
    most = float(np.nanmax(np.where(flying, y, -math.inf))) if (flying & np.isfinite(y)).any() else math.nan
    top = max(most if math.isfinite(most) else float(np.nanmax(y)), MIN_HEIGHT_M)
    x = np.clip(1000.0 * (t - start) / (end - start), 0.0, 1000.0)
    down = STRIP_HEIGHT * (1.0 - np.clip(np.nan_to_num(y) / top, 0.0, 1.0))
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, down, strict=True))
    height = trace.values.get("top")
    text = "" if height is None else f"{height:.0f} m" if height >= WHOLE_METRES_FROM_M else f"{height:.1f} m"
    highest = float(t[np.nanargmax(np.where(flying, y, np.nan))]) if text and math.isfinite(most) else start
    return f"M{x[0]:.1f},{STRIP_HEIGHT} L{points} {x[-1]:.1f},{STRIP_HEIGHT}Z", text, highest


def marked_events(events: Sequence[ShownEvent]) -> list[ShownEvent]:
    """Return at most MAX_MARKS events in trouble or routine, the worst kept, in time order."""
    shown = [e for e in events if e.style in GRADES or e.kind in ROUTINE]
    worst = sorted(shown, key=lambda e: -GRADES.get(e.style, 0))[:MAX_MARKS]
    return sorted(worst, key=lambda e: e.t)


def clear_of_marks(peak: float, marks: Sequence[float]) -> float:
    """Return the place in % of the height's label that is nearest to its peak and on no mark, else the peak."""
    half = 100.0 * HALF_HEIGHT_LABEL_PX / STRIP_WIDTH_PX
    tried = [peak, *(x + side * 1.05 * half for x in marks for side in (-1.0, 1.0))]
    free = [at for at in tried if 3.0 <= at <= 97.0 and all(abs(at - x) >= half for x in marks)]
    near = [(abs(at - peak), at) for at in free if abs(at - peak) <= MAX_SHIFTS * half]
    return round(min(near)[1], 2) if near else peak


def place_labels(marks: list[StripMark], peak: float | None = None) -> list[StripMark]:
    """Place labels, serious ones first; a mark without room keeps only its sentence.

    ``peak``: position in % of the label of the largest height, between the first and the second level.
    """
    taken: list[list[tuple[float, float]]] = [[] for _ in range(LABEL_LEVELS)]
    if peak is not None:
        at, half = peak * STRIP_WIDTH_PX / 100.0, HALF_HEIGHT_LABEL_PX
        for level in taken[:2]:
            level.append((at - half, at + half))
    order = sorted(marks, key=lambda m: (-GRADES.get(m.style, 0), m.t))
    said: set[tuple[str, str]] = set()
    for mark in order:
        wide, at = LETTER_PX * len(mark.label) + GAP_PX, mark.x * STRIP_WIDTH_PX / 100.0
        places = [(level, left) for left in (False, True) for level in range(LABEL_LEVELS)]
        room = next((p for p in places if is_free(taken[p[0]], *label_span(at, wide, p[1]))), None)
        if room is None or not mark.label or ((mark.label, mark.style) in said and mark.style != "bad"):
            mark.label = ""
            continue
        said.add((mark.label, mark.style))
        mark.level, mark.left = room
        taken[mark.level].append(label_span(at, wide, mark.left))
    return marks


def label_span(at: float, wide: float, left: bool) -> tuple[float, float]:
    """Return both ends of a label, px."""
    return (at - wide, at) if left else (at, at + wide)


def is_free(taken: list[tuple[float, float]], a: float, b: float) -> bool:
    """Return whether the strip is empty between a and b."""
    return a >= 0.0 and b <= STRIP_WIDTH_PX and all(b <= low or a >= high for low, high in taken)


def fitting_name(name: str, share: float) -> str:
    """Return the name of a mode if it fits its part, else empty."""
    return name if LETTER_PX * len(name) + GAP_PX <= share * STRIP_WIDTH_PX / 100.0 else ""
