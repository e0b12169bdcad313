"""An estimator that runs sample by sample gives what ``attlog.estimate`` gives over the whole log."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from attlog.core import rotation
from attlog.core.errors import PluginError, PluginTimeout, UsageError
from attlog.estimators import Aids, Measurements, estimate, get, names, parse
from attlog.simulate.fly import fly
from attlog.simulate.onboard import Cleaner, Live
from attlog.simulate.pilot import make_pilot
from attlog.testing.motions import IN_PLACE
from tests.conftest import few
from tests.simulate.test_fly import everything, hop

Array = np.ndarray
STEPPING = [n for n in names() if get(n).step is not None and get(n).origin == "attlog"]
WHOLE = [n for n in names() if get(n).step is None and get(n).origin == "attlog"]
RATE, MAG_EVERY = 200.0, 4
FIELD = np.array([21.0, 1.5, 42.0])


def made(seconds: float, still: float, first_field: float = 0.0) -> tuple[Array, Array, Array, Array]:
    """Times and noisy samples: ``still`` s at rest, then swings; NaN rows where the slow magnetometer has no sample."""
    t = np.arange(int(seconds * RATE)) / RATE
    rng = np.random.default_rng(3)
    moving = np.clip(t - still, 0.0, 1.0)[:, None]
    rate = moving * np.array([0.8, 0.6, 0.9]) * np.sin(t[:, None] * [2.1, 1.7, 0.9] + [0.0, 1.0, 2.0])
    q = np.empty((len(t), 4))
    q[0] = rotation.from_euler(0.1, -0.05, 0.7)
    for k in range(1, len(t)):
        q[k] = rotation.multiply(q[k - 1], rotation.from_rotvec(rate[k] / RATE))
    gyr = rate + np.array([0.01, -0.004, 0.006]) + 0.002 * rng.standard_normal(rate.shape)
    acc = rotation.rotate_inverse(q, np.array([0.0, 0.0, -9.81])) + 0.05 * rng.standard_normal(rate.shape)
    mag = rotation.rotate_inverse(q, FIELD) + 0.1 * rng.standard_normal(rate.shape)
    mag[(np.arange(len(t)) % MAG_EVERY != 0) | (t < first_field)] = np.nan
    return t, gyr, acc, mag


def flown(live: Live, t: Array, gyr: Array, acc: Array, mag: Array) -> Live:
    for k in range(len(t)):
        live.sample(float(t[k]), gyr[k], acc[k], None if np.isnan(mag[k]).all() else mag[k])
    return live


def assert_same(live: Live, t: Array, gyr: Array, acc: Array, mag: Array, within: float = 1e-9, **more: object) -> None:
    if "gnss" in live.row.estimator.needs:
        more = {"aids": IN_PLACE, **more}  # fixes that do not move tell as little as none
    batch = estimate(live.row, t, gyr, acc, mag, declination=4.0, **more)
    own = live.estimate()
    np.testing.assert_array_equal(own.t, batch.t)
    np.testing.assert_allclose(np.degrees(rotation.total_angle(rotation.earth_error(own.q, batch.q))), 0.0, atol=within)
    if batch.bias is not None:
        np.testing.assert_allclose(own.bias, batch.bias, atol=1e-12)
    for name, values in batch.aux.items():
        np.testing.assert_allclose(own.aux[name], values, rtol=1e-9, atol=1e-12)
    assert own.skipped == batch.skipped
    assert own.no_heading == batch.no_heading
    np.testing.assert_allclose(live.q, batch.q[-1], atol=1e-12)


@pytest.mark.parametrize("sampling", ["interval", "instant"])
@pytest.mark.parametrize("name", few(STEPPING, 5))
def test_it_is_the_batch_run_after_a_rest(name: str, sampling: str) -> None:
    data = made(4.0, still=1.2)
    live = flown(Live(name, RATE, RATE / MAG_EVERY, sampling=sampling, declination=4.0), *data)
    assert_same(live, *data, sampling=sampling)


@pytest.mark.parametrize("name", ["mahony_dcm@huang", "ekf12@fan", "mekf", "px4_q"])
@pytest.mark.parametrize("first_field", few([2.0, 3.8], 1))
def test_it_is_the_batch_run_from_a_start_in_motion_and_with_a_compass_that_comes_late(
    name: str, first_field: float
) -> None:
    data = made(6.0, still=0.0, first_field=first_field)
    live = flown(Live(name, RATE, RATE / MAG_EVERY, declination=4.0), *data)
    assert_same(live, *data)


@pytest.mark.parametrize("name", ["mahony", "ekf12", "madgwick"])
def test_it_is_the_batch_run_through_bad_samples_gaps_and_a_restart(name: str) -> None:
    t, gyr, acc, mag = made(9.0, still=1.2)
    gyr[700], acc[720], mag[740] = np.nan, np.inf, 0.0
    gyr[760, 1], t[770] = 1e6, t[600]
    keep = np.ones(len(t), bool)
    keep[800:840] = keep[1000:1150] = False
    data = tuple(x[keep] for x in (t, gyr, acc, mag))
    live = flown(Live(name, RATE, RATE / MAG_EVERY, declination=4.0), *data)
    assert_same(live, *data)
    assert live.skipped["restart"] == 1
    assert live.skipped["gap_bridged"] >= 1


@pytest.mark.parametrize("name", ["px4_q:ATT_ACC_COMP=1", "ap_dcm"])
def test_it_takes_aids_at_the_first_sample_at_or_after_their_time(name: str) -> None:
    data = made(8.0, still=1.2)
    t = data[0]
    fixes = np.arange(0.033, 8.0, 0.2)
    speed = np.column_stack([np.sin(fixes), np.cos(fixes), 0.1 * fixes])
    rest = np.array([[0.0, 1.2]])
    live = Live(name, RATE, RATE / MAG_EVERY, declination=4.0)
    nothing = (float("nan"),) * 3
    for k in range(len(t)):
        live.aids.resting(t[k] <= 1.2)
        for i in np.flatnonzero((fixes <= t[k]) & (fixes > (t[k - 1] if k else -1.0))):
            live.aids.gnss(float(fixes[i]), None, speed[i], nothing)
        live.sample(float(t[k]), data[1][k], data[2][k], None if np.isnan(data[3][k]).all() else data[3][k])
    assert_same(live, *data, aids=Aids(velocity=Measurements(fixes, speed), at_rest=rest))
    without = estimate(live.row, *data, declination=4.0)
    apart = rotation.total_angle(rotation.earth_error(live.estimate().q, without.q))
    assert np.degrees(apart.max()) > 0.1


def test_whole_run_estimators_and_those_without_their_compass_are_refused_with_the_reason() -> None:
    for name in WHOLE:
        with pytest.raises(UsageError, match=f"{name} cannot fly: it runs over a whole log"):
            Live(name, RATE, RATE / MAG_EVERY)
    with pytest.raises(UsageError, match="ekf12 needs a magnetometer"):
        Live("ekf12", RATE, None)
    t, gyr, acc, mag = made(3.0, still=1.2)
    live = flown(Live("mahony", RATE, None), t, gyr, acc, np.full_like(mag, np.nan))
    np.testing.assert_allclose(live.estimate().q, estimate("mahony", t, gyr, acc).q, atol=1e-12)


# Samples one by one: what time each of them is integrated over.

GYR, ACC = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize(("step", "own", "dt"), [(0.0102, 0.01, 0.01), (0.03, 0.01, 0.03), (0.012, 0.0, 0.012)])
def test_a_sample_is_integrated_over_its_own_time_unless_others_were_lost_before_it(
    step: float, own: float, dt: float
) -> None:
    cleaner = Cleaner(100.0, None, hold_mag=False, instant=False, aids=None)
    first, second = (cleaner.cleaned(t, GYR, ACC, None, own) for t in (5.0, 5.0 + step))
    assert first is not None
    assert second is not None
    assert (first.dt, second.dt) == (0.0, pytest.approx(dt))


# A filter that is not attlog's flies in a process of its own: the same flight, and whatever it does ends there.

FILE = '''"""Gyro alone."""
import os
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.vectors import turn
PARAMETERS = (Parameter("scale", 1.0, "", 0, 2, "of the rates", "test"),)
print("at import")
def now():
    {now}
def start(params, acc, mag, q0):
    now()
    return q0.copy()
def step(state, params, dt, gyr, acc, mag):
    turn(state, params[0] * gyr[0], params[0] * gyr[1], params[0] * gyr[2], dt, 0.0)
    {step}
'''


def written(folder: Path, now: str = "pass", step: str = "pass") -> str:
    path = folder / "own.py"
    path.write_text(FILE.format(now=now, step=step))
    return str(path)


@pytest.mark.slow
def test_the_flight_is_that_of_this_process_to_the_bit(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    name = written(tmp_path)
    scenario = hop(seconds=3.0, estimator={"name": f"{name}:scale=0.9"})
    there = fly(scenario, 3)
    out, err = capfd.readouterr()
    assert (out, "at import" in err) == ("", True)
    here = fly(scenario, 3, partial(make_pilot, row=parse(f"{name}:scale=0.9")))
    assert everything(there) == everything(here)
    assert there.onboard.estimator == "own:scale=0.9"
    assert np.isfinite(there.onboard.q[-1]).all()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    ("now", "step", "words"),
    few(
        [
            ("raise ValueError('no good')", "pass", "own.py, line 9: ValueError: no good"),
            ("os.abort()", "pass", "SIGABRT"),
            ("os.closerange(3, 64)", "pass", "cannot answer any more"),
            ("return np.zeros(3)", "state[:] = np.nan", "cannot fly: gives"),
        ],
        1,
    ),
)
def test_what_it_does_ends_its_flight_alone(tmp_path: Path, now: str, step: str, words: str) -> None:
    with pytest.raises(PluginError, match="own") as told:
        fly(hop(seconds=2.0, estimator={"name": written(tmp_path, now, step)}))
    assert words in str(told.value)


@pytest.mark.slow
def test_an_endless_one_is_given_the_flights_own_seconds_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = written(tmp_path, "while True: pass")
    parse(name)  # loading takes its own time
    monkeypatch.setenv("ATTLOG_FILTER_TIMEOUT", "0.5")
    with pytest.raises(PluginTimeout, match=r"longer than 2\.5 s"):
        fly(hop(seconds=2.0, estimator={"name": name}))
