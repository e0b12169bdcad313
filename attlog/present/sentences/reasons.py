"""Why a question, or a row of it, has no answer, and what a pilot can do about it."""

from __future__ import annotations

from collections import Counter

from attlog.present.names import NOT_JUDGED, name_in_sentence
from attlog.present.sentences.judged import Absent, Judged, counted
from attlog.result import Result

ADVICE = {
    "no_events": "Fly some brisk steps in roll, pitch and yaw.",
    "too_few_events": "Fly some more brisk steps in roll, pitch and yaw.",
}
"""What a pilot can do about a code whose reason does not say it."""


def cannot(result: Result, without: list[Absent], nothing: str) -> str:
    """The sentence for a question that no row answers: the commonest reason and what a pilot can do."""
    code, reason = commonest(without)
    flew = (result.log.get("seconds") or {}).get("airborne") != 0
    advice = f" {ADVICE[code]}" if code in ADVICE and flew else ""
    return f"Cannot be judged: {reason or nothing}.{switch(result, code)}{advice}"


def switch(result: Result, code: str) -> str:
    """How this vehicle would log its rest before arming, as a sentence after a blank; empty for other codes."""
    advice = str((result.log.get("advice") or {}).get("rest") or "")
    return f" {advice}" if advice and code in ("no_rest", "rest_too_short") else ""


def commonest(without: list[Absent]) -> tuple[str, str]:
    """Code and reason that most rows give, rows to which the question does not apply only if there are no others."""
    reasons = Counter((a.code, a.reason) for a in without if a.reason and a.code != "not_applicable")
    reasons = reasons or Counter((a.code, a.reason) for a in without if a.reason)
    if not reasons:
        return "", ""
    code, reason = reasons.most_common(1)[0][0]
    reason = reason.rstrip(".")
    return code, reason[0].lower() + reason[1:] if reason[:2].istitle() else reason


def why_not(result: Result, judged: list[Judged], without: list[Absent]) -> str:
    """Who is not judged and why in few words, filters with the same reason together."""
    groups: dict[str, list[str]] = {}
    codes = {a.row.name: a.code for a in without} | {j.row.name: "unranked" for j in judged if not j.ranked}
    for row in result.estimators:
        if row.kind == "replay" and row.name in codes:
            reason = next((j.answer.reason for j in judged if j.row is row), None) or ""
            short = NOT_JUDGED.get(codes[row.name]) or reason.partition(":")[0].partition(";")[0] or "not ranked"
            groups.setdefault(NOT_JUDGED.get(row.status, short), []).append(name_in_sentence(row))
    several = {why: why.replace("does not", "do not") if len(names) > 1 else why for why, names in groups.items()}
    return ", ".join(f"{counted(names)} ({several[why]})" for why, names in groups.items())
