"""Many parameter sets side by side give what one-by-one runs give."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators import batch, get, interface
from attlog.estimators.batch import batch_kernel, estimate_batch
from attlog.estimators.interface import Parameter
from attlog.estimators.registry import BUILT_IN
from attlog.testing.motions import CONSUMER_NOISE, IN_PLACE
from attlog.testing.motions import flight as motion_flight
from tests.conftest import few

G = 9.80665


def flight(n: int = 3000) -> tuple[np.ndarray, ...]:
    """Noisy motion at 200 Hz with a slow magnetometer, a short and a long gap."""
    rng = np.random.default_rng(0)
    t = np.arange(n) / 200.0
    q = rotation.from_euler(0.4 * np.sin(t), 0.3 * np.sin(1.3 * t), 0.5 * t)
    gyr = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) * 200
    gyr = np.vstack([gyr[:1], gyr]) + rng.normal(0, 0.02, (n, 3)) + 0.01
    acc = rotation.rotate_inverse(q, [0, 0, -G]) + rng.normal(0, 1.0, (n, 3))
    mag = rotation.rotate_inverse(q, [20.0, 0, 40.0])
    mag[np.arange(n) % 9 != 0] = np.nan
    keep = np.r_[0 : n // 3, n // 3 + 60 : n // 2, n // 2 + 200 : n]
    return t[keep], gyr[keep], acc[keep], mag[keep]


@pytest.fixture(autouse=True)
def side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """However little there is to do."""
    monkeypatch.setattr(batch, "WORTH", 0)


SETS = [{"kp": 0.1 + 0.2 * i, "ki": 0.002 * i} for i in range(19)]


@pytest.mark.parametrize("name", few(["mahony", "complementary"], 1))
def test_each_set_equals_a_run_of_its_own_to_the_bit(name: str) -> None:
    x = flight()
    found = estimate_batch(get(name), SETS, *x)
    assert len(found) == len(SETS)
    for values, one in zip(SETS, found, strict=True):
        alone = attlog.estimate(name, *x, **values)
        assert np.array_equal(one.q, alone.q)
        assert np.array_equal(one.bias, alone.bias)
        assert np.array_equal(one.t, alone.t)
        assert np.array_equal(one.segment, alone.segment)
        assert one.skipped == alone.skipped


def test_little_work_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    x = flight(300)

    def refused(*_: object) -> None:
        raise AssertionError("a kernel for many sets was asked for")

    monkeypatch.setattr(batch, "batch_kernel", refused)
    monkeypatch.setattr(batch, "WORTH", len(SETS) * len(x[0]) + 1)
    assert len(estimate_batch(get("mahony"), SETS, *x)) == len(SETS)
    monkeypatch.setattr(batch, "WORTH", len(SETS) * len(x[0]))
    with pytest.raises(AssertionError, match="asked for"):
        estimate_batch(get("mahony"), SETS, *x)


ONE_BY_ONE = {"mekf"}
"""Covariances too large to stand side by side in vector registers, and branches that part the sets."""


@pytest.mark.parametrize("name", few([n for n in BUILT_IN if get(n).step is not None], 4))
def test_every_built_in_filter_gives_in_a_batch_what_it_gives_alone(name: str) -> None:
    """The numbers of every filter differ between the sets, so that mixed up columns would show."""
    x = flight(600)
    numbers = [p for p in get(name).own if not p.choices]
    sets = [{p.name: min(p.high, f * float(p.default)) for p in numbers} for f in (1.0, 0.8, 1.3)]
    switches = {i: p.code(p.default) for i, p in enumerate(get(name).own) if p.choices}
    one_by_one = name in ONE_BY_ONE or get(name).aided  # aids arrive at their own times
    assert (batch_kernel(get(name), switches, "float64") is None) == one_by_one
    given = {"aids": IN_PLACE} if "gnss" in get(name).needs else {}
    for values, one in zip(sets, estimate_batch(get(name), sets, *x, **given), strict=True):
        alone = attlog.estimate(name, *x, **given, **values)
        assert np.abs(one.q - alone.q).max() < 1e-12
        for output, columns in alone.aux.items():
            assert np.allclose(one.aux[output], columns, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_switches_declination_start_and_decimation_may_differ_or_be_given() -> None:
    x = flight()
    sets: list[dict[str, Any]] = [{}, {"mag_form": "vector"}, {"declination": 7.0}, {"init": "first"}, {"kp": 3.0}]
    q0 = rotation.from_euler(0.1, 0.2, 0.3)
    found = estimate_batch(get("mahony"), sets, *x, preset="xu-1.1", q0=q0, every=5, sampling="instant")
    for values, one in zip(sets, found, strict=True):
        alone = attlog.estimate("mahony@xu-1.1", *x, q0=q0, every=5, sampling="instant", **values)
        assert np.array_equal(one.q, alone.q)


@pytest.mark.slow
def test_single_precision_stays_within_a_tenth_of_a_degree() -> None:
    x = flight(20000)
    double, single = (estimate_batch(get("mahony"), SETS[:3], *x, dtype=d) for d in ("float64", "float32"))
    for a, b in zip(double, single, strict=True):
        apart = np.rad2deg(rotation.total_angle(rotation.earth_error(a.q, b.q)))
        assert 0 < apart.max() < 0.1


def vector_step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """A step that works on whole arrays, as a plug-in may."""
    turn = 0.5 * dt * gyr[0:3]
    w = state[0]
    state[0] = w - np.sum(state[1:4] * turn)
    state[1:4] = state[1:4] + w * turn
    state[0:4] = state[0:4] / np.sqrt(np.sum(state[0:4] ** 2))


@pytest.mark.slow
def test_a_step_that_cannot_be_rewritten_runs_one_by_one() -> None:
    gain = interface.Parameter("gain", 1.0, "1", 0, 2, "none", "test")
    estimator = interface.Estimator(
        "whole",
        "",
        "",
        "",
        frozenset({"gyro"}),
        frozenset({"gyro"}),
        (gain, interface.INIT),
        {},
        start=lambda params, acc, mag, q0: q0,
        step=vector_step,
        origin="test",
    )
    assert batch_kernel(estimator, {}, "float64") is None
    x = flight()
    found = estimate_batch(estimator, [{}, {"gain": 2.0}], *x)
    assert np.array_equal(found[0].q, attlog.estimate(estimator, *x).q)


NAMES = '''"""A filter that uses the names of the code around it."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.vectors import gravity_error, turn
SOURCE = "test"
STATE = {"q": 4, "seen": 1}
PARAMETERS = (Parameter("kp", 0.6, "1/s", 0, 2, "gain", "test"),)
TAKEN = 0.5

def start(params, acc, mag, q0):
    return np.append(q0, 0.0)

def helper(x):
    return TAKEN * x

def step(state, params, dt, gyr, acc, mag):
    taken = helper(acc[1])
    state[4] = taken + acc[2]
    gx, gy, gz = gravity_error(state, acc, 1.0)
    turn(state, gyr[0] + params[0] * gx, gyr[1] + params[0] * gy, gyr[2] + params[0] * gz, dt, 0.0)
'''


@pytest.mark.parametrize(
    ("what", "name"),
    few(
        [
            ("taken", "BATCH_"),
            ("taken", "acc_1"),
            ("taken", "out"),
            ("TAKEN", "W"),
            ("TAKEN", "KEEP"),
            ("helper", "advance"),
            ("helper", "turned_back"),
        ],
        1,
    ),
)
def test_names_of_the_code_around_a_step_may_be_its_own(tmp_path: Path, what: str, name: str) -> None:
    """Whatever a filter calls its variables, constants and helpers, a batch gives what single runs give."""
    path = tmp_path / "names.py"
    path.write_text(re.sub(rf"\b{what}\b", name, NAMES))
    x = flight(300)
    for one, kp in zip(estimate_batch(get(str(path)), [{"kp": 0.3}, {"kp": 0.9}], *x), (0.3, 0.9), strict=True):
        alone = attlog.estimate(str(path), *x, kp=kp)
        assert one.q == pytest.approx(alone.q, abs=1e-12)
        assert one.aux["seen"] == pytest.approx(alone.aux["seen"], abs=1e-9)
        assert alone.aux["seen"][2:, 0] == pytest.approx((0.5 * x[2][:, 1] + x[2][:, 2])[1:-1], abs=1e-9)


def test_no_sets_no_samples_and_wrong_names_are_handled() -> None:
    x = flight()
    assert estimate_batch(get("mahony"), [], *x) == []
    nothing = estimate_batch(get("mahony"), [{}, {}], *(a[:0] for a in x))
    assert [e.q.shape for e in nothing] == [(0, 4), (0, 4)]
    with pytest.raises(UsageError, match="did you mean kp"):
        estimate_batch(get("mahony"), [{"kpp": 1}], *x)
    with pytest.raises(UsageError, match="float16"):
        estimate_batch(get("mahony"), [{}], *x, dtype="float16")  # type: ignore[arg-type]


# Every parameter of every filter means in a batch what it means in a run of its own.

PARAMETERS = [(name, p.name) for name in BUILT_IN if get(name).step is not None for p in get(name).parameters]
SINGLE_DEG = 0.2
"""What float32 may be off after 20 s: 4000 steps of a few 1e-7 rad each, and gains that carry it."""


def values(parameter: Parameter) -> list[float | str]:
    """Other values than the default, far enough from it to show."""
    if parameter.choices:
        return list(parameter.choices)
    default = float(parameter.default)
    found = (
        [0.5 * default, 1.7 * default] if default else [0.3 * min(parameter.high, 1.0), 0.1 * min(parameter.high, 1.0)]
    )
    return [float(np.clip(v, parameter.low, parameter.high)) for v in found]


@pytest.fixture(autouse=True)
def parameter_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """However little there is to do."""
    monkeypatch.setattr(batch, "WORTH", 0)


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, ...]:
    t, gyr, acc, mag = motion_flight(20.0, 200.0, noise=CONSUMER_NOISE).sensors
    mag = mag.copy()
    mag[np.arange(len(t)) % 4 != 0] = np.nan
    return t, gyr, acc, mag


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), PARAMETERS)
def test_a_batch_over_one_parameter_equals_runs_of_their_own(
    name: str, parameter: str, motion: tuple[np.ndarray, ...]
) -> None:
    sets = [{parameter: v} for v in values(get(name).parameter(parameter))]
    given = {"aids": IN_PLACE} if "gnss" in get(name).needs else {}
    alone = [attlog.estimate(name, *motion, **given, **one) for one in sets]  # type: ignore[arg-type]
    for one, own in zip(estimate_batch(get(name), sets, *motion, **given), alone, strict=True):
        assert np.abs(one.q - own.q).max() < 1e-9
        assert (one.bias is None) == (own.bias is None)
        if own.bias is not None and one.bias is not None:
            assert np.abs(one.bias - own.bias).max() < 1e-9
    for one, own in zip(estimate_batch(get(name), sets, *motion, **given, dtype="float32"), alone, strict=True):
        apart = np.rad2deg(rotation.total_angle(rotation.earth_error(one.q, own.q)))
        assert apart.max() < SINGLE_DEG
