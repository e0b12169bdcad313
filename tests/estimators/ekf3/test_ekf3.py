"""EKF3 on made flights at rest and in turns, and on simulated flights of the firmware itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import attlog
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators.ekf3 import run
from attlog.estimators.ekf3.loop import run_filter
from attlog.estimators.ekf3.parameters import TABLE, settings_of, sources_of
from attlog.estimators.error_state import G
from attlog.estimators.rerun import EARTH_RADIUS_M
from attlog.flight.ardupilot.ekf3_inputs import Ekf3Inputs

RNG = np.random.default_rng(3)
FIELD = np.array([0.22, 0.02, 0.42])  # gauss, north-east-down
HEADING_DEG = 70.0


def made(seconds: float = 40.0, rate_hz: float = 50.0, turn_dps: float = 0.0, **changes: object) -> Ekf3Inputs:
    """A vehicle on the ground that turns about the vertical, with compass, barometer and GNSS at one place."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    n = len(t)

    def attitude(at: np.ndarray) -> Rotation:
        return Rotation.from_rotvec(np.outer(np.radians(HEADING_DEG + turn_dps * at), [0.0, 0.0, 1.0]))

    m = np.arange(0.0, seconds, 0.1)
    g = np.arange(0.0, seconds, 0.2)
    full = np.full
    gnss = {"t": g + 0.12, "t_message": g + 0.12, "lat": full(len(g), 47.0), "lon": full(len(g), 8.0)}
    gnss |= {name: full(len(g), value) for name, value in {"alt": 400.0, "vn": 0.0, "ve": 0.0, "vd": 0.0}.items()}
    gnss |= {"fix": full(len(g), 3.0), "satellites": full(len(g), 12.0), "hdop": full(len(g), 0.8)}
    gnss |= {"hacc": full(len(g), 0.5), "vacc": full(len(g), 0.8), "sacc": full(len(g), 0.3)}
    nothing = {"t": np.zeros(0)}
    none = np.zeros(0)
    names = ("initialised", "final_reset", "anomaly_reset", "gnss_on", "origin", "compass")
    values: dict[str, object] = {
        "core": 0,
        "unit": 0,
        "t": t,
        "gyro": np.tile([0.0, 0.0, np.radians(turn_dps)], (n, 1)),
        "acc": np.tile([0.0, 0.0, -G], (n, 1)),
        "gyro_late": 0.0,
        "acc_late": 0.0,
        "intervals": False,
        "mag": {"t": m, "x": attitude(m - 0.06).inv().apply(np.tile(FIELD, (len(m), 1))), "unit": np.zeros(len(m))},
        "other_mag": nothing | {"x": np.zeros((0, 3)), "unit": none},
        "gnss": gnss,
        "baro": {"t": m, "alt": np.zeros(len(m)), "t_sample": m},
        "airspeed": nothing | {"eas": none, "use": none},
        "gsf": nothing | {"yaw": none, "sigma": none},
        "armed": nothing | {"on": none},
        "landed": nothing | {"on": none},
        "touch_down": nothing | {"on": none},
        "events": dict.fromkeys(names, none),
        "states": None,
        "innovations": nothing,
        "step_s": None,
        "gnss_lag_ms": 120.0,
        "antenna": (0.0, 0.0, 0.0),
        "plane": False,
        "params": {"COMPASS_AUTODEC": 0.0, "COMPASS_DEC": float(np.arctan2(FIELD[1], FIELD[0]))},
        "version": (4, 5),
    }
    return Ekf3Inputs(**(values | changes))  # type: ignore[arg-type]


def yaw_deg(q: np.ndarray) -> np.ndarray:
    return np.degrees(rotation.to_euler(q)[:, 2])


def test_a_vehicle_at_rest_aligns_and_uses_gnss() -> None:
    found = run.rerun(made())
    assert found.start == "cold"
    end = found.q[-10:]
    assert yaw_deg(end) == pytest.approx(HEADING_DEG, abs=0.1)
    assert np.degrees(rotation.tilt_angle(rotation.earth_error(end, end * 0 + [1, 0, 0, 0]))).max() < 0.05
    last = np.flatnonzero(np.isfinite(found.states["gnss"]))[-1]
    assert found.states["gnss"][last] == 1.0
    assert np.abs(found.states["gyro_bias"][last]).max() < 1e-3
    assert {"heading", "velocity_n", "position_e", "baro_height"} <= found.innovations.keys()


def test_a_turning_vehicle_is_followed_at_the_time_of_the_sample() -> None:
    found = run.rerun(made(turn_dps=20.0))
    t, good = found.t[-100:], found.q[-100:]
    wanted = HEADING_DEG + 20.0 * t
    assert rotation.wrap(np.radians(yaw_deg(good) - wanted)) == pytest.approx(0.0, abs=np.radians(0.5))


def test_a_position_that_jumps_is_rejected_and_then_taken() -> None:
    inputs = made(60.0)
    moved = inputs.gnss["lat"] + np.where(inputs.gnss["t"] > 30.0, 40.0 / 111_000.0, 0.0)
    found = run.rerun(replace(inputs, gnss={**inputs.gnss, "lat": moved}))
    ratio = found.innovations["position_n"]
    assert (ratio[(ratio[:, 0] > 31.0) & (ratio[:, 0] < 36.0), 3] > 1.0).all()
    at = np.searchsorted(found.t_step, [35.0, 55.0])
    assert found.states["position"][at, 0] == pytest.approx([0.0, 40.0], abs=2.0)


def test_own_mode_uses_gnss_after_ten_seconds_of_good_checks() -> None:
    inputs = made(60.0)
    few = np.where(inputs.gnss["t"] < 30.0, 5.0, 12.0)
    late = replace(inputs, gnss={**inputs.gnss, "satellites": few})
    found = run.rerun(late)
    assert found.mode == "own"
    assert found.t_step[np.nan_to_num(found.states["gnss"]) > 0][0] == pytest.approx(40.0, abs=0.5)
    flown = run.rerun(replace(late, events={**late.events, "gnss_on": np.array([35.0])}))
    assert flown.mode == "flown"
    assert flown.t_step[np.nan_to_num(flown.states["gnss"]) > 0][0] == pytest.approx(35.0, abs=0.2)


def test_a_compass_that_disagrees_on_the_ground_resets_the_heading_after_five_seconds() -> None:
    inputs = made(60.0)
    turned = Rotation.from_euler("z", -80.0, degrees=True).apply(inputs.mag["x"])
    field = np.where(inputs.mag["t"][:, None] < 30.0, inputs.mag["x"], turned)
    found = run.rerun(replace(inputs, mag={**inputs.mag, "x": field}), {"YAW_M_NSE": 0.05})
    before, after = np.searchsorted(found.t, [34.0, 37.0])
    assert yaw_deg(found.q[[before, after]]) == pytest.approx([HEADING_DEG, HEADING_DEG + 80.0], abs=25.0)


def test_another_compass_begins_with_a_body_field_of_zero() -> None:
    inputs = made(60.0, turn_dps=20.0)
    offset = np.where(inputs.mag["t"][:, None] < 40.0, [0.05, 0.0, 0.0], [0.0, 0.05, 0.0])
    other = replace(inputs, mag={**inputs.mag, "x": inputs.mag["x"] + offset})
    found = run.rerun(replace(other, events={**other.events, "compass": np.array([40.0])}), {"MAG_CAL": 4.0})
    before, after, end = np.searchsorted(found.t_step, [39.5, 40.0, 59.0])
    assert found.states["body_field"][before] == pytest.approx([0.05, 0.0, 0.0], abs=0.01)
    assert np.abs(found.states["body_field"][after]).max() < 0.005
    assert found.states["body_field"][end] == pytest.approx([0.0, 0.05, 0.0], abs=0.01)


def test_own_mode_takes_the_next_compass_after_ten_seconds_of_refusals() -> None:
    inputs = made(90.0, turn_dps=20.0, armed={"t": np.array([30.0]), "on": np.array([1.0])})
    bad = np.where(inputs.mag["t"][:, None] < 40.0, inputs.mag["x"], [0.0, 0.6, -0.6])
    other = {"t": inputs.mag["t"], "x": inputs.mag["x"], "unit": np.ones(len(inputs.mag["t"]))}
    found = run.rerun(replace(inputs, mag={**inputs.mag, "x": bad}, other_mag=other), {"MAG_CAL": 4.0})
    x = found.innovations["mag_x"]
    refused = x[(x[:, 3] > 1.0) & (x[:, 0] > 40.0), 0]
    assert refused[-1] - refused[0] == pytest.approx(10.0, abs=0.5)
    assert rotation.wrap(np.radians(yaw_deg(found.q[-100:]) - HEADING_DEG - 20.0 * found.t[-100:])) == pytest.approx(
        0.0, abs=np.radians(1.0)
    )


def test_a_gnss_antenna_ahead_of_a_turning_imu_moves_in_a_circle() -> None:
    inputs = made(60.0, turn_dps=20.0)
    heading = np.radians(HEADING_DEG + 20.0 * (inputs.gnss["t"] - 0.12))
    speed = 3.0 * np.radians(20.0)  # of an antenna 3 m ahead
    moved = {
        "lat": inputs.gnss["lat"] + np.degrees(3.0 * np.cos(heading) / EARTH_RADIUS_M),
        "lon": inputs.gnss["lon"] + np.degrees(3.0 * np.sin(heading) / EARTH_RADIUS_M / np.cos(np.radians(47.0))),
        "vn": -speed * np.sin(heading),
        "ve": speed * np.cos(heading),
    }
    ahead = replace(inputs, gnss={**inputs.gnss, **moved}, antenna=(3.0, 0.0, 0.0))
    size = [
        np.sqrt(np.mean(run.rerun(one).innovations["velocity_n"][-50:, 1] ** 2))
        for one in (ahead, replace(ahead, antenna=(0.0, 0.0, 0.0)))
    ]
    assert size[0] < 0.03
    assert size[1] > 0.2


def test_steps_of_one_or_two_frames_spread_about_their_mean() -> None:
    inputs = replace(made(), step_s=0.01, params={"SCHED_LOOP_RATE": 120.0})
    step_s, frames, (two, four) = run.filter_step(inputs)
    assert (step_s, frames) == (0.01, 1)
    assert two == pytest.approx((0.8 * 1.0 + 0.2 * 4.0) / 1.44)
    assert four == pytest.approx((0.8 * 1.0 + 0.2 * 16.0) / 1.44**2)


def test_the_covariance_stays_symmetric_and_positive(monkeypatch: pytest.MonkeyPatch) -> None:
    filters = []
    monkeypatch.setattr(run, "run_filter", lambda f, *rest: (run_filter(f, *rest), filters.append(f)))
    run.rerun(made(200.0, turn_dps=20.0), {"MAG_CAL": 4.0})
    P = filters[-1].P
    assert np.abs(P - P.T).max() < 1e-15
    scale = np.sqrt(np.where(np.diag(P) > 0, np.diag(P), 1.0))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-9


def test_the_delay_of_the_imu_filters_is_taken_out() -> None:
    inputs = made()
    wave = np.column_stack([np.sin(6.0 * (inputs.t - 0.02)), np.zeros(len(inputs.t)), np.zeros(len(inputs.t))])
    late = replace(inputs, gyro=wave, gyro_late=0.02)
    _, steps = run.steps_of(late, 0.0125, 5)
    assert steps[100:-100, 1] == pytest.approx(np.sin(6.0 * (steps[100:-100, 0] - 0.00625)), abs=0.01)


def test_a_hole_of_the_imu_ends_a_span() -> None:
    inputs = made()
    keep = (inputs.t < 15.0) | (inputs.t > 17.0)
    spans, steps = run.steps_of(
        replace(inputs, t=inputs.t[keep], gyro=inputs.gyro[keep], acc=inputs.acc[keep]), 0.0125, 5
    )
    assert len(spans) == 2
    assert steps[spans[1].first, 0] > 17.0


def test_the_buffer_is_as_long_as_the_longest_delay() -> None:
    setting = sources_of(settings_of({}, (4, 5), False), (4, 5))
    assert run.ring_length(made(), setting, 120.0) == 11
    assert run.ring_length(made(), setting, 100.0) == 9
    assert run.ring_length(made(), setting | {"HGT_DELAY": 200.0}, 100.0) == 17


def test_the_field_table_is_the_model_at_its_nodes_and_linear_between() -> None:
    node, east = (run.table_field(made(), 40.0, lon) for lon in (10.0, 20.0))
    between = run.table_field(made(), 40.0, 15.0)
    assert node is not None
    assert east is not None
    assert between == pytest.approx(0.5 * (np.array(node) + np.array(east)), rel=1e-9)


def test_correlations_are_taken_over_and_variances_stay() -> None:
    a = RNG.normal(size=(23, 23))
    P = np.diag(RNG.uniform(0.1, 1.0, 23))
    P[20, 20] = 0.0
    made_of = run.correlated(P, a @ a.T)
    assert np.diag(made_of) == pytest.approx(np.diag(P))
    assert np.linalg.eigvalsh(made_of).min() > -1e-12
    sigma, c = RNG.uniform(0.01, 10.0, 23), np.eye(23)
    c[3, 9] = c[9, 3] = 0.4
    c[0, 2] = c[2, 0] = 0.4  # within the attitude: not taken over
    P[20, 20] = 0.5
    made_of = run.correlated(P, c * np.outer(sigma, sigma))
    assert made_of[3, 9] == pytest.approx(0.4 * np.sqrt(P[3, 3] * P[9, 9]))
    assert made_of[0, 2] == pytest.approx(0.0, abs=1e-12)


def test_settings_follow_version_and_vehicle() -> None:
    assert settings_of({}, (4, 5), True)["ALT_M_NSE"] == 3.0
    assert settings_of({}, (4, 0), False)["VELNE_M_NSE"] == 0.5
    assert settings_of({"EK3_MAG_M_NSE": 0.07}, (4, 5), False)["MAG_M_NSE"] == 0.07
    assert settings_of({"GPS1_DELAY_MS": 90.0}, (4, 6), False)["GPS_DELAY_MS"] == 90.0
    assert sources_of(settings_of({"EK3_GPS_TYPE": 3.0}, (4, 0), False), (4, 0))["SRC1_POSXY"] == 0.0


def test_parameters_of_another_version_are_refused() -> None:
    TABLE.check(["SRC1_YAW"], (4, 5))
    with pytest.raises(UsageError, match=r"EK3_SRC1_YAW exists from 4.1 on; this log is of version 4.0"):
        TABLE.check(["SRC1_YAW"], (4, 0))


# Simulated flights of the firmware: median and 95 % of tilt, median of heading in deg, in the air.
FLIGHTS = {
    "copter_loop400.bin": (0.08, 0.25, 0.35),
    "copter_long.bin": (0.08, 0.25, 0.35),
    "copter_aggressive.bin": (0.08, 0.25, 0.35),
    "copter_yaw_turns.bin": (0.08, 0.25, 0.35),
    "copter_gps_loss.bin": (0.10, 0.80, 0.35),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_a_simulated_flight_is_followed(corpus: Path, name: str) -> None:
    log = attlog.read(corpus / "sitl" / "ardupilot" / name)
    inputs = log.estimator.inputs()
    found = run.rerun(inputs)
    t, q = inputs.states.t, inputs.states.x[:, :4]
    good = np.isfinite(found.q[:, 0])
    k = np.clip(np.searchsorted(found.t_step, t), 0, len(found.t_step) - 1)
    use = (t > found.t[good][0] + 10.0) & (t < found.t[good][-1]) & (found.states["in_flight"][k] > 0)
    error = rotation.earth_error(rotation.slerp(found.t[good], found.q[good], t[use]), q[use])
    tilt, heading = np.degrees(rotation.tilt_angle(error)), np.degrees(np.abs(rotation.heading_angle(error)))
    limits = FLIGHTS[name]
    assert np.median(tilt) < limits[0]
    assert np.percentile(tilt, 95) < limits[1]
    assert np.median(heading) < limits[2]
