"""How fast does the heading drift? At rest against standing still, in the air against one heading reference."""

from __future__ import annotations

from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.names import NOT_JUDGED, against_heading
from attlog.present.numbers import quantity
from attlog.present.rows import AIR, REST, find
from attlog.present.sentences.judged import Absent, Judged, bars, counted, onboard_part, some, split, unranked
from attlog.present.sentences.reasons import cannot, commonest, switch
from attlog.result import Result, Verdict

SITUATIONS = ("at rest", "in the air")
"""Where the heading may drift; reasons of this question start with it."""

LOST = ("diverged", "not_converged", "failed", "not_judged")


def drifting(result: Result) -> Verdict:
    """The verdict on heading drift; an interval across zero is "none told, less than X", never "no drift"."""
    reference = quoted_heading_reference(result)
    rest, rest_without = split([(row, find(row, "drift_rest_deg_per_min", REST)) for row in result.estimators])
    air, air_without = split([(row, find(row, f"{DRIFT_AIR}.{reference}", AIR)) for row in result.estimators])
    shown = rest if any(j.ranked for j in rest) or not air else air
    others = [
        (a.row.name, f"{where}, {a.reason}")
        for where, part in zip(SITUATIONS, (rest_without, air_without), strict=True)
        for a in part
    ]
    return Verdict(
        "drifting",
        "How fast does the heading drift?",
        says(result, rest, air, rest_without, air_without),
        "drift_rest_deg_per_min" if shown is rest else f"{DRIFT_AIR}.{reference}",
        shown[0].answer.window if shown else "rest",
        bars(shown, "deg/min"),
        others + unranked(shown),
    )


def says(
    result: Result, rest: list[Judged], air: list[Judged], rest_without: list[Absent], air_without: list[Absent]
) -> str:
    """A sentence for each situation that can be told, else why none can."""
    in_air = f"In the air against {against_heading(quoted_heading_reference(result))}"
    both = any(j.ranked for j in rest) and any(j.ranked for j in air)
    said = [p for p in (drift_part(rest, "At rest", both), drift_part(air, in_air, both)) if p]
    if said:
        return " ".join(said)
    at_rest = bool(rest) and not air
    shown, where = (rest, "At rest") if at_rest else (air, in_air)
    replayed = [j for j in shown if j.replay]
    if replayed:
        return f"{where}, {unranked_part(replayed)}." + onboard_part(shown, "deg/min")
    if rest_without and air_without:
        (code, why_rest), (_, why_air) = commonest(rest_without), commonest(air_without)
        return f"Cannot be judged. At rest: {why_rest}.{switch(result, code)} In the air: {why_air}."
    nothing = "neither a rest nor a flight is long enough"
    return cannot(result, rest_without + air_without, nothing)


def drift_part(judged: list[Judged], where: str, brief: bool) -> str:
    """One sentence on drift in one situation, ``brief`` on what cannot be told; empty where nothing may be ranked."""
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: abs(j.value))
    if not ranked:
        return ""
    drifts = [j for j in ranked if not (j.answer.ci95 and j.answer.ci95[0] <= 0 <= j.answer.ci95[1])]
    still = [j for j in ranked if j not in drifts]
    if not drifts:
        who = f"of {ranked[0].name}" if len(ranked) == 1 else f"of any of {len(ranked)} filters"
        says = f"{where}, no drift {who} is told: less than {bound(ranked)}"
    else:
        worst = drifts[-1]
        says = f"{where}, {worst.name} drifts {'most: ' if len(ranked) > 1 else ''}"
        says += f"{quantity(worst.value, 'deg/min')}{worst.interval}"
        if still:
            says += f"; none told of {some(still, len(ranked))}: less than {bound(still)}"
        elif len(ranked) > 1:
            says += f"; least: {drifts[0].name}, {quantity(drifts[0].value, 'deg/min')}{drifts[0].interval}"
    return says + untold(judged, brief) + "." + onboard_part(judged, "deg/min")


def untold(judged: list[Judged], brief: bool) -> str:
    """Whose drift cannot be told beside those that can."""
    unsure = [j.name for j in judged if j.replay and j.row.status == "ok" and not j.ranked]
    lost = [j for j in judged if j.replay and j.row.status != "ok"]
    if brief:
        names = unsure + [j.name for j in lost]
        return f"; {counted(names)} cannot be judged" if names else ""
    judged_not = f"; {counted(unsure)} cannot be judged" if unsure else ""
    return judged_not + (f"; {lost_part(lost)}" if lost else "")


def bound(judged: list[Judged]) -> str:
    """What the drifts of all these rows stay below: the largest end of their intervals."""
    ends = [abs(end) for j in judged for end in (j.answer.ci95 or (j.value, j.value))]
    return quantity(max(ends), "deg/min", signed=False)


def unranked_part(replayed: list[Judged]) -> str:
    """Why no filter's drift is compared: rests that disagree, or filters that lost their way."""
    ranges = [j.answer.detail["range"] for j in replayed if j.row.status == "ok" and "range" in j.answer.detail]
    if ranges:
        low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
        return f"the rests disagree: drifts from {quantity(low, 'deg/min')} to {quantity(high, 'deg/min')}"
    lost = lost_part([j for j in replayed if j.row.status != "ok"])
    return "no filter's drift can be ranked" + (f": {lost}" if lost else "")


def lost_part(judged: list[Judged]) -> str:
    """Which filters lost their way, and how."""
    states = {state: [j.name for j in judged if j.row.status == state] for state in LOST}
    return ", ".join(f"{counted(names)} {NOT_JUDGED[state]}" for state, names in states.items() if names)
