"""Filters without GNSS on simulated firmware flights: planes with airspeed, and starts in the air."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.estimators import estimate, place
from attlog.pipeline import inputs
from attlog.testing import Noise, still
from attlog.testing.motions import tilt_deg

PLANES = ("ardupilot/plane_dcm.bin", "ardupilot/plane_fbwa_cruise.bin", "px4/px4_plane.ulg")
AFTER_S, LATER_S = 15.0, 20.0
"""What is scored begins so long after the first sample; a start in the air comes so long after lift-off."""


def flight(path: Path, in_the_air: bool) -> tuple[Any, dict[str, Any]]:
    """The log and what a filter is given of it, from the first sample or from 20 s after lift-off."""
    case = attlog.prepare(path)
    log = case.log
    assert log.imu is not None
    assert log.mag is not None
    imu, field = log.imus[log.imu], log.mags[log.mag].field
    t = imu.gyro.t_best
    given = {"t": t, "gyr": imu.gyro.x, "acc": imu.acc.x, "mag": place(t, field.t_best, field.x)}
    begin = case.segments.of("airborne")[0].t0 + LATER_S if in_the_air else t[0]
    given = {name: x[t >= begin] for name, x in given.items()}
    aids = replace(inputs.aids_of(log, case.segments, imu), position=None, velocity=None).between(begin, t[-1])
    declination = case.reference.alignment.declination_deg or 0.0
    rest: dict[str, Any] = {"sampling": imu.gyro.sampling, "declination": declination}
    return log, given | rest | {"aids": aids}


def off(log: Any, e: Any) -> tuple[float, float]:
    """RMS of tilt and heading error in deg against the simulator's truth."""
    use = (log.truth.t > e.t[0] + AFTER_S) & (log.truth.t < e.t[-1]) & np.isfinite(log.truth.q).all(axis=1)
    error = rotation.earth_error(rotation.slerp(e.t, e.q, log.truth.t[use]), log.truth.q[use])
    both = rotation.tilt_angle(error), rotation.heading_angle(error)
    return tuple(float(np.degrees(np.sqrt(np.mean(x**2)))) for x in both)  # type: ignore[return-value]


@pytest.mark.parametrize("in_the_air", [False, True])
@pytest.mark.parametrize("name", PLANES)
def test_planes_keep_their_attitude_by_airspeed(name: str, in_the_air: bool, corpus: Path) -> None:
    """Measured with, and without airspeed: 0.7 to 1.4, and 1.2 to 24 deg of tilt."""
    log, given = flight(corpus / "sitl" / name, in_the_air)
    deaf = given | {"aids": replace(given["aids"], airspeed=None)}
    tilt, heading = off(log, estimate("mekf", **given))
    assert tilt < min(1.6, 0.75 * off(log, estimate("mekf", **deaf))[0])
    assert heading < 2.5
    assert off(log, estimate("smoother", **given))[0] < tilt


@pytest.mark.parametrize("name", ["px4_aggressive.ulg", "px4_wind.ulg", "px4_steps.ulg"])
def test_a_log_that_begins_in_a_lively_flight_is_off_by_few_degrees(name: str, corpus: Path) -> None:
    """Before a start in motion was told from one at rest: 14.6 deg of tilt and 15 of heading on the first."""
    log, given = flight(corpus / "sitl" / "px4" / name, in_the_air=True)
    tilt, heading = off(log, estimate("mekf", **given))
    assert tilt < 5.5
    assert heading < 8.0


# The adapters to other people's packages: what they report, and that settings mean what their units say.


def biased(deg_s: float, seconds: float = 60.0) -> tuple[np.ndarray, ...]:
    """Rest with a gyro bias in roll; true attitude first."""
    m = still(seconds, 50.0, noise=Noise(gyro=1e-4, acc=0.003, bias=(np.deg2rad(deg_s), 0.0, 0.0)))
    return m.q, m.t, m.gyr, m.acc


def test_vqf_tells_when_the_bias_exceeds_its_clip() -> None:
    _, *sensors = biased(4.0)
    assert estimate("vqf@package", *sensors).skipped["bias_beyond_clip"] > 1000
    assert "bias_beyond_clip" not in estimate("vqf:bias_clip=10", *sensors).skipped


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_fusion_settles_where_gain_and_gyro_bias_balance(gain: float) -> None:
    """sin(error) = bias / gain, with gain in 1/s."""
    q, *sensors = biased(4.0)
    seen = tilt_deg(estimate(f"fusion:gain={gain}", *sensors).q[-100:], q[-100:])
    assert np.median(np.abs(seen)) == pytest.approx(np.rad2deg(np.arcsin(np.deg2rad(4.0) / gain)), rel=0.05)


def test_fusion_s_timeout_is_in_seconds() -> None:
    """With 8 deg/s the accelerometer is soon left out; it comes back after the timeout or never."""
    q, *sensors = biased(8.0)
    soon, never = (tilt_deg(estimate(f"fusion@example:timeout={s}", *sensors).q, q).max() for s in (1, 1000))
    assert soon < 60.0
    assert never > 120.0
