"""Which filter is closest to what all are compared with? The tilt error of each row, and its heading error."""

from __future__ import annotations

from attlog.present.contest import ColumnRanking, RankedValue, contest
from attlog.present.names import against_heading, against_whom
from attlog.present.numbers import duration, listed
from attlog.present.sentences.reasons import cannot
from attlog.present.sentences.words import (
    NAMED,
    QuestionWords,
    bars,
    last,
    leading,
    left_out,
    lost,
    lost_part,
    single,
    values,
)
from attlog.present.table.rows import AIR
from attlog.present.text import typeset
from attlog.result import Result, Verdict

TILT, HEADING = "inclination_rmse_deg", "heading_rmse_deg"
ONBOARD_CHECKS = ("onboard against smoother", "onboard against truth")
"""The checks that say whether the onboard attitude is in error."""
HEADING_CHECK = "heading by GNSS"
"""The one that says whether its heading is."""


def accuracy_verdict(result: Result) -> Verdict:
    """The verdict on errors: in flight where there is any, else over the whole log."""
    tilt = contest(result, TILT, AIR)
    heading = contest(result, HEADING, (tilt.window,))
    if tilt.ranked:
        sentence = says(result, tilt, heading)
    elif tilt.filters:
        sentence = unranked(result, tilt, heading)
    else:
        sentence = cannot(result, tilt.absent, "the log holds no attitude to compare with")
    sentence += caveat_part(result)
    return Verdict(
        "accuracy", title(result), sentence, TILT, tilt.window, bars(tilt), left_out(tilt), notes(result, tilt)
    )


def title(result: Result) -> str:
    """What is answered: agreement with what flew is no accuracy."""
    whom = result.reference.choice if result.reference else ""
    return "Accuracy" if whom != "onboard" else "Agreement with onboard"


def says(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """Who is closest in tilt and who is farthest, then the same of the heading, then who lost its way."""
    agrees = result.reference is not None and result.reference.choice == "onboard"
    text = leading(tilt, tilt_words(result, agrees=agrees)) + "."
    text += last(tilt, tilt_words(result, agrees=agrees))
    text += heading_part(result, tilt, heading) + no_north(result, heading) + flew(result, tilt, heading)
    gone = lost_part(lost(result))
    return text + (f" {gone}." if gone else "")


def caveat_part(result: Result) -> str:
    """What the ranking has to say of its reference, as sentences after a blank; empty for nothing."""
    said = typeset(result.reference.caveat) if result.reference else ""
    return "".join(f" {part[0].upper()}{part[1:]}." for part in said.split("; ") if part)


def tilt_words(result: Result, *, agrees: bool) -> QuestionWords:
    """How the tilt error is spoken of: against the onboard attitude it is agreement, not truth."""
    whom = against_whom(result, sigma=True)
    alone, close = f"is the only filter to compare in tilt with {whom}", f" in tilt against {whom}"
    if agrees:
        one, several = (f"{verb} best in tilt with {whom}" for verb in ("agrees", "agree"))
        return QuestionWords(one, several, "agrees least", alone, close)
    return QuestionWords(f"is closest in tilt to {whom}", f"are closest in tilt to {whom}", "is farthest", alone, close)


def unranked(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """The errors where no filter was compared with another: all of them lost, or too little time."""
    whom = against_whom(result, sigma=True)
    sound = [j for j in tilt.filters if j.row.status == "ok"]
    if not sound:
        states = {j.row.status for j in tilt.filters}
        if "not_judged" in states:
            return f"No filter can be judged: {typeset(tilt.filters[0].row.reason)}.{flew(result, tilt, heading)}"
        whole = "All " if len(tilt.filters) == tilt.total else ""
        who = f"{whole}{len(tilt.filters)} filters" if len(tilt.filters) > 1 else tilt.filters[0].name
        how = "diverged from" if "not_converged" not in states else "did not settle near"
        if len(states) > 1:
            how = "diverged from or did not settle near"
        end = "either they or the onboard attitude is wrong" if "onboard" in whom else "none can be judged"
        end = "either they or the smoother is wrong" if "smoother" in whom else end
        return f"{who} {how} {whom}: {end}.{flew(result, tilt, heading)}"
    seconds = duration(max(j.answer.seconds for j in sound))
    spread = f"{alike(sound)} against {whom}"
    if len(sound) <= NAMED:
        spread = f"{listed([f'{j.name} {j.text}{j.interval}' for j in sound])} against {whom}"
    text = f"Filters cannot be ranked over {seconds}: tilt errors are {spread}."
    beside = [j for j in (heading.of(one.row) for one in sound) if j is not None]
    text += f" Heading errors are {alike(beside)}{against_north(result)}." if beside else ""
    text += no_north(result, heading) if beside else ""
    gone = lost_part(lost(result))
    return text + flew(result, tilt, heading) + (f" {gone}." if gone else "")


def alike(judged: list[RankedValue]) -> str:
    """The range of values; of several that are shown alike that they are."""
    text = values(judged, named=False)
    return f"all {text}" if len(judged) > 1 and text == judged[0].text else text


def flew(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """The errors of what flew, where something better is the reference, and whether it is in error."""
    if tilt.onboard is None:
        return ""
    failed = {check.name for check in result.audit if check.verdict == "fault"}
    error = "; it is in error here" if failed.intersection(ONBOARD_CHECKS) else ""
    error = error or ("; its heading is in error" if HEADING_CHECK in failed else "")
    refused = result.reference is not None and "onboard" in result.reference.refused
    error = error or ("; it is in error here" if refused else "")
    beside = f", heading {heading.onboard.text}" if heading.onboard else ""
    return f" Onboard: {tilt.onboard.text}{beside}{error}."


def heading_part(result: Result, tilt: ColumnRanking, heading: ColumnRanking) -> str:
    """The heading error: who leads where it is ranked, else that of the rows that lead in tilt."""
    if heading.ranked:
        words = QuestionWords("is closest", "are closest", "is farthest", "alone can be compared")
        if not heading.best and len(heading.ranked) > 1:
            return f" No significant difference in heading: {values(heading.ranked, named=False)}."
        return f" In heading {leading(heading, words)}.{last(heading, words)}"
    leaders = tilt.best or tilt.ranked
    beside = [j for j in (heading.of(leader.row) for leader in leaders) if j is not None]
    if not beside:
        return ""
    whom = against_north(result)
    if len(beside) == 1:
        return f" Its heading is off by {single(beside[0])}{whom}, not ranked."
    return f" Their headings are off by {values(beside, named=bool(tilt.best))}{whom}, not ranked."


def no_north(result: Result, heading: ColumnRanking) -> str:
    """That headings of filters without a compass are compared with their offset subtracted."""
    if not heading.filters or any(r.uses_mag or r.north_by_gnss for r in result.estimators if r.kind == "replay"):
        return ""
    return " Without a compass they know no north: each heading counts from the start."


def against_north(result: Result) -> str:
    """What headings are compared with, where that is another than what tilt is compared with."""
    shared = result.reference is not None and result.reference.heading_by == "onboard"
    return f" against {against_heading(result, 'onboard')}" if shared else ""


def notes(result: Result, tilt: ColumnRanking) -> list[str]:
    """What an error means here, and over which part of the log."""
    seconds = max((j.answer.seconds for j in tilt.filters), default=0.0)
    where = "in the air" if tilt.window == "airborne" else "over the whole log" if tilt.window == "all" else "armed"
    over = [f"RMS error {where}, {seconds:.0f} s."] if seconds else []
    return ([typeset(result.reference.text)] if result.reference else []) + over
