"""How a column is put into words: who leads, who is last, who flew; by what the ranking found and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.contest import Contest, Judged, why_unranked
from attlog.present.names import NOT_JUDGED, name_in_sentence
from attlog.present.numbers import below, listed
from attlog.present.rows import is_baseline
from attlog.present.text import typeset
from attlog.result import EstimatorRow, Result

NAMED = 3
"""So many rows are named in a sentence; more are counted."""

LOST = ("diverged", "not_converged", "failed")


@dataclass(frozen=True, slots=True)
class Words:
    """The words of a question: verb phrases for one and several rows, and the rest of the sentence.

    ``one`` and ``several`` follow names ("wanders least", "wander least"), ``last`` follows
    the name of the worst row, ``alone`` the only row that could be compared, ``close``
    follows how many are too close to rank.
    """

    one: str
    several: str
    last: str
    alone: str
    close: str


def leading(found: Contest, words: Words, where: str = "") -> str:
    """Who leads, with value and interval; ``where`` follows the value. No full stop at the end."""
    ranked, best = found.ranked, found.best
    if len(ranked) == 1:
        return f"{ranked[0].name} {words.alone}{ranked[0].text}{ranked[0].interval}{where}"
    if len(best) == 1:
        return f"{best[0].name} {words.one}: {best[0].text}{best[0].interval}{where}"
    if best:
        names = some(best, len(ranked))
        return f"{names} {words.several}, not told apart: {values(best)}{where}"
    who = "Both filters are" if len(ranked) == 2 else f"All {len(ranked)} filters are"
    return f"{who} {words.close}, too close to rank: {values(ranked)}{where}"


def last(found: Contest, words: Words) -> str:
    """Who is worst, as a sentence after a blank; empty where nobody is told to be."""
    return f" {found.worst.name} {words.last}: {found.worst.text}{found.worst.interval}." if found.worst else ""


def values(judged: list[Judged]) -> str:
    """The values of rows in the order of their names; the ends of the range where they are only counted."""
    if len(judged) <= NAMED:
        return listed([j.text for j in judged])
    low, high = judged[0], judged[-1]
    return low.text if low.text == high.text else f"{low.text} to {high.text}"


def some(judged: list[Judged], of: int) -> str:
    """Up to NAMED rows by name, more as a count."""
    names = [j.name for j in judged]
    return listed(names) if len(names) <= NAMED else f"{len(names)} of {of} filters"


def counted(names: list[str]) -> str:
    """Up to NAMED filters by name, more as a count."""
    return listed(names) if len(names) <= NAMED else f"{len(names)} filters"


def lost(result: Result) -> list[EstimatorRow]:
    """Filters that diverged, did not settle or failed; the baseline is none of them."""
    return [r for r in result.estimators if r.kind == "replay" and r.status in LOST and not is_baseline(r)]


def lost_part(rows: list[EstimatorRow]) -> str:
    """Which filters lost their way, and how: ``Mahony Xu 0.6 diverged``; a row whose values are no numbers says so."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        groups.setdefault(NOT_JUDGED[row.status], []).append(name_in_sentence(row))
    return ", ".join(f"{counted(names)} {state}" for state, names in groups.items())


def left_out(found: Contest) -> list[tuple[str, str]]:
    """Rows (by id) without a value or whose value is not ranked, each with its reason, in a card's details."""
    unranked = [(j.row.name, typeset(why_unranked(j))) for j in found.judged if j.replay and not j.ranked]
    absent = [(a.row.name, typeset(why_absent(a.row, a.reason))) for a in found.absent]
    return absent + unranked


def why_absent(row: EstimatorRow, reason: str) -> str:
    """Why a row has no value: what the row itself is said to suffer from comes before what it is missing."""
    return row.reason if row.kind == "replay" and row.status in LOST and row.reason else reason


def bars(found: Contest) -> list[tuple[str, float, str]]:
    """What the card draws, the smallest size first, lost rows last: (row id, value, unit)."""
    shown = sorted((j for j in found.judged if j.shown), key=lambda j: j.row.status != "ok")
    return [(j.row.name, j.value, j.answer.unit) for j in shown]


def onboard_part(found: Contest, *, interval: bool = False) -> str:
    """What the attitude that flew did, as a short last sentence; empty where all were compared with it."""
    flew = found.onboard
    return f" Onboard: {flew.text}{flew.interval if interval else ''}." if flew is not None else ""


def bound(judged: list[Judged]) -> str:
    """What all these rows stay below: the largest end of their intervals, never less."""
    return below(max(abs(end) for j in judged for end in j.ends), judged[0].answer.unit)
