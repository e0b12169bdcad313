"""Findings and checks for every output: one line each, with evidence."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from attlog.result import CHECKS, Check, Setting, setting_number
from attlog.words.numbers import MINUS, decimals, duration, interval, moment, number, quantity, unit_sign
from attlog.words.text import clean, typeset

if TYPE_CHECKING:
    from attlog.result import Finding, Result


# Label and style by severity, the worst first.
SEVERITY = {
    "serious": ("Serious", "bad"),
    "warning": ("Warning", "warn"),
    "note": ("Note", "note"),
    "info": ("Note", "note"),
}


class ShownFinding(NamedTuple):
    """Finding for display.

    ``when``: the part of its sentence with the time, or empty. ``t`` to ``t_end`` s, None without a time. ``why``:
    evidence and cause, one line each. ``kind`` and ``about``: those of the finding.
    """

    label: str
    style: str
    before: str
    when: str
    after: str
    t: float | None
    action: str
    why: tuple[str, ...] = ()
    kind: str = ""
    about: str = ""
    t_end: float | None = None

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.before}{self.when}{self.after}"

    @property
    def line(self) -> str:
        """The sentence with its action."""
        return f"{self.text} {self.action}".strip()

    @property
    def is_note(self) -> bool:
        """True if it requires no action."""
        return self.style == "note"


def findings(result: Result) -> list[ShownFinding]:
    """Return the findings of a result for display."""
    return shown_findings(result.findings)


def shown_findings(found: Iterable[Finding]) -> list[ShownFinding]:
    """Return findings for display, the worst first."""
    order = {name: i for i, name in enumerate(SEVERITY)}
    return [_shown_finding(finding) for finding in sorted(found, key=lambda f: order.get(f.severity, 9))]


# Most findings and words of the first screen's list, and findings that it has in any case.
MAX_FIRST, MAX_FIRST_WORDS, MIN_FIRST = 5, 75, 2
# The end of a sentence with another behind it.
SENTENCE_END = re.compile(r"(?<=[.!?]) (?=[A-Z“])")


def first_screen_findings(trouble: Sequence[ShownFinding]) -> list[ShownFinding]:
    """Return the findings of the first screen: each with its first sentence, the others as evidence."""
    found: list[ShownFinding] = []
    words = 0
    for finding in map(_first_sentence, trouble[:MAX_FIRST]):
        words += len(finding.line.split())
        if len(found) >= MIN_FIRST and words > MAX_FIRST_WORDS:
            break
        found.append(finding)
    return found


def _first_sentence(finding: ShownFinding) -> ShownFinding:
    """Return a finding whose later sentences are evidence, unless its time stands in one of them."""
    action, *more = SENTENCE_END.split(finding.action, maxsplit=1)
    finding = finding._replace(action=action, why=(*more, *finding.why))
    ends = SENTENCE_END.split(finding.after if finding.when else finding.before, maxsplit=1)
    if len(ends) < 2 or (finding.when and SENTENCE_END.search(finding.before)):
        return finding
    why = (ends[1], *finding.why)
    return finding._replace(after=ends[0], why=why) if finding.when else finding._replace(before=ends[0], why=why)


# Brackets at the end of a sentence, which take its time too.
END_IN_BRACKETS = re.compile(r"\([^()]+\)\.?$")


def no_problem_text(shown: list[ShownFinding], hidden: int = 0) -> str:
    """Return the sentence for an empty list; ``hidden``: number of notes not listed."""
    if shown:
        return ""
    notes = {0: "", 1: "; 1 note with -v"}.get(hidden, f"; {hidden} notes with -v")
    return f"No problem was found{notes}."


def _shown_finding(finding: Finding) -> ShownFinding:
    label, style = SEVERITY.get(finding.severity, ("Note", "note"))
    text = typeset(finding.text)
    places = () if finding.offset is None else (str(finding.offset), f"{finding.offset:,}")
    if places and not any(re.search(rf"(?<![\d,]){place}(?!,?\d)", finding.text) for place in places):
        text = f"{text.rstrip('.')}, at byte {finding.offset:,}."
    t = round(finding.t, 3) if finding.t is not None and math.isfinite(finding.t) else None
    told = any(f" {n} " in f" {text} " for n in (str(finding.count), f"{finding.count:,}"))
    times = f"{finding.count:,} times" if finding.count > 1 and not told else ""
    before, when, after = _timed(text, t, times)
    why = [typeset(line) for line in finding.evidence]
    why += [f"Cause: {typeset(finding.cause)}"] if finding.cause else []
    action = "" if finding.action in finding.text else typeset(finding.action)
    end = finding.t_end if t is not None and finding.t_end is not None and finding.t_end > t else None
    return ShownFinding(label, style, before, when, after, t, action, tuple(why), finding.kind, finding.about, end)


def _timed(text: str, t: float | None, times: str) -> tuple[str, str, str]:
    """Split a sentence at its time.

    A missing time is appended. ``times``: number of occurrences, appended too.
    """
    if t is None:
        return (f"{text.rstrip('.')} ({times})." if times else text), "", ""
    for written in dict.fromkeys((moment(t), f"{t:.1f} s", f"{t:.1f}", f"{t:.0f} s", f"{t:.0f}")):
        found = re.search(rf"(?:(?<=at )|(?<=rom )|(?<=, )(?=[\d.]+ to )){re.escape(written)}(?![\d.]\d)", text)
        if found:
            after = text[found.end() :]
            return text[: found.start()], written, f"{after.rstrip('.')} ({times})." if times else after
    word = f"{times + ', ' if times else ''}{'from' if times else 'at'} "
    if END_IN_BRACKETS.search(text):  # one pair of brackets
        return f"{text.rstrip('.)')}, {word}", moment(t), ")."
    return f"{text.rstrip('.')} ({word}", moment(t), ")."


# Checks of sensors and estimator for every output.

# The worst first, unknown last.
VERDICTS = ("fault", "warning", "ok", "unknown")
BAD_VERDICTS = ("fault", "warning")
# An interval more asymmetric than this share of its half width is written as two ends.
LOPSIDED = 0.25
# Units of counted things.
COUNTED = ("satellites", "samples")


class ParameterChange(NamedTuple):
    """Parameter to set: name, logged value (empty if unknown) and new value.

    ASCII only, because users type or paste the values.
    """

    name: str
    old: str
    new: str

    def __str__(self) -> str:
        """``COMPASS_OFS_X -12 -> 145``; the new value alone where the old one is missing."""
        return f"{self.name} {self.old} -> {self.new}" if self.old else f"{self.name} {self.new}"


class ShownCheck(NamedTuple):
    """Check for display: a row of a table.

    ``value`` with unit and 95 % interval. ``settings``: parameters to set; ``advice``: action if there are none.
    ``why``: components, evidence, extent, limit, one line each. ``id``: that of the question.
    """

    sensor: str
    question: str
    verdict: str
    value: str
    text: str
    settings: tuple[ParameterChange, ...]
    advice: str
    why: tuple[str, ...]
    t: float | None
    id: str = ""
    t_end: float | None = None

    @property
    def to_set(self) -> str:
        """Settings or advice in one line."""
        return ", ".join(map(str, self.settings)) or self.advice

    @property
    def listed(self) -> bool:
        """True for a fault, a warning, or a check with settings."""
        return self.verdict in BAD_VERDICTS or bool(self.settings)

    @property
    def asks(self) -> bool:
        """True for a fault, and for what asks the reader to set or to do something."""
        return self.verdict == "fault" or bool(self.settings or self.advice)


def shown_checks(checks: Iterable[Check]) -> list[ShownCheck]:
    """Return checks for display: faults, warnings, ok, unknown."""
    return sorted(map(_shown_check, checks), key=lambda a: VERDICTS.index(a.verdict))


def repeat_advice_once(rows: Iterable[ShownCheck]) -> list[ShownCheck]:
    """Replace repeated advice by the name of the first sensor with it."""
    first: dict[tuple[str, str], str] = {}
    found = []
    for row in rows:
        sensor = first.setdefault((row.question, row.advice), row.sensor)
        again = row.advice and sensor != row.sensor
        found.append(row._replace(advice=f"The same as for {sensor or 'the first'}.") if again else row)
    return found


def question_titles(rows: Iterable[ShownCheck]) -> str:
    """List the questions of rows, with the number of sensors: ``vibration (3)``."""
    times = Counter(row.question for row in rows)
    return ", ".join(f"{question} ({n})" if n > 1 else question for question, n in times.items())


def reasons_unknown(rows: Iterable[ShownCheck]) -> list[tuple[str, str]]:
    """Return unknown questions with their reasons, grouped by reason."""
    asked: dict[str, list[str]] = {}
    for row in rows:
        why = row.text if row.advice in row.text else f"{row.text} {row.advice}"
        asked.setdefault(why, []).append(f"{row.question} of {row.sensor}" if row.sensor else row.question)
    return [("; ".join(dict.fromkeys(names)), why) for why, names in asked.items()]


def question_title(question: str) -> str:
    """Return the title of a question."""
    return CHECKS[question].title if question in CHECKS else clean(question.replace("_", " "))


def value_text(check: Check) -> str:
    """Format a value with its 95 % interval: ``15.1 ± 2.0 µT``."""
    unit, ci95 = check.unit, check.ci95
    value = number(check.value, unit)
    if value and unit in COUNTED:
        return f"{check.value:,.0f} {unit}"
    if not value or ci95 is None or not interval(ci95, unit):
        return quantity(check.value, unit)
    sign = unit_sign(unit)
    end = sign if sign.startswith(("°", "×")) or not sign else f" {sign}"
    middle, half = 0.5 * (ci95[0] + ci95[1]), 0.5 * abs(ci95[1] - ci95[0])
    if half == 0.0:
        return quantity(check.value, unit)
    if abs(middle - (check.value or 0.0)) > LOPSIDED * half:
        return f"{value} ({interval(ci95, unit)}){end}"
    plus = "+" if value.startswith("+") else ""
    return f"{plus}{_with_half(check.value or 0.0, half, unit)}{end}"


def parameter_change(setting: Setting) -> ParameterChange:
    """Format a parameter to set."""
    old = "" if setting.old is None else setting_number(setting.old)
    return ParameterChange(clean(setting.name), old, setting_number(setting.new))


def parameter_changes(settings: Sequence[Setting], most: int) -> str:
    """List parameters to set in one line, at most ``most`` by name."""
    rest = len(settings) - most
    named = ", ".join(str(parameter_change(setting)) for setting in settings[:most])
    return f"{named} and {rest} more" if rest > 0 else named


def _shown_check(one: Check) -> ShownCheck:
    advice = "" if one.settings else one.action or one.why_no_setting
    why = [text for text in (one.action, one.why_no_setting) if text and text != advice]
    extent = [f"n = {one.n:,}"] if one.n else []
    extent += [f"over {duration(one.seconds)}"] if one.seconds > 0 else []
    limit = f"{one.threshold} ({one.source})" if one.threshold and one.source else one.threshold
    limit = f"O{limit[1:]}." if limit.startswith("ok") else f"Limit: {limit}." if limit else ""
    why += [*_axes(one), *one.evidence, *([f"{' '.join(extent)}."] if extent else []), *([limit] if limit else [])]
    why += [f"Cause: {one.cause}"] if one.cause else []
    return ShownCheck(
        clean(one.sensor),
        question_title(one.question),
        one.verdict if one.verdict in VERDICTS else "unknown",
        value_text(one),
        typeset(one.text),
        tuple(map(parameter_change, one.settings)),
        typeset(advice),
        tuple(map(typeset, why)),
        one.t,
        one.question,
        one.t_end,
    )


def _axes(one: Check) -> list[str]:
    """Format the components in body axes: ``x 12.0 ± 2.0, y ... µT.``"""
    numbers = [*one.vector, *one.vector_ci95]
    if not one.vector or len(one.vector) != len(one.vector_ci95) or not all(map(math.isfinite, numbers)):
        return []
    each = zip("xyz", one.vector, one.vector_ci95, strict=False)
    return [f"{', '.join(f'{axis} {_with_half(value, half, one.unit)}' for axis, value, half in each)} {one.unit}."]


def _with_half(value: float, half: float, unit: str) -> str:
    """Format value ± half interval with equal decimals, one significant for the latter."""
    places = decimals(max(abs(value), half), unit)
    if half > 0.0:
        places = max(places, min(-math.floor(math.log10(half)), 6))
    return f"{value + 0.0:.{places}f} ± {half:.{places}f}".replace("-", MINUS)
