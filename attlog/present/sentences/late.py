"""How much lag in a step? The pooled lag of each row that follows the reference's shape."""

from __future__ import annotations

from attlog.present.names import against_whom, name_in_sentence
from attlog.present.numbers import counted as count
from attlog.present.numbers import quantity
from attlog.present.rows import AIR, find
from attlog.present.sentences.judged import Absent, Judged, bars, counted, onboard_part, some, split, unranked
from attlog.present.sentences.reasons import cannot, why_not
from attlog.result import Result, Verdict

NOT_PURE = "not_a_pure_delay"


def late(result: Result) -> Verdict:
    """The verdict on lag in quick movements."""
    judged, without = split([(row, find(row, "lag_ms", AIR)) for row in result.estimators])
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: j.value)
    bent = [a for a in without if a.code == NOT_PURE and a.row.kind == "replay"]
    if ranked:
        sentence = says(result, ranked, bent) + onboard_part(judged, "ms")
    elif bent or any(j.replay for j in judged):
        sentence = f"No filter's lag can be judged: {why_not(result, judged, without)}."
        sentence += (" Compare their tilt errors instead." if bent else "") + onboard_part(judged, "ms")
    else:
        sentence = cannot(result, without, "the flight holds too few quick movements (3 per axis are needed)")
    return Verdict(
        "late",
        "How much lag in a step?",
        sentence,
        "lag_ms",
        judged[0].answer.window if judged else "airborne",
        bars(judged, "ms"),
        [(a.row.name, a.reason) for a in without] + unranked(judged),
    )


def says(result: Result, ranked: list[Judged], bent: list[Absent]) -> str:
    """Who lags most and against what, then who does not, then whose movement is no pure delay."""
    half = half_sample_ms(result)
    slow = [j for j in ranked if j.value > half and not (j.answer.ci95 and j.answer.ci95[0] <= 0)]
    if slow:
        text = most(result, ranked, slow)
    else:
        names = [j.name for j in ranked]
        none = f"Of {counted(names)} none lags" if len(names) > 1 else f"{names[0]} does not lag"
        text = f"{none if bent else 'No filter lags'} measurably"
        text += f" against {against_whom(result)} over {count(max(j.answer.n for j in ranked), 'step')}"
        text += f"; less than {half:.2g} ms, half an IMU sample, counts as zero." if half else "."
    return text + (f" {bent_part(bent, result)}." if bent else "")


def half_sample_ms(result: Result) -> float:
    """Half an IMU sample: a lag below it counts as zero."""
    rate = (result.log.get("imu") or {}).get("rate_hz") or 0.0
    return 500.0 / rate if rate > 0 else 0.0


def most(result: Result, ranked: list[Judged], slow: list[Judged]) -> str:
    """The largest lag with its interval, and the other end."""
    worst = slow[-1]
    text = f"{worst.name} lags {'most: ' if len(ranked) > 1 else ''}"
    text += f"{quantity(worst.value, 'ms')}{worst.interval} against {against_whom(result)}"
    text += f" over {count(worst.answer.n, 'step')}."
    others = [j for j in ranked if j not in slow]
    if others:
        return text + f" {some(others, len(ranked))} {'does' if len(others) == 1 else 'do'} not lag measurably."
    if len(ranked) > 1:
        text += f" Least: {ranked[0].name}, {quantity(ranked[0].value, 'ms')}{ranked[0].interval}."
    return text


def bent_part(bent: list[Absent], result: Result) -> str:
    """How many rows go through the movement at a wrong angle, and what that means for their lag."""
    of = sum(row.kind == "replay" for row in result.estimators)
    who = f"{len(bent)} of {of}" if len(bent) > 1 else name_in_sentence(bent[0].row)
    verb = "show" if len(bent) > 1 else "shows"
    return f"{who} {verb} a wrong angle in the movement, which is not a pure delay"
