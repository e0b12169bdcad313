"""How much does a filter move by itself? Its noise at rest, else what it adds to the gyro's in motion."""

from __future__ import annotations

from attlog.present.contest import ColumnRanking, contest
from attlog.present.numbers import counted as count
from attlog.present.numbers import quantity
from attlog.present.sentences.accuracy import TILT
from attlog.present.sentences.reasons import cannot, why_not
from attlog.present.sentences.words import QuestionWords, bars, last, leading, left_out, onboard_part, some, values
from attlog.present.table.rows import AIR, PHASES
from attlog.result import Result, Verdict

NOISE = "noise_tilt_deg"
SIGMA = "1 sigma within 5 s"
WHERE = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
"""Phases in words; flight other than hover is ``cruise``."""

WORDS = QuestionWords(
    "has the least noise", "have the least noise", "has the most noise", "is the only filter to be ranked"
)
WORDS_IN_MOTION = QuestionWords(
    "adds the least noise",
    "add the least noise",
    "adds the most noise",
    "is the only filter to be ranked",
    " in added noise",
)
"""There the gyro's own noise is in every row, and cancels."""


def noise_verdict(result: Result) -> Verdict:
    """The verdict on noise: the first phase in which filters could be compared leads, others follow in one clause."""
    phases = [contest(result, NOISE, (phase,)) for phase in PHASES]
    ranked = [found for found in phases if found.ranked]
    shown = [found for found in phases if found.filters]
    lead = (ranked or shown or phases)[0]
    if ranked:
        sentence = says(result, ranked) + onboard_part(lead)
    elif shown:
        sentence = f"No filter can be ranked: {why_not(lead)}.{onboard_part(lead)}"
    else:
        sentence = cannot(result, lead.absent, "no phase of the log is long enough")
    return Verdict("noise", "Noise", sentence, NOISE, lead.window, bars(lead), left_out(lead), notes(shown))


def says(result: Result, ranked: list[ColumnRanking]) -> str:
    """Who has the least noise in the first phase, with its tilt error, who the most, then the other phases."""
    lead = ranked[0]
    words = WORDS if lead.window == "rest" else WORDS_IN_MOTION
    text = leading(lead, words, SIGMA, f" {WHERE[lead.window]}") + tilt_errors(result, lead) + "."
    text += last(lead, words) + gyro_part(lead)
    others = [f"{WHERE[found.window]} {clause(found)}" for found in ranked[1:]]
    return text + (f" {others[0][0].upper()}{'; '.join(others)[1:]}." if others else "")


def tilt_errors(result: Result, lead: ColumnRanking) -> str:
    """The tilt error of who has the least noise: a filter may be quiet and wrong."""
    tilt = contest(result, TILT, AIR)
    leaders = lead.best or (lead.ranked if len(lead.ranked) == 1 else [])
    errors = [j for j in (tilt.of(leader.row) for leader in leaders) if j is not None]
    if not errors:
        return ""
    return f". Its tilt error is {errors[0].text}" if len(errors) == 1 else f". Their tilt errors are {values(errors)}"


def gyro_part(lead: ColumnRanking) -> str:
    """What the gyro itself wanders by, as a sentence after a blank, where a row adds less; else empty."""
    own = gyro_wander(lead)
    return own and f" The gyro's own noise is about {own}."


def gyro_wander(found: ColumnRanking) -> str:
    """What the gyro itself wanders by, where a row adds less and rows below it share a rank; else empty."""
    share = max((j.answer.gyro_share for j in found.ranked), default=0.0)
    return quantity(float(f"{share:.1g}"), "deg") if any(j.value < share for j in found.ranked) else ""


def clause(found: ColumnRanking) -> str:
    """Another phase in few words; all but rest, which leads where it is ranked, tell what is added."""
    if len(found.ranked) == 1:
        return f"{found.ranked[0].name} adds {found.ranked[0].text}"
    if not found.best:
        return f"no significant difference, {values(found.ranked, named=False)} added"
    adds = "adds" if len(found.best) == 1 else "add"
    own = gyro_wander(found)
    beside = f" (the gyro's own noise is about {own})" if own and len(found.best) > 1 else ""
    return f"{some(found.best, found)} {adds} least, {values(found.best)}{beside}"


def notes(shown: list[ColumnRanking]) -> list[str]:
    """How much of each phase was measured."""
    return [
        f"{WHERE[found.window][0].upper()}{WHERE[found.window][1:]}: "
        f"{count(max(j.answer.n for j in found.filters), 'window')} of 5 s."
        for found in shown
    ]
