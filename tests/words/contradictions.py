"""Does anything that a report says contradict what it shows? Each rule reads the words and looks into the result."""

from __future__ import annotations

import re
from collections.abc import Iterator

from attlog.result import EstimatorRow, Result, Verdict
from attlog.words.answers import EXCLUDES_NOTHING, NO_ANSWER
from attlog.words.names import name_in_sentence, row_names
from attlog.words.numbers import below, number
from attlog.words.ranking import (
    AIR,
    DRIFT_AIR,
    PHASES,
    REST,
    ColumnRanking,
    is_baseline,
    quoted_heading_reference,
    rank_column,
)
from attlog.words.table import main_table
from tests.words.made import DRIFT_REST, HEADING, LAG, NOISE, STEP_PCT, TILT

TROUBLE = ("warning", "fault")
BOUND = re.compile(r"(?:below|up to) ([\d.,]+)(?:°/min| ms)")
OF = re.compile(r"\b[Aa]ll (\d+) (ranked )?filters")
JUMPS = re.compile(r"[Hh]eading jumped|[Aa]ttitude jumped|jumped in (?:heading|tilt)")
NUMBER = re.compile(r"[−+]?<?\d[\d,]*(?:\.\d+)?(?=°|°/min| ms| to [−+]?<?\d[\d.,]*(?:°| ms|\)))")
CODE = re.compile(
    r"\b[a-z]+_[a-z_]+\b|[a-z]@|\bdeg\b|\bNone\b(?! of)|\bnan\b|\+-|-0\.0|\b1 \w+(?:s|es) \w+ed\b|\b1 steps"
)


def contradictions(result: Result) -> list[str]:
    """What is wrong, one line each; empty where nothing is."""
    found: list[str] = []
    messages = {part for row in result.estimators for part in (row.title, row.title.partition(".")[0])}
    for verdict in result.verdicts:
        said = verdict.sentence
        rules = [*leaders(result, verdict), *bounds(result, verdict), *figures(result, verdict)]
        rules += [*counts(result, verdict), *answered(result, verdict)]
        notes = " ".join(verdict.notes)
        for name in sorted(row_names(result).values(), key=len, reverse=True):
            notes = notes.replace(name, "#")
        odd = CODE.finditer(f"{said} {notes}")
        rules += [f"code or id in words: {m[0]!r}" for m in odd if m[0] not in messages]
        found += [f"{verdict.question}: {why} | {said}" for why in rules]
    return [*found, *marks(result), *headline(result), *findings(result)]


def marked(table: dict[str, dict[str, list[str]]], window: str, metric: str) -> set[str]:
    """The rows that the ranking marks in a column."""
    return set(table.get(window, {}).get(metric, ()))


def rows_in(result: Result, text: str) -> set[str]:
    """Ids of the rows that are named in a text; of names that begin alike the longest counts."""
    found = set()
    for row in sorted(result.estimators, key=lambda r: -len(name_in_sentence(r))):
        name = name_in_sentence(row)
        if re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.]*\w)", text):
            found.add(row.name)
            text = text.replace(name, "#")
    return found


def filters(result: Result) -> list[EstimatorRow]:
    """Replayed rows but the baseline."""
    return [row for row in result.estimators if row.kind == "replay" and not is_baseline(row)]


def columns(result: Result, question: str) -> list[ColumnRanking]:
    """The columns of the table that a question is about."""
    air = f"{DRIFT_AIR}.{quoted_heading_reference(result)}"
    asked = {
        "accuracy": [(TILT, AIR), (HEADING, AIR)],
        "noise": [(NOISE, (phase,)) for phase in PHASES],
        "lag": [(LAG, AIR)],
        "yaw_drift": [(DRIFT_REST, REST), (air, AIR)],
    }[question]
    return [rank_column(result, metric, windows) for metric, windows in asked]


def own_column(result: Result, verdict: Verdict) -> ColumnRanking:
    """The column that the sentence is about."""
    return rank_column(result, verdict.metric, (verdict.window,))


def plain(said: str) -> str:
    """A sentence without warnings, doubts and what is added to the answer."""
    said = re.sub(r"^Unreliable, [^:]*: |\(in doubt: [^)]*\)| The IMU itself is .*$|Not ranked \([^)]*\): ", "", said)
    return re.sub(r" (?:[^.;]*|\d+ filters are up to [^.;]*) after 0\.5 s\.$", "", said)


def leaders(result: Result, verdict: Verdict) -> Iterator[str]:
    """Who stands first in accuracy and noise is best in the ranking, and all others are not."""
    if verdict.question not in ("accuracy", "noise") or verdict.sentence.startswith((NO_ANSWER, "Not ranked")):
        return
    said, column = plain(verdict.sentence), own_column(result, verdict)
    best = {j.row.name for j in column.ranked if j.row.name in marked(result.best, verdict.window, verdict.metric)}
    if len(column.ranked) == 1:
        return
    if "(not significant)" in said:
        if best:
            yield "called too close although the ranking marks some"
        return
    as_good = re.match(r"(.*) not significantly worse", said)
    head = as_good[1] if as_good else said.partition(", ")[0]
    counted = re.search(r"(\d+) filters", head)
    named = rows_in(result, head)
    if counted and int(counted[1]) + bool(as_good) != len(best):
        yield f"{counted[0]} called best, ranking says {best}"
    elif not counted and named != best:
        yield f"{named} called best, ranking says {best}"


def bounds(result: Result, verdict: Verdict) -> Iterator[str]:
    """A bound excludes something, and a row without significance stays below it by both ends of its interval."""
    column = own_column(result, verdict)
    for stated in BOUND.findall(re.sub(r" to show even [^;.]*", "", verdict.sentence)):
        value = float(stated.strip(".,").replace(",", ""))
        words = verdict.sentence
        if verdict.question == "yaw_drift" and value > EXCLUDES_NOTHING and not re.search("uncertain|possible", words):
            yield f"the bound {stated} excludes nothing"
    text = re.sub(r"Onboard below .*$", "", plain(verdict.sentence))
    stated = BOUND.findall(text)
    for j in column.ranked if stated else ():
        sure = j.significant and (verdict.question != "lag" or abs(j.value) > j.answer.counts_as_zero_below)
        most = max(map(abs, j.ends))
        if not sure and most > float(stated[-1].strip(".,").replace(",", "")) + 1e-9:
            yield f"{j.name} can be {most:.3g}, said to be below {stated[-1]}"


def counts(result: Result, verdict: Verdict) -> Iterator[str]:
    """ "All 7 filters" are all filters of the table, "5 ranked filters" those that a column ranks."""
    for match in OF.finditer(verdict.sentence):
        n, ranked = int(match[1]), bool(match[2])
        known = {len(filters(result))}
        if ranked:
            known = {len(column.ranked) for column in columns(result, verdict.question)}
        if n not in known:
            yield f"{match[0]!r}, the table has {sorted(known)}"


def figures(result: Result, verdict: Verdict) -> Iterator[str]:
    """Every number of an answer stands in the table, or bounds an interval."""
    if verdict.sentence.startswith(NO_ANSWER):
        return
    known: set[str] = set()
    for column in columns(result, verdict.question):
        for judged in column.judged:
            known |= {number(x, judged.answer.unit).lstrip("+−") for x in (judged.value, *judged.ends)}
            end = below(max(map(abs, judged.ends)), judged.answer.unit)
            known.add(re.sub(r"[^\d.,<]+$", "", end))
    for match in NUMBER.finditer(plain(verdict.sentence)):
        if match[0].lstrip("+−") not in known:
            yield f"{match[0]} is no number of the table"
    for percent in re.findall(r"(\d+) %", verdict.sentence):
        every = [w.get(STEP_PCT) for row in result.estimators for w in row.metrics.values()]
        if percent not in {number(abs(a.value), "%") for a in every if a is not None and a.value is not None}:
            yield f"{percent} % is no error of a step"


def answered(result: Result, verdict: Verdict) -> Iterator[str]:
    """A question is unanswered only if no filter was compared in its column."""
    compared = marked(result.ranked, verdict.window, verdict.metric) - {"gyro"}
    values = {
        r.name for r in result.estimators if r.name in compared and verdict.metric in r.metrics.get(verdict.window, {})
    }
    if verdict.sentence.startswith(NO_ANSWER) and values:
        yield f"said to have no answer, but {sorted(values)} were compared"


def headline(result: Result) -> Iterator[str]:
    """Where nothing went wrong nothing serious is found; what a headline tells, the checks do not deny."""
    serious = [f.text for f in result.findings if f.severity == "serious"]
    serious += [c.text for c in result.checks if c.verdict == "fault"]
    if "Nothing went wrong" in result.headline and serious:
        yield f"headline: nothing went wrong beside: {serious[0]}"
    if result.headline and "never left the ground" in result.headline:
        airborne = (result.log.get("seconds") or {}).get("airborne") or 0.0
        if airborne > 0.0:
            yield f"headline: never left the ground, {airborne} s in the air"
    if "EKF re-aligned yaw" in result.headline and not any(e.kind == "realigned" for e in result.events):
        yield "headline: the yaw was re-aligned, no event says so"
    checks = {c.question: c.verdict for c in result.checks}
    if JUMPS.search(result.headline) and checks.get("attitude_jumps") == "ok":
        yield "headline: a jump, the check says none"


def findings(result: Result) -> Iterator[str]:
    """A finding of a sensor is one that a check of its question found too."""
    asked: dict[str, set[str]] = {}
    for one in result.checks:
        asked.setdefault(one.question, set()).add(one.verdict)
    for finding in result.findings:
        if not finding.is_trouble or not finding.about:
            continue
        verdicts = asked.get(finding.about)
        if verdicts and not verdicts.intersection(TROUBLE):
            yield f"finding: {finding.about} is {sorted(verdicts)} by its checks | {finding.text}"
    compass = [a for a in result.checks if a.question == "compass_heading"]
    if any("heading" in f.text and f.kind == "compass" and f.severity == "serious" for f in result.findings):
        if compass and all(a.verdict == "ok" for a in compass):
            yield "finding: the compass's heading is ok by its check"


def marks(result: Result) -> Iterator[str]:
    """Stars of the table are those of the ranking; the baseline and what was not compared has none."""
    table = main_table(result)
    for row, cells in table.rows:
        for column, cell in zip(table.columns, cells, strict=True):
            if column.metric.startswith(("cost_", "step_gain", "distortion")):
                continue
            if cell.best != (row.name in marked(result.best, column.window, column.metric) - {"gyro"}):
                yield f"star of {row.name} in {column.metric} differs from the ranking"
            if cell.best and (cell.unranked or row.kind != "replay"):
                yield f"{row.name} has a star in {column.metric} and is not ranked"
