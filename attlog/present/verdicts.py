"""The three answers in plain sentences: how quiet at rest, how late in a step, how fast does the heading drift.

Sentences are made by rule from the answers of a Result, never by hand: first the
answer, then the number, then who is worst and by what factor, then the onboard
attitude. What may not be ranked is never named as best, and an interval across
zero reads "no drift told, less than X", never "no drift".
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from attlog.metrics.answer import Answer
from attlog.metrics.drift_air import AGREEMENT, QUOTED, quoted
from attlog.present.numbers import duration, interval, listed, quantity
from attlog.result import EstimatorRow, Result, Verdict

REST = ("rest", "rest.long", "all")
AIR = ("airborne", "all", "armed")
SITUATIONS = ("at rest", "in the air")
"""Where the heading may drift; reasons of the third question start with it."""

NAMED = 3
"""So many rows are named in a sentence; more are counted."""

SMALLEST_DEG = 0.0005
"""Noise below this is shown as "below 0.001 deg": no differences and no factors are told from it."""

LARGEST_FACTOR = 100.0

ADVICE = {
    "no_events": "Fly some brisk steps in roll, pitch and yaw.",
    "too_few_events": "Fly some more brisk steps in roll, pitch and yaw.",
}
"""What a pilot can do about a code whose reason does not say it."""

LOGGED_BEFORE_ARMING = {"ArduPilot": "LOG_DISARMED", "PX4": "SDLOG_MODE"}
"""The parameter that makes an autopilot log before it is armed."""


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


def cannot(result: Result, without: list[tuple[str, str, str]], nothing: str) -> str:
    """The sentence for a question that no row answers: the commonest reason and what a pilot can do."""
    code, reason = commonest(without)
    flew = (result.log.get("seconds") or {}).get("airborne") != 0
    advice = f" {ADVICE[code]}" if code in ADVICE and flew else ""
    return f"Cannot be judged: {reason or nothing}{switch(result, code)}.{advice}"


def switch(result: Result, code: str) -> str:
    """In brackets, the parameter by which this autopilot logs its rest before arming; empty for other codes."""
    name = str((result.log.get("firmware") or {}).get("name") or "")
    found = next((p for maker, p in LOGGED_BEFORE_ARMING.items() if name.startswith(maker)), "")
    return f" (parameter {found})" if found and code in ("no_rest", "rest_too_short") else ""


def commonest(without: list[tuple[str, str, str]]) -> tuple[str, str]:
    """Code and reason that most rows give, rows to which the question does not apply only if there are no others."""
    reasons = Counter((code, reason) for _, code, reason in without if reason and code != "not_applicable")
    reasons = reasons or Counter((code, reason) for _, code, reason in without if reason)
    if not reasons:
        return "", ""
    code, reason = reasons.most_common(1)[0][0]
    reason = reason.rstrip(".")
    return code, reason[0].lower() + reason[1:] if reason[:2].istitle() else reason


def why_not(result: Result, judged: list[Judged], without: list[tuple[str, str, str]]) -> str:
    """Who is not judged and why in few words, filters with the same reason together."""
    groups: dict[str, list[str]] = {}
    codes = {name: code for name, code, _ in without} | {j.row.name: "unranked" for j in judged if not j.ranked}
    for row in result.estimators:
        if row.kind == "replay" and row.name in codes:
            reason = next((j.answer.reason for j in judged if j.row is row), None) or ""
            short = SHORT.get(codes[row.name]) or reason.partition(":")[0].partition(";")[0] or "not ranked"
            groups.setdefault(SHORT.get(row.status, short), []).append(row.name)
    several = {why: why.replace("does not", "do not") if len(names) > 1 else why for why, names in groups.items()}
    return ", ".join(f"{counted(names)} ({several[why]})" for why, names in groups.items())


SHORT = {
    "not_a_pure_delay": "wrong angle in the movement",
    "lag_at_edge": "wrong angle in the movement",
    "too_few_events": "too few steps",
    "not_covered": "not comparable",
    "diverged": "diverged",
    "not_converged": "did not settle",
    "failed": "failed",
}
"""Codes and states in a few words."""


def counted(names: list[str]) -> str:
    """Up to NAMED filters by name, more as a count."""
    return listed(names) if len(names) <= NAMED else f"{len(names)} filters"


def times(value: float, least: float) -> str:
    """By which factor the largest noise exceeds the least, as people say it; empty where the least is not resolved."""
    if least < SMALLEST_DEG:
        return ""
    ratio = value / least
    if ratio > LARGEST_FACTOR:
        return f", over {LARGEST_FACTOR:.0f} times as much"
    return f", {ratio:.0f} times as much" if ratio >= 9.5 else f", {ratio:.1f} times as much"


def held(value: float) -> str:
    """To within what: ``to within 0.012°``, ``to less than 0.001°``."""
    return f"to within {quantity(value, 'deg')}" if value >= SMALLEST_DEG else "to less than 0.001°"


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
            f"No filter can be ranked: {why_not(result, judged, without)}." + onboard_part(judged, "deg")
            if any(j.row.kind == "replay" for j in judged)
            else cannot(result, without, "the log holds no segment with the vehicle at rest and the motors off")
        )
        return verdict
    floor = result.reference.floor_deg if result.reference else 0.0
    leaders = [j for j in ranked if j.value <= 1.5 * ranked[0].value + max(floor, SMALLEST_DEG)]
    worst, hold = ranked[-1], held(leaders[-1].value)
    seconds = max(j.answer.seconds for j in ranked)
    over = f" over {duration(seconds)} of rest" if seconds > 0 else ""
    if len(ranked) == 1:
        says = f"{worst.row.name} holds roll and pitch {hold}{over}; no other filter can be ranked."
    elif len(leaders) == len(ranked):
        who = "Both" if len(ranked) == 2 else f"All {len(ranked)}"
        says = f"{who} filters hold roll and pitch {hold}{over}, too close to rank."
    elif len(leaders) == 1:
        quieter = [j for j in judged if j.row.kind == "replay" and not j.ranked and j.value < ranked[0].value]
        quietest = f"quietest of the {len(ranked)} ranked" if quieter else "quietest"
        says = f"{leaders[0].row.name} is {quietest}: it holds roll and pitch {hold}{over}."
    else:
        says = f"{some(leaders, len(ranked))} hold roll and pitch {hold}{over}, too close to rank."
    if worst not in leaders:
        louder = any(j.row.kind == "replay" and j.value > worst.value for j in judged)
        noisiest = f"noisiest of the {len(ranked)} ranked" if louder else "noisiest"
        says += f" {worst.row.name} is {noisiest}: {quantity(worst.value, 'deg')}{times(worst.value, ranked[0].value)}."
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
    bent = [name for name, code, _ in without if code == "not_a_pure_delay" and name in replayed]
    if not ranked:
        verdict.sentence = (
            f"No filter's delay can be judged: {why_not(result, judged, without)}."
            + (" Compare their tilt errors instead." if bent else "")
            + onboard_part(judged, "ms")
            if bent or any(j.row.kind == "replay" for j in judged)
            else cannot(result, without, "the flight holds too few quick movements (3 per axis are needed)")
        )
        return verdict
    rate = (result.log.get("imu") or {}).get("rate_hz") or 0.0
    half = 500.0 / rate if rate > 0 else 0.0
    slow = [j for j in ranked if j.value > half and not (j.answer.ci95 and j.answer.ci95[0] <= 0)]
    against = against_whom(result)
    steps = max(j.answer.n for j in ranked)
    if not slow:
        names = [j.row.name for j in ranked]
        says = (
            "No filter is" if not bent else f"Of {counted(names)} none is" if len(names) > 1 else f"{names[0]} is not"
        )
        says += f" measurably late against {against} over {steps} steps"
        says += f"; less than {half:.2g} ms, half an IMU sample, counts as zero." if half else "."
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
        says += f" {bent_part(bent, len(replayed))}."
    verdict.sentence = says + onboard_part(judged, "ms")
    return verdict


def bent_part(bent: list[str], of: int) -> str:
    """How many rows go through the movement at a wrong angle, and what that means for their delay."""
    who = f"{len(bent)} of {of}" if len(bent) > 1 else bent[0]
    return f"{who} {'show' if len(bent) > 1 else 'shows'} a wrong angle in the movement, which no delay describes"


def drifting(result: Result) -> Verdict:
    """How fast does the heading drift: at rest against standing still, in the air against a heading reference."""
    rest, rest_without = split([(row, find(row, "drift_rest_deg_per_min", REST)) for row in result.estimators])
    heading_reference, air, air_without = air_drift(result)
    shown = rest if any(j.ranked for j in rest) or not air else air
    others = [
        (name, f"{where}, {reason}")
        for where, part in zip(SITUATIONS, (rest_without, air_without), strict=True)
        for name, _, reason in part
    ]
    verdict = Verdict(
        "drifting",
        "How fast does the heading drift?",
        "",
        "drift_rest_deg_per_min" if shown is rest else f"drift_air_deg_per_min.{heading_reference}",
        shown[0].answer.window if shown else "rest",
        [(j.row.name, j.value, "deg/min") for j in sorted(shown, key=lambda j: abs(j.value)) if j.shown],
        others + unranked(shown),
    )
    both = any(j.ranked for j in rest) and any(j.ranked for j in air)
    parts = [
        drift_part(rest, "At rest", both),
        drift_part(air, f"In the air against {heading_reference_name(heading_reference)}", both),
    ]
    said = [p for p in parts if p]
    replayed = [j for j in shown if j.row.kind == "replay"]
    if said:
        verdict.sentence = " ".join(said)
    elif replayed:
        where = "At rest" if shown is rest else f"In the air against {heading_reference_name(heading_reference)}"
        verdict.sentence = f"{unranked_part(replayed, where)}." + onboard_drift(shown)
    elif rest_without and air_without:
        (code, at_rest), (_, in_air) = commonest(rest_without), commonest(air_without)
        verdict.sentence = f"Cannot be judged. At rest: {at_rest}{switch(result, code)}. In the air: {in_air}."
    else:
        nothing = "neither a rest nor a flight is long enough"
        verdict.sentence = cannot(result, rest_without + air_without, nothing)
    return verdict


def unranked_part(replayed: list[Judged], where: str) -> str:
    """Why no filter's drift is compared: rests that disagree, or filters that lost their way."""
    ranges = [
        j.answer.detail["range"] for j in replayed if j.row.status == "ok" and not j.answer.detail.get("agree", True)
    ]
    if ranges:
        low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
        return f"{where}, the rests disagree: drifts from {quantity(low, 'deg/min')} to {quantity(high, 'deg/min')}"
    lost = lost_part(replayed)
    return f"{where}, no filter's drift can be ranked{f': {lost}' if lost else ''}"


def lost_part(judged: list[Judged]) -> str:
    """Which filters lost their way, and how."""
    states = {s: [j.row.name for j in judged if j.row.status == s] for s in ("diverged", "not_converged", "failed")}
    return ", ".join(f"{counted(names)} {SHORT[state]}" for state, names in states.items() if names)


def quoted_heading_reference(result: Result) -> str:
    """The heading reference that the sentence quotes: the first by which any replayed row has a value."""
    replayed = [row for row in result.estimators if row.kind == "replay"]
    answers = {name: [find(row, f"drift_air_deg_per_min.{name}", AIR) for row in replayed] for name in QUOTED}
    return quoted({n: any(a is not None and a.value is not None for a in found) for n, found in answers.items()}) or (
        "onboard"
    )


def air_drift(result: Result) -> tuple[str, list[Judged], list[tuple[str, str, str]]]:
    """The heading reference that is quoted for the air, with the rows by it."""
    heading_reference = quoted_heading_reference(result)
    metric = f"drift_air_deg_per_min.{heading_reference}"
    judged, without = split([(row, find(row, metric, AIR)) for row in result.estimators])
    return heading_reference, judged, without


def drift_part(judged: list[Judged], where: str, brief: bool) -> str:
    """One sentence on drift in one situation, ``brief`` on what cannot be told; empty where nothing may be ranked."""
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: abs(j.value))
    if not ranked:
        return ""
    drifts = [j for j in ranked if not (j.answer.ci95 and j.answer.ci95[0] <= 0 <= j.answer.ci95[1])]
    still = [j for j in ranked if j not in drifts]
    if not drifts:
        who = f"of {ranked[0].row.name}" if len(ranked) == 1 else f"of any of {len(ranked)} filters"
        says = f"{where}, no drift {who} is told: less than {bound(ranked)}"
    else:
        worst = drifts[-1]
        says = f"{where}, {worst.row.name} drifts {'most: ' if len(ranked) > 1 else ''}"
        says += f"{quantity(worst.value, 'deg/min')}{worst.interval}"
        if still:
            says += f"; none told of {some(still, len(ranked))}: less than {bound(still)}"
        elif len(ranked) > 1:
            says += f"; least: {drifts[0].row.name}, {quantity(drifts[0].value, 'deg/min')}{drifts[0].interval}"
    unsure = [j.row.name for j in judged if j.row.kind == "replay" and j.row.status == "ok" and not j.ranked]
    lost = [j.row.name for j in judged if j.row.kind == "replay" and j.row.status != "ok"]
    if brief and unsure + lost:
        says += f"; {counted(unsure + lost)} cannot be judged"
    elif unsure:
        says += f"; {counted(unsure)} cannot be judged"
    if lost and not brief:
        says += f"; {lost_part([j for j in judged if j.row.kind == 'replay'])}"
    return says + "." + onboard_drift(judged)


def bound(judged: list[Judged]) -> str:
    """What the drifts of all these rows stay below: the largest end of their intervals."""
    ends = [abs(end) for j in judged for end in (j.answer.ci95 or (j.value, j.value))]
    return quantity(max(ends), "deg/min", signed=False)


def onboard_drift(judged: list[Judged]) -> str:
    """How the heading that flew drifted, with its interval, as a short last sentence."""
    onboard = [j for j in judged if j.row.name == "onboard"]
    return f" Onboard: {quantity(onboard[0].value, 'deg/min')}{onboard[0].interval}." if onboard else ""


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


def heading_reference_name(heading_reference: str) -> str:
    """A heading reference in words."""
    word = {
        "truth": "the logged truth",
        "smoother": "the smoother",
        "gnss_yaw": "the GNSS heading",
        "mag": "the magnetometer",
        "course": "the GNSS course",
    }.get(heading_reference, heading_reference)
    return f"{word} (agreement, not truth)" if heading_reference in AGREEMENT else word


def upper(text: str) -> str:
    """The sentence as it is: names of filters keep their case, plain words start with a capital."""
    word = text.split(" ", 1)[0]
    return text[0].upper() + text[1:] if word in ("both", "all", "none", "it") or word.isdigit() else text
