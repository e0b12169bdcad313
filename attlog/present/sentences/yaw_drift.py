"""How fast does the heading drift? At rest against standing still, in the air against one heading reference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from attlog.present.contest import ColumnRanking, RankedValue, contest
from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.names import NOT_JUDGED, against_heading
from attlog.present.numbers import below, duration, listed, moment, quantity
from attlog.present.numbers import counted as count
from attlog.present.sentences.reasons import cannot, commonest, switch, undetermined, why_not
from attlog.present.sentences.words import NAMED, bars, bound, counted, left_out, onboard_part, some, values
from attlog.present.table.rows import AIR, REST
from attlog.present.text import typeset
from attlog.result import Result, Verdict

DRIFT_REST = "drift_rest_deg_per_min"
BOUNDS_DIFFER = 3.0
EXCLUDES_NOTHING = 15.0
"""deg/min: the bias of a warm gyro that nobody calibrated, 0.25 deg/s, turns by as much. A larger bound is no news."""
SITUATIONS = ("at rest", "in the air")
"""Where the heading may drift; reasons of this question start with it."""


def yaw_drift_verdict(result: Result) -> Verdict:
    """The verdict on heading drift: significant where the interval excludes zero, else bounded by its larger end."""
    reference = quoted_heading_reference(result)
    rest = contest(result, DRIFT_REST, REST)
    air = contest(result, f"{DRIFT_AIR}.{reference}", AIR)
    shown = rest if rest.ranked or not air.filters else air
    reasons = [
        (name, reason if found is shown and has_value(found, name) else f"{where}, {reason}")
        for where, found in zip(SITUATIONS, (rest, air), strict=True)
        for name, reason in left_out(found)
        if found is shown or not has_value(found, name)
    ]
    return Verdict(
        "yaw_drift",
        "Yaw drift",
        says(result, rest, air, reference),
        shown.metric,
        shown.window,
        bars(shown),
        reasons,
        notes(result, rest),
    )


def has_value(found: ColumnRanking, name: str) -> bool:
    """Whether the row of this id has a value."""
    return any(j.row.name == name for j in found.judged)


def says(result: Result, rest: ColumnRanking, air: ColumnRanking, reference: str) -> str:
    """A sentence for each situation that can be determined, else why none can."""
    in_air = f"In the air against {against_heading(result, reference)}"
    said = [
        drift_part(found, where) for found, where in ((rest, "At rest"), (air, in_air)) if found.ranked or found.filters
    ]
    if said:
        return " ".join(said)
    if rest.absent and air.absent:
        (code, why_rest), (_, why_air) = commonest(rest.absent), commonest(air.absent)
        return f"Cannot be judged. At rest: {why_rest}.{switch(result, code)} In the air: {why_air}."
    return cannot(result, rest.absent + air.absent, "neither a rest nor a flight is long enough")


def drift_part(found: ColumnRanking, where: str) -> str:
    """One situation: who drifts, below which bound the others stay, whose rests disagree, who lost its way."""
    significant = [j for j in found.ranked if j.significant][::-1]
    still = [j for j in found.ranked if not j.significant]
    parts = [drifts(found, significant)] if significant else []
    if still:
        who = f"{len(still)} filters" if len(still) > 2 else listed([j.name for j in still])
        parts.append(f"no significant drift of {who}: {bounds(still)}")
    least = {j.row.name for j in found.best}
    if significant and 0 < len(least) <= NAMED and least != {j.row.name for j in still}:
        parts.append(f"least: {some(found.best, found)}")
    disagree = [j for j in found.filters if j.row.status == "ok" and j.answer.disagree is not None]
    if disagree:
        parts.append(f"the rests disagree for {counted([j.name for j in disagree])}: {spread(disagree)}")
    others = [j for j in found.filters if not j.ranked and j not in disagree and j.row.status == "ok"]
    if others:
        parts.append(f"{counted([j.name for j in others])} {'is' if len(others) == 1 else 'are'} not ranked")
    parts += [unsure] if (unsure := undetermined(found)) else []
    parts += last_named([j for j in found.filters if j.row.status not in ("ok", "not_judged")])
    if not parts:
        parts = [f"no filter can be ranked: {why_not(found)}"]
    text = ". ".join([f"{where}, {parts[0]}", *(part[:1].upper() + part[1:] for part in parts[1:])])
    return f"{text}.{onboard_part(found, interval=True)}"


def drifts(found: ColumnRanking, significant: list[RankedValue]) -> str:
    """Rows with significant drift, the fastest first; "most" only for the row that the ranking finds worst."""
    most, others = significant[0], significant[1:]
    if not others:
        return f"{most.name} drifts {most.text}{most.interval}{changing(most)}"
    if found.worst is not None and found.worst.row.name == most.row.name:
        text = f"{most.name} drifts most: {most.text}{most.interval}{changing(most)}"
        return f"{text}; {some(others, found)} {values(others[::-1])}"
    return f"{some(significant, found)} drift: {values(significant)}"


def bounds(still: list[RankedValue]) -> str:
    """What these drifts stay below, a range where the bounds differ much; what is possible where that says nothing."""
    ends = sorted(max(map(abs, j.ends)) for j in still)
    if ends[-1] > EXCLUDES_NOTHING:
        return f"up to {bound(still)} possible"
    if ends[-1] <= BOUNDS_DIFFER * ends[0]:
        return f"less than {bound(still)}"
    return f"less than {below(ends[0], 'deg/min')} to {below(ends[-1], 'deg/min')}"


def changing(judged: RankedValue) -> str:
    """That the rate itself rises or falls."""
    change = judged.answer.changes
    return f" (the rate itself changes from {signed(change[0])} to {signed(change[1])})" if change else ""


def signed(value: float) -> str:
    """A drift with sign and unit."""
    return quantity(value, "deg/min")


def spread(judged: list[RankedValue]) -> str:
    """The range over rests that do not agree."""
    ranges = [j.answer.disagree for j in judged if j.answer.disagree is not None]
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    return f"{signed(low)} to {signed(high)}"


def last_named(judged: list[RankedValue]) -> list[str]:
    """Rows that lost their way: their drift is named, after all others."""
    return [f"{j.name}, which {NOT_JUDGED.get(j.row.status, 'failed')}, {j.text}{j.interval}" for j in judged[:2]] + (
        [f"{count(len(judged) - 2, 'more filter')} lost the way"] if len(judged) > 2 else []
    )


def notes(result: Result, rest: ColumnRanking) -> list[str]:
    """Every rest with its time, what of it could be used, and what it says for one row; the earth's own turn."""
    rows = [j.answer for j in rest.filters] or [
        a.row.metrics[rest.window][rest.metric] for a in rest.absent if a.row.kind == "replay"
    ]
    if not rows:
        return []
    said = [f"Rest from {moment(r.t0)} to {moment(r.t1)}: {usable(r.usable_s, r.reason)}." for r in rows[0].records]
    turn = turned(result.log.get("place") or {})
    return said + ([turn] if turn else [])


def usable(seconds: float, reason: str | None) -> str:
    """How much of a rest counts."""
    return typeset(reason) if reason else f"{duration(seconds)} usable"


def turned(place: Mapping[str, Any]) -> str:
    """How fast the earth turns the heading of a perfect gyro."""
    turn = place.get("earth_turn_deg_per_min")
    return f"The earth itself turns by {quantity(turn, 'deg/min')} here." if turn is not None else ""
