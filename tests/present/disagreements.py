"""Do headline, findings, checks, sensors, sentences and short answers of a result agree with each other?"""

from __future__ import annotations

import re
from collections.abc import Iterator
from statistics import median

from attlog.present.contest import ColumnRanking, contest
from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.numbers import number
from attlog.present.sentences.brief import brief_answers
from attlog.present.table.rows import AIR, PHASES, REST, is_baseline
from attlog.result import EstimatorRow, Result, Verdict
from tests.present.made import DRIFT_REST, HEADING, LAG, NOISE, TILT

TROUBLE = ("warning", "fault")
ABOUT_NOTHING = 15.0
"""A drift below more than this, deg/min, may be any; a lag that may be any has no value to begin with."""
BOUND = re.compile(r"(?:less than|below) (?:[\d.,]+(?:°/min)? to )?([\d.,]+)°/min")
OF = re.compile(r"\b(?:[Aa]ll|\d+ of) (\d+) (ranked )?filters")
LARGEST = ("is farthest", "agrees least", "has the most noise", "adds the most noise", "lags most", "drifts most")
JUMPS = re.compile(r"[Hh]eading jumped|[Aa]ttitude jumped|jumped in (?:heading|tilt)")
SHORT_NUMBER = re.compile(r"[−+]?<?\d[\d,]*(?:\.\d+)?(?=°|°/min| ms| to [−+]?<?\d[\d.,]*(?:°| ms))")


def disagreements(result: Result) -> Iterator[str]:
    """What is wrong, one line each; nothing where all agree."""
    for verdict in result.verdicts:
        said = verdict.sentence
        for rule in (empty_bounds, largest_of_all, called_wrong):
            yield from (f"{verdict.question}: {why} | {said}" for why in rule(result, verdict))
    sentences = {v.question: v.sentence for v in result.verdicts}
    brief = {q: answer.text for q, answer in brief_answers(result).items()}
    yield from (f"{q}: {why} | {said}" for q, said in brief.items() for why in short(result, q, said))
    for question, said in [*sentences.items(), *brief.items()]:
        yield from (f"{question}: {why} | {said}" for why in counts(result, question, said))
    yield from headline(result)
    yield from findings(result)


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
    return [contest(result, metric, windows) for metric, windows in asked]


def empty_bounds(result: Result, verdict: Verdict) -> Iterator[str]:
    """A bound that excludes nothing is no answer."""
    yield from bounds_of(verdict.sentence)


def bounds_of(said: str) -> Iterator[str]:
    """Bounds in a text that exclude nothing."""
    for bound in BOUND.findall(re.sub(r" to show even [^;.]*", "", said)):
        if float(bound.strip(".,").replace(",", "")) > ABOUT_NOTHING:
            yield f"the bound {bound}°/min excludes nothing"


def largest_of_all(result: Result, verdict: Verdict) -> Iterator[str]:
    """Who is called most or farthest has the largest of all values that are ranked, in the column meant."""
    for clause in re.split(r"(?<=[.;]) ", verdict.sentence):
        words = next((words for words in LARGEST if words in clause), None)
        if words is None:
            continue
        named = clause[: clause.find(words)].strip()
        for column in columns(result, verdict.question):
            called = [j for j in column.ranked if re.search(rf"(?<!\w){re.escape(j.name)}$", named)]
            if called and called[0].text in clause and called[0].size < max(j.size for j in column.ranked):
                yield f"{called[0].name} {words}, beside larger values"
                break


def called_wrong(result: Result, verdict: Verdict) -> Iterator[str]:
    """The onboard attitude is not called in error beside values by which it is better than most filters."""
    if verdict.question != "accuracy" or "in error" not in verdict.sentence:
        return
    metric = HEADING if "heading is in error" in verdict.sentence else TILT
    column = contest(result, metric, (verdict.window,))
    others = [j.size for j in column.filters if j.row.status == "ok"]
    if column.onboard is not None and len(others) > 1 and column.onboard.size < median(others):
        yield f"onboard {column.onboard.text} is called in error and better than most"


def counts(result: Result, question: str, said: str) -> Iterator[str]:
    """ "All 7 filters" are all filters of the table, "5 ranked filters" those that a column ranks."""
    for match in OF.finditer(said):
        n, ranked = int(match[1]), bool(match[2])
        known = {len(filters(result))}
        if ranked:
            known = {len(column.ranked) for column in columns(result, question)}
        if n not in known:
            yield f"{match[0]!r}, the table has {sorted(known)}"


def short(result: Result, question: str, said: str) -> Iterator[str]:
    """Every number of a short answer stands in the table, or bounds an interval."""
    yield from bounds_of(said)
    if "Cannot be determined" in said:
        return
    known: set[str] = set()
    for column in columns(result, question):
        for judged in column.judged:
            known |= {number(x, judged.answer.unit).lstrip("+−") for x in (judged.value, *judged.ends)}
    bounds = {m[1] for m in re.finditer(r"(?:below|up to) ([\d.,]+)", said)}
    text = re.sub(r"^Unreliable, [^:]*: |\(in doubt: [^)]*\)| The IMU itself is .*$|Not ranked \([^)]*\): ", "", said)
    for match in SHORT_NUMBER.finditer(text):
        if match[0].lstrip("+−") not in known and match[0] not in bounds:
            yield f"{match[0]} is no number of the table"


def headline(result: Result) -> Iterator[str]:
    """Where nothing went wrong nothing serious is found; what a headline tells, the checks do not deny."""
    serious = [f.text for f in result.findings if f.severity == "serious"]
    serious += [c.text for c in result.audit if c.verdict == "fault"]
    serious += [a.text for a in result.health if a.verdict == "fault"]
    if "Nothing went wrong" in result.headline and serious:
        yield f"headline: nothing went wrong beside: {serious[0]}"
    if result.headline and "never left the ground" in result.headline:
        airborne = (result.log.get("seconds") or {}).get("airborne") or 0.0
        if airborne > 0.0:
            yield f"headline: never left the ground, {airborne} s in the air"
    if "EKF re-aligned yaw" in result.headline and not any(e.kind == "realigned" for e in result.events):
        yield "headline: the yaw was re-aligned, no event says so"
    checks = {c.name: c.verdict for c in result.audit}
    if JUMPS.search(result.headline) and checks.get("attitude jumps") == "ok":
        yield "headline: a jump, the check says none"


def findings(result: Result) -> Iterator[str]:
    """A finding of a sensor is one that its check, or the question about it, found too."""
    checks = {c.name: c.verdict for c in result.audit}
    asked: dict[str, set[str]] = {}
    for one in result.health:
        asked.setdefault(one.question, set()).add(one.verdict)
    for finding in result.findings:
        if not finding.is_trouble or not finding.about:
            continue
        if checks.get(finding.about) == "ok":
            yield f"finding: {finding.about} is ok by its check | {finding.text}"
        verdicts = asked.get(finding.about)
        if verdicts and not verdicts.intersection(TROUBLE):
            yield f"finding: {finding.about} is {sorted(verdicts)} by the sensors' table | {finding.text}"
    compass = [a for a in result.health if a.question == "compass_heading"]
    if any("heading" in f.text and f.kind == "compass" and f.severity == "serious" for f in result.findings):
        if compass and all(a.verdict == "ok" for a in compass):
            yield "finding: the compass's heading is ok by the sensors' table"
