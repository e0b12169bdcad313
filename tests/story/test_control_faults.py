"""Rates that follow or do not, and oscillations of known frequency and amplitude."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from attlog import flight, story
from attlog.flight.model import Firmware, FlightLog, Imu, Problem, Stream
from attlog.segments import build
from attlog.segments.model import Segments
from attlog.simulate.controller import Gains, LoopAxis, margins
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.scenario import Controller, Vehicle, build_scenario
from attlog.story.control_faults import study_control
from tests.simulate.plant import authority
from tests.story.falling import segments

SECONDS = 60.0


def flown(
    gain: float = 1.0, lag: float = 0.05, noise: float = 1.0, hz: float = 100.0, spread: float = 30.0
) -> tuple[FlightLog, Segments]:
    """A roll rate that follows a smooth set-point with gain and lag, deg/s of noise."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, SECONDS, 1.0 / hz)
    # A band of sines up to 1.2 Hz: any delay is exact.
    waves = [(0.2 + 0.1 * k, rng.uniform(0.0, 6.0)) for k in range(11)]

    def wanted(at: np.ndarray) -> np.ndarray:
        size = spread * np.sqrt(2.0 / len(waves))
        return size * np.sum([np.sin(2.0 * np.pi * f * at + p) for f, p in waves], axis=0)

    rate = np.zeros((len(t), 3))
    rate[:, 0] = gain * wanted(t - lag)
    rate += noise * rng.normal(size=rate.shape)
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    gyro = Stream(t, np.radians(rate), "rad/s", "FRD", "gyro")
    log.imus, log.imu = [Imu(0, gyro, Stream(t, 0.0 * rate, "m/s^2", "FRD", "acc"))], 0
    at = np.arange(0.0, SECONDS, 0.1)
    asked = np.column_stack([wanted(at), 0.0 * at, 0.0 * at])
    log.setpoints.rates = Stream(at, np.radians(asked), "rad/s", "FRD", "RATE")
    return log, segments(SECONDS - 2.0)


@pytest.mark.parametrize(
    ("made", "verb"),
    [
        ({}, None),
        ({"lag": 0.18}, None),
        ({"lag": 0.24}, "lags"),
        ({"gain": 1.9}, "overshoots"),
        ({"gain": 0.3}, "falls short of"),
        ({"gain": -1.0}, "does not follow"),
        ({"noise": 60.0}, "does not follow"),
    ],
    ids=str,
)
def test_a_rate_that_does_not_follow_is_told(made: dict[str, float], verb: str | None) -> None:
    found = study_control(*flown(**made)).faults["rate_tracking"]
    assert [fault.text.partition(" its set-point")[0] for fault in found] == (
        [] if verb is None else [f"Roll rate {verb}"]
    )


def test_gain_and_lag_are_measured() -> None:
    text = study_control(*flown(gain=0.9, lag=0.08)).numbers["rate_tracking"]
    assert text.startswith("Roll: gain 90 %, lag 80 ms")


def test_a_calm_set_point_or_a_decimated_gyro_answer_nothing() -> None:
    assert "moves too little" in study_control(*flown(spread=10.0)).missing["rate_tracking"]
    log, spans = flown()
    log.problems.append(Problem("imu_decimated", "note", "Decimated."))
    assert "left out" in study_control(log, spans).missing["rate_tracking"]
    assert set(study_control(*flown(hz=10.0)).missing) == {"rate_tracking", "oscillation"}


def shaken(
    axis: int, hz: float, dps: float, begin: float, end: float, rate: float = 200.0
) -> tuple[FlightLog, Segments]:
    """A flight with a sine on an axis from begin to end s."""
    log, spans = flown(hz=rate, spread=15.0)
    t, x = log.imus[0].gyro.t, log.imus[0].gyro.x
    x[:, axis] += np.radians(dps * np.sin(2.0 * np.pi * hz * t)) * ((t >= begin) & (t <= end))
    return log, spans


@pytest.mark.parametrize(("axis", "hz", "rate"), [(0, 6.2, 200.0), (1, 11.3, 800.0), (2, 5.1, 25.0)])
def test_an_oscillation_has_axis_frequency_amplitude_and_share(axis: int, hz: float, rate: float) -> None:
    log, spans = shaken(axis, hz, 40.0, 20.0, 40.0, rate)
    (found,) = study_control(log, spans).faults["oscillation"]
    mirror = f" or {rate - hz:.1f} Hz" if rate < 50.0 else ""
    assert found.text.startswith(f"{('Roll', 'Pitch', 'Yaw')[axis]} oscillated at {hz:.1f} Hz{mirror} from ")
    assert found.value == pytest.approx(40.0, rel=0.05)
    assert found.t == pytest.approx(20.0, abs=2.1)
    assert found.t_end == pytest.approx(40.0, abs=2.1)
    assert ("alias" in found.cause) is bool(found.action) is bool(mirror)
    (event,) = [e for e in story.events(log, spans) if e.kind == "oscillation"]
    assert (event.part, event.severity) == ("control", "warning")


@pytest.mark.parametrize(
    ("hz", "dps", "end"), [(3.0, 40.0, 40.0), (30.0, 40.0, 40.0), (6.0, 4.0, 40.0), (6.0, 40.0, 25.0)], ids=str
)
def test_movements_of_a_pilot_vibration_and_short_or_weak_swings_are_none(hz: float, dps: float, end: float) -> None:
    assert study_control(*shaken(0, hz, dps, 20.0, end)).faults["oscillation"] == []


def test_two_frequencies_or_a_sweep_are_no_oscillation() -> None:
    log, spans = shaken(0, 6.0, 30.0, 0.0, 60.0)
    t = log.imus[0].gyro.t
    log.imus[0].gyro.x[:, 0] += np.radians(30.0 * np.sin(2.0 * np.pi * 12.0 * t))
    assert study_control(log, spans).faults["oscillation"] == []


def test_a_window_that_begins_within_a_pause_of_the_gyro_shows_nothing() -> None:
    log, spans = shaken(0, 6.0, 40.0, 20.0, 42.0)
    gyro = log.imus[0].gyro
    keep = (gyro.t < 29.0) | (gyro.t > 33.0)
    gyro.t, gyro.x = gyro.t[keep], gyro.x[keep]
    log.imus[0].acc.t = gyro.t
    # 9 s on either side of the pause are no 10 s in a row.
    assert study_control(log, spans).faults["oscillation"] == []


@pytest.mark.parametrize("suffix", [".ulg", ".bin"])
def test_a_rate_gain_above_the_gain_margin_oscillates_at_the_phase_crossover(suffix: str, tmp_path: Path) -> None:
    """Frequency by the loop's transfer function: saturation lowers the gain to the margin and leaves the phase."""
    axis, begin, end, late = 1, 12.0, 26.0, 0.015
    values = {
        "seconds": 32.0,
        "command": [{"t": 4, "do": "arm"}, {"t": 5, "do": "takeoff", "up_m": 4}, {"t": 10, "do": "hold"}],
        "fault": [{"t": begin, "seconds": end - begin, "part": "gain", "kind": "scale", "instance": axis, "factor": 4}],
        "sensors": {"imu": [{"delay_s": late}]},
        "estimator": {"name": "mekf"},
        "logging": {"truth": False},
    }
    write(tmp_path / f"x{suffix}", fly(build_scenario(values), 3))
    log = flight.read(tmp_path / f"x{suffix}")
    (found,) = study_control(log, build(log)).faults["oscillation"]
    vehicle = Vehicle()
    # The gyro's delay and one period of the loop, which computes and holds.
    loop = LoopAxis(float(authority(vehicle)[axis]), vehicle.motor_lag_s, Gains.of(Controller()), axis, late + 0.0025)
    margin = margins(loop)
    assert 1.0 < margin.gain < 4.0
    said = re.match(r"Pitch oscillated at ([\d.]+) Hz from ", found.text)
    assert said is not None
    assert float(said[1]) == pytest.approx(margin.gain_at / (2.0 * np.pi), rel=0.05)
    assert (found.t, found.t_end) == (pytest.approx(begin, abs=2.1), pytest.approx(end, abs=2.1))


@pytest.mark.parametrize(("hz", "top"), [(200.0, "20"), (25.0, "10.5")])
def test_the_band_that_was_judged_is_named(hz: float, top: str) -> None:
    study = study_control(*shaken(0, 6.0, 0.0, 0.0, 60.0, hz))
    assert study.numbers["oscillation"] == f"No axis oscillated between 4.5 and {top} Hz."


def test_a_short_flight_shows_no_oscillation() -> None:
    log, _ = flown()
    assert "10 s" in study_control(log, segments(10.0)).missing["oscillation"]
