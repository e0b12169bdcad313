"""Whether a reference plainly follows the gyro: the same answer as the fit of the lag where it is clear, else none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import estimators, flight, pipeline, reference, segments
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.flight import read
from attlog.metrics import answerable, lag
from attlog.metrics.metric import Case, missing
from attlog.metrics.ranking import CODE
from attlog.pipeline import inspection
from attlog.pipeline.inspection import inspect
from tests.conftest import SAMPLES as conftest_SAMPLES
from tests.conftest import corpus_logs, corpus_root

SAMPLES = Path(__file__).parents[3] / "sample_logs"


def case_of(name: str) -> Case:
    log = read(SAMPLES / name)
    case = inspection._compared(log, segments.build(log))[1]
    assert case is not None
    return case


@pytest.fixture(scope="module")
def steps() -> Case:
    return case_of("px4_steps.ulg")


@pytest.mark.parametrize("name", ["px4_hover.ulg", "copter_yaw_turns.bin"])
def test_the_events_are_those_of_the_fit(name: str) -> None:
    case = case_of(name)
    row = answerable.stand_in(case)
    fitted = lag.compute_lag(case, row, "airborne")[lag.metric_id("lag", "all")]
    assert fitted.value is not None
    assert answerable.plain_lag_events(case, row, "airborne") == fitted.n


def changed(case: Case, q: np.ndarray, t: np.ndarray | None = None) -> Case:
    """The case with another attitude as reference, nothing of the old one kept."""
    reference = replace(case.reference, q=q, t=case.reference.t if t is None else t)
    return replace(case, reference=reference, of_log={})


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.1])
def test_a_reference_that_comes_later_or_earlier_is_followed_at_that_delay(steps: Case, late_s: float) -> None:
    row = answerable.stand_in(steps)
    found = []
    whole = answerable.Rates.compared
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(answerable.Rates, "compared", lambda self, d: found.append(d) or whole(self, d))
        answerable.plain_lag_events(changed(steps, steps.reference.q, steps.reference.t - late_s), row, "all")
    assert found == [pytest.approx(late_s, abs=0.0015)]


def test_a_reference_of_another_size_or_shape_is_left_to_the_fit(steps: Case) -> None:
    row = answerable.stand_in(steps)
    assert answerable.plain_lag_events(steps, row, "airborne") is not None
    half = rotation.from_rotvec(0.8 * rotation.to_rotvec(steps.reference.q))
    assert answerable.plain_lag_events(changed(steps, half), row, "airborne") is None
    t = steps.reference.t
    wobble = rotation.from_rotvec(np.radians(2.0) * np.sin(20.0 * t)[:, None] * np.array([1.0, 1.0, 0.0]))
    assert (
        answerable.plain_lag_events(changed(steps, rotation.multiply(steps.reference.q, wobble)), row, "airborne")
        is None
    )


def test_few_events_are_left_to_the_fit(steps: Case) -> None:
    assert answerable.plain_lag_events(steps, answerable.stand_in(steps), "0:1") is None


@pytest.mark.parametrize(("kind", "told"), [("truth", False), ("onboard", True)])
def test_a_row_ahead_of_its_reference_is_left_to_the_fit_unless_that_is_an_estimate_itself(
    steps: Case, kind: str, told: bool
) -> None:
    """What flew may well be late; truth is not, and a row that is ahead of it has something wrong."""
    ahead = changed(steps, steps.reference.q, steps.reference.t + 0.03)
    ahead.reference.kind = kind  # type: ignore[assignment]
    assert (answerable.plain_lag_events(ahead, answerable.stand_in(steps), "all") is not None) is told


def test_a_row_that_shakes_beside_its_movement_is_left_to_the_fit(steps: Case) -> None:
    """The gain is right, the shape is not: 1 deg at 8 Hz adds tens of deg/s that the reference does not turn."""
    row = answerable.stand_in(steps)
    shake = rotation.from_rotvec(np.radians(1.0) * np.sin(50.0 * row.t)[:, None] * np.array([1.0, 1.0, 1.0]))
    shaken = replace(row, q=rotation.multiply(row.q, shake))
    assert answerable.plain_lag_events(steps, row, "airborne") is not None
    assert answerable.plain_lag_events(steps, shaken, "airborne") is None


# The stand-in is the gyro alone, and what is possible with it is what filters are judged by.

ONLY_FILTERS_TELL = {"px4_1.6.5_hand_rotation.ulg", "log_copter_3.1.1_nan.log", "bin_plane_3.0.4beta3_nomag.BIN"}
"""The onboard attitude is refused because six filters agree against it: before they run nobody knows."""


def every_log() -> list[Path]:
    root = corpus_root()
    cases = [] if root is None else sorted((root / "logs" / "cases").glob("*"))
    return corpus_logs() + [p for p in cases if p.suffix.lower() in (".ulg", ".bin", ".tlog", ".log")]


def test_products_are_those_of_one_multiplication_after_the_other() -> None:
    q = rotation.normalize(np.random.default_rng(3).normal(size=(2500, 4)))
    told = answerable.products(q)
    expected = q[0]
    for k in range(1, len(q)):
        expected = rotation.multiply(expected, q[k])
    assert abs(expected @ told[-1]) == pytest.approx(1.0, abs=1e-9)
    assert np.allclose(told[0], q[0])


def test_the_stand_in_turns_as_the_compiled_gyro_row_does() -> None:
    imu = flight.read(conftest_SAMPLES / "copter_yaw_turns.bin").replay_imu
    assert imu is not None
    own = answerable.integrated(imu, imu.gyro.x, "sample")
    row = estimators.estimate(
        "gyro", imu.gyro.t_best, imu.gyro.x, imu.acc.x, sampling=imu.gyro.sampling, dt=imu.dt, q0=own.q[0]
    )
    assert np.array_equal(own.t, row.t)
    apart = rotation.total_angle(rotation.earth_error(own.q, rotation.normalize(row.q)))
    assert np.degrees(np.max(apart)) < 0.01


def without_smoother(monkeypatch: pytest.MonkeyPatch) -> None:
    choose = reference.choose
    monkeypatch.setattr(reference, "choose", lambda *given, smooth=None, **more: choose(*given, **more))


@pytest.mark.slow
@pytest.mark.parametrize("path", every_log(), ids=lambda p: f"{p.parent.name}-{p.name}")
def test_info_says_of_every_log_what_analyze_can_answer(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compared with the same: info does not run the smoother, and says of it only that it comes first."""
    without_smoother(monkeypatch)
    try:
        result = pipeline.evaluate(pipeline.prepare(path))
    except AttlogError:
        return
    answered = {v.question: bool(v.bars) for v in result.verdicts}
    if path.name in ONLY_FILTERS_TELL:
        assert "attitude" in {p.kind for p in result.findings}
        assert inspect_answers(path) != answered, "no longer an exception"
        answered |= {"accuracy": True, "lag": inspect_answers(path)["lag"]}
    said = inspect(path)["answerable"]
    large = {a["question"] for a in said if "only a larger error would be significant" in (a["reason"] or "")}
    assert {a["question"]: a["can"] or (a["question"] in large and answered[a["question"]]) for a in said} == answered


@pytest.mark.slow
def test_of_a_flight_too_short_for_any_small_drift_only_large_ones_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    root = corpus_root()
    if root is None:
        pytest.skip("no corpus")
    path = root / "logs" / "cases" / "copter_3.6.8_compass.bin"
    without_smoother(monkeypatch)
    said = next(a for a in inspect(path)["answerable"] if a["question"] == "yaw_drift")
    assert not said["can"]
    assert "only a larger error would be significant" in said["reason"]
    told = next(v for v in pipeline.evaluate(pipeline.prepare(path)).verdicts if v.question == "yaw_drift")
    assert told.bars
    assert all(abs(value) > 60.0 for _, value, _ in told.bars)


def inspect_answers(path: Path) -> dict[str, bool]:
    return {a["question"]: a["can"] for a in inspect(path)["answerable"]}


def test_a_refusal_says_why_and_of_an_uncertain_number_also_who_is_told_of_one() -> None:
    assert answerable.refused(missing("no_rest", "no rest of 20 s", "deg", "rest")) == answerable.Availability(
        (), ("no rest of 20 s",), ("no_rest",)
    )
    (why,) = answerable.refused(missing(CODE, "too noisy", "deg", "rest")).why
    assert why.startswith("too noisy; only a larger error would be significant")
