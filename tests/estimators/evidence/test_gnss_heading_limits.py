"""When the heading by GNSS acceleration counts, is wrong or sound: limits from both sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.estimators.evidence import gnss_heading as gnss

FOUND = gnss.HeadingOffset(0.0, 1.0, 1.0, 0.9, 0.1, 9.0, 0.0, 60.0, True, "")


@pytest.mark.parametrize(
    ("offset", "sigma", "wrong", "sound"),
    [
        (7.9, 1.0, False, False),
        (8.1, 1.0, True, False),
        (-8.1, 1.0, True, False),
        (14.9, 5.0, False, False),
        (15.1, 5.0, True, False),
        (2.9, 1.0, False, True),
        (-3.1, 1.0, False, False),
        (3.9, 2.0, False, True),
        (4.1, 2.0, False, False),
        (0.0, 2.1, False, False),
    ],
)
def test_a_heading_is_wrong_beyond_eight_and_sound_within_three_degrees_or_its_sigmas(
    offset: float, sigma: float, wrong: bool, sound: bool
) -> None:
    found = replace(FOUND, offset_deg=offset, sigma_deg=sigma)
    assert (found.wrong, found.sound) == (wrong, sound)
    silent = replace(found, told=False)
    assert (silent.wrong, silent.sound) == (False, False)


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("correlation", 0.71, 0.69),
        ("scale", 0.71, 0.69),
        ("scale", 1.29, 1.31),
        ("blocks", 1.9, 1.7),
        ("sigma_deg", 9.9, 10.1),
    ],
)
def test_an_offset_counts_within_each_limit(name: str, inside: float, outside: float) -> None:
    assert gnss._why_not(replace(FOUND, **{name: inside}), gnss.LEAST_BLOCKS) == ""
    assert gnss._why_not(replace(FOUND, **{name: outside}), gnss.LEAST_BLOCKS) != ""


def test_a_piece_needs_more_blocks_than_the_whole() -> None:
    assert (gnss.LEAST_BLOCKS, gnss.LEAST_BLOCKS_OF_SEGMENT) == (1.8, 2.5)


def test_a_fix_is_paired_with_the_nearest_to_a_second_later() -> None:
    t = np.array([0.0, 0.4, 0.9, 1.2, 2.45, 3.14, 3.16])
    i, j = gnss._pairs(t)
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == [(0, 2), (1, 3), (3, 4), (4, 6)]
    i, j = gnss._pairs(np.array([0.0, 0.9, 1.1001]))
    assert (i.tolist(), j.tolist()) == ([0], [1])
    assert len(gnss._pairs(np.array([0.0]))[0]) == 0


def test_windows_lie_between_samples_without_a_gap_of_0_15_s_and_inside_a_span() -> None:
    t = np.r_[np.arange(0.0, 2.01, 0.14), np.arange(2.12, 4.0, 0.14)]
    begin, end = np.array([0.1, 1.5, 2.2, -0.1, 3.5]), np.array([1.1, 2.3, 3.2, 0.9, 4.5])
    assert gnss._without_gap(t, begin, end).tolist() == [True, False, True, False, False]
    spans = np.array([[0.1, 1.1], [2.0, 3.1]])
    assert gnss._inside(spans, begin, end).tolist() == [True, False, False, False, False]


def test_a_window_far_from_the_fit_of_the_others_is_left_out() -> None:
    rng = np.random.default_rng(1)
    b = rng.normal(size=60) + 1j * rng.normal(size=60)
    a = b * np.exp(-0.3j) * 1.1 + 0.2 + 0.002 * rng.normal(size=60)
    for off, kept in ((0.18, True), (0.25, False)):
        odd = a.copy()
        odd[7] += off
        found = gnss._without_outliers(odd, b)
        assert np.flatnonzero(~found).tolist() == ([] if kept else [7])
    # Of plane errors the median length is 1.18 sigma: four sigmas are 4 m/s where sigma is 1.
    errors = rng.normal(size=4000) + 1j * rng.normal(size=4000)
    errors /= np.median(np.abs(errors)) / np.sqrt(2.0 * np.log(2.0))
    far, near = 4.3, 3.7
    errors[np.abs(errors) > 3.0] *= 0.5
    errors[:2] = [far, near]
    many = 100.0 * (rng.normal(size=4000) + 1j * rng.normal(size=4000))
    assert gnss._without_outliers(many + errors, many)[:2].tolist() == [False, True]


def test_thirty_seconds_of_four_windows_are_a_segment() -> None:
    number = np.repeat([0, 1, 3], [4, 3, 5])
    assert [part.tolist() for part in gnss._of_segments(number)] == [[0, 1, 2, 3], [7, 8, 9, 10, 11]]
