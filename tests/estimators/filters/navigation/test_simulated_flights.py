"""`eskf` and `smoother` against the truth in simulated logs of both firmwares."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.analysis import inputs
from attlog.base import rotation
from attlog.estimators import estimate, place
from attlog.reference import declination
from tests.conftest import few

SAMPLES = Path(__file__).parents[4] / "sample_logs"
FLIGHTS = {"copter_yaw_turns.bin": (0.25, 0.9, 117.0, "nobody"), "px4_steps.ulg": (0.8, 0.6, 0.0, "both")}
"""Most that tilt and heading errors of the smoother may be of the onboard attitude's; the delay of GNSS in ms; what
heading rests on: turns on the spot show GNSS none."""


@pytest.fixture(scope="module", params=FLIGHTS)
def flown(request):
    case = attlog.prepare(SAMPLES / request.param)
    log, imu = case.log, case.log.imus[case.log.imu]
    field = log.mags[log.mag].field
    given = {
        "t": imu.gyro.t_best,
        "gyr": imu.gyro.x,
        "acc": imu.acc.x,
        "mag": place(imu.gyro.t_best, field.t_best, field.x),
        "sampling": imu.gyro.sampling,
        "aids": inputs.aids_of(log, case.segments, imu, declination.model(log)),
        "declination": case.reference.declination_deg,
    }
    return request.param, log, given


def rms_deg(log, t, q):
    """Tilt and heading RMSE against truth from 15 s on."""
    use = (log.truth.t > 15.0) & (log.truth.t < t[-1]) & np.isfinite(log.truth.q).all(axis=1)
    e = rotation.error(rotation.slerp(t, q, log.truth.t[use]), log.truth.q[use])
    angles = rotation.inclination_angle(e), rotation.heading_angle(e)
    return np.degrees([np.sqrt(np.mean(x * x)) for x in angles])


def test_the_smoother_is_closer_to_truth_than_what_flew(flown):
    name, log, given = flown
    tilt, heading, delay, heading_from = FLIGHTS[name]
    e = estimate("smoother", **given)
    onboard = log.onboard_attitude
    at = onboard.t if onboard.t_sample is None else onboard.t_sample
    ratio = rms_deg(log, e.t, e.q) / rms_deg(log, at, onboard.q)
    assert ratio[0] < tilt
    assert ratio[1] < heading
    assert e.quality["gnss_delay_ms"] == pytest.approx(delay, abs=20.0)
    assert e.quality["heading_from"] == heading_from
    assert (e.quality["refused"] == "") == (heading_from == "both")


@pytest.mark.parametrize("spec", few(["eskf", "eskf@fixed"], 1))
def test_the_filter_does_not_diverge(flown, spec):
    _, log, given = flown
    tilt, heading = rms_deg(log, *(lambda e: (e.t, e.q))(estimate(spec, **given)))
    assert tilt < 1.2
    assert heading < 3.0
