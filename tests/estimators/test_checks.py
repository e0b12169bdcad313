"""Tests of the checks: an estimator that is broken on purpose fails the check that is meant for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import FunctionType
from typing import Any

import numpy as np
import pytest

from attlog.core.errors import PluginError
from attlog.estimators import Estimate, Estimator, EstimatorSpec, Parameter, get, samples
from attlog.estimators.vectors import down, field_error, gravity_error, turn
from attlog.testing import CheckFailed, CheckOutcome, check_estimator, checks, contract, motions
from attlog.testing.motions import Subject


@pytest.fixture(autouse=True)
def _plain_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the broken filters as plain Python: compiling each would take seconds."""
    monkeypatch.setenv("ATTLOG_NO_JIT", "1")


def healthy(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    gx, gy, gz = gravity_error(state, acc, 0.0)
    mx, my, mz = field_error(state, mag, 0.0)
    turn(state, gyr[0] + gx + mx, gyr[1] + gy + my, gyr[2] + gz + mz, dt, 0.0)


def gyro_reversed(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    turn(state, -gyr[0], -gyr[1], -gyr[2], dt, 0.0)


def pitch_reversed(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    turn(state, gyr[0], -gyr[1], gyr[2], dt, 0.0)


def gyro_in_degrees(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    f = math.pi / 180.0
    turn(state, gyr[0] * f, gyr[1] * f, gyr[2] * f, dt, 0.0)


def gravity_reversed(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    gx, gy, gz = gravity_error(state, acc, 0.0)
    turn(state, gyr[0] - gx, gyr[1] - gy, gyr[2] - gz, dt, 0.0)


def field_reversed(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    gx, gy, gz = gravity_error(state, acc, 0.0)
    mx, my, mz = field_error(state, mag, 0.0)
    turn(state, gyr[0] + gx - mx, gyr[1] + gy - my, gyr[2] + gz - mz, dt, 0.0)


def without_correction(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    turn(state, gyr[0], gyr[1], gyr[2], dt, 0.0)


def gain_per_sample(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    gx, gy, gz = gravity_error(state, acc, 0.0)
    mx, my, mz = field_error(state, mag, 0.0)
    k = 0.02 / dt
    turn(state, gyr[0] + k * (gx + mx), gyr[1] + k * (gy + my), gyr[2] + k * (gz + mz), dt, 0.0)


def field_in_tesla(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    gx, gy, gz = gravity_error(state, acc, 0.0)
    mx, my, mz = field_error(state, mag, 0.0)
    size = 1e5 * math.sqrt(mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2])
    turn(state, gyr[0] + gx + size * mx, gyr[1] + gy + size * my, gyr[2] + gz + size * mz, dt, 0.0)


def grows(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    healthy(state, params, dt, gyr, acc, mag)
    for i in range(4):
        state[i] = state[i] * 1.00001


def divides_by_the_norm(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    norm = np.sqrt(acc[0] * acc[0] + acc[1] * acc[1] + acc[2] * acc[2])
    dx, dy, dz = down(state)
    vx = -acc[0] / norm
    vy = -acc[1] / norm
    vz = -acc[2] / norm
    turn(state, gyr[0] + vy * dz - vz * dy, gyr[1] + vz * dx - vx * dz, gyr[2] + vx * dy - vy * dx, dt, 0.0)


def prefers_north(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    healthy(state, params, dt, gyr, acc, mag)
    state[3] = state[3] * (1.0 - 0.1 * dt)
    turn(state, 0.0, 0.0, 0.0, dt, 0.0)


def bias_in_degrees(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    gx, gy, _ = gravity_error(state, acc, 0.0)
    f = math.pi / 180.0
    state[4] -= 0.02 * gx * dt / f
    state[5] -= 0.02 * gy * dt / f
    turn(state, gyr[0] - state[4] * f + gx, gyr[1] - state[5] * f + gy, gyr[2], dt, 0.0)


BROKEN: list[tuple[Callable[..., None], str]] = [
    (gyro_reversed, "follows_a_turn[roll]"),
    (gyro_reversed, "follows_a_turn[yaw]"),
    (pitch_reversed, "follows_a_turn[pitch]"),
    (gyro_in_degrees, "follows_a_turn[roll]"),
    (gravity_reversed, "corrects_an_offset[roll]"),
    (gravity_reversed, "corrects_an_offset[pitch]"),
    (field_reversed, "corrects_an_offset[yaw]"),
    (without_correction, "converges_from_170_deg"),
    (without_correction, "starts_in_motion"),
    (gravity_reversed, "finds_the_attitude_at_rest"),
    (field_reversed, "works_at_every_heading"),
    (gain_per_sample, "does_not_depend_on_the_sampling_rate"),
    (field_in_tesla, "takes_the_field_in_any_unit"),
    (grows, "gives_unit_quaternions"),
    (divides_by_the_norm, "survives_dead_sensors"),
    (prefers_north, "turns_with_the_earth"),
    (gravity_reversed, "works_without_magnetometer"),
    (gravity_reversed, "survives_nan"),
    (bias_in_degrees, "finds_the_gyro_bias"),
]


def broken(step: Callable[..., None] = healthy, **changes: Any) -> Estimator:
    """Mahony's frame with another step; a kernel's step is called step."""
    return replace(get("mahony"), name=step.__name__, step=FunctionType(step.__code__, globals(), "step"), **changes)


def check(estimator: Estimator, title: str) -> Callable[[], None]:
    return dict(checks(estimator))[title]


@pytest.mark.parametrize(("step", "title"), BROKEN, ids=[f"{s.__name__}-{t}" for s, t in BROKEN])
def test_a_broken_step_fails_its_check(step: Callable[..., None], title: str) -> None:
    with pytest.raises(CheckFailed):
        check(broken(step), title)()


@pytest.mark.parametrize("title", sorted({t for _, t in BROKEN} - {"finds_the_gyro_bias"}))
def test_the_healthy_step_passes_the_same_checks(title: str) -> None:
    check(broken(), title)()


def test_a_parameter_without_wire_is_found() -> None:
    loose = Parameter("loose", 1.0, "1", 0, 2, "connected to nothing", "test")
    with pytest.raises(CheckFailed, match="loose"):
        check(broken(parameters=(loose,), presets={}), "uses_every_parameter")()


def test_missing_words_and_doubled_names_are_found() -> None:
    silent = Parameter("silent", 1.0, "1", 0, 2, "", "")
    with pytest.raises(CheckFailed, match="silent"):
        check(broken(parameters=(silent,)), "describes_itself")()
    with pytest.raises(CheckFailed, match="SOURCE"):
        check(broken(source=""), "describes_itself")()


def whole_run(function: Callable[..., Any]) -> Estimator:
    """An estimator that takes whole runs: the function sees t, gyr, acc and gives attitudes (n, 4)."""

    def run(t: Any, gyr: Any, acc: Any, mag: Any, aids: Any, params: Any) -> Estimate:
        return Estimate(t=t, q=function(t, gyr, acc))

    return replace(get("mahony"), name="whole", step=None, start=None, run=run, parameters=(), presets={}, slices={})


def level(t: Any) -> Any:
    return np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))


def test_a_random_estimator_does_not_repeat_itself() -> None:
    random = np.random.default_rng(1)

    def shaken(t: Any, gyr: Any, acc: Any) -> Any:
        q = level(t) + 0.1 * random.standard_normal((len(t), 4))
        return q / np.linalg.norm(q, axis=1, keepdims=True)

    with pytest.raises(CheckFailed, match="two runs"):
        check(whole_run(shaken), "repeats_itself")()


def test_a_look_into_the_future_is_found_unless_declared() -> None:
    def ahead(t: Any, gyr: Any, acc: Any) -> Any:
        q = level(t)
        q[:, 1] = 0.1 * np.tanh(gyr[-1, 0])
        return q / np.linalg.norm(q, axis=1, keepdims=True)

    with pytest.raises(CheckFailed, match="later samples"):
        check(whole_run(ahead), "looks_back_only")()
    assert "looks_back_only" not in dict(checks(replace(whole_run(ahead), causal=False)))


@pytest.mark.parametrize(
    "make",
    [lambda t, g, a: np.full((len(t), 4), np.nan), lambda t, g, a: level(t)[:-1], lambda t, g, a: 2.0 * level(t)],
    ids=["nan", "one-too-few", "not-unit"],
)
def test_attitudes_that_are_none_are_found(make: Callable[..., Any]) -> None:
    with pytest.raises((CheckFailed, PluginError)):
        check(whole_run(make), "gives_unit_quaternions")()


LOOPS: list[tuple[str, Any, Callable[[Subject], None]]] = [
    ("timestamps.MAX_BRIDGED_GAP_S", 0.0, contract.bridges_a_short_gap),
    ("timestamps.MAX_BRIDGED_GAP_S", 100.0, contract.restarts_after_a_long_gap),
    ("GYRO_LIMIT_RAD_S", np.inf, contract.drops_impossible_values),
    ("HOLD_PERIODS", 0.0, contract.works_with_a_slow_magnetometer),
    ("timestamps.longest_rising", lambda t: np.arange(len(t)), contract.drops_times_that_do_not_rise),
    ("_vectors", lambda x, *_, **__: x, contract.survives_nan),
]


@pytest.mark.parametrize(("name", "value", "test"), LOOPS, ids=[f"{n}-{t.__name__}" for n, _, t in LOOPS])
def test_a_loop_without_its_rule_fails(
    monkeypatch: pytest.MonkeyPatch, name: str, value: Any, test: Callable[[Subject], None]
) -> None:
    monkeypatch.setattr(f"{samples.__name__}.{name}", value)
    with pytest.raises(CheckFailed), np.errstate(all="ignore"):
        test(Subject.of("mahony"))


def test_a_changed_input_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(row: EstimatorSpec, t: Any, gyr: Any, acc: Any, mag: Any, **options: Any) -> None:
        np.nan_to_num(mag, copy=False)

    monkeypatch.setattr(motions, "estimate", careless)
    with pytest.raises(CheckFailed, match="changes its input mag"):
        contract.leaves_its_input_alone(Subject.of("mahony"))


def test_arrays_that_make_a_difference_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = motions.estimate

    def picky(row: EstimatorSpec, t: Any, gyr: Any, acc: Any, mag: Any = None, **options: Any) -> Estimate:
        return plain(row, t, gyr if gyr.dtype == np.float64 else 0.9 * gyr, acc, mag, **options)

    monkeypatch.setattr(motions, "estimate", picky)
    with pytest.raises(CheckFailed, match="float32"):
        contract.takes_any_array(Subject.of("mahony"))


def test_running_without_the_sensor_it_needs_is_found() -> None:
    with pytest.raises(CheckFailed, match="needs a magnetometer and runs without"):
        contract.refuses_without_magnetometer(Subject.of("mahony"))
    with pytest.raises(CheckFailed, match="needs GNSS and runs without"):
        contract.refuses_without_gnss(Subject.of("eskf"))


def test_outcomes_name_the_check_and_say_what_happened() -> None:
    seen: list[CheckOutcome] = []
    estimator = replace(whole_run(lambda t, g, a: level(t)), source="")
    outcomes = [o for o in check_estimator(estimator, seen.append) if not o.passed]
    assert len(seen) == len(checks(estimator))
    assert {"describes_itself", "follows_a_turn[roll]"} <= {o.name for o in outcomes}
    assert any("a turn of 30 deg in roll gives 0.0 deg of roll" in o.message for o in outcomes)
