"""What holds for all sentences: there are always four, short, and a wrong sensor is said by each."""

from __future__ import annotations

from attlog.metrics.evidence.common_bias import CommonBias
from attlog.present.sentences import verdicts
from attlog.result import Check, Result
from tests.present.made import absent, drift, lag, merged, noise, result, row, sentence, step, tilt


def test_nothing_at_all_still_gives_four_sentences():
    found = verdicts(Result({}, "", {}, {}))
    assert [v.question for v in found] == ["accuracy", "noise", "lag", "yaw_drift"]
    assert all(v.sentence.startswith("Cannot be judged: ") and v.sentence.endswith(".") for v in found)


def test_sentences_stay_short_with_many_filters():
    every = [
        merged(tilt(i + 1.0, i + 2.0), noise(0.01 * (i + 1)), lag(3.0 * i), step(i + 0.1, -i * 3), drift(i, 0.5))
        for i in range(20)
    ]
    rows = [row(f"filter{i}@preset", metrics) for i, metrics in enumerate(every)]
    names = [r.name for r in rows]
    best = {m: names[:4] for m in ("inclination_rmse_deg", "noise_tilt_deg", "lag_ms", "drift_rest_deg_per_min")}
    for found in verdicts(result(rows, best, dict.fromkeys(best, names[-1]), "truth")):
        assert len(found.sentence.split()) <= 70, found.sentence


def test_a_gyro_that_reads_wrong_standing_still_is_said_by_every_card():
    made = result([row("a", noise(0.01))])
    made.audit = [Check("gyro bias", "fault", "At rest -24.34, -23.28, 2.62 deg/s about x, y, z.")]
    for found in verdicts(made):
        assert found.sentence.startswith(
            "Unreliable, the gyro is wrong: at rest −24.34, −23.28, 2.62°/s about x, y, z. "
        )
    made.gyro_bias = [CommonBias("rest", "rest", dps=[-24.2, -24.1, 2.5])]
    assert not any(found.sentence.startswith("Unreliable") for found in verdicts(made)), "it was subtracted"
    made.estimators[0].status = "not_judged"
    assert sentence("noise", made).startswith("Unreliable")
    made.audit[0].verdict = "warning"
    assert not sentence("noise", made).startswith("Unreliable")


def test_what_a_filter_of_nan_is_missing_is_not_blamed_on_the_log():
    nan = row(
        "nan",
        absent("noise_tilt_deg", "rest", "rest_too_short", "rest too short"),
        status="failed",
        reason="returned NaN from 0.0 s on",
    )
    found = {v.question: v for v in verdicts(result([nan, row("a", noise(0.01))]))}
    assert ("nan", "returned NaN from 0.0 s on") in found["noise"].not_judged
    assert sentence("noise", result([nan])) == "Cannot be judged: returned NaN from 0.0 s on."
