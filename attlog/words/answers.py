"""The four answers of a result: one sentence each, with notes.

Notes describe the measurement and rows that are not ranked. Sentences are derived from the ranking of the table, so
they cannot contradict its stars. A drift or lag whose interval includes zero is reported as below the larger end of its
interval.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from attlog.core.brief import first_part
from attlog.health.gravity import is_usable_gravity
from attlog.result import Check, EstimatorRow, Result, Verdict
from attlog.words.names import (
    NOT_JUDGED,
    against_heading,
    against_whom,
    is_against_onboard,
    name_in_sentence,
    row_names,
)
from attlog.words.numbers import below, between, counted, duration, listed, moment, quantity
from attlog.words.ranking import (
    AIR,
    DRIFT_AIR,
    PHASES,
    REST,
    ColumnRanking,
    MissingValue,
    RankedValue,
    is_baseline,
    quoted_heading_reference,
    rank_column,
    reason_unranked,
)
from attlog.words.text import typeset

# Names of the questions, in the order of the page.
QUESTIONS = {"accuracy": "accuracy", "noise": "noise", "lag": "lag", "yaw_drift": "yaw drift"}
TILT, NOISE, LAG, DRIFT_REST = "tilt_rmse_deg", "noise_tilt_deg", "lag_ms", "drift_rest_deg_per_min"
STEP_DEG, STEP_PCT = "step_error_deg.0.5s", "step_error_pct.0.5s"
# Moving flight (not hover) is the phase ``cruise``.
PHASE_WORDS = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
# Start of an answer without any value.
NO_ANSWER = "Cannot be determined: "
NO_FILTER_RAN = "no filter was run"
ONLY_BASELINE = "only Gyro was run, which is never ranked"
# Error of a step, %, from which a filter is called short of it or beyond it.
WRONG_PCT = 10.0
# Largest informative bound of a drift, deg/min: an uncalibrated warm gyro drifts as much (0.25 deg/s).
EXCLUDES_NOTHING = 15.0
# Delays of the IMU below this are not reported, ms.
SHOWN_DELAY_MS = 0.5
# Rows named in a note; more are counted.
NAMED = 3
# Sensors that every filter needs: check -> meaning of its fault.
SPOILING_CHECKS = {
    "gyro_bias": "the gyro is wrong",
    "accelerometer_dead": "the accelerometer is wrong",
    "accelerometer_rest": "the accelerometer is wrong",
    "accelerometer_axes": "the accelerometer is wrong",
}
# Advice to the pilot for codes whose reason contains none.
ADVICE = {
    "no_events": "Fly some brisk steps in roll, pitch and yaw.",
    "too_few_events": "Fly some more brisk steps in roll, pitch and yaw.",
}


class AnswerLine(NamedTuple):
    """Answer from a column of the table.

    ``onboard`` and ``remark``: additional sentences, or empty. ``where``: start of ``text`` that names quantity or
    phase.
    """

    text: str
    column: ColumnRanking
    onboard: str = ""
    remark: str = ""
    notes: tuple[str, ...] = ()
    where: str = ""

    @property
    def answered(self) -> bool:
        """True if there is a value."""
        return not self.text.startswith(NO_ANSWER)

    @property
    def sentence(self) -> str:
        """The whole answer."""
        return " ".join(filter(None, (self.text, self.onboard, self.remark)))

    @property
    def beside_values(self) -> str:
        """The answer beside its values, which have quantity, phase and the onboard row."""
        return " ".join(filter(None, (_capital(self.text.removeprefix(self.where).lstrip()), self.remark)))

    def within(self, width: int) -> str:
        """Return the answer, with the onboard value if it fits into ``width`` characters."""
        both = f"{self.text} {self.onboard}".strip()
        return both if len(both) <= width else self.text


def verdicts(result: Result) -> list[Verdict]:
    """Return the four answers in the order of the page."""
    return [
        Verdict(
            question, line.sentence, line.column.metric, line.column.window, bool(line.column.filters), list(line.notes)
        )
        for question, line in answer_lines(result).items()
    ]


def answer_lines(result: Result) -> dict[str, AnswerLine]:
    """Return the answers by question, marked unreliable if a sensor has a fault."""
    found = {"accuracy": _accuracy(result), "noise": _noise(result), "lag": _lag(result), "yaw_drift": _drift(result)}
    check = spoiling_check(result)
    if check is None:
        return found
    wrong = SPOILING_CHECKS[check.question]
    note = f"{_capital(wrong)}: {typeset(check.text.rstrip('.'))}."
    lines = {question: line._replace(notes=(note, *line.notes)) for question, line in found.items()}
    return {
        question: line._replace(text=f"Unreliable, {wrong}: {line.text}", onboard="") if line.answered else line
        for question, line in lines.items()
    }


def spoiling_check(result: Result) -> Check | None:
    """Return the first fault of a sensor that every filter needs.

    A subtracted gyro bias does not count if rows were judged all the same.
    """
    judged = all(row.status != "not_judged" for row in result.estimators)
    mended = judged and any(bias.dps is not None for bias in result.gyro_bias)
    faults = [c for c in result.checks if c.verdict == "fault" and c.in_use and c.question in SPOILING_CHECKS]
    faults = [c for c in faults if c.question != "accelerometer_rest" or not is_usable_gravity(c.value or 0.0)]
    return next((check for check in faults if not (mended and check.question == "gyro_bias")), None)


def _accuracy(result: Result) -> AnswerLine:
    """Answer with the tilt error in flight, else over the whole log."""
    tilt = rank_column(result, TILT, AIR)
    line = _unranked(tilt, "tilt ")
    if tilt.ranked:
        line = AnswerLine(f"Tilt: {_compared(tilt)}.", tilt, _onboard_value(tilt), where="Tilt:")
    notes = []
    reference = result.reference
    if reference is not None:
        notes = [typeset(reference.text)]
        notes += [f"{part[0].upper()}{part[1:]}." for part in typeset(reference.caveat).split("; ") if part]
        if reference.heading_by == "onboard":
            notes.append(f"Headings are compared with {against_heading(result, 'onboard')}.")
    seconds = max((j.answer.seconds for j in tilt.filters), default=0.0)
    if seconds:
        where = {"airborne": "in the air", "all": "over the whole log"}.get(tilt.window, "armed")
        notes.append(f"RMS error {where}, {seconds:.0f} s, against {against_whom(result, sigma=True)}.")
    replayed = [row for row in result.estimators if row.kind == "replay"]
    if tilt.filters and not any(row.uses_mag or row.north_by_gnss for row in replayed):
        notes.append("Without a compass filters know no north: each heading counts from the start.")
    return line._replace(notes=(*notes, *reason_notes(result, [("", tilt)])))


def _noise(result: Result) -> AnswerLine:
    """Answer with the first phase in which filters were compared."""
    phases = [rank_column(result, NOISE, (phase,)) for phase in PHASES]
    shown = [found for found in phases if found.filters]
    lead = next((found for found in phases if found.ranked), (shown or phases)[0])
    notes = [
        f"{_capital(PHASE_WORDS[found.window])}: {counted(max(j.answer.n for j in found.filters), 'window')} of 5 s."
        for found in shown
    ]
    notes += [f"The gyro's own noise is about {own}." for own in (gyro_noise(lead),) if own]
    notes += reason_notes(result, [("", lead)])
    if not lead.ranked:
        return _unranked(lead)._replace(notes=(*advice(result, lead), *notes))
    where = PHASE_WORDS[lead.window]
    where = _capital(where) if lead.window == "rest" else f"Added {where}:"
    return AnswerLine(f"{where} {_compared(lead)}.", lead, _onboard_value(lead), notes=tuple(notes), where=where)


def gyro_noise(found: ColumnRanking) -> str:
    """Return the gyro noise floor if a ranked row is below it, else empty."""
    share = max((j.answer.gyro_share for j in found.ranked), default=0.0)
    return quantity(float(f"{share:.1g}"), "deg") if any(j.value < share for j in found.ranked) else ""


def _lag(result: Result) -> AnswerLine:
    """Answer with the significant lags, largest first, and a bound for all others."""
    lag = rank_column(result, LAG, AIR)
    notes = (*imu_delay_notes(result, lag), *reason_notes(result, [("", lag)]))
    if not lag.ranked:
        return _unranked(lag)._replace(notes=(*advice(result, lag), *notes))
    moved = [j for j in lag.ranked if j.significant and abs(j.value) > j.answer.counts_as_zero_below][::-1]
    rest = [j for j in lag.ranked if j not in moved]
    steps = counted(max(j.answer.n for j in lag.ranked), "step")
    if is_against_onboard(result) and not rest and all(j.value < 0.0 for j in moved):
        least, most = (quantity(-j.value, "ms", signed=False) for j in (moved[-1], moved[0]))
        text = f"{_who(moved, lag)} {between(least, most)} ahead of onboard"
    else:
        text = _significant(moved, rest, lag)
    text = f"{_capital(text)} ({steps}).{late_imu(result)}"
    return AnswerLine(text, lag, _onboard_value(lag), step_remark(result), notes)


def late_imu(result: Result) -> str:
    """Report an IMU with more delay than its filters have."""
    for check in result.checks:
        if check.question == "imu_delay" and check.is_trouble and check.value is not None:
            if check.value > 0.0:
                return f" The IMU itself is {quantity(check.value, 'ms', signed=False)} late, and every filter with it."
    return ""


def imu_delay_notes(result: Result, lag: ColumnRanking) -> list[str]:
    """Report the delay of the logged IMU, ignoring attitudes with their own clock."""
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


def step_remark(result: Result) -> str:
    """Report the filter with the largest error 0.5 s after a step.

    Of several filters report their number; empty where all errors are below WRONG_PCT. A filter with a wrong angle may
    still have no lag.
    """
    step = rank_column(result, STEP_DEG, AIR)
    percent = {j.name: _step_share(j, step.window) for j in step.filters if j.row.status == "ok"}
    wrong = sorted((name for name, x in percent.items() if abs(x) >= WRONG_PCT), key=lambda name: -abs(percent[name]))
    if not wrong:
        return ""
    most = percent[wrong[0]]
    if len(wrong) == 1:
        return f"{wrong[0]} is {quantity(abs(most), '%')} {'short' if most < 0 else 'too far'} after 0.5 s."
    return f"{len(wrong)} filters are up to {quantity(abs(most), '%')} off after 0.5 s."


def _step_share(judged: RankedValue, window: str) -> float:
    """Return the error as a signed share of the step, %; 0 if missing."""
    answer = judged.row.metrics.get(window, {}).get(STEP_PCT)
    return 0.0 if answer is None or answer.value is None else answer.value


def _drift(result: Result) -> AnswerLine:
    """Answer with the drift at rest, else in the air."""
    reference = quoted_heading_reference(result)
    rest, air = rank_column(result, DRIFT_REST, REST), rank_column(result, f"{DRIFT_AIR}.{reference}", AIR)
    where, found = ("At rest", rest) if rest.ranked or not air.ranked else ("In flight", air)
    notes = (*rest_notes(result, rest), *reason_notes(result, [("at rest, ", rest), ("in the air, ", air)]))
    if not found.ranked:
        line = _unranked(rest if rest.filters or not air.filters else air)
        return line._replace(notes=(*advice(result, rest), *notes))
    drifting = [j for j in found.ranked if j.significant][::-1]
    still = [j for j in found.ranked if not j.significant]
    against = against_heading(result, reference) if found is air else ""
    doubt = f"against {against}: " if "in doubt" in against else ""
    text = _significant(drifting, still, found)
    if still and max(abs(end) for j in still for end in j.ends) > EXCLUDES_NOTHING:
        possible = f"up to {bound_text(still)}"
        text = f"{_span(drifting)}; others uncertain ({possible})" if drifting else f"uncertain, {possible} is possible"
    return AnswerLine(f"{where} {doubt}{text}.", found, _onboard_drift(found), notes=notes, where=where)


def rest_notes(result: Result, rest: ColumnRanking) -> list[str]:
    """Describe every rest, its usable part, and the earth's own turn."""
    rows = [j.answer for j in rest.filters] or [
        a.row.metrics[rest.window][rest.metric] for a in rest.absent if a.row.kind == "replay"
    ]
    if not rows:
        return []
    usable = [typeset(r.reason) if r.reason else f"{duration(r.usable_s)} usable" for r in rows[0].records]
    spans = [f"Rest from {moment(r.t0)} to {moment(r.t1)}" for r in rows[0].records]
    notes = [f"{span}: {what}." for span, what in zip(spans, usable, strict=True)]
    turn = (result.log.get("place") or {}).get("earth_turn_deg_per_min")
    return notes + ([] if turn is None else [f"The earth itself turns by {quantity(turn, 'deg/min')} here."])


def _compared(found: ColumnRanking) -> str:
    """List the rows that no row is significantly better than, then all others."""
    ranked, best = found.ranked, found.best
    if len(ranked) == 1:
        alone = " alone is ranked:" if found.total > 1 else ""
        return f"{ranked[0].name}{alone} {ranked[0].text}{ranked[0].interval}"
    if not best:
        return f"{_who(ranked, found)} {_range(ranked)} (not significant)"
    others = [j for j in ranked if j not in best]
    leaders = f"{_counted(best)} best ({_range(best)})" if len(best) > 1 else _span(best)
    if not others:
        return leaders
    rest, verb = (others[0].name, "is") if len(others) == 1 else ("others", "are")
    equal = best[1:]
    if equal and (equal[-1].size >= others[0].size or equal[-1].text == others[0].text):
        # A large uncertain value is not significantly worse where a smaller, sure one is.
        leaders = f"{_span(best[:1])}, {_counted(equal)} not significantly worse ({_range(equal)})"
        return f"{leaders}, {rest} {verb} ({_range(others)})"
    return f"{leaders}, {rest} {_range(others)}"


def _significant(beyond: list[RankedValue], still: list[RankedValue], found: ColumnRanking) -> str:
    """List rows with a significant value, and a bound for all others."""
    parts = [_span(beyond)] if beyond else []
    return "; ".join([*parts, f"{_who(still, found)} below {bound_text(still)}"] if still else parts)


def _who(judged: list[RankedValue], found: ColumnRanking) -> str:
    """Name one or two rows; count more, or write "all" for all compared rows."""
    if len(judged) > 2:
        return f"all {found.compared}" if len(judged) == len(found.ranked) else f"{len(judged)} filters"
    return listed([j.name for j in judged])


def _span(judged: list[RankedValue]) -> str:
    return f"{_counted(judged)} {_range(judged)}"


def _counted(judged: list[RankedValue]) -> str:
    """Name one or two rows; count more."""
    return listed([j.name for j in judged]) if len(judged) <= 2 else f"{len(judged)} filters"


def _range(judged: list[RankedValue]) -> str:
    ends = sorted(judged, key=lambda j: j.value)
    return between(ends[0].text, ends[-1].text)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def bound_text(judged: list[RankedValue]) -> str:
    """Return the largest end of the intervals of these rows, rounded up."""
    return below(max(abs(end) for j in judged for end in j.ends), judged[0].answer.unit)


def _onboard_value(found: ColumnRanking) -> str:
    """Return the value of the onboard attitude, unless all were compared with it."""
    return f"Onboard {found.onboard.text}." if found.onboard is not None else ""


def _onboard_drift(found: ColumnRanking) -> str:
    """Return the onboard drift if significant, else an informative bound, else nothing."""
    onboard = found.onboard
    if onboard is None or onboard.significant:
        return _onboard_value(found)
    return "" if max(map(abs, onboard.ends)) > EXCLUDES_NOTHING else f"Onboard below {bound_text([onboard])}."


def _unranked(found: ColumnRanking, what: str = "") -> AnswerLine:
    """Return why filters were not compared, with their values."""
    sound = [j for j in found.filters if j.row.status == "ok"]
    if sound:
        why = typeset(first_part(reason_unranked(sound[0]), ":")).removesuffix(" to rank")
        lost = [j for j in found.filters if j.row.status == "diverged"]
        gone = f"; {_counted(lost)} diverged" if lost else ""
        return AnswerLine(f"Not ranked ({why}): {what}{_range(sound)}{gone}.", found, _onboard_value(found))
    rows = [j.row for j in found.filters] + [a.row for a in found.absent if a.row.kind == "replay"]
    rows = [row for row in rows if not is_baseline(row)]
    if len(rows) == found.total > 1 and rows[0].status != "ok" and all(row.status == rows[0].status for row in rows):
        why = typeset(rows[0].reason) if rows[0].status == "not_judged" else ""
        return AnswerLine(f"{NO_ANSWER}{why or f'all {len(rows)} filters {NOT_JUDGED[rows[0].status]}'}.", found)
    nothing = ONLY_BASELINE if any(is_baseline(j.row) for j in found.judged) else NO_FILTER_RAN
    why = reasons_unranked(found) if found.filters else commonest_reason(found.absent)[1] or nothing
    return AnswerLine(f"{NO_ANSWER}{first_part(why, ';')}.", found, _onboard_value(found))


def advice(result: Result, found: ColumnRanking) -> list[str]:
    """Return advice to the pilot for an answer from the next log."""
    code, _ = commonest_reason(found.absent)
    if code in ("no_rest", "rest_too_short"):
        rest = str((result.log.get("advice") or {}).get("rest") or "").rstrip(".")
        return [f"{rest}."] if rest else []
    flew = ((result.log.get("seconds") or {}).get("airborne") or 0.0) > 0
    return [ADVICE[code]] if code in ADVICE and flew else []


def commonest_reason(without: list[MissingValue]) -> tuple[str, str]:
    """Return the most frequent code and reason among filters.

    Baseline and onboard rows count only if there are no filters.
    """
    filters = [a for a in without if a.row.kind == "replay" and not is_baseline(a.row)]
    given = [(a.code, reason_absent(a.row, a.reason)) for a in filters or without]
    reasons = Counter((code, reason) for code, reason in given if reason and code != "not_applicable")
    reasons = reasons or Counter((code, reason) for code, reason in given if reason)
    if not reasons:
        return "", ""
    code, reason = reasons.most_common(1)[0][0]
    reason = typeset(reason.rstrip("."))
    return code, reason[0].lower() + reason[1:] if reason[:2].istitle() else reason


def reasons_unranked(found: ColumnRanking) -> str:
    """List filters that are not ranked with short reasons, grouped by reason."""
    groups: dict[str, list[str]] = {}
    for judged in found.filters:
        if not judged.ranked:
            short = first_part(reason_unranked(judged), ":", ";", ",")
            groups.setdefault(NOT_JUDGED.get(judged.row.status, typeset(short)), []).append(judged.name)
    for absent in found.absent:
        if absent.row.kind == "replay" and not is_baseline(absent.row):
            short = NOT_JUDGED.get(absent.row.status) or NOT_JUDGED.get(absent.code) or typeset(absent.reason)
            groups.setdefault(short, []).append(name_in_sentence(absent.row))
    several = {why: why.replace("does not", "do not") if len(names) > 1 else why for why, names in groups.items()}
    return ", ".join(f"{few_or_count(names)} ({several[why]})" for why, names in groups.items())


def few_or_count(names: list[str]) -> str:
    """Name up to NAMED filters; count more."""
    return listed(names) if len(names) <= NAMED else f"{len(names)} filters"


def reason_absent(row: EstimatorRow, reason: str) -> str:
    """Return why a row has no value; a failure of the filter comes first."""
    return row.reason if row.status == "failed" and row.reason else reason


def reason_notes(result: Result, columns: list[tuple[str, ColumnRanking]]) -> list[str]:
    """List rows without a ranked value, grouped by reason.

    ``columns``: (situation, column), the situation begins its reasons. The reference itself is left out.
    """
    groups: dict[str, list[str]] = {}
    for situation, found in columns:
        absent = [(a.row.name, situation + reason_absent(a.row, a.reason)) for a in found.absent]
        unranked = [(j.row.name, situation + reason_unranked(j)) for j in found.judged if j.replay and not j.ranked]
        for name, reason in absent + unranked:
            if not reason.endswith("itself"):
                groups.setdefault(typeset(reason.rstrip(".")), []).append(name)
    names, replayed = row_names(result), {row.name for row in result.estimators if row.kind == "replay"}
    notes = []
    for reason, who in groups.items():
        every = len(who) > 1 and replayed <= set(who)
        notes.append(f"{'All filters' if every else listed([names.get(w, w) for w in who])}: {reason}.")
    return notes
