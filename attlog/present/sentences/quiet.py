"""How quiet at rest? The worse of roll and pitch noise of each row."""

from __future__ import annotations

from attlog.present.numbers import duration, quantity
from attlog.present.rows import REST, find, has_value, value_of
from attlog.present.sentences.judged import Judged, bars, onboard_part, some, split, unranked
from attlog.present.sentences.reasons import cannot, why_not
from attlog.result import Answer, EstimatorRow, Result, Verdict

SMALLEST_DEG = 0.0005
"""Noise below this is shown as "below 0.001 deg": no differences and no factors are told from it."""

LARGEST_FACTOR = 100.0

CLOSE = 1.5
"""Rows within this factor of the least noise are too close to rank."""


def quiet(result: Result) -> Verdict:
    """The verdict on noise at rest."""
    judged, without = split([(row, noise(row)) for row in result.estimators])
    ranked = sorted((j for j in judged if j.ranked), key=lambda j: j.value)
    if ranked:
        sentence = says(result, judged, ranked) + onboard_part(judged, "deg")
    elif any(j.replay for j in judged):
        sentence = f"No filter can be ranked: {why_not(result, judged, without)}." + onboard_part(judged, "deg")
    else:
        sentence = cannot(result, without, "the log holds no segment with the vehicle at rest and the motors off")
    return Verdict(
        "quiet",
        "How quiet at rest?",
        sentence,
        "max(noise_roll_deg, noise_pitch_deg)",
        judged[0].answer.window if judged else "rest",
        bars(judged, "deg"),
        [(a.row.name, a.reason) for a in without] + unranked(judged),
    )


def noise(row: EstimatorRow) -> Answer | None:
    """The worse of the two axes; where one axis may not be ranked, that one."""
    axes = [a for a in (find(row, f"noise_{axis}_deg", REST) for axis in ("roll", "pitch")) if a is not None]
    values = [a for a in axes if has_value(a)]
    if not values:
        return axes[0] if axes else None
    worst = max(values, key=value_of)
    return next((a for a in axes if not a.ranked), worst) if worst.ranked else worst


def says(result: Result, judged: list[Judged], ranked: list[Judged]) -> str:
    """Who holds still best, then who is noisiest and by what factor."""
    floor = result.reference.floor_deg if result.reference else 0.0
    leaders = [j for j in ranked if j.value <= CLOSE * ranked[0].value + max(floor, SMALLEST_DEG)]
    worst, hold = ranked[-1], held(leaders[-1].value)
    seconds = max(j.answer.seconds for j in ranked)
    over = f" over {duration(seconds)} of rest" if seconds > 0 else ""
    if len(ranked) == 1:
        text = f"{worst.name} holds roll and pitch {hold}{over}; no other filter can be ranked."
    elif len(leaders) == len(ranked):
        who = "Both" if len(ranked) == 2 else f"All {len(ranked)}"
        text = f"{who} filters hold roll and pitch {hold}{over}, too close to rank."
    elif len(leaders) == 1:
        quieter = [j for j in judged if j.replay and not j.ranked and j.value < ranked[0].value]
        quietest = f"quietest of the {len(ranked)} ranked" if quieter else "quietest"
        text = f"{leaders[0].name} is {quietest}: it holds roll and pitch {hold}{over}."
    else:
        text = f"{some(leaders, len(ranked))} hold roll and pitch {hold}{over}, too close to rank."
    if worst not in leaders:
        louder = any(j.replay and j.value > worst.value for j in judged)
        noisiest = f"noisiest of the {len(ranked)} ranked" if louder else "noisiest"
        text += f" {worst.name} is {noisiest}: {quantity(worst.value, 'deg')}{times(worst.value, ranked[0].value)}."
    return text


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
