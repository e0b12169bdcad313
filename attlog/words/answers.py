"""How a column is put into words: who leads, who is last, who flew; by what the ranking found and nothing else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from attlog.result import Check, EstimatorRow, Result, Verdict
from attlog.words.names import NOT_JUDGED, against_heading, against_whom, name_in_sentence
from attlog.words.numbers import below, between, counted, duration, listed, moment, number, quantity
from attlog.words.numbers import counted as count
from attlog.words.ranking import (
    AIR,
    CODE_TOO_UNCERTAIN,
    DRIFT_AIR,
    PHASES,
    REST,
    ColumnRanking,
    MissingValue,
    RankedValue,
    is_baseline,
    quoted_heading_reference,
    rank_column,
    reason_unranked,
)
from attlog.words.text import typeset

__all__ = ["QUESTIONS", "verdicts"]


NAMED = 3
"""So many rows are named in a sentence; more are counted."""

LOST = ("diverged", "not_converged", "failed")


@dataclass(frozen=True, slots=True)
class QuestionWords:
    """The words of a question: verb phrases for one and several rows.

    ``one`` and ``several`` follow names ("has the least noise", "have the least noise"), ``last`` follows
    the name of the worst row, ``alone`` the only row that could be compared. ``close``
    follows "No significant difference".
    """

    one: str
    several: str
    last: str
    alone: str
    close: str = ""


def leading(found: ColumnRanking, words: QuestionWords, unit: str = "", where: str = "") -> str:
    """Who leads, with value and interval, no full stop at the end.

    ``unit`` says in brackets what the number is, ``where`` follows it.
    """
    ranked, best = found.ranked, found.best
    if len(ranked) == 1:
        return f"{ranked[0].name} {words.alone}: {single_value(ranked[0], unit)}{where}"
    if len(best) == 1:
        return f"{best[0].name} {words.one}: {single_value(best[0], unit)}{where}"
    noted = f" ({unit})" if unit else ""
    if best:
        return f"{some_rows(best, found)} {words.several}: {values_text(best)}{noted}{where} (not significant)"
    return f"No significant difference{words.close}: {values_text(ranked, named=False)}{noted}{where}"


def single_value(judged: RankedValue, unit: str = "") -> str:
    """One value with its interval, and in the same brackets what the number is."""
    brackets = "; ".join(x for x in (unit, judged.interval.strip(" ()")) if x)
    return f"{judged.text} ({brackets})" if brackets else judged.text


def worst_part(found: ColumnRanking, words: QuestionWords) -> str:
    """Who is worst, as a sentence after a blank; empty where nobody significantly is."""
    return f" {found.worst.name} {words.last}: {found.worst.text}{found.worst.interval}." if found.worst else ""


def values_text(judged: list[RankedValue], *, named: bool = True) -> str:
    """The values of rows in the order of their names; the ends of the range where they are only counted."""
    if len(judged) <= NAMED and (named or len(judged) == 2):
        return listed([j.text for j in judged])
    ends = sorted(judged, key=lambda j: j.size)
    return between(ends[0].text, ends[-1].text)


def some_rows(judged: list[RankedValue], found: ColumnRanking) -> str:
    """Up to NAMED of the rows that were compared by name, more as a count."""
    names = [j.name for j in judged]
    if len(names) <= NAMED:
        return listed(names)
    return f"All {found.compared}" if len(names) == len(found.ranked) else f"{len(names)} of {found.compared}"


def few_or_count(names: list[str]) -> str:
    """Up to NAMED filters by name, more as a count."""
    return listed(names) if len(names) <= NAMED else f"{len(names)} filters"


def lost_rows(result: Result) -> list[EstimatorRow]:
    """Filters that diverged, did not settle or failed; the baseline is none of them."""
    return [r for r in result.estimators if r.kind == "replay" and r.status in LOST and not is_baseline(r)]


def lost_part(rows: list[EstimatorRow]) -> str:
    """Which filters lost their way, and how: ``Mahony Xu 0.6 diverged``, ``Mine returned NaN from 0.0 s on``."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        how = row.reason if row.status == "failed" and row.reason else NOT_JUDGED[row.status]
        groups.setdefault(typeset(how), []).append(name_in_sentence(row))
    return ", ".join(f"{few_or_count(names)} {state}" for state, names in groups.items())


def reasons_left_out(found: ColumnRanking) -> list[tuple[str, str]]:
    """Rows (by id) without a value or whose value is not ranked, each with its reason, in a card's details."""
    unranked = [(j.row.name, typeset(reason_unranked(j))) for j in found.judged if j.replay and not j.ranked]
    absent = [(a.row.name, typeset(reason_absent(a.row, a.reason))) for a in found.absent]
    return absent + unranked


def reason_absent(row: EstimatorRow, reason: str) -> str:
    """Why a row has no value: that it failed comes before what was missing for it."""
    return row.reason if row.status == "failed" and row.reason else reason


def bars(found: ColumnRanking) -> list[tuple[str, float, str]]:
    """What the card draws, the smallest size first, lost rows last: (row id, value, unit); none without a filter."""
    if not any(j.replay for j in found.judged):
        return []
    shown = sorted((j for j in found.judged if j.shown), key=lambda j: j.row.status != "ok")
    return [(j.row.name, j.value, j.answer.unit) for j in shown]


def onboard_part(found: ColumnRanking, *, interval: bool = False) -> str:
    """The value of the onboard attitude, as a short last sentence; empty where all were compared with it."""
    flew = found.onboard
    return f" Onboard: {flew.text}{flew.interval if interval else ''}." if flew is not None else ""


def bound_text(judged: list[RankedValue]) -> str:
    """What all these rows stay below: the largest end of their intervals, never less."""
    return below(max(abs(end) for j in judged for end in j.ends), judged[0].answer.unit)


# Why a question, or a row of it, has no answer, and what a pilot can do about it.

ADVICE = {
    "no_events": "Fly some brisk steps in roll, pitch and yaw.",
    "too_few_events": "Fly some more brisk steps in roll, pitch and yaw.",
}
"""What a pilot can do about a code whose reason does not say it."""
ONLY_BASELINE = "Cannot be judged: of the filters only Gyro was run, which is shown and never ranked."


def cannot_be_judged(result: Result, without: list[MissingValue], nothing: str) -> str:
    """The sentence for a question that no row answers: the commonest reason and what a pilot can do."""
    replays = [row for row in result.estimators if row.kind == "replay"]
    if replays and all(is_baseline(row) for row in replays):
        return ONLY_BASELINE
    code, reason = commonest_reason(without)
    flew = ((result.log.get("seconds") or {}).get("airborne") or 0.0) > 0
    advice = f" {ADVICE[code]}" if code in ADVICE and flew else ""
    return f"Cannot be judged: {reason or nothing}.{rest_advice(result, code)}{advice}"


def undetermined_part(found: ColumnRanking) -> str:
    """Whose value leaves too much open, and why: ``cannot be determined for Madgwick: ...``; empty for nobody."""
    unsure = [a for a in found.absent if a.code == CODE_TOO_UNCERTAIN and a.row.status == "ok"]
    rows = [a for a in unsure if a.row.kind == "replay" and not is_baseline(a.row)]
    if not rows:
        return ""
    return (
        f"cannot be determined for {few_or_count([name_in_sentence(a.row) for a in rows])}: {commonest_reason(rows)[1]}"
    )


def rest_advice(result: Result, code: str) -> str:
    """How this vehicle would log its rest before arming, as a sentence after a blank; empty for other codes."""
    advice = str((result.log.get("advice") or {}).get("rest") or "")
    return f" {advice.rstrip('.')}." if advice and code in ("no_rest", "rest_too_short") else ""


def commonest_reason(without: list[MissingValue]) -> tuple[str, str]:
    """Code and reason that most filters give; the baseline and onboard rows count only without others."""
    filters = [a for a in without if a.row.kind == "replay" and not is_baseline(a.row)]
    said = [(a.code, reason_absent(a.row, a.reason)) for a in filters or without]
    reasons = Counter((code, reason) for code, reason in said if reason and code != "not_applicable")
    reasons = reasons or Counter((code, reason) for code, reason in said if reason)
    if not reasons:
        return "", ""
    code, reason = reasons.most_common(1)[0][0]
    reason = typeset(reason.rstrip("."))
    return code, reason[0].lower() + reason[1:] if reason[:2].istitle() else reason


def reasons_unranked(found: ColumnRanking) -> str:
    """Who is not ranked and why in few words, filters with the same reason together."""
    groups: dict[str, list[str]] = {}
    for judged in found.filters:
        if not judged.ranked:
            short = reason_unranked(judged).partition(":")[0].partition(";")[0].partition(",")[0]
            groups.setdefault(NOT_JUDGED.get(judged.row.status, typeset(short)), []).append(judged.name)
    for absent in found.absent:
        if absent.row.kind == "replay" and not is_baseline(absent.row):
            short = NOT_JUDGED.get(absent.row.status) or NOT_JUDGED.get(absent.code) or typeset(absent.reason)
            groups.setdefault(short, []).append(name_in_sentence(absent.row))
    several = {why: why.replace("does not", "do not") if len(names) > 1 else why for why, names in groups.items()}
    return ", ".join(f"{few_or_count(names)} ({several[why]})" for why, names in groups.items())


# Is a sensor so wrong that no verdict on this log means anything? Then each card says that first.

SPOILING_CHECKS = {
    "gyro bias": "the gyro is wrong",
    "gravity": "the accelerometer is wrong",
    "accelerometer axes": "the accelerometer is wrong",
}
"""Checks of the sensors that every filter lives on, and what a bad one means."""


def spoiling_check(result: Result) -> Check | None:
    """The first bad check of a sensor that every filter lives on, None where both can be used: a gyro that is off
    can where that was subtracted and rows were judged all the same."""
    judged = all(row.status != "not_judged" for row in result.estimators)
    mended = judged and any(bias.dps is not None for bias in result.gyro_bias)
    bad = [check for check in result.audit if check.verdict == "fault" and check.name in SPOILING_CHECKS]
    return next((check for check in bad if not (mended and check.name == "gyro bias")), None)


def with_spoiling_check(result: Result, verdict: Verdict) -> Verdict:
    """The verdict, led by what is wrong with the sensors if anything is."""
    check = spoiling_check(result)
    if check is not None:
        found = typeset(check.text.rstrip("."))
        found = found[0].lower() + found[1:] if found[:2].istitle() else found
        verdict.sentence = f"Unreliable, {SPOILING_CHECKS[check.name]}: {found}. {verdict.sentence}"
    return verdict


# Which filter is closest to what all are compared with? The tilt error of each row, and its heading error.

TILT, HEADING = "tilt_rmse_deg", "heading_rmse_deg"
ONBOARD_CHECKS = ("onboard against smoother", "onboard against truth")
"""The checks that say whether the onboard attitude is in error."""
HEADING_CHECK = "heading by GNSS"
"""The one that says whether its heading is."""


def accuracy_verdict(result: Result) -> Verdict:
    """The verdict on errors: in flight where there is any, else over the whole log."""
    tilt = rank_column(result, TILT, AIR)
    heading = rank_column(result, HEADING, (tilt.window,))
    if tilt.ranked:
        sentence = accuracy_sentence(result, tilt, heading)
    elif tilt.filters:
        sentence = unranked_accuracy(result, tilt, heading)
    else:
        sentence = cannot_be_judged(result, tilt.absent, "the log holds no attitude to compare with")
    sentence += caveat_part(result)
    return Verdict(
        "accuracy",
        accuracy_title(result),
        sentence,
        TILT,
        tilt.window,
        bars(tilt),
        reasons_left_out(tilt),
        accuracy_notes(result, tilt),
    )


def accuracy_title(result: Result) -> str:
    """What is answered: agreement with what flew is no accuracy."""
    whom = result.reference.choice if result.reference else ""
    return "Accuracy" if whom != "onboard" else "Agreement with onboard"


def accuracy_sentence(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """Who is closest in tilt and who is farthest, then the same of the heading, then who lost its way."""
    agrees = result.reference is not None and result.reference.choice == "onboard"
    text = leading(tilt, tilt_words(result, agrees=agrees)) + "."
    text += worst_part(tilt, tilt_words(result, agrees=agrees))
    text += heading_part(result, tilt, heading) + no_north_part(result, heading) + onboard_errors(result, tilt, heading)
    gone = lost_part(lost_rows(result))
    return text + (f" {gone}." if gone else "")


def caveat_part(result: Result) -> str:
    """What the ranking has to say of its reference, as sentences after a blank; empty for nothing."""
    said = typeset(result.reference.caveat) if result.reference else ""
    return "".join(f" {part[0].upper()}{part[1:]}." for part in said.split("; ") if part)


def tilt_words(result: Result, *, agrees: bool) -> QuestionWords:
    """How the tilt error is spoken of: against the onboard attitude it is agreement, not truth."""
    whom = against_whom(result, sigma=True)
    alone, close = f"is the only filter to compare in tilt with {whom}", f" in tilt against {whom}"
    if agrees:
        one, several = (f"{verb} best in tilt with {whom}" for verb in ("agrees", "agree"))
        return QuestionWords(one, several, "agrees least", alone, close)
    return QuestionWords(f"is closest in tilt to {whom}", f"are closest in tilt to {whom}", "is farthest", alone, close)


def unranked_accuracy(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """The errors where no filter was compared with another: all of them lost, or too little time."""
    whom = against_whom(result, sigma=True)
    sound = [j for j in tilt.filters if j.row.status == "ok"]
    if not sound:
        states = {j.row.status for j in tilt.filters}
        if "not_judged" in states:
            return f"No filter can be judged: {typeset(tilt.filters[0].row.reason)}.{onboard_errors(result, tilt, heading)}"
        whole = "All " if len(tilt.filters) == tilt.total else ""
        who = f"{whole}{len(tilt.filters)} filters" if len(tilt.filters) > 1 else tilt.filters[0].name
        how = "diverged from" if "not_converged" not in states else "did not settle near"
        if len(states) > 1:
            how = "diverged from or did not settle near"
        end = "either they or the onboard attitude is wrong" if "onboard" in whom else "none can be judged"
        end = "either they or the smoother is wrong" if "smoother" in whom else end
        return f"{who} {how} {whom}: {end}.{onboard_errors(result, tilt, heading)}"
    seconds = duration(max(j.answer.seconds for j in sound))
    spread = f"{equal_values(sound)} against {whom}"
    if len(sound) <= NAMED:
        spread = f"{listed([f'{j.name} {j.text}{j.interval}' for j in sound])} against {whom}"
    text = f"Filters cannot be ranked over {seconds}: tilt errors are {spread}."
    beside = [j for j in (heading.of(one.row) for one in sound) if j is not None]
    text += f" Heading errors are {equal_values(beside)}{against_north(result)}." if beside else ""
    text += no_north_part(result, heading) if beside else ""
    gone = lost_part(lost_rows(result))
    return text + onboard_errors(result, tilt, heading) + (f" {gone}." if gone else "")


def equal_values(judged: list[RankedValue]) -> str:
    """The range of values; of several that are shown alike that they are."""
    text = values_text(judged, named=False)
    return f"all {text}" if len(judged) > 1 and text == judged[0].text else text


def onboard_errors(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """The errors of what flew, where something better is the reference, and whether it is in error."""
    if tilt.onboard is None:
        return ""
    failed = {check.name for check in result.audit if check.verdict == "fault"}
    error = "; it is in error here" if failed.intersection(ONBOARD_CHECKS) else ""
    error = error or ("; its heading is in error" if HEADING_CHECK in failed else "")
    refused = result.reference is not None and "onboard" in result.reference.refused
    error = error or ("; it is in error here" if refused else "")
    beside = f", heading {heading.onboard.text}" if heading.onboard else ""
    return f" Onboard: {tilt.onboard.text}{beside}{error}."


def heading_part(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """The heading error: who leads where it is ranked, else that of the rows that lead in tilt."""
    if heading.ranked:
        words = QuestionWords("is closest", "are closest", "is farthest", "alone can be compared")
        if not heading.best and len(heading.ranked) > 1:
            return f" No significant difference in heading: {values_text(heading.ranked, named=False)}."
        return f" In heading {leading(heading, words)}.{worst_part(heading, words)}"
    leaders = tilt.best or tilt.ranked
    beside = [j for j in (heading.of(leader.row) for leader in leaders) if j is not None]
    if not beside:
        return ""
    whom = against_north(result)
    if len(beside) == 1:
        return f" Its heading is off by {single_value(beside[0])}{whom}, not ranked."
    return f" Their headings are off by {values_text(beside, named=bool(tilt.best))}{whom}, not ranked."


def no_north_part(result: Result, heading: ColumnRanking) -> str:
    """That headings of filters without a compass are compared with their offset subtracted."""
    if not heading.filters or any(r.uses_mag or r.north_by_gnss for r in result.estimators if r.kind == "replay"):
        return ""
    return " Without a compass they know no north: each heading counts from the start."


def against_north(result: Result) -> str:
    """What headings are compared with, where that is another than what tilt is compared with."""
    shared = result.reference is not None and result.reference.heading_by == "onboard"
    return f" against {against_heading(result, 'onboard')}" if shared else ""


def accuracy_notes(result: Result, tilt: ColumnRanking) -> list[str]:
    """What an error means here, and over which part of the log."""
    seconds = max((j.answer.seconds for j in tilt.filters), default=0.0)
    where = "in the air" if tilt.window == "airborne" else "over the whole log" if tilt.window == "all" else "armed"
    over = [f"RMS error {where}, {seconds:.0f} s."] if seconds else []
    return ([typeset(result.reference.text)] if result.reference else []) + over


# How much does a filter move by itself? Its noise at rest, else what it adds to the gyro's in motion.

NOISE = "noise_tilt_deg"
SIGMA = "1 sigma within 5 s"
PHASE_WORDS = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
"""Phases in words; flight other than hover is ``cruise``."""

NOISE_WORDS = QuestionWords(
    "has the least noise", "have the least noise", "has the most noise", "is the only filter to be ranked"
)
ADDED_NOISE_WORDS = QuestionWords(
    "adds the least noise",
    "add the least noise",
    "adds the most noise",
    "is the only filter to be ranked",
    " in added noise",
)
"""There the gyro's own noise is in every row, and cancels."""


def noise_verdict(result: Result) -> Verdict:
    """The verdict on noise: the first phase in which filters could be compared leads, others follow in one clause."""
    phases = [rank_column(result, NOISE, (phase,)) for phase in PHASES]
    ranked = [found for found in phases if found.ranked]
    shown = [found for found in phases if found.filters]
    lead = (ranked or shown or phases)[0]
    if ranked:
        sentence = noise_sentence(result, ranked) + onboard_part(lead)
    elif shown:
        sentence = f"No filter can be ranked: {reasons_unranked(lead)}.{onboard_part(lead)}"
    else:
        sentence = cannot_be_judged(result, lead.absent, "no phase of the log is long enough")
    return Verdict(
        "noise", "Noise", sentence, NOISE, lead.window, bars(lead), reasons_left_out(lead), noise_notes(shown)
    )


def noise_sentence(result: Result, ranked: list[ColumnRanking]) -> str:
    """Who has the least noise in the first phase, with its tilt error, who the most, then the other phases."""
    lead = ranked[0]
    words = NOISE_WORDS if lead.window == "rest" else ADDED_NOISE_WORDS
    text = leading(lead, words, SIGMA, f" {PHASE_WORDS[lead.window]}") + tilt_errors(result, lead) + "."
    text += worst_part(lead, words) + gyro_part(lead)
    others = [f"{PHASE_WORDS[found.window]} {phase_clause(found)}" for found in ranked[1:]]
    return text + (f" {others[0][0].upper()}{'; '.join(others)[1:]}." if others else "")


def tilt_errors(result: Result, lead: ColumnRanking) -> str:
    """The tilt error of who has the least noise: a filter may be quiet and wrong."""
    tilt = rank_column(result, TILT, AIR)
    leaders = lead.best or (lead.ranked if len(lead.ranked) == 1 else [])
    errors = [j for j in (tilt.of(leader.row) for leader in leaders) if j is not None]
    if not errors:
        return ""
    return (
        f". Its tilt error is {errors[0].text}"
        if len(errors) == 1
        else f". Their tilt errors are {values_text(errors)}"
    )


def gyro_part(lead: ColumnRanking) -> str:
    """What the gyro itself wanders by, as a sentence after a blank, where a row adds less; else empty."""
    own = gyro_noise(lead)
    return own and f" The gyro's own noise is about {own}."


def gyro_noise(found: ColumnRanking) -> str:
    """What the gyro itself wanders by, where a row adds less and rows below it share a rank; else empty."""
    share = max((j.answer.gyro_share for j in found.ranked), default=0.0)
    return quantity(float(f"{share:.1g}"), "deg") if any(j.value < share for j in found.ranked) else ""


def phase_clause(found: ColumnRanking) -> str:
    """Another phase in few words; all but rest, which leads where it is ranked, tell what is added."""
    if len(found.ranked) == 1:
        return f"{found.ranked[0].name} adds {found.ranked[0].text}"
    if not found.best:
        return f"no significant difference, {values_text(found.ranked, named=False)} added"
    adds = "adds" if len(found.best) == 1 else "add"
    own = gyro_noise(found)
    beside = f" (the gyro's own noise is about {own})" if own and len(found.best) > 1 else ""
    return f"{some_rows(found.best, found)} {adds} least, {values_text(found.best)}{beside}"


def noise_notes(shown: list[ColumnRanking]) -> list[str]:
    """How much of each phase was measured."""
    return [
        f"{PHASE_WORDS[found.window][0].upper()}{PHASE_WORDS[found.window][1:]}: "
        f"{count(max(j.answer.n for j in found.filters), 'window')} of 5 s."
        for found in shown
    ]


# How much does a filter lag in a step? The lag of each row, and the angle it is off afterwards.

LAG = "lag_ms"
STEP_DEG, STEP_PCT, STEP_AFTER = "step_error_deg.0.5s", "step_error_pct.0.5s", "0.5 s"
NOT_PURE = ("not_a_pure_delay", "lag_at_edge")
WRONG_PCT = 10.0
"""From this share of the step on a filter is called short of it or beyond it."""
ONE_SAMPLE = (0.8, 1.2)
SLOW_IMU_S = 0.015
"""Lags of one sample are said to be that where samples are further apart than this."""
SHOWN_DELAY_MS = 0.5


def lag_verdict(result: Result) -> Verdict:
    """The verdict on steps: who lags, and who shows a wrong angle afterwards."""
    lag, step = rank_column(result, LAG, AIR), rank_column(result, STEP_DEG, AIR)
    impure = [a for a in lag.absent if a.code in NOT_PURE and a.row.kind == "replay" and not is_baseline(a.row)]
    if lag.ranked:
        unsure = undetermined_part(lag)
        sentence = lag_sentence(result, lag) + (f" {unsure[0].upper()}{unsure[1:]}." if unsure else "")
        sentence += late_imu(result) + impure_part([a.row.name for a in impure], result)
        sentence += onboard_lag(lag) + step_part(result, step)
    elif lag.filters or impure:
        sentence = f"No filter's lag can be judged: {reasons_unranked(lag)}.{onboard_lag(lag)}{step_part(result, step)}"
    else:
        sentence = cannot_be_judged(result, lag.absent, "the flight holds too few steps (3 per axis are needed)")
    return Verdict("lag", "Lag", sentence, LAG, lag.window, bars(lag), reasons_left_out(lag), lag_notes(result, lag))


def lag_sentence(result: Result, lag: ColumnRanking) -> str:
    """Who lags by its interval and by how much, else below which bound none does."""
    ranked = lag.ranked
    slow = [j for j in ranked if j.significant and j.value > zero_below(j)]
    early = [j for j in ranked if j.significant and j.value < -zero_below(j)]
    rest = [j for j in ranked if j not in slow and j not in early]
    against = f"against {against_whom(result)} in {count(max(j.answer.n for j in ranked), 'step')}"
    parts = []
    if slow:
        parts.append(f"{lagging(result, lag, slow)} {against}")
    if early:
        parts.append(ahead_part(result, early, lag, "" if slow else f" {against}"))
    if rest and parts:
        who = some_rows(rest, lag) if len(rest) <= NAMED else f"the other {len(rest)} filters"
        parts.append(f"No significant lag of {who}: less than {bound_text(rest)}")
    elif rest:
        who = rest[0].name if len(rest) == 1 else f"{len(rest)} filters"
        parts.append(f"No significant lag of {who}: less than {bound_text(rest)} {against}")
    return ". ".join(parts) + "."


def zero_below(judged: RankedValue) -> float:
    """Lags below this count as none, ms: half an IMU sample."""
    return judged.answer.counts_as_zero_below


def lagging(result: Result, lag: ColumnRanking, slow: list[RankedValue]) -> str:
    """Rows that lag significantly, the largest first; "most" only for the row that the ranking finds worst."""
    slowest = slow[::-1]
    if len(slow) == 1:
        return f"{slow[0].name} lags by {slow[0].text}{slow[0].interval}{one_sample_part(result, slow[0])}"
    if lag.worst is not None and lag.worst.row.name == slowest[0].row.name:
        most, others = slowest[0], slowest[1:]
        text = f"{most.name} lags most: {most.text}{most.interval}{one_sample_part(result, most)}"
        return f"{text}; {some_rows(others, lag)} by {values_text(others[::-1])}"
    return f"{some_rows(slow, lag)} lag by {values_text(slow)}"


def one_sample_part(result: Result, judged: RankedValue) -> str:
    """That a lag is one sample of a slow log, which is as late as a filter that uses the newest sample can be."""
    rate = float((result.log.get("imu") or {}).get("rate_hz") or 0.0)
    if rate <= 0 or 1.0 / rate < SLOW_IMU_S or not ONE_SAMPLE[0] <= judged.value * rate / 1000.0 <= ONE_SAMPLE[1]:
        return ""
    return f", one sample of this log's {number(rate, 'Hz')} Hz IMU,"


def ahead_part(result: Result, early: list[RankedValue], lag: ColumnRanking, against: str) -> str:
    """Rows that come before what they are compared with: if all filters do, that itself lags."""
    who = some_rows(early, lag)
    text = f"{who} {'is' if len(early) == 1 else 'are'} ahead: {values_text(early)}{against}"
    flew = result.reference is not None and result.reference.choice == "onboard"
    return f"{text}. The onboard attitude itself lags" if flew and len(early) == len(lag.ranked) > 1 else text


def late_imu(result: Result) -> str:
    """That the IMU itself comes late, by more than its filters explain: no filter can be earlier."""
    for check in result.audit:
        if check.name == "imu delay" and check.verdict in ("warning", "fault") and isinstance(check.value, float):
            if check.value > 0.0:
                return f" The IMU itself is {quantity(check.value, 'ms', signed=False)} late, and every filter with it."
    return ""


def impure_part(names: list[str], result: Result) -> str:
    """Whose lag cannot be determined, because it goes through the step in another shape."""
    if not names:
        return ""
    called = [j.name for j in rank_column(result, STEP_DEG, AIR).judged if j.row.name in names]
    who = few_or_count(called) if len(called) == len(names) else count(len(names), "filter")
    return f" Lag cannot be determined for {who}: not a pure delay."


def onboard_lag(lag: ColumnRanking) -> str:
    """The lag of what flew, where something better is the reference."""
    flew = lag.onboard
    return f" Onboard: {flew.text}{flew.interval}." if flew is not None else ""


def step_part(result: Result, step: ColumnRanking) -> str:
    """How wrong the angle is after a step: who is short of it, and how far the others are off."""
    filters = [j for j in step.filters if j.row.status == "ok"]
    if not filters:
        return ""
    percent = {j.row.name: step_share(j, step.window) for j in filters}
    wrong = [j for j in filters if abs(percent[j.row.name]) >= WRONG_PCT][::-1]
    best = {j.row.name for j in step.best}
    least = list(takewhile(lambda j: j.row.name in best, filters))  # one behind a worse row is only not significant
    others = [j for j in filters if j not in wrong and j not in least]
    parts = [step_errors(wrong, percent, len(filters))] if wrong else []
    if least:
        are = "is" if len(least) == 1 else "are"
        parts.append(f"{some_rows(least, step)} {are} least off, {values_text(least)}")
    parts += [step_offset(others, all_of_them=len(others) == step.total)] if others else []
    return f" {STEP_AFTER} after a step ({movements(filters)}) {'; '.join(parts)}."


def step_remark(result: Result) -> str:
    """Which filter misses most of a step 0.5 s after it, of several how many; empty where all follow it.

    A filter whose angle is wrong may have no lag.
    """
    step = rank_column(result, STEP_DEG, AIR)
    percent = {j.name: step_share(j, step.window) for j in step.filters if j.row.status == "ok"}
    wrong = sorted((name for name, x in percent.items() if abs(x) >= WRONG_PCT), key=lambda name: -abs(percent[name]))
    if not wrong:
        return ""
    if len(wrong) == 1:
        return f"{wrong[0]} is {step_shortfall(percent[wrong[0]])} after 0.5 s."
    return f"{len(wrong)} filters are up to {quantity(abs(percent[wrong[0]]), '%')} off after 0.5 s."


def movements(judged: list[RankedValue]) -> str:
    """How many steps count: fewer than for the lag, for a step that ends early tells no error after it."""
    least, most = (end(j.answer.n for j in judged) for end in (min, max))
    return count(most, "step") if least == most else f"{least} to {count(most, 'step')}"


def step_errors(wrong: list[RankedValue], percent: dict[str, float], of: int) -> str:
    """Rows that show too little or too much of the step, the largest error first."""
    if len(wrong) > NAMED:
        shares = sorted(abs(percent[j.row.name]) for j in wrong)
        ends = f"{number(shares[0], '%')} to {quantity(shares[-1], '%')}"
        return f"{len(wrong)} of {of} filters are off by {ends} of it ({values_text(wrong)})"
    said = []
    for k, j in enumerate(wrong):
        same = k > 0 and (percent[j.row.name] < 0) == (percent[wrong[k - 1].row.name] < 0)
        text = quantity(abs(percent[j.row.name]), "%") if same else step_shortfall(percent[j.row.name])
        said.append(f"{j.name} {'' if same else 'is still '}{text} ({j.text})")
    return listed(said) if len({percent[j.row.name] < 0 for j in wrong}) == 1 else "; ".join(said)


def step_share(judged: RankedValue, window: str) -> float:
    """The error as a signed share of the step, %; 0 where it is not known."""
    answer = judged.row.metrics.get(window, {}).get(STEP_PCT)
    return 0.0 if answer is None or answer.value is None else answer.value


def step_shortfall(percent: float) -> str:
    """How much of the step is missing or too much."""
    return f"{quantity(abs(percent), '%')} {'short' if percent < 0 else 'too far'}"


def step_offset(judged: list[RankedValue], *, all_of_them: bool) -> str:
    """How far rows are off, in degrees."""
    if len(judged) <= NAMED:
        return f"{listed([j.name for j in judged])} {'is' if len(judged) == 1 else 'are'} off by {values_text(judged)}"
    return f"{'all ' if all_of_them else ''}{len(judged)} filters are off by {values_text(judged)}"


def lag_notes(result: Result, lag: ColumnRanking) -> list[str]:
    """The delay of the logged sensors, which is no filter's fault; an attitude from a file has its own clock."""
    answers = [
        row.metrics.get(lag.window, {}).get(LAG)
        for row in result.estimators
        if row.kind == "replay" and "clock" not in row.quality
    ]
    delays = [a.taken_out for a in answers if a is not None and a.taken_out is not None]
    if not delays:
        return []
    delay = max(delays, key=abs)
    if abs(delay) < SHOWN_DELAY_MS:
        return ["No delay of the logged IMU is known; lags are taken as they are."]
    return [f"The logged IMU itself comes {quantity(delay, 'ms', signed=False)} late; that is not counted as lag."]


# How fast does the heading drift? At rest against standing still, in the air against one heading reference.

DRIFT_REST = "drift_rest_deg_per_min"
BOUNDS_DIFFER = 3.0
EXCLUDES_NOTHING = 15.0
"""deg/min: the bias of a warm gyro that nobody calibrated, 0.25 deg/s, turns by as much. A larger bound is no news."""
SITUATIONS = ("at rest", "in the air")
"""Where the heading may drift; reasons of this question start with it."""


def yaw_drift_verdict(result: Result) -> Verdict:
    """The verdict on heading drift: significant where the interval excludes zero, else bounded by its larger end."""
    reference = quoted_heading_reference(result)
    rest = rank_column(result, DRIFT_REST, REST)
    air = rank_column(result, f"{DRIFT_AIR}.{reference}", AIR)
    shown = rest if rest.ranked or not air.filters else air
    reasons = [
        (name, reason if found is shown and row_has_value(found, name) else f"{where}, {reason}")
        for where, found in zip(SITUATIONS, (rest, air), strict=True)
        for name, reason in reasons_left_out(found)
        if found is shown or not row_has_value(found, name)
    ]
    return Verdict(
        "yaw_drift",
        "Yaw drift",
        drift_sentence(result, rest, air, reference),
        shown.metric,
        shown.window,
        bars(shown),
        reasons,
        drift_notes(result, rest),
    )


def row_has_value(found: ColumnRanking, name: str) -> bool:
    """Whether the row of this id has a value."""
    return any(j.row.name == name for j in found.judged)


def drift_sentence(result: Result, rest: ColumnRanking, air: ColumnRanking, reference: str) -> str:
    """A sentence for each situation that can be determined, else why none can."""
    in_air = f"In the air against {against_heading(result, reference)}"
    said = [
        drift_part(found, where) for found, where in ((rest, "At rest"), (air, in_air)) if found.ranked or found.filters
    ]
    if said:
        return " ".join(said)
    if rest.absent and air.absent:
        (code, why_rest), (_, why_air) = commonest_reason(rest.absent), commonest_reason(air.absent)
        return f"Cannot be judged. At rest: {why_rest}.{rest_advice(result, code)} In the air: {why_air}."
    return cannot_be_judged(result, rest.absent + air.absent, "neither a rest nor a flight is long enough")


def drift_part(found: ColumnRanking, where: str) -> str:
    """One situation: who drifts, below which bound the others stay, whose rests disagree, who lost its way."""
    significant = [j for j in found.ranked if j.significant][::-1]
    still = [j for j in found.ranked if not j.significant]
    parts = [significant_drifts(found, significant)] if significant else []
    if still:
        who = f"{len(still)} filters" if len(still) > 2 else listed([j.name for j in still])
        parts.append(f"no significant drift of {who}: {drift_bounds(still)}")
    least = {j.row.name for j in found.best}
    if significant and 0 < len(least) <= NAMED and least != {j.row.name for j in still}:
        parts.append(f"least: {some_rows(found.best, found)}")
    disagree = [j for j in found.filters if j.row.status == "ok" and j.answer.disagree is not None]
    if disagree:
        parts.append(f"the rests disagree for {few_or_count([j.name for j in disagree])}: {rest_spread(disagree)}")
    others = [j for j in found.filters if not j.ranked and j not in disagree and j.row.status == "ok"]
    if others:
        parts.append(f"{few_or_count([j.name for j in others])} {'is' if len(others) == 1 else 'are'} not ranked")
    parts += [unsure] if (unsure := undetermined_part(found)) else []
    parts += lost_drifts([j for j in found.filters if j.row.status not in ("ok", "not_judged")])
    if not parts:
        parts = [f"no filter can be ranked: {reasons_unranked(found)}"]
    text = ". ".join([f"{where}, {parts[0]}", *(part[:1].upper() + part[1:] for part in parts[1:])])
    return f"{text}.{onboard_part(found, interval=True)}"


def significant_drifts(found: ColumnRanking, significant: list[RankedValue]) -> str:
    """Rows with significant drift, the fastest first; "most" only for the row that the ranking finds worst."""
    most, others = significant[0], significant[1:]
    if not others:
        return f"{most.name} drifts {most.text}{most.interval}{rate_change(most)}"
    if found.worst is not None and found.worst.row.name == most.row.name:
        text = f"{most.name} drifts most: {most.text}{most.interval}{rate_change(most)}"
        return f"{text}; {some_rows(others, found)} {values_text(others[::-1])}"
    return f"{some_rows(significant, found)} drift: {values_text(significant)}"


def drift_bounds(still: list[RankedValue]) -> str:
    """What these drifts stay below, a range where the bounds differ much; what is possible where that says nothing."""
    ends = sorted(max(map(abs, j.ends)) for j in still)
    if ends[-1] > EXCLUDES_NOTHING:
        return f"up to {bound_text(still)} possible"
    if ends[-1] <= BOUNDS_DIFFER * ends[0]:
        return f"less than {bound_text(still)}"
    return f"less than {below(ends[0], 'deg/min')} to {below(ends[-1], 'deg/min')}"


def rate_change(judged: RankedValue) -> str:
    """That the rate itself rises or falls."""
    change = judged.answer.changes
    return f" (the rate itself changes from {signed_drift(change[0])} to {signed_drift(change[1])})" if change else ""


def signed_drift(value: float) -> str:
    """A drift with sign and unit."""
    return quantity(value, "deg/min")


def rest_spread(judged: list[RankedValue]) -> str:
    """The range over rests that do not agree."""
    ranges = [j.answer.disagree for j in judged if j.answer.disagree is not None]
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    return f"{signed_drift(low)} to {signed_drift(high)}"


def lost_drifts(judged: list[RankedValue]) -> list[str]:
    """Rows that lost their way: their drift is named, after all others."""
    return [f"{j.name}, which {NOT_JUDGED.get(j.row.status, 'failed')}, {j.text}{j.interval}" for j in judged[:2]] + (
        [f"{count(len(judged) - 2, 'more filter')} lost the way"] if len(judged) > 2 else []
    )


def drift_notes(result: Result, rest: ColumnRanking) -> list[str]:
    """Every rest with its time, what of it could be used, and what it says for one row; the earth's own turn."""
    rows = [j.answer for j in rest.filters] or [
        a.row.metrics[rest.window][rest.metric] for a in rest.absent if a.row.kind == "replay"
    ]
    if not rows:
        return []
    said = [
        f"Rest from {moment(r.t0)} to {moment(r.t1)}: {usable_rest(r.usable_s, r.reason)}." for r in rows[0].records
    ]
    turn = earth_turn(result.log.get("place") or {})
    return said + ([turn] if turn else [])


def usable_rest(seconds: float, reason: str | None) -> str:
    """How much of a rest counts."""
    return typeset(reason) if reason else f"{duration(seconds)} usable"


def earth_turn(place: Mapping[str, Any]) -> str:
    """How fast the earth turns the heading of a perfect gyro."""
    turn = place.get("earth_turn_deg_per_min")
    return f"The earth itself turns by {quantity(turn, 'deg/min')} here." if turn is not None else ""


# The four answers in a line each, for a terminal: what the table shows in numbers, and what is significant.
#
# They come from the same ranking as the sentences, which say more: intervals, other phases, who is not ranked and
# why.

NO_FILTER_RAN = "no filter was run"
NO_ANSWER = "Cannot be determined: "
"""How an answer without any value begins."""


@dataclass(frozen=True, slots=True)
class BriefAnswer:
    """An answer from a column, and the same of the onboard attitude as a sentence of its own (may be empty)."""

    text: str
    column: ColumnRanking
    onboard: str = ""

    def within(self, width: int) -> str:
        """The answer; with the onboard attitude, which stands in the table too, where that fits into so many signs."""
        both = f"{self.text} {self.onboard}" if self.onboard else self.text
        return both if len(both) <= width else self.text

    def led(self, warning: str) -> BriefAnswer:
        """The answer behind a warning."""
        return BriefAnswer(warning + self.text, self.column)


def brief_answers(result: Result) -> dict[str, BriefAnswer]:
    """Question -> its answer in few words, in the order of the page; where sensors spoil it, that comes first."""
    found = {
        "accuracy": _accuracy(result),
        "noise": _noise(result),
        "lag": _lag(result, rank_column(result, LAG, AIR)),
        "yaw_drift": _yaw_drift(result),
    }
    check = spoiling_check(result)
    if check is None:
        return found
    return {
        q: answer if answer.text.startswith(NO_ANSWER) else answer.led(f"Unreliable, {SPOILING_CHECKS[check.name]}: ")
        for q, answer in found.items()
    }


def _accuracy(result: Result) -> BriefAnswer:
    tilt = rank_column(result, TILT, AIR)
    if not tilt.ranked:
        return _unranked(tilt, "tilt ")
    return BriefAnswer(f"Tilt: {_compared(tilt)}.", tilt, _onboard_value(tilt))


def _noise(result: Result) -> BriefAnswer:
    phases = [rank_column(result, NOISE, (phase,)) for phase in PHASES]
    lead = next((found for found in phases if found.ranked), next((f for f in phases if f.filters), phases[0]))
    if not lead.ranked:
        return _unranked(lead)
    where = PHASE_WORDS[lead.window] if lead.window == "rest" else f"added {PHASE_WORDS[lead.window]}:"
    return BriefAnswer(f"{where[0].upper()}{where[1:]} {_compared(lead)}.", lead, _onboard_value(lead))


def _lag(result: Result, lag: ColumnRanking) -> BriefAnswer:
    """Which lags are measurable, the largest first, and below which bound all others are."""
    if not lag.ranked:
        return _unranked(lag)
    moved = [j for j in lag.ranked if j.significant and abs(j.value) > zero_below(j)][::-1]
    rest = [j for j in lag.ranked if j not in moved]
    steps = counted(max(j.answer.n for j in lag.ranked), "step")
    flew = result.reference is not None and result.reference.choice == "onboard"
    if flew and not rest and all(j.value < 0.0 for j in moved):
        least, most = (quantity(-j.value, "ms", signed=False) for j in (moved[-1], moved[0]))
        text = f"{_who(moved, lag)} {between(least, most)} ahead of onboard"
    else:
        text = _significant(moved, rest, lag)
    return BriefAnswer(f"{text[0].upper()}{text[1:]} ({steps}).{late_imu(result)}", lag, _onboard_value(lag))


def _yaw_drift(result: Result) -> BriefAnswer:
    """Drift at rest, where filters were compared there, else in the air."""
    rest = rank_column(result, DRIFT_REST, REST)
    air = rank_column(result, f"{DRIFT_AIR}.{quoted_heading_reference(result)}", AIR)
    where, found = ("At rest", rest) if rest.ranked or not air.ranked else ("In flight", air)
    if not found.ranked:
        return _unranked(rest if rest.filters or not air.filters else air)
    drifting = [j for j in found.ranked if j.significant][::-1]
    still = [j for j in found.ranked if not j.significant]
    against = against_heading(result, quoted_heading_reference(result)) if found is air else ""
    where += f" against {against}:" if "in doubt" in against else ""
    text = _significant(drifting, still, found)
    if still and max(abs(end) for j in still for end in j.ends) > EXCLUDES_NOTHING:
        possible = f"up to {bound_text(still)}"
        text = f"{_span(drifting)}; others uncertain ({possible})" if drifting else f"uncertain, {possible} is possible"
    return BriefAnswer(f"{where} {text}.", found, _onboard_drift(found))


def _compared(found: ColumnRanking) -> str:
    """The rows that none is significantly better than, then all others."""
    ranked, best = found.ranked, found.best
    if len(ranked) == 1:
        alone = " alone is ranked:" if found.total > 1 else ""
        return f"{ranked[0].name}{alone} {ranked[0].text}{ranked[0].interval}"
    if not best:
        return f"{_who(ranked, found)} {_range(ranked)} (not significant)"
    others = [j for j in ranked if j not in best]
    leaders = f"{_counted(best)} best ({_range(best)})" if len(best) > 1 else _span(best)
    rest = f"{others[0].name} {others[0].text}" if len(others) == 1 else f"others {_range(others)}"
    return f"{leaders}, {rest}" if others else leaders


def _significant(beyond: list[RankedValue], still: list[RankedValue], found: ColumnRanking) -> str:
    """Rows whose value is significant, and what all others stay below."""
    parts = [_span(beyond)] if beyond else []
    return "; ".join([*parts, f"{_who(still, found)} below {bound_text(still)}"] if still else parts)


def _who(judged: list[RankedValue], found: ColumnRanking) -> str:
    """One or two rows by name, more as a count; all that were compared are said to be all."""
    if len(judged) > 2:
        return f"all {found.compared}" if len(judged) == len(found.ranked) else f"{len(judged)} filters"
    return listed([j.name for j in judged])


def _span(judged: list[RankedValue]) -> str:
    """One or two rows by name, of more their number, with their range."""
    return f"{_counted(judged)} {_range(judged)}"


def _counted(judged: list[RankedValue]) -> str:
    """One or two rows by name, of more their number."""
    return listed([j.name for j in judged]) if len(judged) <= 2 else f"{len(judged)} filters"


def _range(judged: list[RankedValue]) -> str:
    """The least and the largest value."""
    ends = sorted(judged, key=lambda j: j.value)
    return between(ends[0].text, ends[-1].text)


def _onboard_value(found: ColumnRanking) -> str:
    """The value of the onboard attitude, unless all were compared with it."""
    return f"Onboard {found.onboard.text}." if found.onboard is not None else ""


def _onboard_drift(found: ColumnRanking) -> str:
    """The drift of the onboard attitude where it is significant, else what it stays below; nothing where that is
    anything."""
    flew = found.onboard
    if flew is None or flew.significant:
        return _onboard_value(found)
    return "" if max(map(abs, flew.ends)) > EXCLUDES_NOTHING else f"Onboard below {bound_text([flew])}."


def _unranked(found: ColumnRanking, what: str = "") -> BriefAnswer:
    """Why filters were not compared, and what they show all the same."""
    sound = [j for j in found.filters if j.row.status == "ok"]
    if sound:
        why = typeset(reason_unranked(sound[0])).partition(":")[0].removesuffix(" to rank")
        lost = [j.name for j in found.filters if j.row.status == "diverged"]
        gone = f"; {listed(lost) if len(lost) <= 2 else f'{len(lost)} filters'} diverged" if lost else ""
        return BriefAnswer(f"Not ranked ({why}): {what}{_range(sound)}{gone}.", found, _onboard_value(found))
    rows = [j.row for j in found.filters] + [a.row for a in found.absent if a.row.kind == "replay"]
    rows = [row for row in rows if not is_baseline(row)]
    if len(rows) == found.total > 1 and rows[0].status != "ok" and all(row.status == rows[0].status for row in rows):
        why = typeset(rows[0].reason) if rows[0].status == "not_judged" else ""
        return BriefAnswer(f"{NO_ANSWER}{why or f'all {len(rows)} filters {NOT_JUDGED[rows[0].status]}'}.", found)
    why = reasons_unranked(found) if found.filters else commonest_reason(found.absent)[1] or NO_FILTER_RAN
    return BriefAnswer(f"{NO_ANSWER}{why.partition(';')[0]}.", found, _onboard_value(found))


# Who is not ranked in an answer, who is not judged, and why.


def not_ranked(verdict: Verdict) -> set[str]:
    """Rows (by id) that have a value and are not ranked."""
    return {name for name, reason in verdict.not_judged if not reason.startswith(SITUATIONS)}


def grouped_reasons(verdict: Verdict, names: Mapping[str, str], filters: set[str]) -> list[tuple[str, str]]:
    """Who is not judged, and why: rows with the same reason together, what needs no reason left out.

    ``names`` are the rows' names by id, ``filters`` the ids of all replayed rows.
    """
    gathered: dict[str, list[str]] = {}
    for name, reason in verdict.not_judged:
        if not reason.endswith("itself"):
            gathered.setdefault(reason, []).append(name)
    return [
        ("All filters" if len(who) > 1 and filters <= set(who) else listed([names.get(w, w) for w in who]), reason)
        for reason, who in gathered.items()
    ]


# The questions in plain sentences, one file each.
#
# Sentences are made by rule from a Result, never by hand: first the answer, then the
# number, then who is worst, then the onboard attitude. Who is best or worst comes from
# the ranking that also marks the table (``result.best``, ``result.worst``), so that a
# sentence cannot contradict a star. A drift or lag whose interval holds zero is bounded
# by the interval's larger end, never called absent.

QUESTIONS = {"accuracy": "accuracy", "noise": "noise", "lag": "lag", "yaw_drift": "yaw drift"}
"""What the questions are called, in the order of the page."""


def verdicts(result: Result) -> list[Verdict]:
    """The verdicts of a result in the order of the page; always all of them."""
    answers = (accuracy_verdict, noise_verdict, lag_verdict, yaw_drift_verdict)
    return [with_spoiling_check(result, answer(result)) for answer in answers]
