"""How fast does the heading drift? At rest against standing still, in the air against the best heading reference."""

from __future__ import annotations

from attlog.present.heading import DRIFT_AIR, best_heading_reference
from attlog.present.names import NOT_JUDGED, against_heading
from attlog.present.numbers import quantity
from attlog.present.rows import AIR, REST, find
from attlog.present.sentences.judged import Absent, Judged, bars, counted, onboard_part, some, split, unranked
from attlog.present.sentences.reasons import cannot, commonest, switch
from attlog.result import Result, Verdict

SITUATIONS = ("at rest", "in the air")
"""Where the heading may drift; reasons of this question start with it."""

LOST = ("diverged", "not_converged", "failed")


def drifting(result: Result) -> Verdict:
    """The verdict on heading drift; an interval across zero is "none that differs from zero", never "no drift"."""
    reference = best_heading_reference(result)
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
    in_air = f"In the air against {against_heading(best_heading_reference(result))}"
    both = any(j.ranked for j in rest) and any(j.ranked for j in air)
    said = [p for p in (drift_part(rest, "At rest", both), drift_part(air, in_air, both)) if p]
    if said:
        return " ".join(said)
    at_rest = bool(rest) and not air
    shown, where = (rest, "At rest") if at_rest else (air, in_air)
    replayed = [j for j in shown if j.replay]
    if replayed:
        return f"{where}, {wander_part(replayed, at_rest)}." + onboard_part(shown, "deg/min")
    if rest_without and air_without:
        (code, why_rest), (_, why_air) = commonest(rest_without), commonest(air_without)
        return f"Cannot be judged. At rest: {why_rest}.{switch(result, code)} In the air: {why_air}."
    nothing = "neither a rest nor a flight is long enough to tell a drift from wander"
    return cannot(result, rest_without + air_without, nothing)


def drift_part(judged: list[Judged], where: str, brief: bool) -> str:
    """One sentence on drift in one situation, ``brief`` on what cannot be told; empty where nothing may be ranked."""
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: abs(j.value))
    if not ranked:
        return ""
    drifts = [j for j in ranked if not (j.answer.ci95 and j.answer.ci95[0] <= 0 <= j.answer.ci95[1])]
    still = [j for j in ranked if j not in drifts]
    if not drifts:
        who = f"{ranked[0].name} shows no" if len(ranked) == 1 else f"none of {len(ranked)} filters shows a"
        says = f"{where}, {who} drift that differs from zero (at most {quantity(ranked[-1].value, 'deg/min')})"
    else:
        worst = drifts[-1]
        says = f"{where}, {worst.name} drifts {'most: ' if len(ranked) > 1 else ''}"
        says += f"{quantity(worst.value, 'deg/min')}{worst.interval}"
        if still:
            says += f"; {some(still, len(ranked))} {'shows' if len(still) == 1 else 'show'} none that differs from zero"
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
    wander = f"; {counted(unsure)} wander{'s' if len(unsure) == 1 else ''} too much to tell a drift" if unsure else ""
    return wander + (f"; {lost_part(lost)}" if lost else "")


def wander_part(replayed: list[Judged], at_rest: bool) -> str:
    """Why no filter's drift can be told, and what would help."""
    lost = [j for j in replayed if j.row.status != "ok"]
    halves = [0.5 * (j.answer.ci95[1] - j.answer.ci95[0]) for j in replayed if j.answer.ci95 and j.row.status == "ok"]
    if not halves:
        return f"no filter's drift can be ranked: {lost_part(lost)}"
    surest = quantity(min(halves), "deg/min", signed=False)
    says = f"no filter's drift can be told from its wander: the surest is known to ±{surest}"
    says += f"; a longer {'rest' if at_rest else 'flight'} would narrow it"
    return says + (f". {lost_part(lost)}" if lost else "")


def lost_part(judged: list[Judged]) -> str:
    """Which filters lost their way, and how."""
    states = {state: [j.name for j in judged if j.row.status == state] for state in LOST}
    return ", ".join(f"{counted(names)} {NOT_JUDGED[state]}" for state, names in states.items() if names)
