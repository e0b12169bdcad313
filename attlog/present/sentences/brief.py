"""The four answers in a line each, for a terminal: what the table shows in numbers, and what is significant.

They come from the same ranking as the sentences, which say more: intervals, other phases, who is not ranked and why.
"""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.contest import ColumnRanking, RankedValue, contest, why_unranked
from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.names import NOT_JUDGED, against_heading
from attlog.present.numbers import between, counted, listed, quantity
from attlog.present.sentences.accuracy import TILT
from attlog.present.sentences.lag import LAG, late_imu, zero_below
from attlog.present.sentences.noise import NOISE, WHERE
from attlog.present.sentences.reasons import commonest, why_not
from attlog.present.sentences.spoiled import SPOILING, spoiling
from attlog.present.sentences.words import bound
from attlog.present.sentences.yaw_drift import DRIFT_REST, EXCLUDES_NOTHING
from attlog.present.table.rows import AIR, PHASES, REST, is_baseline
from attlog.present.text import typeset
from attlog.result import Result

NONE = "no filter was run"
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
        "lag": _lag(result, contest(result, LAG, AIR)),
        "yaw_drift": _yaw_drift(result),
    }
    check = spoiling(result)
    if check is None:
        return found
    return {
        q: answer if answer.text.startswith(NO_ANSWER) else answer.led(f"Unreliable, {SPOILING[check.name]}: ")
        for q, answer in found.items()
    }


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
    flew = result.reference is not None and result.reference.choice == "onboard"
    if flew and not rest and all(j.value < 0.0 for j in moved):
        least, most = (quantity(-j.value, "ms", signed=False) for j in (moved[-1], moved[0]))
        text = f"{_who(moved, lag)} {between(least, most)} ahead of onboard"
    else:
        text = _significant(moved, rest, lag)
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
    text = _significant(drifting, still, found)
    if still and max(abs(end) for j in still for end in j.ends) > EXCLUDES_NOTHING:
        possible = f"up to {bound(still)}"
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
    return "; ".join([*parts, f"{_who(still, found)} below {bound(still)}"] if still else parts)


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


def _onboard(found: ColumnRanking) -> str:
    """The value of the onboard attitude, unless all were compared with it."""
    return f"Onboard {found.onboard.text}." if found.onboard is not None else ""


def _onboard_drift(found: ColumnRanking) -> str:
    """The drift of the onboard attitude where it is significant, else what it stays below; nothing where that is
    anything."""
    flew = found.onboard
    if flew is None or flew.significant:
        return _onboard(found)
    return "" if max(map(abs, flew.ends)) > EXCLUDES_NOTHING else f"Onboard below {bound([flew])}."


def _unranked(found: ColumnRanking, what: str = "") -> BriefAnswer:
    """Why filters were not compared, and what they show all the same."""
    sound = [j for j in found.filters if j.row.status == "ok"]
    if sound:
        why = typeset(why_unranked(sound[0])).partition(":")[0].removesuffix(" to rank")
        lost = [j.name for j in found.filters if j.row.status == "diverged"]
        gone = f"; {listed(lost) if len(lost) <= 2 else f'{len(lost)} filters'} diverged" if lost else ""
        return BriefAnswer(f"Not ranked ({why}): {what}{_range(sound)}{gone}.", found, _onboard(found))
    rows = [j.row for j in found.filters] + [a.row for a in found.absent if a.row.kind == "replay"]
    rows = [row for row in rows if not is_baseline(row)]
    if len(rows) == found.total > 1 and rows[0].status != "ok" and all(row.status == rows[0].status for row in rows):
        why = typeset(rows[0].reason) if rows[0].status == "not_judged" else ""
        return BriefAnswer(f"{NO_ANSWER}{why or f'all {len(rows)} filters {NOT_JUDGED[rows[0].status]}'}.", found)
    why = why_not(found) if found.filters else commonest(found.absent)[1] or NONE
    return BriefAnswer(f"{NO_ANSWER}{why.partition(';')[0]}.", found, _onboard(found))
