"""Traces of flight data: heights from take-off, peaks in envelopes, gaps of the logger."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.flight.model import Firmware, FlightLog, Imu, Stream
from attlog.metrics.flight_data import (
    MAX_FAST,
    MAX_NEAR,
    MAX_SAMPLES,
    _detailed,
    broken_spans,
    flight_data,
    near_events,
)
from attlog.story.flight_events import Event

RNG = np.random.default_rng(5)


def log_with(baro: Stream) -> FlightLog:
    log = FlightLog(Path("made.ulg"), "ulog", 1, 0, Firmware("PX4"), "quadrotor")
    log.baro = [baro]
    return log


def stream(t: np.ndarray, x: np.ndarray) -> Stream:
    return Stream(t, x[:, None], "m", "", "made")


def test_a_height_is_zero_on_the_ground_before_take_off() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    x = 488.0 + np.where(t > 20.0, 1.0 * (t - 20.0), 0.0) + RNG.normal(0.0, 0.05, len(t))
    (trace,) = flight_data(log_with(stream(t, x)), [(20.0, 60.0)])
    y = trace.columns["barometer"]
    assert abs(float(np.median(y[trace.t < 20.0]))) < 0.02
    assert abs(float(y[-1]) - 39.9) < 0.3


def test_a_long_line_keeps_its_peak_and_its_pause() -> None:
    t = np.concatenate([np.arange(0.0, 900.0, 0.01), np.arange(1000.0, 1900.0, 0.01)])
    x = np.sin(t)
    x[123_457] = 77.0
    (trace,) = flight_data(log_with(stream(t, x)), [])
    y = trace.columns["barometer"]
    assert len(trace.t) <= MAX_SAMPLES + 2
    assert trace.ratio > 20.0
    assert float(np.nanmax(y)) - float(np.nanmedian(y)) > 76.0
    assert np.isnan(y[(trace.t > 890.0) & (trace.t < 1010.0)]).any()


def test_an_oscillation_in_a_long_flight_is_kept_sample_by_sample() -> None:
    t = np.arange(0.0, 2000.0, 0.01)
    wave = np.radians(30.0) * np.sin(2.0 * np.pi * 8.0 * t) * ((t > 1500.0) & (t < 1520.0))
    log = log_with(stream(t[:2], t[:2]))
    rates = Stream(t, np.column_stack([wave, 0.0 * t, 0.0 * t]), "rad/s", "FRD", "made")
    force = Stream(t, np.tile([0.0, 0.0, -9.8], (len(t), 1)), "m/s^2", "FRD", "made")
    log.imus, log.imu = [Imu(0, rates, force)], 0
    event = Event("oscillation", 1500.0, "warning", "Roll oscillated.", t_end=1520.0)
    traces = {trace.key: trace for trace in flight_data(log, [], [event])}
    roll, force_z = traces["roll_rate"], traces["acceleration"]
    inside = (roll.t > 1500.5) & (roll.t < 1503.0)
    assert np.count_nonzero(inside) >= 249
    expected = 30.0 * np.sin(2.0 * np.pi * 8.0 * roll.t[inside])
    assert np.abs(roll.columns["gyro"][inside] - expected).max() < 1e-6
    assert len(roll.t) < MAX_SAMPLES + MAX_NEAR
    assert np.all(np.diff(roll.t) >= 0.0)
    assert np.allclose(force_z.columns["z"], -9.8)


def test_detail_near_events_has_a_limit() -> None:
    events = [Event("impact", 50.0 * k, "serious", "Hit.") for k in range(40)]
    near = near_events(events)
    assert len(near) == MAX_FAST
    assert np.all(near[1:, 0] > near[:-1, 1])
    assert len(near_events([Event("armed", 5.0, "note", "Armed.")])) == 0


@pytest.mark.parametrize("rate", [400, 1000, 4000])
def test_the_gravest_event_has_detail_at_any_rate(rate: int) -> None:
    t = np.arange(0.0, 100.0, 1.0 / rate)
    kinds = (("clipping", 10.0, "warning"), ("oscillation", 20.0, "warning"), ("impact", 60.0, "serious"))
    near = near_events([Event(kind, at, severity, "Made.") for kind, at, severity in kinds])
    kept, _ = _detailed(t, RNG.normal(size=(len(t), 3)), MAX_SAMPLES, near)
    inside = (t > 59.6) & (t < 60.8)
    assert np.isin(t[inside], kept).all()
    assert len(kept) <= MAX_SAMPLES + MAX_NEAR + 10


def test_detail_near_an_event_leaves_the_rest_of_a_long_line_whole() -> None:
    t = np.concatenate([np.arange(0.0, 2000.0, 0.0025), np.arange(2100.0, 3600.0, 0.0025)])
    log = log_with(stream(t[:2], t[:2]))
    rates = Stream(t, np.column_stack([0.01 * np.sin(t)] * 3), "rad/s", "FRD", "made")
    force = Stream(t, np.tile([0.0, 0.0, -9.8], (len(t), 1)), "m/s^2", "FRD", "made")
    log.imus, log.imu = [Imu(0, rates, force)], 0
    events = [Event("impact", at, "serious", "Hit.") for at in (100.0, 300.0)]
    for trace in flight_data(log, [], events):
        if trace.key in ("roll_rate", "acceleration"):
            gaps = np.isnan(next(iter(trace.columns.values())))
            assert np.count_nonzero(gaps) == 1
            assert 2000.0 - 1e-6 < trace.t[gaps][0] <= 2100.0
            assert np.all(np.diff(trace.t) >= 0.0)


def test_a_height_above_sea_level_is_set_beside_gnss_and_left_out_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from attlog.flight.panels import PanelLine
    from attlog.metrics import flight_data as module

    t = np.arange(0.0, 60.0, 0.2)
    climbing = 488.0 + np.maximum(t - 20.0, 0.0)
    demand = PanelLine("height", "TECS set-point", t, climbing + 5.0)
    gnss = PanelLine("height", "GNSS", t, climbing.copy())
    log = log_with(stream(t, climbing))
    monkeypatch.setattr(module, "panel_lines", lambda _: [demand, gnss])
    (trace,) = flight_data(log, [(20.0, 60.0)])
    assert abs(float(trace.columns["TECS set-point"][-1]) - 44.8) < 0.3
    monkeypatch.setattr(module, "panel_lines", lambda _: [demand])
    assert flight_data(log, [(20.0, 60.0)]) == []


def test_a_slow_line_is_broken_where_the_logger_paused_and_only_there() -> None:
    slow = np.array([3.0, 33.0, 43.0, 53.0, 78.0, 88.0])
    stops = np.array([[9.1, 30.4], [44.0, 51.0]])
    assert broken_spans(slow, stops).tolist() == [[3.0, 33.0]]
    assert len(broken_spans(slow, np.zeros((0, 2)))) == 0
