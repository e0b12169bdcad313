"""What a comparison says: one lead sentence for each configuration beside the first, then one for each question that
differs significantly. What does not stands in the table alone.

Every number of a sentence stands in the table, written by the same functions
(:mod:`attlog.compare.differences.wording`). A lead has the changes of the table, a further sentence is about who is
better.
"""

from __future__ import annotations

from attlog.compare.differences.comparison import Comparison, ConfigurationSentences
from attlog.compare.differences.wording import DirectedDifference, clause, directed, signed, subject_of
from attlog.present.contest import BY_ITSELF
from attlog.present.names import AGREEMENT
from attlog.present.numbers import counted, listed

NAMED = 4
"""So many questions are named in a lead; the table has all."""
STATUS = {
    "diverged": "diverged",
    "not_converged": "did not settle",
    "failed": "failed",
    "not_judged": "cannot be judged",
}
"""What a row's state is called after its name."""


def verdicts(found: Comparison) -> list[ConfigurationSentences]:
    """The sentences of a comparison, one entry for each configuration after the first."""
    return [_sentences(found, c.name) for c in found.configurations[1:]]


def _sentences(found: Comparison, name: str) -> ConfigurationSentences:
    called = {c.name: c.label for c in found.configurations}
    first = found.configurations[0].name
    a, b, lost = called[first], called[name], _lost(found, name)
    views = [
        view
        for q in found.questions
        for c in q.contrasts
        if q.main and c.configuration == name and c.over is not None and (view := directed(q, c.over)) is not None
    ]
    if not views:
        return ConfigurationSentences(name, f"{b} and {a} cannot be compared: {_why(found, name)}.", lost)
    if all(view.direction == "same" for view in views):
        logs = counted(max(view.logs for view in views), "log")
        return ConfigurationSentences(
            name, f"No difference: {b} and {a} give the same in every question, on {logs}.", lost
        )
    significant = [view for view in views if view.direction in ("better", "worse")]
    if not significant:
        logs = counted(max(view.logs for view in views), "log")
        asked = counted(len(views), "question")
        return ConfigurationSentences(name, f"No significant difference of {b} and {a} in {asked} on {logs}.", lost)
    sides = {d: _changes([v for v in significant if v.direction == d]) for d in (v.direction for v in significant)}
    lead = ", ".join(f"{direction} in {changes}" for direction, changes in sides.items())
    lead = lead.replace(" in ", f" than {a} in ", 1)
    return ConfigurationSentences(
        name, f"{b} is significantly {lead}.", [*(_sentence(view, a, b) for view in significant), *lost]
    )


def _changes(views: list[DirectedDifference]) -> str:
    """Questions with their changes: ``tilt error (−24 %), lag (−3.2 ms)``."""
    named = [f"{subject_of(v.question)} ({signed(v.value, v.question)})" for v in views[:NAMED]]
    rest = len(views) - NAMED
    return listed([*named, f"{rest} more"] if rest > 0 else named)


def _sentence(view: DirectedDifference, first: str, second: str) -> str:
    """One question on its own, about the better one if it is significantly so; numbers as the table shows them."""
    if view.direction == "worse":
        return f"{first} {clause(view.turned, second)}."
    return f"{second} {clause(view, first)}."


def _why(found: Comparison, name: str) -> str:
    """Why no question has a difference: the commonest reason."""
    questions = [c for q in found.questions if q.main for c in q.contrasts if c.configuration == name]
    reasons = [b.reason for c in questions for b in c.logs if b.reason]
    reasons = reasons or [line.reason for line in found.logs if line.reason]
    return (
        max(set(reasons), key=lambda r: (reasons.count(r), r)).rstrip(".") if reasons else "no question has an answer"
    )


def _lost(found: Comparison, name: str) -> list[str]:
    """Where one of the two drops out: what is left would flatter it; and where there is no truth to compare with."""
    called = {c.name: c.label for c in found.configurations}
    said = []
    for one in (found.configurations[0].name, name):
        lost: dict[tuple[str, str], list[str]] = {}
        for log, cells in found.questions[0].cells.items() if found.questions else ():
            if one in cells and cells[one].status != "ok":
                why = cells[one].reason if cells[one].status == "failed" else ""
                lost.setdefault((cells[one].status, why), []).append(log)
        for (status, why), logs in lost.items():
            where = f"on {listed(logs)}{f' ({why})' if why else ''}"
            said.append(f"{called[one]} {STATUS.get(status, status)} {where} and is not compared there.")
    used = [line for line in found.logs if not line.code]
    onboard = sum(line.reference.startswith("onboard") for line in used)
    against = [q for q in found.questions if not q.metric.startswith(BY_ITSELF)]
    if onboard and any(b.value is not None for q in against for c in q.contrasts for b in c.logs):
        where = "" if onboard == len(used) else f" on {onboard} of {counted(len(used), 'log')}"
        said.append(f"Errors are differences from {AGREEMENT}{where}.")
    return said
