"""How a column is put into words: who leads, who is last, who flew; by what the ranking found and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.contest import ColumnRanking, RankedValue, why_unranked
from attlog.present.names import NOT_JUDGED, name_in_sentence
from attlog.present.numbers import below, between, listed
from attlog.present.table.rows import is_baseline
from attlog.present.text import typeset
from attlog.result import EstimatorRow, Result

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
        return f"{ranked[0].name} {words.alone}: {single(ranked[0], unit)}{where}"
    if len(best) == 1:
        return f"{best[0].name} {words.one}: {single(best[0], unit)}{where}"
    noted = f" ({unit})" if unit else ""
    if best:
        return f"{some(best, found)} {words.several}: {values(best)}{noted}{where} (not significant)"
    return f"No significant difference{words.close}: {values(ranked, named=False)}{noted}{where}"


def single(judged: RankedValue, unit: str = "") -> str:
    """One value with its interval, and in the same brackets what the number is."""
    brackets = "; ".join(x for x in (unit, judged.interval.strip(" ()")) if x)
    return f"{judged.text} ({brackets})" if brackets else judged.text


def last(found: ColumnRanking, words: QuestionWords) -> str:
    """Who is worst, as a sentence after a blank; empty where nobody significantly is."""
    return f" {found.worst.name} {words.last}: {found.worst.text}{found.worst.interval}." if found.worst else ""


def values(judged: list[RankedValue], *, named: bool = True) -> str:
    """The values of rows in the order of their names; the ends of the range where they are only counted."""
    if len(judged) <= NAMED and (named or len(judged) == 2):
        return listed([j.text for j in judged])
    ends = sorted(judged, key=lambda j: j.size)
    return between(ends[0].text, ends[-1].text)


def some(judged: list[RankedValue], found: ColumnRanking) -> str:
    """Up to NAMED of the rows that were compared by name, more as a count."""
    names = [j.name for j in judged]
    if len(names) <= NAMED:
        return listed(names)
    return f"All {found.compared}" if len(names) == len(found.ranked) else f"{len(names)} of {found.compared}"


def counted(names: list[str]) -> str:
    """Up to NAMED filters by name, more as a count."""
    return listed(names) if len(names) <= NAMED else f"{len(names)} filters"


def lost(result: Result) -> list[EstimatorRow]:
    """Filters that diverged, did not settle or failed; the baseline is none of them."""
    return [r for r in result.estimators if r.kind == "replay" and r.status in LOST and not is_baseline(r)]


def lost_part(rows: list[EstimatorRow]) -> str:
    """Which filters lost their way, and how: ``Mahony Xu 0.6 diverged``, ``Mine returned NaN from 0.0 s on``."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        how = row.reason if row.status == "failed" and row.reason else NOT_JUDGED[row.status]
        groups.setdefault(typeset(how), []).append(name_in_sentence(row))
    return ", ".join(f"{counted(names)} {state}" for state, names in groups.items())


def left_out(found: ColumnRanking) -> list[tuple[str, str]]:
    """Rows (by id) without a value or whose value is not ranked, each with its reason, in a card's details."""
    unranked = [(j.row.name, typeset(why_unranked(j))) for j in found.judged if j.replay and not j.ranked]
    absent = [(a.row.name, typeset(why_absent(a.row, a.reason))) for a in found.absent]
    return absent + unranked


def why_absent(row: EstimatorRow, reason: str) -> str:
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


def bound(judged: list[RankedValue]) -> str:
    """What all these rows stay below: the largest end of their intervals, never less."""
    return below(max(abs(end) for j in judged for end in j.ends), judged[0].answer.unit)
