"""One filter with many parameter sets gives what runs of their own give."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators import Estimate, get
from attlog.estimators.batch import estimate_batch
from attlog.testing.motions import IN_PLACE
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


SETS = [{"kp": 0.1 + 0.2 * i, "ki": 0.002 * i} for i in range(19)]


def assert_same(one: Estimate, alone: Estimate) -> None:
    assert np.array_equal(one.q, alone.q)
    assert np.array_equal(one.t, alone.t)
    assert np.array_equal(one.segment, alone.segment)
    assert one.skipped == alone.skipped
    assert (one.bias is None) == (alone.bias is None)
    if one.bias is not None and alone.bias is not None:
        assert np.array_equal(one.bias, alone.bias)
    for name, columns in alone.aux.items():
        assert np.array_equal(one.aux[name], columns, equal_nan=True)


def test_each_set_equals_a_run_of_its_own_to_the_bit() -> None:
    x = flight()
    found = estimate_batch(get("mahony"), SETS, *x)
    assert len(found) == len(SETS)
    for values, one in zip(SETS, found, strict=True):
        assert_same(one, attlog.estimate("mahony", *x, **values))


@pytest.mark.parametrize("name", few(["mekf", "gsf", "gyro", "vqf", "ap_dcm"], 2))
def test_filters_of_every_kind_give_in_a_batch_what_they_give_alone(name: str) -> None:
    """The numbers of a filter differ between the sets, so that a mix-up would show."""
    x = flight(600)
    numbers = [p for p in get(name).own if not p.choices]
    sets = [{p.name: min(p.high, f * float(p.default)) for p in numbers} for f in (1.0, 0.8, 1.3)]
    given = {"aids": IN_PLACE} if "gnss" in get(name).needs else {}
    for values, one in zip(sets, estimate_batch(get(name), sets, *x, **given), strict=True):
        assert_same(one, attlog.estimate(name, *x, **given, **values))


def test_switches_declination_start_and_decimation_may_differ_or_be_given() -> None:
    x = flight()
    sets: list[dict[str, Any]] = [{}, {"mag_form": "vector"}, {"declination": 7.0}, {"init": "first"}, {"kp": 3.0}]
    q0 = rotation.from_euler(0.1, 0.2, 0.3)
    found = estimate_batch(get("mahony"), sets, *x, preset="xu-1.1", q0=q0, every=5, sampling="instant")
    for values, one in zip(sets, found, strict=True):
        assert_same(one, attlog.estimate("mahony@xu-1.1", *x, q0=q0, every=5, sampling="instant", **values))


PLUGIN = '''"""A filter that uses the names of the code around it."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.vectors import gravity_error, turn
SOURCE = "test"
STATE = {"q": 4, "seen": 1}
PARAMETERS = (Parameter("kp", 0.6, "1/s", 0, 2, "gain", "test"),)
out = 0.5

def start(params, acc, mag, q0):
    return np.append(q0, 0.0)

def advance(x):
    return out * x

def step(state, params, dt, gyr, acc, mag):
    samples = advance(acc[1])
    state[4] = samples + acc[2]
    gx, gy, gz = gravity_error(state, acc, 1.0)
    turn(state, gyr[0] + params[0] * gx, gyr[1] + params[0] * gy, gyr[2] + params[0] * gz, dt, 0.0)
'''


def test_a_plugin_may_use_the_names_of_the_code_around_its_step(tmp_path: Path) -> None:
    path = tmp_path / "names.py"
    path.write_text(PLUGIN)
    x = flight(300)
    for one, kp in zip(estimate_batch(get(str(path)), [{"kp": 0.3}, {"kp": 0.9}], *x), (0.3, 0.9), strict=True):
        alone = attlog.estimate(str(path), *x, kp=kp)
        assert_same(one, alone)
        assert alone.aux["seen"][2:, 0] == pytest.approx((0.5 * x[2][:, 1] + x[2][:, 2])[1:-1], abs=1e-9)


def test_no_sets_no_samples_and_wrong_names_are_handled() -> None:
    x = flight()
    assert estimate_batch(get("mahony"), [], *x) == []
    nothing = estimate_batch(get("mahony"), [{}, {}], *(a[:0] for a in x))
    assert [e.q.shape for e in nothing] == [(0, 4), (0, 4)]
    with pytest.raises(UsageError, match="did you mean kp"):
        estimate_batch(get("mahony"), [{"kpp": 1}], *x)
