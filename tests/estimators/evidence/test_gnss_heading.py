"""The heading error by GNSS acceleration, on motion whose heading and GNSS are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.evidence import gnss_heading
from attlog.estimators.evidence.gnss_heading import HeadingOffset, both, heading_offset, pieces, velocity_steps

GRAVITY = 9.81


@dataclass
class Flight:
    """A flight of 120 s: the truth, and what its sensors say."""

    t: np.ndarray
    acc: np.ndarray
    q: np.ndarray
    fixes: np.ndarray
    velocity: np.ndarray

    def found(self, *, heading_deg: float = 0.0, tilt_deg: float = 0.0) -> HeadingOffset:
        """What is said of the true attitude, turned by these."""
        q = rotation.turn_about_down(self.q, np.radians(heading_deg))
        q = rotation.multiply(rotation.from_rotvec(np.radians([tilt_deg, 0.0, 0.0])), q)
        return heading_offset(self.t, self.acc, q, self.fixes, self.velocity)


def flown(
    *, late_s: float = 0.0, moves: float = 1.5, noise_m_s: float = 0.03, every_s: float = 0.2, scale: float = 1.0
) -> Flight:
    """A copter that accelerates by two tones (m/s^2) in each direction while it yaws; GNSS ``late_s`` later."""
    t = np.arange(0.0, 120.0, 0.008)
    tones = np.array([[0.31, 0.83], [0.23, 0.67]])  # Hz of north and east
    amplitude = moves * np.array([[0.6, 0.8], [0.9, 0.5]])
    w = 2.0 * np.pi * tones
    earth = np.stack([(amplitude[k] * np.sin(np.outer(t, w[k]))).sum(axis=1) for k in range(2)], axis=1)
    force = np.column_stack([earth, np.full(len(t), -GRAVITY)])
    q = rotation.from_euler(0.1 * np.sin(0.9 * t), 0.1 * np.cos(0.7 * t), 0.4 * t)
    fixes = np.arange(0.5, 119.5, every_s)
    then = fixes - late_s
    speed = np.stack(
        [(amplitude[k] / w[k] * (1.0 - np.cos(np.outer(then, w[k])))).sum(axis=1) for k in range(2)], axis=1
    )
    rng = np.random.default_rng(5)
    velocity = np.column_stack([speed + noise_m_s * rng.standard_normal(speed.shape), np.zeros(len(fixes))])
    acc = scale * rotation.rotate_inverse(q, force) + 0.1 * rng.standard_normal((len(t), 3)) + [0.2, -0.1, 0.1]
    return Flight(t, acc, q, fixes, velocity)


@pytest.mark.parametrize("off", [-120.0, -28.0, 0.0, 12.0, 170.0])
def test_the_offset_of_a_heading_is_found_with_its_sign(off: float) -> None:
    found = flown().found(heading_deg=off)
    assert found.told
    assert found.offset_deg == pytest.approx(off, abs=1.0)
    assert abs(found.offset_deg - off) < 3.0 * found.sigma_deg
    assert found.wrong == (abs(off) > 8.0)
    assert found.sound == (off == 0.0)


@pytest.mark.parametrize("late", [-0.15, 0.2, 0.45])
def test_a_late_receiver_moves_the_delay_and_not_the_heading(late: float) -> None:
    found = flown(late_s=late).found(heading_deg=20.0)
    assert found.delay_s == pytest.approx(late, abs=0.03)
    assert found.offset_deg == pytest.approx(20.0, abs=1.5)


def test_a_receiver_later_than_any_is_not_believed() -> None:
    found = flown(late_s=0.7).found()
    assert not found.told
    assert "delay" in found.why


def test_fixes_of_1_hz_are_enough() -> None:
    found = flown(every_s=1.0).found(heading_deg=30.0)
    assert found.told
    assert found.offset_deg == pytest.approx(30.0, abs=4.0)


def test_a_tilt_error_hides_no_heading() -> None:
    found = flown().found(heading_deg=25.0, tilt_deg=8.0)
    assert found.told
    assert found.offset_deg == pytest.approx(25.0, abs=2.0)


def test_hover_says_nothing_of_any_heading() -> None:
    found = flown(moves=0.01, noise_m_s=0.1).found(heading_deg=90.0)
    assert not any([found.told, found.wrong, found.sound])
    assert found.why


def test_an_accelerometer_of_wrong_scale_is_another_fault() -> None:
    found = flown(scale=2.0).found(heading_deg=40.0)
    assert found.correlation > 0.9
    assert not found.told
    assert "0.5 times" in found.why


def test_jumps_of_gnss_are_left_out() -> None:
    flight = flown()
    flight.velocity[200:203] += 8.0
    found = flight.found(heading_deg=15.0)
    assert found.told
    assert found.offset_deg == pytest.approx(15.0, abs=1.5)


def test_one_turn_to_one_side_leaves_delay_and_heading_unknown() -> None:
    """While a vehicle circles, 0.15 s of delay look like 0.15 s of turning: here 9 deg."""
    flight = flown()
    rate = np.radians(60.0)
    force = np.column_stack(
        [-3.0 * np.sin(rate * flight.t), 3.0 * np.cos(rate * flight.t), np.full(len(flight.t), -GRAVITY)]
    )
    flight.acc = rotation.rotate_inverse(flight.q, force)
    flight.velocity[:, 0] = 3.0 / rate * np.cos(rate * flight.fixes)
    flight.velocity[:, 1] = 3.0 / rate * np.sin(rate * flight.fixes)
    flight.velocity[:, :2] += 0.03 * np.random.default_rng(3).standard_normal((len(flight.fixes), 2))
    assert flight.found().sigma_deg == pytest.approx(9.0, abs=1.0)


def test_a_heading_that_is_wrong_for_a_part_is_wrong_in_these_segments() -> None:
    flight = flown()
    turned = np.where(flight.t > 60.0, np.radians(45.0), 0.0)
    found = pieces(flight.t, flight.acc, rotation.turn_about_down(flight.q, turned), flight.fixes, flight.velocity)
    early = [one for one in found if one.t1 < 60.0]
    late = [one for one in found if one.t0 > 60.0]
    assert early
    assert not any(one.wrong for one in early)
    assert late
    assert all(one.wrong for one in late)
    assert [one.offset_deg for one in late] == pytest.approx([45.0] * len(late), abs=3.0)


def test_errors_stay_within_their_sigma() -> None:
    """White GNSS noise of 20 flights: the offset is beyond two sigma in about one of twenty, never in five."""
    errors = []
    flight = flown(noise_m_s=0.0, moves=0.4)
    rng = np.random.default_rng(7)
    velocity = flight.velocity
    for _ in range(20):
        flight.velocity = velocity + 0.15 * rng.standard_normal(velocity.shape)
        found = flight.found()
        errors.append(found.offset_deg / found.sigma_deg)
    assert np.count_nonzero(np.abs(errors) > 2.0) < 5
    assert np.sqrt(np.mean(np.square(errors))) > 0.2


def test_gaps_of_the_imu_and_times_outside_the_spans_are_left_out() -> None:
    flight = flown()
    bad = (flight.t > 50.0) & (flight.t < 52.0)
    flight.acc[bad & (flight.t < 51.0)] = np.nan
    keep = ~(bad & (flight.t >= 51.0))
    spans = np.array([[10.0, 100.0]])
    args = flight.t[keep], flight.acc[keep], flight.q[keep], flight.fixes, flight.velocity
    found = heading_offset(*args, spans)
    assert found.told
    assert abs(found.offset_deg) < 1.0
    assert found.t0 >= 10.0
    assert found.t1 <= 100.0
    assert heading_offset(*args, np.zeros((0, 2))).why


@pytest.mark.parametrize("fixes", [0, 1, 3])
def test_without_gnss_there_is_no_answer(fixes: int) -> None:
    flight = flown()
    whole, parts = both(flight.t, flight.acc, flight.q, flight.fixes[:fixes], flight.velocity[:fixes])
    assert not whole.told
    assert whole.why
    assert parts == []


def test_what_stays_beside_a_gap_is_as_without_it_for_every_delay() -> None:
    """Delays reach from 0.4 s before to 0.75 s after a fix: windows that would need the gap for one of them go."""
    flight = flown()
    keep = (flight.t < 50.0) | (flight.t > 51.0)
    args = flight.fixes, flight.velocity
    whole = velocity_steps(flight.t, flight.acc, flight.q, *args)
    found = velocity_steps(flight.t[keep], flight.acc[keep], flight.q[keep], *args)
    same = np.isin(whole.t0, found.t0)
    assert found.t0.tolist() == whole.t0[same].tolist()
    assert found.force == pytest.approx(whole.force[:, same], abs=1e-9)
    left_out = whole.t0[~same]
    assert (left_out.min(), left_out.max()) == (pytest.approx(48.6, abs=0.21), pytest.approx(51.7, abs=0.21))


def test_a_receiver_that_seems_earlier_than_any_is_not_believed() -> None:
    found = flown(late_s=-0.4).found()
    assert not found.told
    assert "delay" in found.why


@pytest.mark.parametrize("each_s", [1.0, 0.5, 0.25])
def test_windows_of_a_second_that_overlap_are_no_more_evidence_than_those_side_by_side(each_s: float) -> None:
    """Errors of 0.3 m/s across, to and fro, on accelerations of 1: sqrt(0.3^2 / 2 / 40) rad in 40 s, however many."""
    t = np.arange(0.0, 40.0, each_s)
    across = 0.3 * np.where((np.arange(len(t)) // 2) % 2 == 0, 1.0, -1.0)
    sigma, blocks = gnss_heading._spread(t, 1.0 + 1j * across, np.ones(len(t), complex))
    assert blocks == pytest.approx(8.0)
    assert sigma == pytest.approx(np.sqrt(0.5 * 0.09 / 40.0), rel=0.3)
