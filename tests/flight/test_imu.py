"""Candidates for an inertial unit: what of them is believed, and which is the best."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import flight
from attlog.flight import imu
from attlog.flight.builder import LogBuilder
from attlog.flight.compass import dead_reason
from attlog.flight.frozen import turned_deg
from attlog.flight.imu import ImuCandidate, validate_candidate
from attlog.flight.model import FlightLog, Imu, Mag, Stream
from attlog.formats.table import OTHER_DIALECT
from tests.flight import fake
from tests.flight.fake import messages, micros


def candidate(n: int, rate: float = 100.0, rank: int = 0, source: str = "IMU") -> ImuCandidate:
    acc = np.tile([0.0, 0.0, -9.81], (n, 1))
    return ImuCandidate(0, rank, micros(n, rate).astype(np.int64), np.zeros((n, 3)), acc, source, "instant")


def builder() -> LogBuilder:
    return LogBuilder(messages("ulog", {}))


def test_a_unit_that_measures_in_fewer_than_one_record_of_a_hundred_was_never_read() -> None:
    for measured, kept in ((5, False), (30, True)):
        unit = candidate(1000)
        unit.acc[measured:] = 0.0
        assert (validate_candidate(builder(), unit) is not None) is kept


def test_repeated_stamps_count_as_refused_only_where_nearly_all_repeat() -> None:
    """Two tasks that log each record leave half of them; a stamp that stands still is no clock."""
    for repeats, refused in ((2, 0.0), (20, 0.95)):
        unit = candidate(1000)
        unit.t_us = unit.t_us[np.arange(1000) // repeats * repeats]
        found = validate_candidate(builder(), unit)
        assert found is not None
        assert found.refused == refused


# Which unit is replayed, and what makes a unit useless: limits from both sides on candidates made by hand.


def unit(index: int = 0, hz: float = 100.0, seconds: float = 60.0, begin_s: float = 10.0, **more: Any) -> ImuCandidate:
    n = round(hz * seconds) + 1
    t = np.round(1e6 * (begin_s + np.arange(n) / hz)).astype(np.int64)
    rank = more.pop("rank", 0)
    return ImuCandidate(index, rank, t, np.ones((n, 3)), np.ones((n, 3)), f"IMU:{index}/{rank}", "instant", **more)


def empty_builder() -> LogBuilder:
    return LogBuilder(fake.messages("ulog", {}), t0_us=0)


def chosen(*units: ImuCandidate, flew: int | None = None, asked: int | None = None) -> tuple[int | None, list[str]]:
    made = empty_builder()
    found = imu.choose_imu(made, list(units), flew, "it flew", asked)
    return found, [p.code for p in made.problems]


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ({"hz": 100.0, "seconds": 0.18}, "imu_too_short"),
        ({"hz": 100.0, "seconds": 0.19}, None),
        ({"refused": 0.51}, "imu_mostly_refused"),
        ({"refused": 0.49}, None),
        ({"hz": 9.9}, "imu_rate_too_low"),
        ({"hz": 9.96}, "imu_low_rate"),
        ({"hz": 44.0}, "imu_low_rate"),
        ({"hz": 46.0}, None),
    ],
)
def test_a_unit_is_replayed_with_enough_good_samples_at_a_sufficient_rate(
    more: dict[str, Any], code: str | None
) -> None:
    found, codes = chosen(unit(**more))
    assert codes == ([] if code is None else [code])
    assert (found is None) is (code is not None and code != "imu_low_rate")


def test_the_unit_that_flew_or_was_asked_for_counts_else_the_first() -> None:
    units = unit(0), unit(1), unit(2)
    assert chosen(*units)[0] == 0
    assert chosen(*units, flew=2)[0] == 2
    assert chosen(*units, flew=2, asked=1)[0] == 1
    assert chosen(*units, flew=7)[0] == 0
    assert chosen(*units, asked=7) == (None, ["imu_not_in_log"])


def test_another_unit_takes_the_place_of_one_that_flew_and_is_too_slow() -> None:
    assert chosen(unit(0, hz=5.0), unit(1), flew=0) == (1, ["imu_that_flew_too_slow"])
    assert chosen(unit(0, hz=5.0), unit(1, usable=False), flew=0) == (None, ["imu_rate_too_low"])
    assert chosen(unit(0, hz=5.0), unit(1), asked=0) == (None, ["imu_rate_too_low"])


@pytest.mark.parametrize(
    ("begin", "seconds", "told"),
    [
        (7.0, 66.0, True),
        (8.0, 65.0, False),
        (4.9, 65.1, True),
        (5.1, 64.9, False),
        (10.0, 65.1, True),
        (12.0, 50.0, False),
    ],
)
def test_a_unit_that_was_logged_for_five_seconds_more_before_and_behind_is_told(
    begin: float, seconds: float, told: bool
) -> None:
    _, codes = chosen(unit(0), unit(1, begin_s=begin, seconds=seconds), flew=0)
    assert codes == (["imu_covers_a_part"] if told else [])


def test_of_each_unit_the_best_usable_message_counts_that_covers_its_time() -> None:
    best = imu.best_per_unit(empty_builder(), [unit(1, rank=2), unit(1, rank=1), unit(0, rank=3)])
    assert [(c.index, c.rank) for c in best] == [(0, 3), (1, 1)]
    (found,) = imu.best_per_unit(empty_builder(), [unit(0, rank=0, usable=False), unit(0, rank=2)])
    assert found.rank == 2
    (found,) = imu.best_per_unit(empty_builder(), [unit(0, hz=2.0, rank=0), unit(0, hz=5.0, rank=2)])
    assert found.rank == 2
    for share, rank in ((0.95 * imu.MIN_COVERED_SHARE, 1), (1.05 * imu.MIN_COVERED_SHARE, 0)):
        (found,) = imu.best_per_unit(empty_builder(), [unit(0, rank=0, seconds=60.0 * share), unit(0, rank=1)])
        assert found.rank == rank


def damaged(lost: int, size: int = 1_000_000, places: int = 2, at: int = 500, seconds: float = 60.0) -> list[Any]:
    messages = fake.messages("ulog", {})
    messages.size = size
    for _ in range(places):
        messages.losses.add(at, lost // places, "bytes that are no record", "later")
    return flight.damage_problems(messages, seconds)


def test_messages_of_another_dialect_are_not_blamed_on_the_radio_link() -> None:
    messages = fake.messages("tlog", {})
    messages.size = 1_000_000
    messages.losses.add(933, 8000, f"383 packets of message 132 with a wrong checksum {OTHER_DIALECT}", "later")
    messages.losses.add(9000, 20, "20 bytes without a packet", "later")
    (found,) = flight.damage_problems(messages, 60.0)
    assert "dialect" in found.remedy
    (plain,) = damaged(2000)
    assert plain.remedy == ""


def test_damage_is_a_warning_from_a_thousandth_of_the_file_on() -> None:
    for lost, severity in ((990, "note"), (1010, "warning")):
        (found,) = damaged(lost)
        assert (found.code, found.severity, found.count) == ("damage", severity, 2)
        assert f"{lost:,} bytes are not usable" in found.text
    (cut,) = damaged(4000, places=1, at=996_000)
    assert (cut.code, cut.severity) == ("cut_at_end", "note")
    (early,) = damaged(4000, places=1, at=996_000, seconds=0.2)
    assert (early.severity, "cut after 1,000,000 bytes and 0.2 s" in early.text) == ("warning", True)
    (long,) = damaged(4100, places=1, at=995_900)
    assert long.code == "damage"


def test_dropouts_of_more_than_a_tenth_of_a_second_are_a_warning() -> None:
    for lost, severity in (([40, 60], "note"), ([40, 61], "warning")):
        known: Any = SimpleNamespace(dropouts_ms=lost)
        (found,) = flight.dropout_problems(known)
        assert (found.severity, found.count) == (severity, 2)


# Samples at the end of a sensor's range: which counts of which firmware mean what they say.


def counted(log: FlightLog, sensor: str = "accelerometer") -> dict[int | None, int]:
    """New clipped samples by unit."""
    return {c.unit: int(c.new.sum()) for c in log.vibration.clippings if c.sensor == sensor}


def codes(log: FlightLog) -> set[str]:
    """Codes of the log's problems."""
    return {p.code for p in log.problems}


def test_px4_counts_every_unit_and_flags_the_selected_one(corpus):
    """Read by hand: about 400 flagged samples from 37.2 s on; the unit that was not selected counts 1,804."""
    log = attlog.read(corpus / "logs" / "cases" / "px4_1.14_clipping_crash.ulg")
    assert counted(log) == {0: 0, 1: 42 + 158 + 1604, None: 397}
    flags = next(c for c in log.vibration.clippings if not c.whole)
    assert flags.t[np.argmax(flags.new > 0)] == pytest.approx(37.2, abs=0.1)


@pytest.mark.parametrize("name", ["px4_1.14_clipping_crash", "px4_1.14_clipping_field", "px4_1.14_hard_landing"])
def test_unset_memory_in_px4_1_14_is_no_gyro_at_the_end_of_its_range(corpus, name):
    """``sensor_combined.gyro_clipping`` holds 90, 115, 243 there, at 34 deg/s."""
    log = attlog.read(corpus / "logs" / "cases" / f"{name}.ulg")
    assert set(counted(log, "gyro").values()) == {0}
    assert "gyro_clipped" not in codes(log)


@pytest.mark.parametrize(
    ("name", "clips"),
    [
        ("cases/copter_flip_at_takeoff.bin", {0: 196, 1: 50, 2: 181}),
        ("bin_copter_3.4.4_mechfail_cut.bin", {0: 28, 1: 30}),
    ],
)
def test_ardupilot_counts_by_unit_in_one_record_or_in_one_for_each(corpus, name, clips):
    assert counted(attlog.read(corpus / "logs" / name)) == clips


# Magnetometers: which one measures nothing.

T = np.arange(0.0, 10.0, 0.01)


def turning(deg: float) -> Imu:
    """A unit that turns by so much about its z axis and back."""
    rate = np.zeros((len(T), 3))
    rate[:, 2] = np.radians(deg) * np.pi / 10.0 * np.cos(2.0 * np.pi * T / 10.0)
    return Imu(0, Stream(T, rate, "rad/s", "FRD", "IMU"), Stream(T, 0.0 * rate, "m/s^2", "FRD", "IMU"))


def compass(field: np.ndarray) -> Mag:
    return Mag(0, Stream(T[::10], np.tile(field, (len(T) // 10, 1)), "T", "FRD", "MAG"))


@pytest.mark.parametrize(("deg", "is_dead"), [(10.0, False), (25.0, True)])
def test_a_field_that_never_changes_is_none_only_where_the_vehicle_turns(deg: float, is_dead: bool) -> None:
    assert turned_deg(turning(deg).gyro, 0.0, 10.0) == pytest.approx(deg, rel=0.02)
    assert bool(dead_reason(compass(np.array([2e-5, 0.0, 4e-5])), turning(deg))) is is_dead


def test_a_field_of_zero_is_none_whatever_the_vehicle_does() -> None:
    assert dead_reason(compass(np.zeros(3)), None) == "all its values are zero"
