"""Planted tones: where they are, how large, folded or not, following throttle or rotors or nothing."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Stream
from attlog.flight.vibration.model import OnboardSpectrum
from attlog.health.assessments.vibration import origin, spectra
from attlog.health.assessments.vibration.peaks import Peak, floor, interval, peaks
from tests.health.assessments.vibration.shaken import BEGIN, END, SECONDS, shaken, throttle_at

WITHIN = [(BEGIN, END)]


def strongest(log: FlightLog) -> Peak:
    return origin.analysed(log, spectra.all_of(log, WITHIN)[0], WITHIN)[0]


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


def test_noise_has_no_peak_and_a_tone_in_it_needs_ten_decibels() -> None:
    log = shaken(1000.0, 100.0, rms_dps=0.0)
    assert peaks(spectra.all_of(log, WITHIN)[0]) == []


@pytest.mark.parametrize(("decibels", "found"), [(9.5, 0), (10.5, 1)])
def test_a_peak_stands_ten_decibels_above_the_floor(decibels: float, found: int) -> None:
    density = np.ones((5, 200, 3))
    density[:, 50] = 10.0 ** (decibels / 10.0)
    one = spectra.Spectra("gyro", 0, "", 800.0, 2.0, False, np.arange(5.0), 2.0 * np.arange(200), density)
    assert [p.frequency for p in peaks(one)] == [100.0] * found


def test_the_floor_is_the_local_median() -> None:
    density = np.ones(200)
    density[100] = 1e4
    assert floor(density, 2.0) == pytest.approx(np.ones(200))


@pytest.mark.parametrize(
    ("frequency", "rate", "shown"),
    [(67.0, 120.0, 53.0), (74.0, 120.0, 46.0), (150.0, 200.0, 50.0), (230.0, 200.0, 30.0), (30.0, 200.0, 30.0)],
)
def test_a_slow_stream_folds(frequency: float, rate: float, shown: float) -> None:
    """67 -> 53 and 74 -> 46 were measured at 120 Hz on one vehicle."""
    assert float(origin.fold(frequency, rate)) == pytest.approx(shown)
    found = strongest(shaken(rate, frequency))
    assert found.frequency == pytest.approx(shown, abs=0.6)
    assert min(abs(f - frequency) for f in found.possible) < 0.7
    assert found.true is None


def test_every_alias_folds_back() -> None:
    for frequency in origin.aliases(33.0, 190.0):
        assert float(origin.fold(frequency, 190.0)) == pytest.approx(33.0)
    assert origin.aliases(33.0, 190.0) == [33.0, 157.0, 223.0, 347.0, 413.0]


def test_rotors_are_told_from_what_stays_where_it_is() -> None:
    moving, fixed = strongest(shaken(1000.0, with_throttle(90.0))), strongest(shaken(1000.0, 90.0))
    assert (moving.follows, fixed.follows) == ("throttle", "nothing")
    assert moving.windows >= origin.LEAST_MOVED
    assert moving.true == pytest.approx(90.0, rel=0.06)


def test_an_alias_does_not_follow_throttle() -> None:
    """It goes down as throttle goes up, or too far."""
    for hover in (120.0, 260.0):
        assert strongest(shaken(200.0, with_throttle(hover))).follows != "throttle"


def test_with_steady_throttle_nothing_tells_what_a_peak_follows() -> None:
    log = shaken(1000.0, 90.0)
    log.throttle = Stream(np.array([0.0, SECONDS]), np.full((2, 1), 0.3), "1", "", "")
    found = strongest(log)
    assert found.follows == ""
    assert found.windows < origin.LEAST_MOVED


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
    found = strongest(shaken(200.0, 150.0, onboard_spectrum=onboard))
    assert found.true == (None if true is None else pytest.approx(true, abs=1.0))


def test_the_interval_of_a_frequency_holds_it() -> None:
    log = shaken(1000.0, 90.0)
    one = spectra.all_of(log, WITHIN)[0]
    low, high = interval(one, strongest(log)) or (0.0, 0.0)
    assert low < 90.0 < high
    assert high - low < 3.0
