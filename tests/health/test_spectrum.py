"""Planted tones: where they are, how large, folded or not, following throttle or rotors or nothing."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Burst, FlightLog, OnboardSpectrum, Stream
from attlog.health import spectrum
from attlog.health.spectrum import Peak, frequency_interval
from tests.health.shaken import BEGIN, END, SECONDS, shaken, throttle_at

WITHIN = [(BEGIN, END)]


def strongest(log: FlightLog) -> Peak:
    return spectrum.analyse_peaks(log, spectrum.all_spectra(log, WITHIN)[0], WITHIN)[0]


def with_throttle(hover_hz: float):
    """A frequency that goes with the root of throttle, as rotors do."""
    return lambda t: hover_hz * np.sqrt(throttle_at(t) / 0.3)


@pytest.mark.parametrize(("frequency", "rms"), [(62.0, 3.0), (133.3, 1.0), (310.0, 8.0)])
def test_a_tone_is_found_with_its_size(frequency: float, rms: float) -> None:
    found = strongest(shaken(1000.0, frequency, rms))
    assert found.frequency == pytest.approx(frequency, abs=0.6)
    assert found.rms == pytest.approx(rms, rel=0.05)
    assert found.axis == 1
    assert found.share == 1.0


@pytest.mark.parametrize(
    ("frequency", "rate", "shown"),
    [(67.0, 120.0, 53.0), (74.0, 120.0, 46.0), (150.0, 200.0, 50.0), (230.0, 200.0, 30.0), (30.0, 200.0, 30.0)],
)
def test_a_slow_stream_folds(frequency: float, rate: float, shown: float) -> None:
    """67 -> 53 and 74 -> 46 were measured at 120 Hz on one vehicle."""
    assert float(spectrum.fold(frequency, rate)) == pytest.approx(shown)
    found = strongest(shaken(rate, frequency))
    assert found.frequency == pytest.approx(shown, abs=0.6)
    assert min(abs(f - frequency) for f in found.possible) < 0.7
    assert found.true is None


def test_rotors_are_told_from_what_stays_where_it_is() -> None:
    moving, fixed = strongest(shaken(1000.0, with_throttle(90.0))), strongest(shaken(1000.0, 90.0))
    assert (moving.follows, fixed.follows) == ("throttle", "nothing")
    assert moving.windows >= spectrum.MIN_MOVED_WINDOWS
    assert moving.true == pytest.approx(90.0, rel=0.06)


def test_an_alias_does_not_follow_throttle() -> None:
    """It goes down as throttle goes up, or too far."""
    for hover in (120.0, 260.0):
        assert strongest(shaken(200.0, with_throttle(hover))).follows != "throttle"


def rotors_of(speed: float, spread: float = 0.0) -> Stream:
    t = np.arange(0.0, SECONDS, 0.1)
    turns = speed * np.sqrt(throttle_at(t) / 0.3)
    return Stream(t, 60.0 * turns[:, None] * (1.0 + spread * np.array([-1.0, 0.0, 1.0])), "rpm", "", "ESC")


@pytest.mark.parametrize(("rate", "harmonic", "speed"), [(1000.0, 1, 90.0), (1000.0, 2, 60.0), (200.0, 1, 140.0)])
def test_rotors_name_their_peak_even_where_it_is_folded(rate: float, harmonic: int, speed: float) -> None:
    log = shaken(rate, with_throttle(harmonic * speed), rpm=rotors_of(speed))
    found = strongest(log)
    assert (found.follows, found.harmonic) == ("rotors", harmonic)
    assert found.true == pytest.approx(harmonic * speed, rel=0.06)


def test_a_fixed_peak_where_rotors_fold_to_by_chance_is_not_theirs() -> None:
    """At hover 130 Hz are shown at 70: a resonance at 70 Hz does not move with them."""
    assert strongest(shaken(200.0, 70.0, rpm=rotors_of(130.0))).follows != "rotors"


def test_a_peak_must_move_when_folded_rotors_do_even_where_they_hardly_ever_do() -> None:
    t = np.arange(0.0, SECONDS, 0.1)
    turns = np.where(np.floor(t / 5.0) % 5 == 1, 150.0, 130.0)
    log = shaken(200.0, 70.0, rpm=Stream(t, 60.0 * turns[:, None], "rpm", "", "ESC"))
    assert strongest(log).follows != "rotors"


def test_rotors_whose_lines_cover_the_band_name_nothing() -> None:
    log = shaken(200.0, 70.0, rpm=rotors_of(80.0, spread=0.3))
    assert strongest(log).follows != "rotors"


@pytest.mark.parametrize(("told", "true"), [(150.0, 150.0), (50.0, 50.0), (90.0, None)])
def test_the_onboard_spectrum_at_another_rate_unfolds(told: float, true: float | None) -> None:
    t = np.arange(0.0, SECONDS, 0.05)
    onboard = OnboardSpectrum(t, np.column_stack([np.full(len(t), told), np.full(len(t), np.nan)]), 2000.0, 4.0, "fft")
    found = strongest(shaken(200.0, 150.0, spectrum=onboard))
    assert found.true == (None if true is None else pytest.approx(true, abs=1.0))


def test_the_interval_of_a_frequency_holds_it() -> None:
    log = shaken(1000.0, 90.0)
    one = spectrum.all_spectra(log, WITHIN)[0]
    low, high = frequency_interval(one, strongest(log)) or (0.0, 0.0)
    assert low < 90.0 < high
    assert high - low < 3.0


# Spectra against scipy's and against what was planted.


def test_a_tone_has_the_power_of_its_amplitude_and_a_gyro_is_in_degrees() -> None:
    t = np.arange(800) / 400.0
    x = np.zeros((2, 800, 3))
    x[:, :, 1] = 3.0 * np.sin(2 * np.pi * 50.0 * t)
    f, density = spectrum.welch(x, 400.0, 200)
    assert f.tolist() == pytest.approx((2.0 * np.arange(101)).tolist())
    assert density[:, :, 1].sum(axis=1) * 2.0 == pytest.approx([4.5, 4.5], rel=1e-6)
    assert np.argmax(density[0, :, 1]) == 25
    _, turning = spectrum.welch(x, 400.0, 200, "gyro")
    assert turning == pytest.approx(density * np.degrees(1.0) ** 2)


def test_windows_lie_in_flight_and_hold_no_gap() -> None:
    t = np.arange(0.0, 40.0, 0.005)
    t = t[(t < 15.0) | (t > 16.0)]
    stream = Stream(t, np.zeros((len(t), 3)), "rad/s", "FRD", "GYR")
    found = spectrum.stream_spectra(stream, [(10.0, 20.0)], "gyro", 0, False)
    assert found is not None
    begin, end = found.t - 0.5 * found.seconds, found.t + 0.5 * found.seconds
    assert len(begin) == 4  # two from 10 to 15 s, two from 16 to 20 s
    assert begin.min() >= 9.99
    assert end.max() <= 20.01
    assert not ((begin < 15.0) & (end > 16.0)).any()


def test_single_lost_samples_do_not_end_a_window_and_move_no_peak() -> None:
    log = shaken(200.0, 40.0, rms_dps=5.0)
    stream = log.imus[0].gyro
    kept = np.random.default_rng(1).random(len(stream.t)) > 0.04
    lossy = Stream(stream.t[kept], stream.x[kept], "rad/s", "FRD", "GYR")
    whole = spectrum.stream_spectra(stream, [(10.0, 70.0)], "gyro", 0, False)
    found = spectrum.stream_spectra(lossy, [(10.0, 70.0)], "gyro", 0, False)
    assert whole is not None
    assert found is not None
    assert len(found.t) > 0.7 * len(whole.t)
    assert found.frequency[np.argmax(np.median(found.total, axis=0))] == pytest.approx(40.0, abs=found.step)


def test_jitter_of_the_stamps_takes_nothing_out_near_half_the_rate() -> None:
    """A tone at 53 of 60 Hz; stamps wander by a fifth of an interval, and their usual step is not the mean one."""
    rng = np.random.default_rng(4)
    number = np.arange(120 * 60)
    x = np.zeros((len(number), 3))
    x[:, 0] = 2.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 53.0 * number / 120.0)
    t = number / 120.0 + rng.uniform(0.0, 0.2 / 120.0, len(number)) + np.where(number % 5 == 0, 0.2 / 120.0, 0.0)
    found = spectrum.stream_spectra(Stream(t, x, "m/s^2", "FRD", "ACC"), [(0.0, 60.0)], "accelerometer", 0, False)
    assert found is not None
    assert found.rate == pytest.approx(120.0, rel=0.002)
    near = np.abs(found.frequency - 53.0) < 5.0
    assert np.sqrt(found.median[near, 0].sum() * found.step) == pytest.approx(2.0, rel=0.01)


def test_bursts_in_flight_have_spectra_at_the_sensors_rate() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(1024) / 2000.0
    tone = np.radians(3.0 * np.sqrt(2.0)) * np.sin(2 * np.pi * 300.0 * t)
    bursts = [
        Burst("gyro", 0, at, 2000.0, np.float32(1e-3 * rng.standard_normal((1024, 3)) + tone[:, None]), False, "")
        for at in (1.0, 20.0, 30.0)
    ]
    found = spectrum.burst_spectra(bursts, [(10.0, 40.0)])
    assert found is not None
    assert len(found.t) == 2
    near = np.abs(found.frequency - 300.0) < 15.0
    assert np.sqrt(found.median[near, 0].sum() * found.step) == pytest.approx(3.0, rel=0.03)
    assert spectrum.burst_spectra(bursts, [(50.0, 60.0)]) is None
