"""What a comparison says: one lead sentence for each configuration beside the first, one for every further question.

Every number of a sentence stands in the table, written by the same functions
(:mod:`attlog.compare.differences.wording`).
The subject of a lead is who is better; where nothing differs significantly that is said, with the interval.
"""

from __future__ import annotations

from attlog.compare.differences.comparison import Comparison, ConfigurationSentences
from attlog.compare.differences.wording import DirectedDifference, clause, directed
from attlog.present.contest import BY_ITSELF
from attlog.present.names import AGREEMENT
from attlog.present.numbers import counted, listed

LEADS = ("inclination_rmse_deg", "heading_rmse_deg", "noise_tilt_deg", "lag_ms")
"""Which question leads: the first of these that differs significantly, else the first that has an answer."""
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
    leading = _leading(views)
    subject, other = (b, a) if leading.direction != "worse" else (a, b)
    sides = [view.turned if subject == a else view for view in views]
    begin = next(v for v in sides if v.question.id == leading.question.id)
    lead = f"{subject} {clause(begin, other)}"
    used = {begin.question.id}
    lag = next((v for v in sides if v.question.metric == "lag_ms" and v.question.id not in used), None)
    if lag is not None:
        joint = "but" if lag.direction == "worse" and begin.direction == "better" else "and"
        lead += f", {joint} {clause(lag, other)}"
        used.add(lag.question.id)
    rest = [_sentence(view, a, b) for view in views if view.question.id not in used]
    return ConfigurationSentences(name, lead + ".", [*rest, *lost])


def _sentence(view: DirectedDifference, first: str, second: str) -> str:
    """One question on its own, about the better one if it is significantly so; numbers as the table shows them."""
    if view.direction == "worse":
        return f"{first} {clause(view.turned, second)}."
    return f"{second} {clause(view, first)}."


def _leading(views: list[DirectedDifference]) -> DirectedDifference:
    in_order = sorted(views, key=lambda v: LEADS.index(v.question.metric) if v.question.metric in LEADS else len(LEADS))
    significant = [v for v in in_order if v.direction in ("better", "worse")]
    return (significant or in_order)[0]


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
