"""Configurations on real logs: what is known of their difference comes out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from attlog.compare.comparison import Comparison, select_questions
from attlog.compare.paired import Difference, pool
from attlog.compare.run import compare, log_names
from attlog.compare.setting import parse_configuration
from attlog.core.errors import UsageError
from attlog.pipeline.config import Config
from tests.conftest import SAMPLES

STEPS, TURNS = SAMPLES / "copter_steps_stabilize.bin", SAMPLES / "copter_yaw_turns.bin"


def over(found: Comparison, metric: str, configuration: str) -> Difference:
    question = next(q for q in found.questions if q.metric == metric)
    one = next(c.over for c in question.contrasts if c.configuration == configuration)
    assert one is not None
    return one


@pytest.fixture(scope="module")
def known() -> Comparison:
    """One log, and what makes a known difference to one filter."""
    specs = ["mahony", "mahony:latency=10", "mahony:lowpass=20", "mahony:rate=50"]
    return compare([STEPS], [*map(parse_configuration, specs), parse_configuration("mahony", "again")])


def test_a_latency_is_found_as_lag_to_a_tenth_of_a_millisecond(known: Comparison) -> None:
    found = over(known, "lag_ms", "mahony:latency=10")
    assert found.value == pytest.approx(10.0, abs=0.1)
    assert found.direction == "worse"


def test_a_low_pass_makes_late_as_its_group_delay_says(known: Comparison) -> None:
    """sqrt(2) / (2 pi f) at low frequencies, 11.3 ms for 20 Hz; nothing of it is counted as the log's own delay."""
    assert over(known, "lag_ms", "mahony:lowpass=20").value == pytest.approx(11.25, rel=0.12)


def test_means_of_samples_make_nothing_late(known: Comparison) -> None:
    assert abs(over(known, "lag_ms", "mahony:rate=50").value) < 0.5


def test_a_gyro_that_shows_too_much_shows_in_the_step_gain() -> None:
    found = compare(
        [STEPS], [parse_configuration(text) for text in ["mahony", "mahony:gyro_scale=1.03"]], metrics=["step_gain"]
    )
    gains = [cell.value or 0.0 for cell in found.questions[0].cells[STEPS.name].values()]
    assert gains[1] - gains[0] == pytest.approx(0.03, abs=0.003)


def test_the_same_configuration_twice_differs_by_exactly_nothing(known: Comparison) -> None:
    for question in known.questions:
        one = next(c for c in question.contrasts if c.configuration == "again")
        if one.over is not None:
            assert one.over.direction == "same"
            assert one.over.value == (1.0 if question.scale == "ratio" else 0.0)
    said = next(v for v in known.verdicts if v.configuration == "again")
    assert said.lead.startswith("No difference: again and mahony give the same in every question")


def test_what_a_log_cannot_do_costs_the_configuration_alone(known: Comparison) -> None:
    found = compare(
        [STEPS], [parse_configuration(text) for text in ["mahony", "mahony:rpm_notch=20", "mahony:lowpass=5000"]]
    )
    cells = found.questions[0].cells[STEPS.name]
    assert cells["mahony"].status == "ok"
    assert cells["mahony:rpm_notch=20"].status == "failed"
    assert "a low-pass at 5000 Hz needs samples above 10000 Hz" in cells["mahony:lowpass=5000"].reason
    assert found.logs[0].code == 0


def test_one_broken_log_of_many_is_a_line_with_its_reason(tmp_path: Path) -> None:
    broken = tmp_path / "broken.bin"
    broken.write_bytes(b"not a log" * 100)
    other = tmp_path / STEPS.name
    shutil.copy(STEPS, other)
    configurations = [parse_configuration(text) for text in ["mahony:kp=0.3", "mahony:kp=0.6"]]
    logs = [other, broken, TURNS]
    one = compare(logs, configurations)
    assert [(line.name, line.code) for line in one.logs] == [(other.name, 0), ("broken.bin", 65), (TURNS.name, 0)]
    assert one.logs[1].reason
    tilt = over(one, "tilt_rmse_deg", "mahony:kp=0.6")
    assert tilt.logs == 2


@pytest.mark.slow
def test_a_flight_that_is_given_twice_counts_once_where_logs_are_pooled(tmp_path: Path) -> None:
    again = Path(shutil.copy(STEPS, tmp_path / "again.bin"))
    configurations = [parse_configuration(text) for text in ["mahony:kp=0.3", "mahony:kp=0.6"]]
    twice, once = compare([STEPS, again, TURNS], configurations), compare([STEPS, TURNS], configurations)
    assert [line.same_as for line in twice.logs] == ["", STEPS.name, ""]
    for metric in ("tilt_rmse_deg", "lag_ms"):
        assert over(twice, metric, "mahony:kp=0.6") == over(once, metric, "mahony:kp=0.6")
    assert json.loads(twice.to_json())["logs"][1]["same_as"] == STEPS.name


@pytest.mark.slow
def test_processes_find_what_one_process_finds(tmp_path: Path) -> None:
    configurations = [parse_configuration(text) for text in ["mahony:kp=0.3", "mahony:kp=0.6"]]
    logs = [STEPS, tmp_path / "none.bin", TURNS]
    assert compare(logs, configurations, jobs=2).to_json() == compare(logs, configurations).to_json()


def test_two_logs_of_one_name_are_told_apart() -> None:
    assert log_names([Path("a/x.bin"), Path("b/x.bin"), Path("b/y.bin")]) == ["a/x.bin", "b/x.bin", "y.bin"]
    assert log_names([Path("c/a/x.bin"), Path("d/a/x.bin")]) == ["a/x.bin-1", "a/x.bin-2"]


def test_one_configuration_is_no_comparison() -> None:
    with pytest.raises(UsageError, match="two configurations or more"):
        compare([STEPS], [parse_configuration(text) for text in ["mahony"]])


def test_other_questions_can_be_asked_in_one_window() -> None:
    found = compare(
        [STEPS],
        [parse_configuration(text) for text in ["mahony:kp=0.3", "mahony:kp=0.6"]],
        Config(window="30:60"),
        metrics=["total_rmse_deg"],
    )
    assert [(q.metric, q.windows) for q in found.questions] == [("total_rmse_deg", ("30:60",))]
    with pytest.raises(UsageError, match="there is no metric lagms; did you mean lag_ms"):
        select_questions(["lagms"])
    assert len(select_questions(["all"])) > 40


# What several logs say together: one log that resolves more than the others does not decide for all.


@pytest.mark.parametrize(
    ("floors", "direction"),
    [((0.0, 0.6, 0.9), "not significant"), ((0.0, 0.1, 0.9), "better"), ((0.6, 0.6, 0.0), "not significant")],
)
def test_what_most_logs_cannot_resolve_is_no_difference(floors: tuple[float, ...], direction: str) -> None:
    each = [
        Difference("difference", value, (value - 0.1, value + 0.1), 0.001, 0.05, floor, "better", better=1)
        for value, floor in zip((-0.5, -0.52, -0.48), floors, strict=True)
    ]
    found = pool(each, "difference")
    assert found is not None
    assert (found.value, found.direction) == (pytest.approx(-0.5, abs=0.01), direction)
