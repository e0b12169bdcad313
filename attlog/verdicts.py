"""The three answers in plain sentences: how quiet at rest, how late in a step, how fast does the heading drift.

Sentences are made by rule from the answers of a Result, never by hand: first the
answer, then the number, then who is worst and by what factor, then the onboard
attitude. What may not be ranked is never named as best, and an interval across
zero reads "no drift that differs from zero", never "no drift".
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from attlog.metrics.answer import Answer
from attlog.numbers import duration, interval, listed, quantity
from attlog.result import EstimatorRow, Result, Verdict

REST = ("rest", "rest.long", "all")
AIR = ("airborne", "all", "armed")
WITNESSES = ("truth", "smoother", "onboard", "gnss_yaw", "mag", "course")
"""The order in which a heading witness in the air is believed."""

NAMED = 3
"""So many rows are named in a sentence; more are counted."""


@dataclass(slots=True)
class Judged:
    """One row with the answer that counts for a question."""

    row: EstimatorRow
    answer: Answer

    @property
    def value(self) -> float:
        """The value; only asked where there is one."""
        return float(self.answer.value)  # type: ignore[arg-type]

    @property
    def ranked(self) -> bool:
        """Whether this row may be called best or worst."""
        return self.row.kind == "replay" and self.answer.ranked and self.row.status == "ok"

    @property
    def shown(self) -> bool:
        """Whether the card has a bar for it: filters and what flew; other onboard rows stand in the table."""
        return self.row.kind == "replay" or self.row.name == "onboard"

    @property
    def interval(self) -> str:
        """The interval in brackets with a blank before it; empty where there is none."""
        text = interval(self.answer.ci95, self.answer.unit)
        return f" ({text})" if text else ""


def verdicts(result: Result) -> list[Verdict]:
    """The three verdicts of a result, in the order quiet, late, drifting; always all three."""
    return [quiet(result), late(result), drifting(result)]


def find(row: EstimatorRow, metric: str, windows: tuple[str, ...]) -> Answer | None:
    """The row's answer in the first of the windows that has it, one with a value preferred."""
    answers = [row.metrics[w][metric] for w in windows if metric in row.metrics.get(w, {})]
    return next((a for a in answers if a.value is not None), answers[0] if answers else None)


def split(rows: list[tuple[EstimatorRow, Answer | None]]) -> tuple[list[Judged], list[tuple[str, str, str]]]:
    """Rows with a value, and (row, code, reason) of the others."""
    with_value = [Judged(r, a) for r, a in rows if a is not None and a.value is not None and math.isfinite(a.value)]
    without = [(r.name, a.code or "", a.reason or "") for r, a in rows if a is not None and a.value is None]
    return with_value, without


def unranked(judged: list[Judged]) -> list[tuple[str, str]]:
    """Replayed rows whose value is shown but not ranked, each with its reason."""
    return [
        (j.row.name, j.answer.reason or j.row.reason or f"is {j.row.status.replace('_', ' ')}")
        for j in judged
        if j.row.kind == "replay" and not j.ranked
    ]


def cannot(without: list[tuple[str, str, str]], nothing: str) -> str:
    """The sentence for a question that no row answers: the commonest reason."""
    return f"Cannot be judged: {commonest(without) or nothing}."


def commonest(without: list[tuple[str, str, str]]) -> str:
    """The reason that most rows give, rows to which the question does not apply only if there are no others."""
    reasons = Counter(reason for _, code, reason in without if reason and code != "not_applicable")
    reasons = reasons or Counter(reason for _, _, reason in without if reason)
    if not reasons:
        return ""
    reason = reasons.most_common(1)[0][0].rstrip(".")
    return reason[0].lower() + reason[1:] if reason[:2].istitle() else reason


def why_not(result: Result, verdict: Verdict) -> str:
    """Who is not judged and why in few words, rows with the same reason together."""
    groups: dict[str, list[str]] = {}
    rows = {r.name: r for r in result.estimators if r.kind == "replay"}
    for name, reason in verdict.not_judged:
        if name in rows:
            row = rows[name]
            bent = any(
                a.code == "bent" for m in row.metrics.values() for a in (m.get(verdict.metric),) if a is not None
            )
            short = "does not follow the movement" if bent else reason.partition(":")[0].partition(";")[0]
            groups.setdefault(row.status.replace("_", " ") if row.status != "ok" else short, []).append(name)
    several = {why: why.replace("does not", "do not") if len(names) > 1 else why for why, names in groups.items()}
    return ", ".join(f"{listed(names)} ({several[why]})" for why, names in groups.items())


def times(ratio: float) -> str:
    """A factor as people say it."""
    if ratio >= 1000:
        return "over 1000 times as much"
    return f"{ratio:.0f} times as much" if ratio >= 9.5 else f"{ratio:.1f} times as much"


def quiet(result: Result) -> Verdict:
    """How quiet at rest: the worse of roll and pitch noise of each row."""
    pairs = []
    for row in result.estimators:
        axes = [a for a in (find(row, f"noise_{axis}_deg", REST) for axis in ("roll", "pitch")) if a is not None]
        values = [a for a in axes if a.value is not None and math.isfinite(a.value)]
        worst = max(values, key=lambda a: a.value) if values else axes[0] if axes else None
        if worst is not None and worst.ranked:
            worst = next((a for a in axes if not a.ranked), worst)
        pairs.append((row, worst))
    judged, without = split(pairs)
    verdict = Verdict(
        "quiet",
        "How quiet at rest?",
        "",
        "max(noise_roll_deg, noise_pitch_deg)",
        judged[0].answer.window if judged else "rest",
        [(j.row.name, j.value, "deg") for j in sorted(judged, key=lambda j: j.value) if j.shown],
        [(name, reason) for name, _, reason in without] + unranked(judged),
    )
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: j.value)
    if not ranked:
        verdict.sentence = (
            f"No filter can be ranked: {why_not(result, verdict)}." + onboard_part(judged, "deg")
            if any(j.row.kind == "replay" for j in judged)
            else cannot(without, "the log holds no stretch with the vehicle at rest and the motors off")
        )
        return verdict
    floor = result.reference.floor_deg if result.reference else 0.0
    leaders = [j for j in ranked if j.value <= 1.5 * ranked[0].value + floor]
    worst, hold = ranked[-1], quantity(leaders[-1].value, "deg").lstrip("<")
    seconds = duration(max(j.answer.seconds for j in ranked))
    over = f" over {seconds} of rest" if max(j.answer.seconds for j in ranked) > 0 else ""
    if len(ranked) == 1:
        says = f"{worst.row.name} holds roll and pitch to within {hold}{over}; no other filter can be ranked."
    elif len(leaders) == len(ranked):
        who = "Both" if len(ranked) == 2 else f"All {len(ranked)}"
        says = f"{who} filters hold roll and pitch to within {hold}{over}, too close to rank."
    elif len(leaders) == 1:
        says = f"{leaders[0].row.name} is quietest: roll and pitch within {hold}{over}."
    else:
        says = f"{some(leaders, len(ranked))} hold roll and pitch to within {hold}{over}, too close to rank."
    if worst not in leaders:
        factor = f", {times(worst.value / ranked[0].value)}" if ranked[0].value > 0 else ""
        says += f" {worst.row.name} is noisiest: {quantity(worst.value, 'deg')}{factor}."
    verdict.sentence = upper(says) + onboard_part(judged, "deg")
    return verdict


def late(result: Result) -> Verdict:
    """How late in a step: the pooled lag of each row that follows the reference's shape."""
    judged, without = split([(row, find(row, "lag_ms", AIR)) for row in result.estimators])
    verdict = Verdict(
        "late",
        "How late in a step?",
        "",
        "lag_ms",
        judged[0].answer.window if judged else "airborne",
        [(j.row.name, j.value, "ms") for j in sorted(judged, key=lambda j: j.value) if j.shown],
        [(name, reason) for name, _, reason in without] + unranked(judged),
    )
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: j.value)
    replayed = {r.name for r in result.estimators if r.kind == "replay"}
    bent = [name for name, code, _ in without if code == "bent" and name in replayed]
    if not ranked:
        verdict.sentence = (
            f"No filter can be judged: {why_not(result, verdict)}." + onboard_part(judged, "ms")
            if bent or any(j.row.kind == "replay" for j in judged)
            else cannot(without, "the flight holds too few quick movements (3 per axis are needed)")
        )
        return verdict
    rate = (result.log.get("imu") or {}).get("rate_hz") or 0.0
    half = 500.0 / rate if rate > 0 else 0.0
    slow = [j for j in ranked if j.value > half and not (j.answer.ci95 and j.answer.ci95[0] <= 0)]
    against = against_whom(result)
    steps = max(j.answer.n for j in ranked)
    if not slow:
        says = "No filter that can be judged is measurably late" if bent else "No filter is measurably late"
        says += f" against {against} over {steps} steps"
        says += f"; within ±{half:.3g} ms, half an IMU sample, counts as zero." if half else "."
    else:
        worst = slow[-1]
        says = f"{worst.row.name} is latest: {quantity(worst.value, 'ms')}{worst.interval} against {against}"
        says += f" over {worst.answer.n} steps."
        others = [j for j in ranked if j not in slow]
        if others:
            says += f" {some(others, len(ranked))} {'is' if len(others) == 1 else 'are'} not measurably late."
        elif len(ranked) > 1:
            says += f" Least: {ranked[0].row.name}, {quantity(ranked[0].value, 'ms')}{ranked[0].interval}."
    if bent:
        says += f" {upper(bent_part(bent, len(replayed)))}."
    verdict.sentence = upper(says) + onboard_part(judged, "ms")
    return verdict


def bent_part(bent: list[str], of: int) -> str:
    """How many rows do not follow the movement, so that a fitted delay means nothing."""
    tail = "the movement closely enough to fit a delay"
    if len(bent) == of:
        return f"none of {of} follows {tail}" if of > 1 else f"{bent[0]} does not follow {tail}"
    return f"{len(bent)} of {of} do not follow {tail}" if len(bent) > 1 else f"{bent[0]} does not follow {tail}"


def drifting(result: Result) -> Verdict:
    """How fast does the heading drift: at rest against standing still, in the air against the best witness."""
    rest, rest_without = split([(row, find(row, "drift_rest_deg_per_min", REST)) for row in result.estimators])
    witness, air, air_without = air_drift(result)
    shown = rest if any(j.ranked for j in rest) or not air else air
    verdict = Verdict(
        "drifting",
        "How fast does the heading drift?",
        "",
        "drift_rest_deg_per_min" if shown is rest else f"drift_air_deg_per_min.{witness}",
        shown[0].answer.window if shown else "rest",
        [(j.row.name, j.value, "deg/min") for j in sorted(shown, key=lambda j: abs(j.value)) if j.shown],
        [(name, reason) for name, _, reason in (rest_without if shown is rest else air_without)] + unranked(shown),
    )
    parts = [drift_part(rest, "At rest"), drift_part(air, f"In the air against {witness_name(witness)}")]
    said = [p for p in parts if p]
    if said:
        verdict.sentence = " ".join(said)
    elif any(j.row.kind == "replay" for j in shown):
        verdict.sentence = f"No drift can be ranked: {why_not(result, verdict)}."
    elif rest_without and air_without:
        at_rest, in_air = commonest(rest_without), commonest(air_without)
        verdict.sentence = f"Cannot be judged: at rest, {at_rest}; in the air, {in_air}."
    else:
        verdict.sentence = cannot(
            rest_without + air_without, "neither a rest nor a flight is long enough to tell a drift from wander"
        )
    return verdict


def best_witness(result: Result) -> str:
    """The first heading witness of WITNESSES by which any row's drift in the air has a value; ``onboard`` if none."""
    for witness in WITNESSES:
        answers = [find(row, f"drift_air_deg_per_min.{witness}", AIR) for row in result.estimators]
        if any(a is not None and a.value is not None for a in answers):
            return witness
    return "onboard"


def air_drift(result: Result) -> tuple[str, list[Judged], list[tuple[str, str, str]]]:
    """The best witness of the heading in the air, with the rows by it."""
    witness = best_witness(result)
    metric = f"drift_air_deg_per_min.{witness}"
    judged, without = split([(row, find(row, metric, AIR)) for row in result.estimators])
    return witness, judged, without


def drift_part(judged: list[Judged], where: str) -> str:
    """One sentence on drift in one situation; empty where nothing may be ranked."""
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: abs(j.value))
    if not ranked:
        return ""
    drifts = [j for j in ranked if not (j.answer.ci95 and j.answer.ci95[0] <= 0 <= j.answer.ci95[1])]
    still = [j for j in ranked if j not in drifts]
    if not drifts:
        who = f"{ranked[0].row.name} shows no" if len(ranked) == 1 else f"none of {len(ranked)} filters shows a"
        says = f"{where}, {who} drift that differs from zero (at most {quantity(ranked[-1].value, 'deg/min')})"
    else:
        worst = drifts[-1]
        says = f"{where}, {worst.row.name} drifts {'most: ' if len(ranked) > 1 else ''}"
        says += f"{quantity(worst.value, 'deg/min')}{worst.interval}"
        if still:
            says += f"; {some(still, len(ranked))} {'shows' if len(still) == 1 else 'show'} none that differs from zero"
        elif len(ranked) > 1:
            says += f"; least: {drifts[0].row.name}, {quantity(drifts[0].value, 'deg/min')}{drifts[0].interval}"
    others = [j for j in judged if j.row.kind == "replay" and not j.ranked]
    if others:
        says += f"; {some(others, len(ranked) + len(others))} cannot be ranked"
    onboard = [j for j in judged if j.row.name == "onboard"]
    if onboard:
        says += f"; onboard {quantity(onboard[0].value, 'deg/min')}"
    return says + "."


def onboard_part(judged: list[Judged], unit: str) -> str:
    """What the attitude that flew did, as a short last sentence."""
    onboard = [j for j in judged if j.row.name == "onboard" and not (unit == "ms" and j.row.is_reference)]
    return f" Onboard: {quantity(onboard[0].value, unit)}." if onboard else ""


def some(judged: list[Judged], of: int) -> str:
    """Up to NAMED rows by name, more as a count."""
    names = [j.row.name for j in judged]
    return listed(names) if len(names) <= NAMED else f"{len(names)} of {of} filters"


def against_whom(result: Result) -> str:
    """What the rows were compared with, with a warning where it is no truth."""
    choice = result.reference.choice if result.reference else ""
    return {"truth": "the logged truth", "smoother": "the smoother"}.get(choice, "onboard (agreement, not truth)")


def witness_name(witness: str) -> str:
    """A heading witness in words."""
    return {
        "truth": "the logged truth",
        "smoother": "the smoother",
        "onboard": "onboard (agreement, not truth)",
        "gnss_yaw": "the GNSS heading",
        "mag": "the magnetometer",
        "course": "the GNSS course",
    }.get(witness, witness)


def upper(text: str) -> str:
    """The sentence as it is: names of filters keep their case, plain words start with a capital."""
    word = text.split(" ", 1)[0]
    return text[0].upper() + text[1:] if word in ("both", "all", "none", "it") or word.isdigit() else text
