"""Nothing that a report says contradicts what it shows: on made results by the hundred, and on logs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from attlog.metrics.metric import Answer, missing
from attlog.result import Check, EstimatorRow, Finding, Result
from attlog.words.answers import verdicts
from tests.conftest import corpus_logs, corpus_root, few
from tests.words.contradictions import contradictions
from tests.words.made import DRIFT_AIR, DRIFT_REST, HEADING, LAG, NOISE, STEP, STEP_PCT, TILT, merged, result, row

NAMES = ("gyro", "complementary@fan", "mahony", "mahony@xu-0.6", "madgwick", "ekf12", "vqf")
COLUMNS = (
    (TILT, "deg", "airborne"),
    (HEADING, "deg", "airborne"),
    (NOISE, "deg", "rest"),
    (NOISE, "deg", "hover"),
    (NOISE, "deg", "cruise"),
    (NOISE, "deg", "idle"),
    (LAG, "ms", "airborne"),
    (STEP, "deg", "airborne"),
    (STEP_PCT, "%", "airborne"),
    (DRIFT_REST, "deg/min", "rest"),
    (f"{DRIFT_AIR}.onboard", "deg/min", "airborne"),
    (f"{DRIFT_AIR}.truth", "deg/min", "airborne"),
    (f"{DRIFT_AIR}.mag", "deg/min", "airborne"),
)
REASON = {"ok": "", "diverged": "tilt error above 30 deg", "failed": "returned NaN from 0.0 s on"}
WHY = {"no_rest": "the vehicle never stood still", "no_events": "no step", "record_too_short": "8 s"}
# Words of a sentence or of a clause between semicolons, brackets left out.
MAX_WORDS = 18


@st.composite
def answers(draw: st.DrawFn, metric: str, unit: str, window: str) -> Answer:
    """Any answer of a column: a value with or without an interval, ranked or not, or none."""
    if draw(st.integers(0, 4)) == 0:
        code = draw(st.sampled_from(sorted(WHY) + (["not_a_pure_delay"] if metric == LAG else [])))
        return missing(code, WHY.get(code, "follows 51 % of the step"), unit, window)
    low = -300.0 if unit in ("ms", "deg/min", "%") else 0.0
    value = draw(st.floats(low, 300.0)) * draw(st.sampled_from([1.0, 0.1, 0.01, 0.001]))
    half = draw(st.floats(0.0, 100.0)) * draw(st.sampled_from([1.0, 0.1, 0.01]))
    ci95 = draw(st.sampled_from([(value - half, value + half), (value - 0.1 * half, value + half), None]))
    ranked = draw(st.integers(0, 5)) > 0
    zero = draw(st.sampled_from([0.0, 2.0, 20.0])) if metric == LAG else 0.0
    n = draw(st.integers(1, 30))
    return Answer(
        value,
        unit,
        window,
        n,
        60.0,
        ci95,
        ranked=ranked,
        reason=None if ranked else "too short",
        counts_as_zero_below=zero,
    )


@st.composite
def results(draw: st.DrawFn) -> Result:
    """A result with any answers, and any ranking that the rule can give."""
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=6, unique=True))
    rows: list[EstimatorRow] = []
    for name in [*names, "onboard"]:
        metrics: dict[str, dict[str, Answer]] = {}
        for metric, unit, window in COLUMNS:
            if draw(st.integers(0, 5)):
                metrics.setdefault(window, {})[metric] = draw(answers(metric, unit, window))
        status = draw(st.sampled_from(["ok", "ok", "ok", "diverged", "failed"])) if name != "onboard" else "ok"
        rows.append(row(name, metrics, status=status, reason=REASON[status]))
    made = result(rows, reference=draw(st.sampled_from(["onboard", "truth", "smoother"])))
    for metric, _, window in COLUMNS:
        compared = made.ranked.get(window, {}).get(metric, [])
        size = {r.name: abs(r.metrics[window][metric].value or 0.0) for r in rows if r.name in compared}
        if len(compared) < 2 or not draw(st.booleans()):
            continue
        least = min(compared, key=lambda name: size[name])
        beaten = draw(st.lists(st.sampled_from([c for c in compared if c != least]), min_size=1, unique=True))
        made.best.setdefault(window, {})[metric] = [c for c in compared if c not in beaten]
        if draw(st.booleans()):
            made.worst.setdefault(window, {})[metric] = [max(beaten, key=lambda name: size[name])]
    made.verdicts = verdicts(made)
    return made


@pytest.mark.parametrize("examples", few([25, 400], 1))
def test_no_made_result_contradicts_itself(examples):
    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
    @given(results())
    def consistent(made):
        assert contradictions(made) == []

    consistent()


def told() -> Result:
    """A result with a best and a worst row in every column."""
    values = (("vqf", 1.0), ("mahony", 2.0), ("complementary@fan", 9.0))
    rows = [
        row(name, merged(*({w: {m: Answer(v, u, w, 9, 60.0, (0.9 * v, 1.1 * v))}} for m, u, w in COLUMNS)))
        for name, v in values
    ]
    metrics = {m for m, _, _ in COLUMNS}
    made = result(rows, {metric: ["vqf"] for metric in metrics}, dict.fromkeys(metrics, "complementary@fan"), "truth")
    made.verdicts = verdicts(made)
    return made


PLANTED: tuple[tuple[int, str, str], ...] = (
    (0, "Tilt: mahony 2.0°, others 1.0 to 9.0°.", "called best, ranking says"),
    (1, "At rest mahony 2.0°, others 1.0 to 9.0°.", "called best, ranking says"),
    (0, "Tilt: VQF 7.7°, others 2.0 to 9.0°.", "7.7 is no number of the table"),
    (0, "Tilt: VQF 1.0°, others 2.0 to 9.0 deg.", "code or id in words"),
    (2, "VQF +1 ms; VQF is 33 % short after 0.5 s.", "33 % is no error of a step"),
    (2, "All 5 filters 1 to 9 ms ahead of onboard.", "the table has [3]"),
    (2, "All 2 ranked filters 1 to 9 ms ahead of onboard.", "the table has [3]"),
    (3, "At rest VQF below 57.0°/min.", "excludes nothing"),
)


@pytest.mark.parametrize(("question", "said", "why"), PLANTED)
def test_a_sentence_that_the_table_denies_is_found(question: int, said: str, why: str) -> None:
    made = told()
    assert contradictions(made) == []
    made.verdicts[question].sentence = said
    assert any(why in line for line in contradictions(made))


def test_a_headline_or_a_finding_that_the_result_denies_is_found() -> None:
    made = told()
    made.headline = "Quadrotor: flew 3 to 80 s. Nothing went wrong."
    made.findings = [Finding("compass", "warning", "The field is 9 uT off.", about="field")]
    made.checks = [Check("field", "warning", "9 uT off.")]
    assert contradictions(made) == []
    made.checks[0].verdict = "ok"
    made.findings.append(Finding("crash", "serious", "Hit the ground at 9 s."))
    said = " ".join(contradictions(made))
    assert "nothing went wrong beside" in said
    assert "by its checks" in said


def longest_clause(text: str) -> int:
    """Return how many words the longest sentence or clause of a text has."""
    bare = re.sub(r"\s*\([^()]*\)", "", text)
    return max(len(part.split()) for part in re.split(r"(?<=[.;])\s+", bare))


def case_logs() -> list[Path]:
    """The cases that were looked into by hand, where the corpus has them."""
    root = corpus_root()
    return sorted((root / "logs" / "cases").glob("*.[bBulLt]*")) if root is not None else []


@pytest.mark.slow
@pytest.mark.parametrize("path", [*corpus_logs(), *case_logs()], ids=lambda p: p.name)
def test_no_log_in_hand_contradicts_itself(path):
    from attlog.core.errors import AttlogError
    from attlog.pipeline import evaluate, prepare

    try:
        found = evaluate(prepare(path))
    except AttlogError as error:
        pytest.skip(str(error))
    assert contradictions(found) == []
    long = [v.sentence for v in found.verdicts if longest_clause(v.sentence) > MAX_WORDS]
    assert not long
