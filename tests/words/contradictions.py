"""Does anything that a report says contradict what it shows? Each rule reads the words and looks into the result."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from statistics import median

from attlog.result import Answer, EstimatorRow, Result, Verdict
from attlog.words.answers import brief_answers, caveat_part, not_ranked
from attlog.words.names import name_in_sentence
from attlog.words.numbers import below, number, quantity
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
from tests.words.made import DRIFT_AIR as made_DRIFT_AIR
from tests.words.made import DRIFT_REST, HEADING, LAG, NOISE, STEP, STEP_PCT, TILT

# Do headline, findings, checks, sensors, sentences and short answers of a result agree with each other?

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
    return [rank_column(result, metric, windows) for metric, windows in asked]


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
    column = rank_column(result, metric, (verdict.window,))
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


PHASE_WORDS = {"at rest": "rest", "in hover": "hover", "in moving flight": "cruise", "with motors idling": "idle"}
NO_ANSWER = ("Cannot be judged", "No filter can be ranked", "No filter's lag can be judged")
CODE = re.compile(
    r"\b[a-z]+_[a-z_]+\b|[a-z]@|\bdeg\b|\bNone\b(?! of)|\bnan\b|\+-|-0\.0|\b1 \w+(?:s|es) \w+ed\b|\b1 steps"
)
NUMBER = re.compile(r"[−+]?<?\d[\d,]*(?:\.\d+)?(?=°|°/min| ms| %|(?: to [−+]?<?\d[\d.,]*)(?:°|\)| %|;| ms)|\))")
COUNT = re.compile(r"(\d+) of (\d+) (?:ranked )?filters|All (\d+) (?:ranked )?filters")


def contradictions(result: Result) -> list[str]:
    """What is wrong, one line each; empty where nothing is."""
    found: list[str] = []
    messages = {row.title for row in result.estimators}
    for verdict in result.verdicts:
        said = verdict.sentence
        rules = [*superlatives(result, verdict), *bounds(result, verdict), *figures(result, verdict)]
        rules += undetermined(result, verdict) if verdict.question == "yaw_drift" else []
        rules += [*answered(result, verdict), *bars(result, verdict), *heading_references(result, verdict)]
        odd = CODE.finditer(" ".join([said, *verdict.notes]))
        rules += [f"code or id in words: {m[0]!r}" for m in odd if m[0] not in messages]
        found += [f"{verdict.question}: {why} | {said}" for why in rules]
    return found + list(marks(result)) + list(disagreements(result))


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


def superlatives(result: Result, verdict: Verdict) -> Iterator[str]:
    """Best and worst in words are best and worst in the ranking, in the column that the words are about."""
    said = verdict.sentence
    for clause in re.split(r"(?<=[.;]) (?=[A-Z0-9a-z])", said):
        for kind, metric, window in claims(verdict, clause, said):
            best, worst = marked(result.best, window, metric), marked(result.worst, window, metric)
            head = clause[: clause.find(kind)] if kind not in ("Least: ",) else clause[clause.find(kind) :]
            head = re.sub(r"^.*after a step ", "", head)
            named, counted = rows_in(result, head), COUNT.search(head)
            compared = marked(result.ranked, window, metric)
            if kind in WORST:
                if named != worst:
                    yield f"{named} called worst, ranking says {worst}"
            elif counted:
                if int(counted[1] or counted[3]) != len(best & compared):
                    yield f"{counted[0]} called best, ranking says {best}"
            elif metric == STEP:
                if named != before_the_first_worse(result, metric, window, best):
                    yield f"{named} called least off, ranking says {best}"
            elif named != best - {"gyro"}:
                yield f"{named} called best, ranking says {best}"
    if "No significant difference" in said.split(". ")[0] and marked(result.best, verdict.window, verdict.metric):
        yield "called too close although the ranking marks some"


def before_the_first_worse(result: Result, metric: str, window: str, best: set[str]) -> set[str]:
    """The best rows with smaller values than all rows that are significantly worse."""
    values = {
        row.name: answer.value
        for row in result.estimators
        if row.kind == "replay"
        and row.estimator != "gyro"
        and row.status == "ok"
        and (answer := row.metrics.get(window, {}).get(metric)) is not None
        and answer.value is not None
    }
    least_worse = min((value for name, value in values.items() if name not in best), default=math.inf)
    return {name for name, value in values.items() if name in best and value <= least_worse}


BEST = (
    *("is closest", "are closest", "agrees best", "agree best"),
    *("has the least noise", "have the least noise", "adds the least noise", "add the least noise"),
)
WORST = ("is farthest", "agrees least", "has the most noise", "adds the most noise", "lags most", "drifts most")


def claims(verdict: Verdict, clause: str, said: str) -> Iterator[tuple[str, str, str]]:
    """(words, metric, window) of every superlative in a clause."""
    air = "airborne" if verdict.question != "accuracy" else verdict.window
    heading = said.find("In heading")
    after = heading >= 0 and said.find(clause) >= heading
    metric = {"accuracy": HEADING if after else TILT, "noise": NOISE, "lag": LAG}.get(verdict.question, "")
    window = verdict.window if verdict.question in ("accuracy", "noise", "lag") else air
    if verdict.question == "yaw_drift":
        rest = "In the air against" not in said[: said.find(clause) + len(clause)]
        metric, window = (DRIFT_REST, "rest") if rest else (drift_metric(said), "airborne")
    for words in (*BEST, *WORST):
        if words in clause:
            yield words, metric, window
    if verdict.question == "lag" and (m := re.search(r"(?:is|are) least off", clause)):
        yield m[0], STEP, verdict.window
    if verdict.question == "yaw_drift" and "Least: " in clause:
        yield "Least: ", metric, window
    if verdict.question == "noise" and " least," in clause:
        phase = next((p for words, p in PHASE_WORDS.items() if clause.lower().startswith(words)), None)
        if phase:
            yield " least,", NOISE, phase


def drift_metric(said: str) -> str:
    """The column of the heading reference that a sentence quotes."""
    words = {"truth": "truth", "smoother": "smoother", "GNSS heading": "gnss_yaw", "yaw estimator": "yaw_estimator"}
    words |= {"onboard": "onboard", "magnetometer": "mag", "GNSS course": "course"}
    air = said[said.find("In the air against") :].partition(",")[0]
    return f"{made_DRIFT_AIR}.{next(key for word, key in words.items() if word in air)}"


def bounds(result: Result, verdict: Verdict) -> Iterator[str]:
    """A row without significance stays below the number that is said, by both ends of its interval."""
    said = verdict.sentence
    unit, metric = {"lag": ("ms", LAG), "yaw_drift": ("deg/min", "")}.get(verdict.question, ("", ""))
    for part in re.split(r"(?=In the air against)", said):
        stated = re.findall(r"less than (?:[\d.,]+°/min to )?([\d.,]+)", part)
        if not stated or not unit:
            continue
        column = metric or (drift_metric(said) if part.startswith("In the air against") else DRIFT_REST)
        window = "rest" if column == DRIFT_REST else verdict.window if column == LAG else "airborne"
        for row in result.estimators:
            answer = row.metrics.get(window, {}).get(column)
            compared = row.name in marked(result.ranked, window, column) and row.estimator != "gyro"
            if not compared or answer is None or answer.value is None or answer.ci95 is None:
                continue
            sure = not answer.ci95[0] <= 0 <= answer.ci95[1]
            if column == LAG:
                sure = sure and abs(answer.value) > answer.counts_as_zero_below
            if not sure and max(map(abs, answer.ci95)) > float(stated[-1].replace(",", "")) + 1e-9:
                yield f"{row.name} can be {max(map(abs, answer.ci95)):.3g}, said to be less than {stated[-1]}"


def undetermined(result: Result, verdict: Verdict) -> Iterator[str]:
    """A row that cannot be determined has no value, and neither bound nor drift is said of it."""
    for m in re.finditer(r"[Cc]annot be determined for ([^:]*):", verdict.sentence):
        part = next(p for p in re.split(r"(?=In the air against)", verdict.sentence) if m[0] in p)
        column = drift_metric(part) if part.startswith("In the air against") else DRIFT_REST
        for name in rows_in(result, m[1]):
            row = next(r for r in result.estimators if r.name == name)
            answer = row.metrics.get("airborne" if column != DRIFT_REST else "rest", {}).get(column)
            if answer is None or answer.code != "too_uncertain":
                yield f"{name} could be determined"


def figures(result: Result, verdict: Verdict) -> Iterator[str]:
    """Every number in a sentence is a number of the columns that it is about, or the sigma of what is compared with."""
    if any(words in verdict.sentence for words in NO_ANSWER):
        return
    known = {text for row in result.estimators for text in numbers_of(row, verdict.question)}
    own = result.reference.sigma_tilt_deg if result.reference is not None and verdict.question == "accuracy" else None
    known |= set() if own is None else {number(own, "deg", False)}
    shares = {a.gyro_share for row in result.estimators for m in row.metrics.values() for a in m.values()}
    known |= {number(float(f"{share:.1g}"), "deg") for share in shares} if verdict.question == "noise" else set()
    said = re.sub(r"^Unreliable, .*?\. (?=[A-Z])", "", verdict.sentence)
    said = said.removesuffix(caveat_part(result))  # the reference's own numbers
    said = re.sub(r" to show even [^;.]*", "", said)  # what is known without the log
    for m in NUMBER.finditer(said):
        if m[0].lstrip("+−") not in known and m[0] not in known:
            yield f"{m[0]} is no number of the table"


def numbers_of(row: EstimatorRow, question: str) -> Iterator[str]:
    """The values and interval ends of a row as they are written, without sign too."""
    wanted = {
        "accuracy": (TILT, HEADING),
        "noise": (NOISE, TILT),
        "lag": (LAG, STEP, STEP_PCT),
        "yaw_drift": (DRIFT_REST, made_DRIFT_AIR),
    }[question]
    for window in row.metrics.values():
        for metric, answer in window.items():
            if metric.startswith(wanted) and answer.value is not None:
                yield from written(answer)


def written(answer: Answer) -> Iterator[str]:
    """An answer's numbers as text."""
    ends = [abs(x) for x in answer.ci95 or ()]
    values = [answer.value, *(answer.ci95 or ()), *(answer.disagree or ()), *(answer.changes or ())]
    for value in (v for v in values if v is not None):
        yield number(value, answer.unit)
        yield number(abs(value), answer.unit, False)
    for end in [max(ends)] if ends else []:
        yield re.sub(r"[^\d.,<]+$", "", below(end, answer.unit))
    if answer.value is not None and not ends:
        yield re.sub(r"[^\d.,<]+$", "", below(answer.value, answer.unit))


def answered(result: Result, verdict: Verdict) -> Iterator[str]:
    """A question is unanswered only if no filter was compared in its column."""
    cannot = verdict.sentence.startswith(("Cannot be judged", "No filter can be ranked"))
    compared = marked(result.ranked, verdict.window, verdict.metric) - {"gyro"}
    values = {
        r.name for r in result.estimators if r.name in compared and verdict.metric in r.metrics.get(verdict.window, {})
    }
    if cannot and values:
        yield f"said to have no answer, but {sorted(values)} were compared"


def bars(result: Result, verdict: Verdict) -> Iterator[str]:
    """Bars have the numbers of the table, and are pale where the table says that a value is not ranked."""
    table = main_table(result)
    at = [i for i, c in enumerate(table.columns) if (c.metric, c.window) == (verdict.metric, verdict.window)]
    if verdict.bars and not at:
        yield "bars without a column"
    pale = not_ranked(verdict)
    for row, cells in table.rows if at else []:
        cell, bar = cells[at[0]], next((b for b in verdict.bars if b[0] == row.name), None)
        if bar is None:
            if not cell.missing and (row.kind == "replay" or (row.name == "onboard" and verdict.bars)):
                yield f"{row.name} has a value and no bar"
            continue
        if number(bar[1], bar[2]) != cell.text:
            yield f"bar of {row.name} says {quantity(bar[1], bar[2])}, the table {cell.text}"
        if row.kind == "replay" and (row.name in pale) != cell.unranked:
            yield f"bar of {row.name} is {'pale' if row.name in pale else 'full'}, its cell is not"


def heading_references(result: Result, verdict: Verdict) -> Iterator[str]:
    """With truth no other heading reference is in the sentence."""
    said = verdict.sentence
    if verdict.question != "yaw_drift" or "In the air against" not in said:
        return
    truth = f"{made_DRIFT_AIR}.truth"
    told = any(
        (a := row.metrics.get("airborne", {}).get(truth)) is not None and a.value is not None
        for row in result.estimators
        if row.kind == "replay"
    )
    if told and drift_metric(said) != truth:
        yield "truth is there and another heading reference is quoted"
    if said.count("against") != 1:
        yield "two heading references in one sentence"


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
