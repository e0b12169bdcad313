"""The verdicts as sentences: what a pilot reads first."""

from __future__ import annotations

import pytest

from attlog.metrics.answer import Answer, missing
from attlog.present.sentences import verdicts
from attlog.result import EstimatorRow, ReferenceSummary, Result, Verdict

NEAR = 0.1


def row(name: str, metrics: dict[str, dict[str, Answer]], **changes: object) -> EstimatorRow:
    """A row with these answers."""
    kind = "onboard" if name.startswith("onboard") else "replay"
    return EstimatorRow(**{
        "name": name, "kind": kind, "estimator": name, "preset": None, "parameters": {}, "metrics": metrics,
        "skipped": {}, "ns_per_update": None, "status": "ok", **changes,
    })  # fmt: skip


def result(rows: list[EstimatorRow], reference: str = "onboard", floor: float = 0.0, rate: float = 250.0) -> Result:
    """A result of these rows."""
    summary = ReferenceSummary(reference, "ATT", 10.0, floor, "")
    return Result({}, "", {}, {"imu": {"rate_hz": rate}}, reference=summary, estimators=rows)


def noise(roll: float, pitch: float | None = None, **more: object) -> dict[str, dict[str, Answer]]:
    """Noise answers of one row."""
    values = {"roll": roll, "pitch": roll if pitch is None else pitch}
    return {"rest": {f"noise_{a}_deg": Answer(v, "deg", "rest", 50, 36.0, **more) for a, v in values.items()}}


def lag(value: float, half: float = 1.0, n: int = 28) -> dict[str, dict[str, Answer]]:
    """A lag answer of one row."""
    return {"airborne": {"lag_ms": Answer(value, "ms", "airborne", n, 60.0, (value - half, value + half))}}


def drift(
    rest: float | None = None,
    air: float | None = None,
    half: float = NEAR,
    heading_reference: str = "onboard",
    **more: object,
):
    """Drift answers of one row."""
    out: dict[str, dict[str, Answer]] = {"rest": {}, "airborne": {}}
    for window, name, value in (
        ("rest", "drift_rest_deg_per_min", rest),
        ("airborne", f"drift_air_deg_per_min.{heading_reference}", air),
    ):
        if value is not None:
            out[window][name] = Answer(value, "deg/min", window, 6, 120.0, (value - half, value + half), **more)
    return out


def verdict(question: str, *args: object, **more: object) -> Verdict:
    """The verdict for a question."""
    found = {v.question: v for v in verdicts(result(*args, **more))}
    assert list(found) == ["quiet", "late", "drifting"]
    return found[question]


def test_several_leaders_are_too_close_to_rank_and_the_noisiest_is_named_with_its_factor():
    rows = [
        row("gyro", noise(0.003)),
        row("vqf", noise(0.0035)),
        row("mahony", noise(0.004)),
        row("madgwick", noise(0.044)),
    ]
    rows.append(row("onboard", noise(0.012), is_reference=True))
    assert verdict("quiet", rows).sentence == (
        "Gyro, Vqf and Mahony hold roll and pitch to within 0.004° over 36 s of rest, too close to rank. "
        "Madgwick is noisiest: 0.044°, 15 times as much. Onboard: 0.012°."
    )


def test_one_leader_is_quietest():
    rows = [row("vqf", noise(0.003)), row("mahony", noise(0.006)), row("madgwick", noise(0.044))]
    assert verdict("quiet", rows).sentence == (
        "Vqf is quietest: it holds roll and pitch to within 0.003° over 36 s of rest. "
        "Madgwick is noisiest: 0.044°, 15 times as much."
    )


def test_the_worse_axis_counts():
    found = verdict("quiet", [row("a", noise(0.003, 0.009)), row("b", noise(0.004))])
    assert found.bars == [("b", 0.004, "deg"), ("a", 0.009, "deg")]


def test_differences_below_the_floor_are_not_ranked():
    rows = [row("a", noise(0.001)), row("b", noise(0.004))]
    assert verdict("quiet", rows, floor=0.003).sentence == (
        "Both filters hold roll and pitch to within 0.004° over 36 s of rest, too close to rank."
    )


def test_a_single_filter_is_not_called_best():
    assert verdict("quiet", [row("mahony", noise(0.004))]).sentence == (
        "Mahony holds roll and pitch to within 0.004° over 36 s of rest; no other filter can be ranked."
    )


def test_no_rest_is_said_with_its_reason():
    absent = {
        f"noise_{a}_deg": missing("no_rest", "The motors never stopped.", "deg", "rest") for a in ("roll", "pitch")
    }
    found = verdict("quiet", [row("mahony", {"rest": absent})])
    assert found.sentence == "Cannot be judged: the motors never stopped."
    assert found.not_judged == [("mahony", "The motors never stopped.")]
    assert found.bars == []


def test_a_frozen_filter_never_wins():
    frozen = noise(0.0001, ranked=False, reason="does not follow motion: gain 0.1")
    found = verdict("quiet", [row("frozen", frozen), row("a", noise(0.004)), row("b", noise(0.01))])
    assert found.sentence.startswith("A is quietest")
    assert ("frozen", "does not follow motion: gain 0.1") in found.not_judged


@pytest.mark.parametrize("status", ["diverged", "not_converged"])
def test_a_row_that_lost_its_way_is_never_best(status):
    rows = [
        row("lost", noise(0.001), status=status, reason="tilt above 30 deg"),
        row("a", noise(0.004)),
        row("b", noise(0.01)),
    ]
    assert verdict("quiet", rows).sentence.startswith("A is quietest")


def test_where_nobody_can_be_ranked_the_sentence_says_why():
    rows = [
        row("gyro", noise(0.001), status="diverged", reason="tilt above 30 deg"),
        row("a", noise(0.004, ranked=False, reason="does not follow motion: gain 0.5")),
        row("b", noise(0.004, ranked=False, reason="does not follow motion: gain 0.6")),
        row("onboard", noise(0.012)),
    ]
    assert verdict("quiet", rows).sentence == (
        "No filter can be ranked: Gyro (diverged), A and B (do not follow motion). Onboard: 0.012°."
    )


def test_the_largest_lag_is_named_with_interval_reference_and_count():
    rows = [row("mahony", lag(12)), row("vqf", lag(-1)), row("gyro", lag(1))]
    assert verdict("late", rows, reference="truth").sentence == (
        "Mahony lags most: +12 ms (+11 to +13) against the logged truth over 28 steps. "
        "Vqf and Gyro do not lag measurably."
    )


def test_less_than_half_a_sample_is_no_lag():
    assert verdict("late", [row("a", lag(4, 0.5)), row("b", lag(2))], rate=100.0).sentence == (
        "No filter lags measurably against onboard (agreement, not truth) over 28 steps; "
        "less than 5 ms, half an IMU sample, counts as zero."
    )


def test_an_interval_across_zero_is_no_lag():
    assert verdict("late", [row("a", lag(9, 12))]).sentence.startswith("No filter lags measurably")


def test_a_impure_filter_is_not_judged_and_never_early():
    impure = {"airborne": {"lag_ms": missing("not_a_pure_delay", "follows 51 % of the movement", "ms", "airborne")}}
    found = verdict("late", [row("a", lag(1)), row("fan", impure), row("onboard", lag(0), is_reference=True)])
    assert found.sentence.startswith("A does not lag measurably against onboard")
    assert "Fan shows a wrong angle in the movement, which is not a pure delay." in found.sentence
    assert ("fan", "follows 51 % of the movement") in found.not_judged
    assert "fan" not in [name for name, _, _ in found.bars]


def test_all_impure():
    impure = {"airborne": {"lag_ms": missing("not_a_pure_delay", "follows 51 % of the movement", "ms", "airborne")}}
    assert verdict("late", [row("a", impure), row("b", impure)]).sentence == (
        "No filter's lag can be judged: A and B (wrong angle in the movement). Compare their tilt errors instead."
    )


def test_too_few_steps_are_said_with_the_count():
    few = {
        "airborne": {"lag_ms": missing("too_few_events", "2 quick movements; at least 3 are needed", "ms", "airborne")}
    }
    assert verdict("late", [row("a", few), row("b", few)]).sentence == (
        "Cannot be judged: 2 quick movements; at least 3 are needed. Fly some more brisk steps in roll, pitch and yaw."
    )


def test_drift_names_the_worst_and_bounds_what_is_not_told():
    rows = [row("gyro", drift(-1.2, -4.8)), row("a", drift(0.02, 0.03)), row("b", drift(0.05, -0.06))]
    rows.append(row("onboard", drift(-5.7), is_reference=True))
    found = verdict("drifting", rows)
    assert found.sentence == (
        "At rest, Gyro drifts most: −1.2°/min (−1.3 to −1.1); none told of A and B: less than 0.15°/min. "
        "Onboard: −5.7°/min (−5.8 to −5.6). "
        "In the air against onboard (agreement, not truth), Gyro drifts most: −4.8°/min (−4.9 to −4.7); "
        "none told of A and B: less than 0.16°/min."
    )


def test_intervals_across_zero_are_bounded_by_their_larger_end():
    assert verdict("drifting", [row("a", drift(0.02)), row("b", drift(-0.05))]).sentence == (
        "At rest, no drift of any of 2 filters is told: less than 0.15°/min."
    )


def test_truth_is_believed_before_onboard():
    rows = [row("a", drift(air=2.0, heading_reference="onboard")), row("b", drift(air=3.0, heading_reference="truth"))]
    found = verdict("drifting", rows)
    assert found.metric == "drift_air_deg_per_min.truth"
    assert found.sentence == "In the air against the logged truth, B drifts +3.0°/min (+2.9 to +3.1)."


def test_rests_that_disagree_are_said_as_a_range():
    apart = drift(0.5, half=40, ranked=False, reason="the rests of this log disagree: -2.00 to +4.70 deg/min")
    apart["rest"]["drift_rest_deg_per_min"].detail |= {"agree": False, "range": [-2.0, 4.7]}
    found = verdict("drifting", [row("a", apart)])
    assert found.sentence == "At rest, the rests disagree: drifts from −2.0°/min to +4.7°/min."


def test_a_wide_interval_that_excludes_zero_is_told():
    found = verdict("drifting", [row("a", drift(254.5, half=40))])
    assert found.sentence.startswith("At rest, A drifts +254.5°/min")


def test_nothing_at_all_still_gives_three_sentences():
    for found in verdicts(Result({}, "", {}, {})):
        assert found.sentence.startswith("Cannot be judged: ")
        assert found.sentence.endswith(".")


def test_sentences_stay_short():
    rows = [
        row(f"filter{i}@preset", noise(0.001 * (i + 1)) | {"airborne": lag(3.0 * i)["airborne"]}) for i in range(20)
    ]
    for found in verdicts(result(rows)):
        assert len(found.sentence.split()) <= 55


def test_without_any_drift_both_reasons_are_given():
    metrics = {
        "rest": {"drift_rest_deg_per_min": missing("no_rest", "No rest.", "deg/min", "rest")},
        "airborne": {
            "drift_air_deg_per_min.onboard": missing("record_too_short", "8 s in the air", "deg/min", "airborne")
        },
    }
    assert verdict("drifting", [row("a", metrics)]).sentence == (
        "Cannot be judged. At rest: no rest. In the air: 8 s in the air."
    )


@pytest.mark.parametrize("least", [0.0, 1e-16])
def test_no_factor_is_told_from_noise_below_what_is_shown(least):
    found = verdict("quiet", [row("a", noise(least)), row("b", noise(0.003))])
    assert found.sentence == (
        "A is quietest: it holds roll and pitch to less than 0.001° over 36 s of rest. B is noisiest: 0.003°."
    )


def test_large_factors_are_capped():
    found = verdict("quiet", [row("a", noise(0.001)), row("b", noise(0.25))])
    assert found.sentence.endswith("B is noisiest: 0.25°, over 100 times as much.")


def test_the_noisiest_of_the_ranked_is_not_called_the_noisiest_of_all():
    rows = [row("a", noise(0.001)), row("b", noise(0.05)), row("lost", noise(0.08), status="not_converged")]
    assert "B is noisiest of the 2 ranked: 0.050°" in verdict("quiet", rows).sentence


@pytest.mark.parametrize("advice", ["Set LOG_DISARMED to 1 and let the vehicle stand still.", ""])
def test_a_log_without_rest_says_how_the_vehicle_would_log_one(advice):
    absent = {"noise_roll_deg": missing("no_rest", "the log holds no rest", "deg", "rest")}
    found = result([row("a", {"rest": absent})])
    found.log["advice"] = {"rest": advice}
    assert verdicts(found)[0].sentence == f"Cannot be judged: the log holds no rest. {advice}".rstrip()


def test_filters_that_wander_and_filters_that_are_lost_are_told_apart():
    wide = drift(air=3.0, half=40, ranked=False, reason="not measurable")
    rows = [row("gyro", drift(air=6.0)), row("a", wide), row("b", wide), row("c", wide), row("d", wide)]
    rows += [row("lost", wide, status="diverged"), row("onboard", drift(air=-1.2, half=6))]
    assert verdict("drifting", rows).sentence == (
        "In the air against onboard (agreement, not truth), Gyro drifts +6.0°/min (+5.9 to +6.1); "
        "4 filters cannot be judged; Lost diverged. "
        "Onboard: −1.2°/min (−7.2 to +4.8)."
    )


def test_the_part_that_is_not_answered_is_explained():
    air = drift(air=6.0) | {"rest": {"drift_rest_deg_per_min": missing("no_rest", "no rest", "deg/min", "rest")}}
    assert verdict("drifting", [row("gyro", air)]).not_judged == [("gyro", "at rest, no rest")]


def test_a_witness_that_judges_filters_is_preferred_to_one_that_judges_only_onboard_rows():
    by_onboard = missing("record_too_short", "too short", "deg/min", "airborne")
    filters = drift(air=4.0, heading_reference="mag")
    filters["airborne"]["drift_air_deg_per_min.onboard"] = by_onboard
    rows = [row("gyro", filters), row("onboard:AHR2", drift(air=0.4))]
    assert verdict("drifting", rows).sentence.startswith("In the air against the magnetometer, Gyro drifts +4.0°/min")


def test_a_vehicle_that_never_flew_is_not_told_to_fly_steps():
    absent = missing("no_events", "the vehicle was never airborne", "ms", "airborne")
    found = result([row("a", {"airborne": {"lag_ms": absent}})])
    found.log["seconds"] = {"airborne": 0}
    assert verdicts(found)[1].sentence == "Cannot be judged: the vehicle was never airborne."


def test_a_quiet_filter_that_cannot_be_ranked_keeps_another_from_being_quietest_of_all():
    rows = [row("a", noise(0.01)), row("b", noise(0.05)), row("hidden", noise(0.0002, ranked=False, reason="coarse"))]
    assert verdict("quiet", rows).sentence.startswith("A is quietest of the 2 ranked: ")
