"""Whole-run estimators: what they are told of the samples, and what they say of themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.estimators import Aids, Estimate, Measurements, estimate, place
from attlog.estimators.engine.loop import joined_aux
from attlog.testing import still
from tests.conftest import few

PLUGIN = '''"""Says what it was told."""
import numpy as np
from attlog.estimators import Estimate
SOURCE = "test"
NEEDS = {"gyro", "acc"}
USES = {"mag"}

def run(t, gyr, acc, mag, aids, params):
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    said = {"sampling": aids.sampling, "seconds": float(t[-1] - t[0])}
    if aids.mag is not None:
        times = aids.mag.t
        said |= {"fields": len(times), "first_field": times[0], "on_imu": float(np.isin(times, t).mean())}
    return Estimate(t=t, q=q, quality=said)
'''


@pytest.fixture
def plugin(tmp_path: Path) -> str:
    file = tmp_path / "says.py"
    file.write_text(PLUGIN)
    return str(file)


@pytest.mark.parametrize("sampling", few(["interval", "instant"], 1))
def test_a_whole_run_knows_how_its_samples_were_taken(plugin: str, sampling: str) -> None:
    m = still(2.0)
    assert estimate(plugin, m.t, m.gyr, m.acc, sampling=sampling, aids=Aids()).quality["sampling"] == sampling


def test_the_longest_segment_speaks_for_the_run(plugin: str) -> None:
    m = still(20.0)
    kept = m.part(np.r_[0:300, 900:2000])
    quality = estimate(plugin, kept.t, kept.gyr, kept.acc).quality
    assert quality["seconds"] == pytest.approx(10.99)


@pytest.mark.slow
def test_what_a_run_says_of_itself_stands_in_the_result(plugin: str, tmp_path: Path) -> None:
    log = Path(__file__).parents[2] / "sample_logs" / "px4_steps.ulg"
    result = attlog.analyze(log, {"estimators": [plugin]})
    file = tmp_path / "result.json"
    file.write_text(result.to_json())
    row = next(r for r in attlog.Result.load(file).estimators if r.name == "says")
    assert row.quality["sampling"] == "interval"
    field = attlog.read(log).mags[0].field
    assert row.quality["fields"] == pytest.approx(np.unique(field.t_best).size, abs=2)  # not outside the IMU's time
    assert row.quality["on_imu"] < 0.5  # at the log's own times, not at the IMU's


def test_a_magnetometer_comes_at_its_own_times_where_they_are_known(plugin: str) -> None:
    m = still(2.0)
    slow = np.full_like(m.mag, np.nan)
    slow[3::10] = m.mag[3::10]
    rows = estimate(plugin, m.t, m.gyr, m.acc, slow).quality
    assert (rows["fields"], rows["first_field"], rows["on_imu"]) == (20, pytest.approx(0.03), 1.0)
    own = Aids(mag=Measurements(np.arange(0.004, 1.9, 0.1), np.tile(m.mag[0], (19, 1))))
    for mag in (slow, None):
        told = estimate(plugin, m.t, m.gyr, m.acc, mag, aids=own).quality
        assert (told["fields"], told["first_field"], told["on_imu"]) == (19, pytest.approx(0.004), 0.0)
    assert "fields" not in estimate(plugin, m.t, m.gyr, m.acc).quality


def test_the_times_of_a_magnetometer_stand_in_for_its_rows() -> None:
    """Of a filter that steps, each sample goes to the first IMU sample from its time on."""
    m = still(2.0, yaw=0.5)
    times = np.arange(0.004, 1.9, 0.1)
    field = np.tile(m.mag[0], (19, 1))
    own = estimate("mekf", m.t, m.gyr, m.acc, aids=Aids(mag=Measurements(times, field)))
    assert np.array_equal(own.q, estimate("mekf", m.t, m.gyr, m.acc, place(m.t, times, field)).q)


def test_what_only_some_segments_tell_is_missing_in_the_others() -> None:
    def told(n: int, **aux: int) -> Estimate:
        t = np.arange(n) * 0.01
        q = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        return Estimate(t=t, q=q, aux={name: np.full((n, k), 1.0) for name, k in aux.items()})

    found = joined_aux([told(3, velocity=2), told(2), told(4, height=1, velocity=2)])
    assert list(found) == ["velocity", "height"]
    np.testing.assert_array_equal(np.isfinite(found["velocity"][:, 0]), [1, 1, 1, 0, 0, 1, 1, 1, 1])
    np.testing.assert_array_equal(np.isfinite(found["height"][:, 0]), [0, 0, 0, 0, 0, 1, 1, 1, 1])
    assert joined_aux([]) == {}
