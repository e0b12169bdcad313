"""Why a question, or a row of it, has no answer, and what a pilot can do about it."""

from __future__ import annotations

from collections import Counter

from attlog.present.contest import ColumnRanking, MissingValue, why_unranked
from attlog.present.heading import TOO_UNCERTAIN
from attlog.present.names import NOT_JUDGED, name_in_sentence
from attlog.present.sentences.words import counted, why_absent
from attlog.present.table.rows import is_baseline
from attlog.present.text import typeset
from attlog.result import Result

ADVICE = {
    "no_events": "Fly some brisk steps in roll, pitch and yaw.",
    "too_few_events": "Fly some more brisk steps in roll, pitch and yaw.",
}
"""What a pilot can do about a code whose reason does not say it."""
ONLY_BASELINE = "Cannot be judged: of the filters only Gyro was run, which is shown and never ranked."


def cannot(result: Result, without: list[MissingValue], nothing: str) -> str:
    """The sentence for a question that no row answers: the commonest reason and what a pilot can do."""
    replays = [row for row in result.estimators if row.kind == "replay"]
    if replays and all(is_baseline(row) for row in replays):
        return ONLY_BASELINE
    code, reason = commonest(without)
    flew = ((result.log.get("seconds") or {}).get("airborne") or 0.0) > 0
    advice = f" {ADVICE[code]}" if code in ADVICE and flew else ""
    return f"Cannot be judged: {reason or nothing}.{switch(result, code)}{advice}"


def undetermined(found: ColumnRanking) -> str:
    """Whose value leaves too much open, and why: ``cannot be determined for Madgwick: ...``; empty for nobody."""
    unsure = [a for a in found.absent if a.code == TOO_UNCERTAIN and a.row.status == "ok"]
    rows = [a for a in unsure if a.row.kind == "replay" and not is_baseline(a.row)]
    if not rows:
        return ""
    return f"cannot be determined for {counted([name_in_sentence(a.row) for a in rows])}: {commonest(rows)[1]}"


def switch(result: Result, code: str) -> str:
    """How this vehicle would log its rest before arming, as a sentence after a blank; empty for other codes."""
    advice = str((result.log.get("advice") or {}).get("rest") or "")
    return f" {advice.rstrip('.')}." if advice and code in ("no_rest", "rest_too_short") else ""


def commonest(without: list[MissingValue]) -> tuple[str, str]:
    """Code and reason that most filters give; the baseline and onboard rows count only without others."""
    filters = [a for a in without if a.row.kind == "replay" and not is_baseline(a.row)]
    said = [(a.code, why_absent(a.row, a.reason)) for a in filters or without]
    reasons = Counter((code, reason) for code, reason in said if reason and code != "not_applicable")
    reasons = reasons or Counter((code, reason) for code, reason in said if reason)
    if not reasons:
        return "", ""
    code, reason = reasons.most_common(1)[0][0]
    reason = typeset(reason.rstrip("."))
    return code, reason[0].lower() + reason[1:] if reason[:2].istitle() else reason


def why_not(found: ColumnRanking) -> str:
    """Who is not ranked and why in few words, filters with the same reason together."""
    groups: dict[str, list[str]] = {}
    for judged in found.filters:
        if not judged.ranked:
            short = why_unranked(judged).partition(":")[0].partition(";")[0].partition(",")[0]
            groups.setdefault(NOT_JUDGED.get(judged.row.status, typeset(short)), []).append(judged.name)
    for absent in found.absent:
        if absent.row.kind == "replay" and not is_baseline(absent.row):
            short = NOT_JUDGED.get(absent.row.status) or NOT_JUDGED.get(absent.code) or typeset(absent.reason)
            groups.setdefault(short, []).append(name_in_sentence(absent.row))
    several = {why: why.replace("does not", "do not") if len(names) > 1 else why for why, names in groups.items()}
    return ", ".join(f"{counted(names)} ({several[why]})" for why, names in groups.items())
