"""What is subtracted from the gyro for every filter alike, on made samples whose bias is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.flight.model import Firmware, FlightLog, Imu, Mag, Stream
from attlog.metrics.gyro_bias import CommonBias, common_bias
from attlog.segments.model import Segment, Segments

T = np.arange(0.0, 100.0, 0.01)
TRUE = np.array([4.0, -3.0, 0.5])
FLOWN = [Segment("rest.long", 5.0, 50.0), Segment("airborne", 52.0, 80.0), Segment("rest.long", 85.0, 100.0)]


def log(bias_dps=TRUE, turn_dps=(0.0, 0.0, 0.0), seed=0) -> FlightLog:
    """An IMU with white noise, a bias and a steady turn that gravity and a field of dip 60 deg follow."""
    random = np.random.default_rng(seed)
    turned = rotation.from_rotvec(np.radians(turn_dps) * T[:, None])
    acc = rotation.rotate_inverse(turned, np.array([0.0, 0.0, -9.81]))
    field = rotation.rotate_inverse(turned, 5e-5 * np.array([0.5, 0.0, 0.87]))
    rates = np.radians(np.add(bias_dps, turn_dps) + 0.1 * random.standard_normal((len(T), 3)))
    made = FlightLog(Path("made-up.ulg"), "ulog", 0, 0, Firmware("PX4"), "quad")
    gyro = Stream(T, rates, "rad/s", "FRD", "imu")
    made.imus, made.imu = [Imu(0, gyro, Stream(T, acc + 0.02 * random.standard_normal(acc.shape), "", "", "imu"))], 0
    made.mags, made.mag = [Mag(0, Stream(T[::10], field[::10], "T", "FRD", "mag"))], 0
    return made


def found(made: FlightLog, segments=FLOWN, asked="rest") -> CommonBias:
    assert made.replay_imu is not None
    return common_bias(made, Segments(segments), made.replay_imu, asked)


def test_it_is_the_mean_rate_of_the_last_rest_before_take_off():
    made = log()
    made.imus[0].gyro.x[T < 15.0] += np.radians(1.0)  # the gyro warms up
    made.imus[0].gyro.x[T > 80.0] += np.radians(0.5)
    bias = found(made)
    assert bias.taken == "rest"
    assert bias.flew
    assert bias.dps == pytest.approx(TRUE, abs=0.01)
    assert (bias.seconds, bias.t0_s, bias.t1_s) == pytest.approx((30.0, 20.0, 50.0))
    assert bias.landed_dps == pytest.approx(TRUE + 0.5, abs=0.01)
    assert bias.at(np.array([0.0, 99.0])) == pytest.approx(np.radians([bias.dps, bias.dps]))


def test_its_interval_holds_the_truth_as_often_as_it_says():
    inside = []
    for seed in range(40):
        bias = found(log(seed=seed), [Segment("rest.short", 10.0, 16.0), Segment("airborne", 20.0, 80.0)])
        assert bias.half95_dps is not None
        assert max(bias.half95_dps) < 0.02
        inside += list(np.abs(bias.dps - TRUE) <= bias.half95_dps)
    assert 0.88 <= np.mean(inside) <= 1.0


def test_where_nothing_flew_the_first_rest_counts():
    bias = found(log(), [Segment("rest.short", 2.0, 6.0), Segment("rest.long", 10.0, 90.0)])
    assert (bias.taken, bias.flew, bias.landed_dps) == ("rest", False, None)
    assert (bias.seconds, bias.t0_s, bias.t1_s) == pytest.approx((30.0, 2.0, 36.0))


@pytest.mark.parametrize("turn", [(0.0, 0.0, 2.0), (0.0, 0.0, -25.0), (0.6, 0.0, 0.0)])
def test_a_steady_turn_is_not_taken_for_a_bias(turn):
    bias = found(log((0.1, 0.1, 0.1), turn))
    assert bias.taken == "none"
    assert bias.dps is None
    assert "steady turn" in bias.why


def test_without_rest_before_take_off_nothing_is_taken_off_and_it_says_why():
    late = found(log(), FLOWN[1:])
    assert (late.asked, late.taken, late.dps) == ("rest", "none", None)
    assert "only after" in late.why
    assert found(log(), FLOWN[1:2]).why == "the log holds no rest before take-off"
    assert found(log(), []).why == "the log holds no rest"
    assert not late.at(T).any()
    assert found(log(), asked="none").dps is None


def test_onboard_is_the_autopilot_s_own_held_until_its_next_value():
    made = log()
    told = np.radians([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    made.estimator.gyro_bias = Stream(np.array([10.0, 20.0]), told, "rad/s", "FRD", "estimator_sensor_bias:0")
    bias = found(made, asked="onboard")
    assert np.degrees(bias.at(np.array([0.0, 10.0, 19.9, 20.0, 90.0]))[:, 0]) == pytest.approx([1, 1, 1, 2, 2])
    assert bias.dps == pytest.approx([1.5, 0.0, 0.0])
    made.estimator.gyro_bias = None
    assert "no onboard gyro bias" in found(made, asked="onboard").why


@pytest.mark.slow
def test_every_row_gets_the_gyro_without_the_bias_at_rest(samples):
    """The simulator put -0.35, 0.55 and 0.9 deg/s on this gyro (sample_logs/README.md)."""
    case = {asked: attlog.prepare(samples / "px4_hover.ulg", {"gyro_bias": asked}) for asked in ("rest", "none")}
    result = {asked: attlog.evaluate(c, "gyro,mahony:ki=0.001") for asked, c in case.items()}
    (bias,) = result["rest"].gyro_bias
    assert bias.dps == pytest.approx([-0.35, 0.55, 0.9], abs=0.02)
    tilt = {}
    for asked, r in result.items():
        for row in r.estimators:
            if row.kind == "replay":
                tilt[asked, row.name] = row.metrics["all"]["tilt_rmse_deg"].value
    assert tilt["rest", "gyro"] < 0.2 * tilt["none", "gyro"]


def test_samples_changed_before_a_filter_get_the_bias_that_they_have_then(samples):
    """A configuration that calibrates the gyro has its own mean at rest: nothing is subtracted twice."""
    from dataclasses import replace

    case = attlog.prepare(samples / "px4_hover.ulg")
    imu = case.log.replay_imu
    shifted = replace(imu, gyro=replace(imu.gyro, x=imu.gyro.x + np.radians([1.0, 0.0, -2.0])))
    more = np.subtract(case.bias_of(shifted).dps, case.bias_of(imu).dps)
    assert more == pytest.approx([1.0, 0.0, -2.0], abs=1e-9)
    assert case.gyro_of(shifted) == pytest.approx(case.gyro_of(imu), abs=1e-12)


def test_a_cut_gyro_gets_half_a_step_back_before_its_bias_is_taken(samples):
    log, step = attlog.read(samples / "copter_steps_stabilize.bin"), 1e-3
    assert attlog.prepare(log).log.replay_imu.truncation is None
    imu = log.replay_imu
    noise = np.random.default_rng(1).normal((2.0, -2.4, 1.7), 1.5, imu.gyro.x.shape)
    cut = step * np.trunc(noise + imu.gyro.x / step * (np.arange(len(noise)) > 2000)[:, None])
    imus = [replace(one, gyro=replace(one.gyro, x=cut)) if one is imu else one for one in log.imus]
    case = attlog.prepare(replace(log, imus=imus))
    bias = case.gyro_bias[imu.index]
    assert bias.steps_dps == pytest.approx([np.degrees(step)] * 3, rel=1e-3)
    assert 0.0 < bias.steps_seen_s < imu.gyro.t[2000]
    given = case.log.replay_imu.gyro.x
    assert given == pytest.approx(cut + 0.5 * step * np.sign(np.round(cut, 4)), abs=1e-9)


@pytest.mark.slow
def test_extracted_attitudes_are_those_of_the_analysis(attlog, samples, tmp_path):
    import json

    assert attlog("extract", samples / "px4_hover.ulg", "--estimates", "mahony", "-o", tmp_path).code == 0
    about = json.loads((tmp_path / "estimate_mahony.csv.json").read_text())
    assert "subtracted from the gyro first: -0.3576, 0.5492, 0.8937 deg/s (rest)" in about["source"]
    columns = np.genfromtxt(tmp_path / "estimate_mahony.csv", delimiter=",", names=True, max_rows=5)
    begun = [np.degrees(columns[f"bias_{axis}_rad_s"][0]) for axis in "xyz"]
    assert begun == pytest.approx([-0.3576, 0.5492, 0.8937], abs=0.001), "all that is subtracted, not the rest of it"
