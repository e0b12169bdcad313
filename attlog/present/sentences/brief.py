"""The four answers in a line each, for a terminal: what the table shows in numbers, and what is significant.

They come from the same ranking as the sentences, which say more: intervals, other phases, who is not ranked and why.
"""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.contest import ColumnRanking, RankedValue, contest
from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.names import against_heading
from attlog.present.numbers import counted
from attlog.present.sentences.accuracy import TILT
from attlog.present.sentences.lag import LAG, late_imu, zero_below
from attlog.present.sentences.noise import NOISE, WHERE
from attlog.present.sentences.reasons import commonest, why_not
from attlog.present.sentences.spoiled import SPOILING, spoiling
from attlog.present.sentences.words import bound, values
from attlog.present.sentences.yaw_drift import DRIFT_REST
from attlog.present.table.rows import AIR, PHASES, REST
from attlog.result import Result

NONE = "no filter was run"


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


def brief_answers(result: Result) -> dict[str, BriefAnswer]:
    """Question -> its answer in few words, in the order of the page; where sensors spoil it, that comes first."""
    found = {
        "accuracy": _accuracy(result),
        "noise": _noise(result),
        "lag": _lag(result, contest(result, LAG, AIR)),
        "yaw_drift": _yaw_drift(result),
    }
    check = spoiling(result)
    if check is None:
        return found
    doubt = f"Unreliable, {SPOILING[check.name]}: "
    return {q: BriefAnswer(doubt + answer.text, answer.column) for q, answer in found.items()}


def _accuracy(result: Result) -> BriefAnswer:
    tilt = contest(result, TILT, AIR)
    if not tilt.ranked:
        return _unranked(tilt, "tilt ")
    return BriefAnswer(f"Tilt: {_compared(tilt)}.", tilt, _onboard(tilt))


def _noise(result: Result) -> BriefAnswer:
    phases = [contest(result, NOISE, (phase,)) for phase in PHASES]
    lead = next((found for found in phases if found.ranked), next((f for f in phases if f.filters), phases[0]))
    if not lead.ranked:
        return _unranked(lead)
    where = WHERE[lead.window] if lead.window == "rest" else f"added {WHERE[lead.window]}:"
    return BriefAnswer(f"{where[0].upper()}{where[1:]} {_compared(lead)}.", lead, _onboard(lead))


def _lag(result: Result, lag: ColumnRanking) -> BriefAnswer:
    """Which lags are measurable, the largest first, and below which bound all others are."""
    if not lag.ranked:
        return _unranked(lag)
    moved = [j for j in lag.ranked if j.significant and abs(j.value) > zero_below(j)][::-1]
    rest = [j for j in lag.ranked if j not in moved]
    steps = counted(max(j.answer.n for j in lag.ranked), "step")
    text = _significant(moved, rest)
    return BriefAnswer(f"{text[0].upper()}{text[1:]} ({steps}).{late_imu(result)}", lag, _onboard(lag))


def _yaw_drift(result: Result) -> BriefAnswer:
    """Drift at rest, where filters were compared there, else in the air."""
    rest = contest(result, DRIFT_REST, REST)
    air = contest(result, f"{DRIFT_AIR}.{quoted_heading_reference(result)}", AIR)
    where, found = ("At rest", rest) if rest.ranked or not air.ranked else ("In flight", air)
    if not found.ranked:
        return _unranked(rest if rest.filters or not air.filters else air)
    drifting = [j for j in found.ranked if j.significant][::-1]
    still = [j for j in found.ranked if not j.significant]
    against = against_heading(result, quoted_heading_reference(result)) if found is air else ""
    where += f" against {against}:" if "in doubt" in against else ""
    return BriefAnswer(f"{where} {_significant(drifting, still)}.", found, _onboard(found))


def _compared(found: ColumnRanking) -> str:
    """The rows that none is significantly better than, then all others."""
    ranked, best = found.ranked, found.best
    if len(ranked) == 1:
        return f"{ranked[0].name} {ranked[0].text}{ranked[0].interval}"
    if not best:
        return f"all {len(ranked)} filters {values(ranked, named=False)} (not significant)"
    others = [j for j in ranked if j not in best]
    leaders = f"{best[0].name} {best[0].text}" if len(best) == 1 else f"{_span(best)} (not significant)"
    rest = f"{others[0].name} {others[0].text}" if len(others) == 1 else f"others {values(others, named=False)}"
    return f"{leaders}, {rest}" if others else leaders


def _significant(beyond: list[RankedValue], still: list[RankedValue]) -> str:
    """Rows whose value is significant, and what all others stay below."""
    parts = [_span(beyond)] if beyond else []
    if still:
        who = still[0].name if len(still) == 1 else f"{'' if beyond else 'all '}{len(still)} filters"
        parts.append(f"{who} below {bound(still)}")
    return "; ".join(parts)


def _span(judged: list[RankedValue]) -> str:
    """One row with its value, of more their number and range."""
    if len(judged) == 1:
        return f"{judged[0].name} {judged[0].text}"
    ends = sorted(judged, key=lambda j: j.value)
    return f"{len(judged)} filters {ends[0].text} to {ends[-1].text}"


def _onboard(found: ColumnRanking) -> str:
    """The value of the onboard attitude, unless all were compared with it."""
    return f"Onboard {found.onboard.text}." if found.onboard is not None else ""


def _unranked(found: ColumnRanking, what: str = "") -> BriefAnswer:
    """Why filters were not compared, and what they show all the same."""
    sound = [j for j in found.filters if j.row.status == "ok"]
    if sound:
        return BriefAnswer(f"Not ranked: {what}{values(sound, named=False)}.", found, _onboard(found))
    why = why_not(found) if found.filters else commonest(found.absent)[1] or NONE
    return BriefAnswer(f"Cannot be determined: {why.partition(';')[0]}.", found, _onboard(found))
