"""Values that no sensor can give never reach a stream, and every one left out is counted."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight import magnetic
from attlog.flight.builder import LogBuilder
from attlog.flight.inertial import ImuCandidate, best_per_unit, choose_unit, longest_held, onto, validate
from attlog.flight.px4.advice import Px4Logging
from tests.flight.fake import gravity, level, messages, micros

N = 200


def builder() -> LogBuilder:
    return LogBuilder(messages("ulog", {("x", 0): {"timestamp": micros(2, 1)}}), t0_us=10_000_000)


def candidate(gyro: np.ndarray, acc: np.ndarray, **fields: object) -> ImuCandidate:
    return ImuCandidate(0, 0, micros(len(gyro), 100).astype(np.int64), gyro, acc, "made", "interval", **fields)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e15, -150.0])
def test_impossible_rates_leave_the_stream_and_are_told_when_the_source_is_used(wrong: float) -> None:
    gyro = np.zeros((N, 3))
    gyro[70, 1] = wrong
    r = builder()
    one = validate(r, candidate(gyro, gravity(N).astype(float)))
    assert len(one.t_us) == N - 1
    assert not r.problems
    best_per_unit(r, [one])
    assert [(p.code, p.count) for p in r.problems] == [("values_out_of_range", 1)]


def test_magnetometer_spikes_become_missing_and_slow_disturbance_stays() -> None:
    field = np.tile([2e-5, 0, 4e-5], (N, 1))
    field[20] *= 12
    field[50] = 0
    field[100:150] *= np.linspace(1, 2.5, 50)[:, None]
    r = builder()
    mag = magnetic.build(r, 0, micros(N, 10).astype(np.int64), field, "MAG")
    assert np.flatnonzero(~np.isfinite(mag.field.x).all(axis=1)).tolist() == [20, 50]
    assert [(p.code, p.count) for p in r.problems] == [("mag_spikes", 2)]


def test_quaternions_that_are_none_leave_the_attitude() -> None:
    q = level(N).astype(float)
    q[:10] = 0
    q[30] *= 1e6
    q[31] = np.nan
    r = builder()
    attitude = r.attitude(micros(N, 50).astype(np.int64), q, "ATT")
    assert len(attitude.t) == N - 12
    np.testing.assert_allclose(np.linalg.norm(attitude.q, axis=1), 1)
    assert r.attitude(micros(5, 50).astype(np.int64), np.zeros((5, 4)), "ATT") is None


def test_sample_times_are_kept_where_they_tell_something() -> None:
    r = builder()
    t = micros(N, 50).astype(np.int64)
    assert r.sample_times(t, t) is None
    assert r.sample_times(t, np.zeros(N, np.int64)) is None
    sampled = t - 7000
    sampled[3] = 0
    np.testing.assert_allclose(r.sample_times(t, sampled), (t - 10_000_000 - 7000) * 1e-6)


def test_time_lines_keep_changes_only() -> None:
    line = builder().time_line(micros(6, 1).astype(np.int64), [0, 0, 1, 1, 0, 0], "x")
    assert (line.t.tolist(), line.value) == ([0.0, 2.0, 4.0], [0, 1, 0])
    assert (line.at(-5), line.at(2.5), line.at(99)) == (0, 1, 0)


def test_interpolation_onto_another_sensor_never_crosses_a_gap() -> None:
    at = np.concatenate([np.arange(0, 100_000, 1000), np.arange(300_000, 400_000, 1000)])
    got = onto(np.array([500, 50_500, 200_000, 300_500]), at, np.tile(at[:, None] * 1.0, (1, 3)))
    np.testing.assert_allclose(got[[0, 1, 3], 0], [500, 50_500, 300_500])
    assert np.isnan(got[2]).all()


def test_the_unit_that_flew_longest_counts() -> None:
    t = np.array([0, 1_000_000, 20_000_000])
    assert longest_held(t, [1, 0, 2]) == 0
    assert longest_held(t[:0], []) is None


def test_a_message_with_a_damaged_definition_does_not_take_the_others_with_it() -> None:
    r = builder()
    assert r.attempt("GPS", lambda: r.messages["x", 0]["lat"], "nothing") == "nothing"
    assert [(p.code, p.severity) for p in r.problems] == [("unreadable_message", "warning")]
    assert "x has no field 'lat'" in r.problems[0].text


def test_two_axes_are_no_gyro_and_three_numbers_no_attitude() -> None:
    r = builder()
    assert validate(r, candidate(np.zeros((N, 2)), gravity(N).astype(float))) is None
    assert [p.code for p in r.problems] == ["unreadable_message"]
    t = micros(5, 50).astype(np.int64)
    assert r.attempt("ATT", lambda: r.attitude(t, np.ones((5, 3)), "ATT"), None) is None
    assert r.attempt("MAG", lambda: magnetic.build(r, 0, t, np.ones((5, 2)), "MAG"), None) is None
    assert len(r.problems) == 3


def test_a_handful_of_samples_is_no_flight() -> None:
    r = builder()
    one = validate(r, candidate(np.zeros((5, 3)), gravity(5).astype(float)))
    assert choose_unit(r, [one], 0, "it flew", None, Px4Logging("4.6.0", {})) is None
    assert [p.code for p in r.problems] == ["imu_too_short"]


@pytest.mark.parametrize(("spikes", "weight"), [(1, "note"), (3, "note"), (4, "warning")])
def test_single_spikes_of_a_short_log_warn_of_nothing_and_name_the_magnetometer(spikes: int, weight: str) -> None:
    field = np.tile([2e-5, 0, 4e-5], (67, 1))
    field[10 : 10 + 10 * spikes : 10] = 0
    r = builder()
    magnetic.build(r, 0, micros(67, 1).astype(np.int64), field, "RAW_IMU")
    (one,) = r.problems
    assert one.severity == weight
    assert one.text.startswith(f"RAW_IMU: left out {spikes} of 67 records of the magnetometer,")
