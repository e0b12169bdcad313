"""How much does a filter lag in a step? The lag of each row, and the angle it is off afterwards."""

from __future__ import annotations

from itertools import takewhile

from attlog.present.contest import ColumnRanking, RankedValue, contest
from attlog.present.names import against_whom
from attlog.present.numbers import counted as count
from attlog.present.numbers import listed, number, quantity
from attlog.present.sentences.reasons import cannot, undetermined, why_not
from attlog.present.sentences.words import NAMED, bars, bound, counted, left_out, some, values
from attlog.present.table.rows import AIR, is_baseline
from attlog.result import Result, Verdict

LAG = "lag_ms"
STEP_DEG, STEP_PCT, AFTER = "step_error_deg.0.5s", "step_error_pct.0.5s", "0.5 s"
NOT_PURE = ("not_a_pure_delay", "lag_at_edge")
WRONG_PCT = 10.0
"""From this share of the step on a filter is called short of it or beyond it."""
ONE_SAMPLE = (0.8, 1.2)
SLOW_IMU_S = 0.015
"""Lags of one sample are said to be that where samples are further apart than this."""
SHOWN_DELAY_MS = 0.5


def lag_verdict(result: Result) -> Verdict:
    """The verdict on steps: who lags, and who shows a wrong angle afterwards."""
    lag, step = contest(result, LAG, AIR), contest(result, STEP_DEG, AIR)
    impure = [a for a in lag.absent if a.code in NOT_PURE and a.row.kind == "replay" and not is_baseline(a.row)]
    if lag.ranked:
        unsure = undetermined(lag)
        sentence = says(result, lag) + (f" {unsure[0].upper()}{unsure[1:]}." if unsure else "")
        sentence += late_imu(result) + impure_part([a.row.name for a in impure], result)
        sentence += onboard_lag(lag) + step_part(result, step)
    elif lag.filters or impure:
        sentence = f"No filter's lag can be judged: {why_not(lag)}.{onboard_lag(lag)}{step_part(result, step)}"
    else:
        sentence = cannot(result, lag.absent, "the flight holds too few steps (3 per axis are needed)")
    return Verdict("lag", "Lag", sentence, LAG, lag.window, bars(lag), left_out(lag), notes(result, lag))


def says(result: Result, lag: ColumnRanking) -> str:
    """Who lags by its interval and by how much, else below which bound none does."""
    ranked = lag.ranked
    slow = [j for j in ranked if j.significant and j.value > zero_below(j)]
    early = [j for j in ranked if j.significant and j.value < -zero_below(j)]
    rest = [j for j in ranked if j not in slow and j not in early]
    against = f"against {against_whom(result)} in {count(max(j.answer.n for j in ranked), 'step')}"
    parts = []
    if slow:
        parts.append(f"{lagging(result, lag, slow)} {against}")
    if early:
        parts.append(ahead(result, early, lag, "" if slow else f" {against}"))
    if rest and parts:
        who = some(rest, lag) if len(rest) <= NAMED else f"the other {len(rest)} filters"
        parts.append(f"No significant lag of {who}: less than {bound(rest)}")
    elif rest:
        who = rest[0].name if len(rest) == 1 else f"{len(rest)} filters"
        parts.append(f"No significant lag of {who}: less than {bound(rest)} {against}")
    return ". ".join(parts) + "."


def zero_below(judged: RankedValue) -> float:
    """Lags below this count as none, ms: half an IMU sample."""
    return judged.answer.counts_as_zero_below


def lagging(result: Result, lag: ColumnRanking, slow: list[RankedValue]) -> str:
    """Rows that lag significantly, the largest first; "most" only for the row that the ranking finds worst."""
    slowest = slow[::-1]
    if len(slow) == 1:
        return f"{slow[0].name} lags by {slow[0].text}{slow[0].interval}{sample(result, slow[0])}"
    if lag.worst is not None and lag.worst.row.name == slowest[0].row.name:
        most, others = slowest[0], slowest[1:]
        text = f"{most.name} lags most: {most.text}{most.interval}{sample(result, most)}"
        return f"{text}; {some(others, lag)} by {values(others[::-1])}"
    return f"{some(slow, lag)} lag by {values(slow)}"


def sample(result: Result, judged: RankedValue) -> str:
    """That a lag is one sample of a slow log, which is as late as a filter that uses the newest sample can be."""
    rate = float((result.log.get("imu") or {}).get("rate_hz") or 0.0)
    if rate <= 0 or 1.0 / rate < SLOW_IMU_S or not ONE_SAMPLE[0] <= judged.value * rate / 1000.0 <= ONE_SAMPLE[1]:
        return ""
    return f", one sample of this log's {number(rate, 'Hz')} Hz IMU,"


def ahead(result: Result, early: list[RankedValue], lag: ColumnRanking, against: str) -> str:
    """Rows that come before what they are compared with: if all filters do, that itself lags."""
    who = some(early, lag)
    text = f"{who} {'is' if len(early) == 1 else 'are'} ahead: {values(early)}{against}"
    flew = result.reference is not None and result.reference.choice == "onboard"
    return f"{text}. The onboard attitude itself lags" if flew and len(early) == len(lag.ranked) > 1 else text


def late_imu(result: Result) -> str:
    """That the IMU itself comes late, by more than its filters explain: no filter can be earlier."""
    for check in result.audit:
        if check.name == "imu delay" and check.verdict in ("warning", "fault") and isinstance(check.value, float):
            if check.value > 0.0:
                return f" The IMU itself is {quantity(check.value, 'ms', signed=False)} late, and every filter with it."
    return ""


def impure_part(names: list[str], result: Result) -> str:
    """Whose lag cannot be determined, because it goes through the step in another shape."""
    if not names:
        return ""
    called = [j.name for j in contest(result, STEP_DEG, AIR).judged if j.row.name in names]
    who = counted(called) if len(called) == len(names) else count(len(names), "filter")
    return f" Lag cannot be determined for {who}: not a pure delay."


def onboard_lag(lag: ColumnRanking) -> str:
    """The lag of what flew, where something better is the reference."""
    flew = lag.onboard
    return f" Onboard: {flew.text}{flew.interval}." if flew is not None else ""


def step_part(result: Result, step: ColumnRanking) -> str:
    """How wrong the angle is after a step: who is short of it, and how far the others are off."""
    filters = [j for j in step.filters if j.row.status == "ok"]
    if not filters:
        return ""
    percent = {j.row.name: share(j, step.window) for j in filters}
    wrong = [j for j in filters if abs(percent[j.row.name]) >= WRONG_PCT][::-1]
    best = {j.row.name for j in step.best}
    least = list(takewhile(lambda j: j.row.name in best, filters))  # one behind a worse row is only not significant
    others = [j for j in filters if j not in wrong and j not in least]
    parts = [still(wrong, percent, len(filters))] if wrong else []
    if least:
        are = "is" if len(least) == 1 else "are"
        parts.append(f"{some(least, step)} {are} least off, {values(least)}")
    parts += [off(others, all_of_them=len(others) == step.total)] if others else []
    return f" {AFTER} after a step ({movements(filters)}) {'; '.join(parts)}."


def step_remark(result: Result) -> str:
    """Which filter misses most of a step 0.5 s after it, of several how many; empty where all follow it.

    A filter whose angle is wrong may have no lag.
    """
    step = contest(result, STEP_DEG, AIR)
    percent = {j.name: share(j, step.window) for j in step.filters if j.row.status == "ok"}
    wrong = sorted((name for name, x in percent.items() if abs(x) >= WRONG_PCT), key=lambda name: -abs(percent[name]))
    if not wrong:
        return ""
    if len(wrong) == 1:
        return f"{wrong[0]} is {short(percent[wrong[0]])} after 0.5 s."
    return f"{len(wrong)} filters are up to {quantity(abs(percent[wrong[0]]), '%')} off after 0.5 s."


def movements(judged: list[RankedValue]) -> str:
    """How many steps count: fewer than for the lag, for a step that ends early tells no error after it."""
    least, most = (end(j.answer.n for j in judged) for end in (min, max))
    return count(most, "step") if least == most else f"{least} to {count(most, 'step')}"


def still(wrong: list[RankedValue], percent: dict[str, float], of: int) -> str:
    """Rows that show too little or too much of the step, the largest error first."""
    if len(wrong) > NAMED:
        shares = sorted(abs(percent[j.row.name]) for j in wrong)
        ends = f"{number(shares[0], '%')} to {quantity(shares[-1], '%')}"
        return f"{len(wrong)} of {of} filters are off by {ends} of it ({values(wrong)})"
    said = []
    for k, j in enumerate(wrong):
        same = k > 0 and (percent[j.row.name] < 0) == (percent[wrong[k - 1].row.name] < 0)
        text = quantity(abs(percent[j.row.name]), "%") if same else short(percent[j.row.name])
        said.append(f"{j.name} {'' if same else 'is still '}{text} ({j.text})")
    return listed(said) if len({percent[j.row.name] < 0 for j in wrong}) == 1 else "; ".join(said)


def share(judged: RankedValue, window: str) -> float:
    """The error as a signed share of the step, %; 0 where it is not known."""
    answer = judged.row.metrics.get(window, {}).get(STEP_PCT)
    return 0.0 if answer is None or answer.value is None else answer.value


def short(percent: float) -> str:
    """How much of the step is missing or too much."""
    return f"{quantity(abs(percent), '%')} {'short' if percent < 0 else 'too far'}"


def off(judged: list[RankedValue], *, all_of_them: bool) -> str:
    """How far rows are off, in degrees."""
    if len(judged) <= NAMED:
        return f"{listed([j.name for j in judged])} {'is' if len(judged) == 1 else 'are'} off by {values(judged)}"
    return f"{'all ' if all_of_them else ''}{len(judged)} filters are off by {values(judged)}"


def notes(result: Result, lag: ColumnRanking) -> list[str]:
    """The delay of the logged sensors, which is no filter's fault; an attitude from a file has its own clock."""
    answers = [
        row.metrics.get(lag.window, {}).get(LAG)
        for row in result.estimators
        if row.kind == "replay" and "clock" not in row.quality
    ]
    delays = [a.taken_out for a in answers if a is not None and a.taken_out is not None]
    if not delays:
        return []
    delay = max(delays, key=abs)
    if abs(delay) < SHOWN_DELAY_MS:
        return ["No delay of the logged IMU is known; lags are taken as they are."]
    return [f"The logged IMU itself comes {quantity(delay, 'ms', signed=False)} late; that is not counted as lag."]
