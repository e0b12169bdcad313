"""A magnetometer that is thinned to 2 Hz costs little heading: the loop turns its last vector on with the gyro."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.base import rotation
from attlog.estimators import estimate, place


@pytest.mark.parametrize("name", ["px4/px4_yaw.ulg", "ardupilot/copter_yaw_turns.bin"])
def test_heading_at_2_hz_is_within_ten_percent_of_the_full_rate_s(corpus: Path, name: str) -> None:
    log = attlog.read(corpus / "sitl" / name)
    with (corpus / "sitl" / "MANIFEST.csv").open(encoding="utf-8") as file:
        declination = next(float(r["declination_true"]) for r in csv.DictReader(file) if r["file"] == name)
    assert log.imu is not None
    assert log.mag is not None
    assert log.truth is not None
    imu, field, truth = log.imus[log.imu], log.mags[log.mag].field, log.truth
    due = np.floor(field.t_best / 0.5)
    thin = np.flatnonzero(np.diff(due, prepend=-np.inf) > 0)

    def heading_rmse_deg(keep: np.ndarray | slice) -> float:
        mag = place(imu.gyro.t, field.t_best[keep], field.x[keep])
        e = estimate(
            "mahony@xu-0.6", imu.gyro.t, imu.gyro.x, imu.acc.x, mag, sampling=imu.gyro.sampling, declination=declination
        )
        use = (truth.t > 15.0) & (truth.t < e.t[-1])
        error = rotation.error(rotation.slerp(e.t, e.q, truth.t[use]), truth.q[use])
        return float(np.rad2deg(np.sqrt(np.mean(rotation.heading_angle(error) ** 2))))

    assert len(thin) < 0.25 * len(field.t)
    assert heading_rmse_deg(thin) < 1.1 * heading_rmse_deg(slice(None))


COUNTER = '''"""Counts the steps that see a field."""
import numpy as np
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "seen": 1}

def start(params, acc, mag, q0):
    state = np.zeros(5)
    state[0:4] = q0
    return state

def step(state, params, dt, gyr, acc, mag):
    if mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2] > 0:
        state[4] += 1
'''


def test_a_field_is_propagated_for_one_and_a_half_periods_and_then_missing(tmp_path: Path) -> None:
    """2 Hz until 5 s: the filter sees a field up to 0.75 s after each sample, so until 5.75 s and not beyond."""
    path = tmp_path / "counter.py"
    path.write_text(COUNTER)
    t = np.arange(2000) / 100.0
    mag = np.full((2000, 3), np.nan)
    mag[:501:50] = [0.2, 0.0, 0.4]
    e = estimate(str(path), t, np.zeros((2000, 3)), np.tile([0.0, 0.0, -9.81], (2000, 1)), mag)
    seen = np.flatnonzero(np.diff(e.aux["seen"][:, 0]) > 0) + 1
    assert t[seen[-1]] == pytest.approx(5.75, abs=0.011)
    assert np.diff(seen).max() == 1
