import numpy as np
import pytest

from attlog.core import rotation
from attlog.metrics import hover
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 80.0, 0.01)
SEGMENTS = [Segment("continuous", 0, 80), Segment("airborne", 10, 80), Segment("hover", 20, 70)]


def jitter(roll_deg, segments=SEGMENTS, t=T):
    row = flights.row(t, rotation.from_euler(np.radians(roll_deg) + 0 * t, 0 * t, 0.7))
    row.start = float(t[0])
    turning = rotation.from_euler(0.3 * np.sin(t), 0.2 * np.sin(1.3 * t), 0.7)
    return hover.compute_hover(flights.case([row], segments, (t[::4], turning[::4])), row, "hover")["hover_jitter_deg"]


@pytest.mark.parametrize(("hz", "share"), [(0.1, 0.0), (1.0, 1.0), (4.0, 1.0), (12.0, 0.0)])
def test_jitter_is_the_standard_deviation_between_half_and_5_hz(hz, share):
    answer = jitter(0.5 * np.sin(2 * np.pi * hz * T))
    assert answer.value == pytest.approx(0.5 / np.sqrt(2) * share, abs=0.03)  # a Hann window leaks a little
    assert answer.seconds == pytest.approx(50.0, abs=0.1)


def test_hover_that_stays_level_is_100_percent_good_and_one_that_does_not_is_0():
    """A share with the wrong sense would call the worst flight the best."""
    assert jitter(0.5 * np.sin(T)).detail["within_5_deg_pct"] == 100.0
    assert jitter(20.0 * np.sign(np.sin(T))).detail["within_5_deg_pct"] == 0.0


def test_hover_is_needed_for_4_seconds_and_at_10_hz():
    assert jitter(0.0, SEGMENTS[:2]).code == "not_covered"
    assert jitter(0.0, [*SEGMENTS[:2], Segment("hover", 20, 23)]).code == "record_too_short"
    assert jitter(0.0, t=T[::20]).code == "record_too_short"


def test_two_windows_that_differ_too_much_give_no_interval_instead_of_one_beyond_any_angle():
    """A t interval of two logarithms knows no end: 0.002 to 5 deg became "up to 19,000,000 deg"."""
    loud = np.where(T > 26.0, 5.0, 0.002) * np.sin(2 * np.pi * T)
    answer = jitter(loud, [*SEGMENTS[:2], Segment("hover", 20, 30)])
    assert answer.n == 2
    assert answer.ci95 is None
    assert "differ too much" in answer.reason
    assert not answer.ranked


def test_noise_of_known_size_lies_in_the_interval():
    """White noise of 0.3 deg at 100 Hz: 4.5 of its 50 Hz lie in the band."""
    answer = jitter(0.3 * np.random.default_rng(5).standard_normal(len(T)))
    assert answer.n == 12
    assert answer.ci95[0] < 0.3 * np.sqrt(4.5 / 50.0) < answer.ci95[1]
    assert answer.ci95[1] < 1.5 * answer.ci95[0]


@pytest.mark.parametrize(("hz", "answered"), [(9.5, False), (10.5, True)])
def test_ten_values_a_second_are_needed(hz, answered):
    assert (jitter(0.0, t=np.arange(0.0, 80.0, 1.0 / hz)).code is None) is answered


def test_the_first_5_seconds_of_a_row_that_starts_in_hover_do_not_count():
    """Its filter still settles, by 10 deg: from 30 to 35 s of a hover from 20 to 70 s."""
    t = T[T >= 30.0]
    answer = jitter(np.where(t < 34.9, 10.0, 0.5) * np.sin(2 * np.pi * t), t=t)
    assert answer.seconds == pytest.approx(35.0, abs=0.1)
    assert answer.value == pytest.approx(0.5 / np.sqrt(2), abs=0.03)


def test_windows_that_overlap_by_half_are_not_counted_twice_in_the_interval():
    """scipy's powers of windows of 4 s that lie side by side, and its t."""
    from scipy import signal, stats

    roll = 0.3 * np.random.default_rng(7).standard_normal(len(T))
    answer = jitter(roll)
    hover_only = roll[(T >= 20.0) & (T < 70.0)]
    f, _, power = signal.spectrogram(
        hover_only, 100.0, signal.get_window("hann", 400, fftbins=False), noverlap=0, detrend="linear"
    )
    own = np.log(power[(f >= 0.5) & (f <= 5.0)].sum(axis=0))
    half = 0.5 * stats.t.ppf(0.975, len(own) - 1) * stats.sem(own)
    assert (answer.n, len(own)) == (12, 12)
    assert np.log(answer.ci95[1] / answer.ci95[0]) == pytest.approx(2.0 * half, rel=0.02)


def test_a_hover_of_four_seconds_that_lacks_single_samples_has_no_window():
    t = T[(T < 30.0) | (T > 40.0) | (np.arange(len(T)) % 10 != 3)]
    answer = jitter(0.5 * np.sin(2 * np.pi * t), [*SEGMENTS[:2], Segment("hover", 32.0, 36.1)], t)
    assert answer.code == "record_too_short"
    longer = jitter(0.5 * np.sin(2 * np.pi * t), [*SEGMENTS[:2], Segment("hover", 32.0, 37.0)], t)
    assert longer.value == pytest.approx(0.5 / np.sqrt(2), abs=0.05)
