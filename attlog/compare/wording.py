"""Format numbers and sentences of a comparison for table and page.

A comparison has one lead sentence per configuration after the first, with the changes of the table. It has one sentence
per significantly different question, about the better configuration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from attlog.compare.comparison import PHASE_PLACES, Comparison, ConfigurationSentences, Question, commonest_reason
from attlog.compare.paired import Difference, Direction
from attlog.metrics import definitions
from attlog.metrics.metric import Wording, named
from attlog.words.names import AGREEMENT
from attlog.words.numbers import MINUS, between, change, change_end, counted, decimals, listed, number, unit_sign
from attlog.words.ranking import SELF_COMPARED

# Questions named in a lead. The table has all.
MAX_NAMED_QUESTIONS = 4
STATUS_WORDS = {
    "diverged": "diverged",
    "not_converged": "did not settle",
    "failed": "failed",
    "not_judged": "cannot be judged",
}
# Errors that a what-if sentence reports even if unchanged.
REFERENCE_ERRORS = ("tilt_rmse_deg", "heading_rmse_deg")
# An insignificant change within 10 % is reported as unchanged.
UNCHANGED_LOG_RATIO = math.log(1.1)
# Direction words of a table.
DIRECTION_WORDS: dict[Direction, str] = {"better": "better", "worse": "worse", "same": "equal"}
# Shares of gates, which a larger noise or gate lowers by itself: lower is not better.
GATE_SHARES = ("test_ratio_rms", "rejected_pct")
GATE_SHARE_WORDS: dict[Direction, str] = {"better": "lower", "worse": "higher"}


def question_wording(question: Question) -> Wording:
    """Return the wording of a question, from its metric or its title.

    The phase of flight is appended.
    """
    metric = named(definitions().values(), question.metric)
    words, place = metric.wording, PHASE_PLACES.get(question.window) if metric.asked == "phases" else None
    if words is not None:
        return words if place is None else words._replace(more=f"{words.more} {place}", less=f"{words.less} {place}")
    title = subject_of(question)
    if question.better in ("low", "zero"):
        return Wording("has a", f"smaller {title}", f"larger {title}", title)
    return Wording("is", f"nearer to perfect in {title}", f"farther off in {title}", title)


def direction_word(question: Question, direction: Direction | None) -> str:
    """Return the word of a significant direction, empty if not significant."""
    if direction is None:
        return ""
    words = GATE_SHARE_WORDS if question.metric.partition(".")[0] in GATE_SHARES else {}
    return words.get(direction, DIRECTION_WORDS.get(direction, ""))


def subject_of(question: Question) -> str:
    """Return a question as a noun after "in": ``tilt error``, ``noise added in hover``."""
    begin = question.title[:2]
    return question.title if begin.isupper() else begin.lower() + question.title[2:]


def scale_unit(question: Question) -> str:
    """Return the unit of a difference: percent for a ratio, else the metric's."""
    return "%" if question.scale == "ratio" else unit_sign(question.unit)


def titled(question: Question) -> str:
    """Return title and unit, as heading of a row."""
    unit = unit_sign(question.unit)
    return f"{question.title}, {unit}" if unit else question.title


def amount_text(x: float, question: Question) -> str:
    """Format a size without sign, as a percentage or with unit; ``<0.01`` if small."""
    if question.scale == "ratio":
        return change(x, signed=False)
    size, unit = abs(x), question.unit
    places = (2 if size < 0.995 else 1 if size < 9.95 else 0) if unit == "ms" else decimals(size, unit)
    text = f"{size:.{places}f}"
    if float(text) == 0.0 and size > 0.0:
        text = f"<{10.0**-places:.{places}f}"
    sign = unit_sign(unit)
    return text + sign if sign.startswith("°") else f"{text} {sign}".rstrip()


def signed_text(x: float, question: Question) -> str:
    """Format a size with its sign: ``−24 %``, ``+3.2 ms``."""
    if question.scale == "ratio":
        return change(x)
    text = amount_text(x, question)
    return ("" if x == 0.0 or text.startswith("<") else MINUS if x < 0.0 else "+") + text


def own_value_text(x: float | None, question: Question) -> str:
    """Format a configuration's own value without unit."""
    if x is not None and question.unit == "deg" and 0.0 < abs(x) < 0.0095:
        return f"{MINUS if x < 0.0 else ''}{abs(x):.2g}"
    if x is None or question.unit != "ms":
        return number(x, question.unit)
    return signed_text(x, question).removesuffix(" ms")


def interval_text(question: Question, found: Difference) -> str:
    """Format the interval of a difference: ``−31 to −15 %``; empty without one."""
    if found.ci95 is None:
        return ""
    if question.scale == "ratio":
        return between(*map(change_end, found.ci95))
    low, high = (signed_text(end, question) for end in found.ci95)
    return f"{low.removesuffix(unit_sign(question.unit)).rstrip()} to {high}"


def change_text(question: Question, found: Difference) -> str:
    """Format change and interval: ``−24 % (−31 to −15 %)``, ``equal``."""
    if found.direction == "same" or found.value is None:
        return "equal"
    ends = interval_text(question, found)
    return f"{signed_text(found.value, question)}{f' ({ends})' if ends else ''}"


def favour_text(question: Question, found: Difference, than: str = "") -> str:
    """Format a significant difference in favour of the better configuration.

    Example: ``24 % closer (15 % to 31 %, better on 8 of 9 logs)``.
    """
    size = amount_text(found.value or 0.0, question)
    if size == "not comparable":
        return size
    inside = [_reach(question, found), f"better on {found.better} of {found.logs} logs" if found.logs > 1 else ""]
    tail = ", ".join(p for p in inside if p)
    return f"{size} {question_wording(question).more}{than}{f' ({tail})' if tail else ''}"


def _reach(question: Question, found: Difference) -> str:
    """Format both ends of an interval as sizes, the smaller first."""
    if found.ci95 is None:
        return ""
    low, high = sorted(found.ci95, key=lambda x: abs(x - found.even))
    return f"{amount_text(low, question)} to {amount_text(high, question)}"


def comparison_sentences(found: Comparison) -> list[ConfigurationSentences]:
    """Return the sentences of each configuration after the first."""
    return [_configuration_sentences(found, c.name) for c in found.configurations[1:]]


def _configuration_sentences(found: Comparison, name: str) -> ConfigurationSentences:
    a, b, dropped = found.first.label, found.labels[name], _dropped_sentences(found, name)
    answered = [(q, d) for q in found.questions if (d := q.contrast(name).over) is not None]
    pairs = [(q, d) for q, d in answered if q.main] or answered
    if not pairs:
        return ConfigurationSentences(
            name, f"{b} and {a} cannot be compared: {_reason_unavailable(found, name)}.", dropped
        )
    logs = counted(max(d.logs for _, d in pairs), "log")
    if all(d.direction == "same" for _, d in pairs):
        return ConfigurationSentences(
            name, f"No difference: {b} and {a} give the same in every question, on {logs}.", dropped
        )
    significant = [(q, d) for q, d in pairs if d.significant]
    if found.is_what_if:
        lead = what_if_sentence(found, name, pairs)
        return ConfigurationSentences(name, lead, [*(_question_sentence(q, d, a, b) for q, d in significant), *dropped])
    if not significant:
        asked = counted(len(pairs), "question")
        return ConfigurationSentences(name, f"No significant difference of {b} and {a} in {asked} on {logs}.", dropped)
    sides = {way: _change_list([p for p in significant if p[1].direction == way]) for way in ("better", "worse")}
    lead = ", ".join(f"{way} in {changes}" for way, changes in sides.items() if changes)
    lead = lead.replace(" in ", f" than {a} in ", 1)
    return ConfigurationSentences(
        name, f"{b} is significantly {lead}.", [*(_question_sentence(q, d, a, b) for q, d in significant), *dropped]
    )


def what_if_sentence(found: Comparison, name: str, pairs: Sequence[tuple[Question, Difference]]) -> str:
    """Describe the effect of a changed onboard parameter, largest change first.

    One log: ``Heading error 14.2 to 4.1°, compass innovation 18 to 4.2 µT; tilt error unchanged.`` Several: ``On 5
    flights: heading error −62 % (−71 to −50 %).`` Each aid is represented by its innovation, else by its test ratio.
    """
    flights = max(d.logs for _, d in pairs)
    said, same, others = [], [], []
    by_aid: dict[str, tuple[float, str]] = {}
    for question, d in pairs:
        first, second = _values_text(found, question, name)
        text, size = _from_to(question, first, second), abs(math.log(d.value or 1.0)) if d.scale == "ratio" else 0.0
        if flights > 1:
            text = f"{subject_of(question)} {change_text(question, d)}"
            text += f" on {d.logs} of {flights}" if d.logs < flights else ""
        statistic, _, aid = question.metric.partition(".")
        if question.metric in REFERENCE_ERRORS:
            if _is_unchanged(d) or (first == second and flights == 1):
                same.append(subject_of(question))
            else:
                said.append(text + ("" if d.significant or flights > 1 else " (not significant)"))
        elif not d.significant or first == second:
            continue
        elif statistic in ("innovation_rms", "test_ratio_rms"):
            by_aid.setdefault(aid, (-size, text))
        else:
            others.append(text)
    changes = [text for _, text in sorted(by_aid.values())] + others
    shown = max(MAX_NAMED_QUESTIONS - len(said), 1)
    said += changes[:shown] + [f"{len(changes) - shown} more"] * (len(changes) > shown)
    text = "; ".join(part for part in (", ".join(said), f"{listed(same)} unchanged" if same else "") if part)
    text = text or "no significant change of innovations and errors"
    before = [found.labels[name]] * (len(found.configurations) > 2) + [f"on {flights} flights"] * (flights > 1)
    text = f"{' '.join(before)}: {text}" if before else text
    return f"{text[:1].upper() if len(found.configurations) == 2 else text[:1]}{text[1:]}."


def _is_unchanged(d: Difference) -> bool:
    """Return whether a change is insignificant and small; of several logs its whole interval."""
    ends = d.ci95 if d.logs > 1 and d.ci95 is not None else (d.value or 1.0,)
    return not d.significant and all(e > 0.0 and abs(math.log(e)) < UNCHANGED_LOG_RATIO for e in ends)


def _from_to(question: Question, first: str, second: str) -> str:
    """Format values as flown and changed: ``heading error 14.2 to 4.1°``."""
    unit = unit_sign(question.unit)
    return f"{subject_of(question)} {first} to {second}{'' if unit.startswith('°') else ' '}{unit}".rstrip()


def _values_text(found: Comparison, question: Question, name: str) -> list[str]:
    """Format both values without unit; medians over several logs."""
    values = []
    for one in (found.first.name, name):
        known = [v for cells in question.cells.values() if one in cells and (v := cells[one].value) is not None]
        values.append(number(median(map(abs, known)), question.unit, False))
    return values


def _change_list(pairs: list[tuple[Question, Difference]]) -> str:
    """List questions with their changes: ``tilt error (−24 %), lag (−3.2 ms)``."""
    shown = [f"{subject_of(q)} ({signed_text(d.value or 0.0, q)})" for q, d in pairs[:MAX_NAMED_QUESTIONS]]
    rest = len(pairs) - MAX_NAMED_QUESTIONS
    return listed([*shown, f"{rest} more"] if rest > 0 else shown)


def _question_sentence(question: Question, found: Difference, first: str, second: str) -> str:
    """Return a sentence on the significantly better configuration."""
    if found.direction == "worse":
        first, second, found = second, first, found.inverse()
    favour = favour_text(question, found, f" than {first}")
    if favour == "not comparable":
        return f"{second} is {favour} with {first} in {subject_of(question)}."
    return f"{second} {question_wording(question).verb} {favour}."


def _reason_unavailable(found: Comparison, name: str) -> str:
    """Return the most frequent reason why no question has a difference."""
    reasons = [d.reason for q in found.questions if q.main for d in q.contrast(name).logs if d.reason]
    reasons = reasons or [line.reason for line in found.logs if line.reason]
    return commonest_reason(sorted(reasons)).rstrip(".") or "no question has an answer"


def _dropped_sentences(found: Comparison, name: str) -> list[str]:
    """Report logs on which one of both configurations drops out or truth is missing."""
    said = []
    for one in (found.first.name, name):
        dropped: dict[tuple[str, str], list[str]] = {}
        for log, cells in found.questions[0].cells.items() if found.questions else ():
            if one in cells and cells[one].status != "ok":
                why = cells[one].reason if cells[one].status == "failed" else ""
                dropped.setdefault((cells[one].status, why), []).append(log)
        for (status, why), logs in dropped.items():
            where = f"on {listed(logs)}{f' ({why})' if why else ''}"
            said.append(f"{found.labels[one]} {STATUS_WORDS.get(status, status)} {where} and is not compared there.")
    onboard = sum(line.reference.startswith("onboard") for line in found.used)
    against = [q for q in found.questions if not q.metric.startswith(SELF_COMPARED)]
    if onboard and any(d.value is not None for q in against for c in q.contrasts for d in c.logs):
        where = "" if onboard == len(found.used) else f" on {onboard} of {counted(len(found.used), 'log')}"
        said.append(f"Errors are differences from {AGREEMENT}{where}.")
    return said
