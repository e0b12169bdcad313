"""Which unit is replayed, and what makes a unit useless: limits from both sides on candidates made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import flight
from attlog.flight import inertial
from attlog.flight.builder import LogBuilder
from attlog.flight.calibration import px4 as calibration
from attlog.flight.inertial import ImuCandidate
from attlog.flight.px4 import imus
from attlog.formats.base import Damage
from tests.flight import fake

LOGGING: Any = SimpleNamespace(advice=lambda what, rate=None: "Log more.")


def unit(index: int = 0, hz: float = 100.0, seconds: float = 60.0, begin_s: float = 10.0, **more: Any) -> ImuCandidate:
    n = round(hz * seconds) + 1
    t = np.round(1e6 * (begin_s + np.arange(n) / hz)).astype(np.int64)
    rank = more.pop("rank", 0)
    return ImuCandidate(index, rank, t, np.ones((n, 3)), np.ones((n, 3)), f"IMU:{index}/{rank}", "instant", **more)


def builder() -> LogBuilder:
    return LogBuilder(fake.messages("ulog", {}), t0_us=0)


def chosen(*units: ImuCandidate, flew: int | None = None, asked: int | None = None) -> tuple[int | None, list[str]]:
    made = builder()
    found = inertial.choose_unit(made, list(units), flew, "it flew", asked, LOGGING)
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


def test_in_long_logs_a_twentieth_more_is_told() -> None:
    for more, told in ((60.0, True), (48.0, False)):
        _, codes = chosen(unit(0, hz=10.0, seconds=1000.0), unit(1, hz=10.0, seconds=1000.0 + more), flew=0)
        assert ("imu_covers_a_part" in codes) is told


def test_of_each_unit_the_best_usable_message_counts_that_covers_its_time() -> None:
    best = inertial.best_per_unit(builder(), [unit(1, rank=2), unit(1, rank=1), unit(0, rank=3)])
    assert [(c.index, c.rank) for c in best] == [(0, 3), (1, 1)]
    (found,) = inertial.best_per_unit(builder(), [unit(0, rank=0, usable=False), unit(0, rank=2)])
    assert found.rank == 2
    (found,) = inertial.best_per_unit(builder(), [unit(0, hz=2.0, rank=0), unit(0, hz=5.0, rank=2)])
    assert found.rank == 2
    for share, rank in ((0.95 * inertial.COVERED_SHARE, 1), (1.05 * inertial.COVERED_SHARE, 0)):
        (found,) = inertial.best_per_unit(builder(), [unit(0, rank=0, seconds=60.0 * share), unit(0, rank=1)])
        assert found.rank == rank


def damaged(lost: int, size: int = 1_000_000, places: int = 2, at: int = 500) -> list[Any]:
    messages = fake.messages("ulog", {})
    messages.size = size
    messages.damage = [Damage(at, lost // places, "bytes that are no record", "later")] * places
    known: Any = SimpleNamespace(
        damage=messages.damage, damage_bytes=lost, damage_places=places, size=size, dropouts_ms=[]
    )
    return flight.damage(known)


def test_damage_is_a_warning_from_a_thousandth_of_the_file_on() -> None:
    for lost, severity in ((990, "note"), (1010, "warning")):
        (found,) = damaged(lost)
        assert (found.code, found.severity, found.count) == ("damage", severity, 2)
        assert f"{lost} bytes are not usable" in found.text
    (cut,) = damaged(4000, places=1, at=996_000)
    assert cut.code == "cut_at_end"
    (long,) = damaged(4100, places=1, at=995_900)
    assert long.code == "damage"


def test_dropouts_of_more_than_a_tenth_of_a_second_are_a_warning() -> None:
    for lost, severity in (([40, 60], "note"), ([40, 61], "warning")):
        known: Any = SimpleNamespace(dropouts_ms=lost)
        (found,) = flight.dropouts(known)
        assert (found.severity, found.count) == (severity, 2)


def test_increments_are_rates_over_their_own_times_and_each_unit_has_its_own() -> None:
    n = 200
    tables: Any = {}
    for k in range(2):
        tables["vehicle_imu", k] = {
            "timestamp": fake.micros(n, 100.0),
            "timestamp_sample": fake.micros(n, 100.0, 9_990_000),
            "delta_angle": (1.0 + k) * np.tile(np.array([0.001, -0.002, 0.003], np.float32), (n, 1)),
            "delta_velocity": (1.0 + k) * np.tile(np.array([0.05, 0.1, -0.1], np.float32), (n, 1)),
            "delta_angle_dt": np.full(n, 10_000, np.uint16),
            "delta_velocity_dt": np.full(n, 5_000, np.uint16),
            "gyro_device_id": np.full(n, 7 + k, np.uint32),
            "delta_angle_clipping": np.zeros(n, np.uint8),
        }
    tables["vehicle_imu", 0]["delta_angle_dt"][3] = 0
    messages = fake.messages("ulog", tables)
    one, two = imus.vehicle_imu(LogBuilder(messages, t0_us=0))
    np.testing.assert_allclose(one.gyro[0], [0.1, -0.2, 0.3], rtol=1e-5)
    np.testing.assert_allclose(two.acc[0], [20.0, 40.0, -40.0], rtol=1e-5)
    assert (len(one.t_us), len(two.t_us)) == (n - 1, n)
    assert (int(one.t_us[0]), one.device, two.device) == (9_990_000, "7", "8")


def test_without_a_type_of_compensation_the_motors_count_for_nothing() -> None:
    values = {"CAL_MAG0_ID": 41.0, "CAL_MAG0_XCOMP": 1.5} | {f"CAL_MAG0_{axis}OFF": 0.1 for axis in "XYZ"}
    found = calibration.compass(values, 41)
    assert not found.correction.motor.any()
    assert not found.motor_power
