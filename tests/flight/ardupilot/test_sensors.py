"""VIBE and bursts: levels of every unit, samples as pymavlink reads them, what is cut or filtered."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import attlog
from attlog.flight.ardupilot import sensors
from attlog.flight.ardupilot.imu import DataflashBuilder
from attlog.flight.model import Burst
from attlog.formats.table import Messages
from tests.flight import fake

RNG = np.random.default_rng(0)
COUNT, SAMPLES = 3, 1024
RAW = RNG.integers(-2000, 2000, (COUNT, SAMPLES, 3)).astype(np.int16)
START = 10_000_000


def logged(lost: tuple[int, int] | None = None, **head: Any) -> Messages:
    """Three bursts of 1024 samples; ``lost``: (burst, record) that is missing."""
    heads = {
        "TimeUS": (START + 1_000_000 * np.arange(COUNT)).astype(np.uint64),
        "N": np.arange(COUNT, dtype=np.uint16),
        "type": np.array([0, 1, 1], np.uint8),
        "instance": np.array([0, 0, 2], np.uint8),
        "mul": np.full(COUNT, 938, np.uint16),
        "smp_cnt": np.full(COUNT, SAMPLES, np.uint16),
        "SampleUS": (START - 20_000 + 1_000_000 * np.arange(COUNT)).astype(np.uint64),
        "smp_rate": np.full(COUNT, 2000.0, np.float32),
    } | {k: np.asarray(v) for k, v in head.items()}
    rows = [(k, r) for k in range(COUNT) for r in range(SAMPLES // 32) if (k, r) != lost]
    data = {
        "TimeUS": np.zeros(len(rows), np.uint64),
        "N": np.array([k for k, _ in rows], np.uint16),
        "seqno": np.array([r for _, r in rows], np.uint16),
    } | {axis: np.stack([RAW[k, 32 * r : 32 * r + 32, n] for k, r in rows]) for n, axis in enumerate("xyz")}
    two = {("IMU", unit): {"TimeUS": fake.micros(5, 50.0)} for unit in (0, 1)}
    made = fake.messages("dataflash", {**two, ("ISBH", 0): heads, ("ISBD", 0): data})
    header, body = made.tables["ISBH", 0], made.tables["ISBD", 0]
    # each header stands in the file right before its data
    place = np.array([1_000_000 + 10_000 * k for k in range(COUNT)], np.int64)
    made.tables["ISBH", 0] = fake.table("ISBH", 0, {n: header[n] for n in header.fields}, place)
    at = np.array([1_000_000 + 10_000 * k + 100 * (r + 1) for k, r in rows], np.int64)
    made.tables["ISBD", 0] = fake.table("ISBD", 0, {n: body[n] for n in body.fields}, at)
    return made


def bursts(messages: Messages, **values: float) -> list[Burst]:
    builder = DataflashBuilder(messages, t0_us=START)
    builder.values = values
    return sensors.read_bursts(builder)


def test_samples_come_back_by_the_headers_factor_and_time() -> None:
    found = bursts(logged())
    assert [(b.sensor, b.unit, b.filtered) for b in found] == [
        ("accelerometer", 0, False),
        ("gyro", 0, False),
        ("gyro", 2, False),
    ]
    assert [b.t for b in found] == pytest.approx([-0.02, 0.98, 1.98])
    for burst, raw in zip(found, RAW, strict=True):
        assert np.array_equal(np.round(burst.x * 938), raw)
        assert burst.rate == 2000.0


def test_bursts_from_behind_the_filters_are_numbered_after_the_last_imu() -> None:
    assert [(b.unit, b.filtered) for b in bursts(logged(), INS_LOG_BAT_OPT=4.0)] == [(0, False), (0, False), (0, True)]
    assert all(b.filtered for b in bursts(logged(), INS_LOG_BAT_OPT=2.0))


def test_a_lost_record_cuts_its_burst_and_no_other() -> None:
    assert [len(b.x) for b in bursts(logged(lost=(1, 20)))] == [1024, 640, 1024]
    assert [len(b.x) for b in bursts(logged(lost=(1, 3)))] == [1024, 1024]  # 96 samples resolve nothing


@pytest.mark.parametrize(
    "head",
    [{"mul": np.zeros(3, np.uint16)}, {"smp_rate": np.full(3, np.nan, np.float32)}, {"type": np.full(3, 9, np.uint8)},
     {"smp_rate": np.full(3, 1e9, np.float32)}, {"N": np.array([7, 8, 9], np.uint16)}],
)  # fmt: skip
def test_headers_without_sense_give_nothing(head: dict[str, Any]) -> None:
    assert bursts(logged(**head)) == []


def test_bursts_are_those_that_pymavlink_reads(corpus) -> None:
    from pymavlink import DFReader

    path = corpus / "logs" / "bin_copter_4.7dev_crash_isb_cut.bin"
    log = attlog.read(path)
    reader = DFReader.DFReader_binary(str(path))
    head, parts, expected = None, [], []
    while (m := reader.recv_match(type=["ISBH", "ISBD"])) is not None:
        if m.get_type() == "ISBH":
            head, parts = m, []
        elif head is not None and head.N == m.N:
            parts.append(np.stack([np.array(m.x), np.array(m.y), np.array(m.z)], axis=1))
            if m.seqno == 31:
                expected.append((head.instance, np.concatenate(parts) / head.mul))
    whole = [b for b in log.vibration.bursts if len(b.x) == 1024]
    assert len(whole) == len(expected) == 16
    for burst, (instance, x) in zip(whole, expected, strict=True):
        assert burst.filtered == (instance >= 2)
        assert burst.x == pytest.approx(x, abs=1e-4)


def test_the_level_of_bursts_is_that_of_vibe_in_steady_flight(corpus) -> None:
    """Measured 0.95 and 0.90 in the two steady bursts."""
    from attlog.health.vibration import burst_levels

    log = attlog.read(corpus / "logs" / "bin_copter_4.7dev_crash_isb_cut.bin")
    raw = [b for b in log.vibration.bursts if b.sensor == "accelerometer" and not b.filtered]
    own, vibe = burst_levels(raw), next(v for v in log.vibration.levels if v.unit == 0)
    ratio = own.level[:2] / np.interp(own.t[:2], vibe.t, vibe.level)
    assert ratio == pytest.approx([0.95, 0.90], abs=0.06)


def test_a_counter_of_clipped_samples_that_begins_anew_has_counted_none() -> None:
    """3, 2 and 4 new ones; between them the counter falls back to 0, as after a restart of the sensor's driver."""
    counter = {"TimeUS": fake.micros(6, 10.0), "Clip0": np.array([7, 10, 10, 0, 2, 6], np.uint32)}
    log = fake.messages("dataflash", {("IMU", 0): {"TimeUS": fake.micros(5, 50.0)}, ("VIBE", 0): counter})
    (found,) = sensors.clippings(DataflashBuilder(log))
    assert (found.source, found.new.tolist()) == ("VIBE.Clip0", [0, 3, 0, 0, 2, 4])


def test_more_clipped_samples_than_a_sensor_takes_are_damage() -> None:
    """65,535 in 0.1 s, as of a counter of 16 bits that was never set; the 40 real ones stay."""
    counter = {"TimeUS": fake.micros(4, 10.0), "Clip0": np.array([0, 40, 40 + 65_535, 40 + 65_535], np.uint32)}
    log = fake.messages("dataflash", {("IMU", 0): {"TimeUS": fake.micros(5, 50.0)}, ("VIBE", 0): counter})
    builder = DataflashBuilder(log)
    (found,) = sensors.clippings(builder)
    assert found.new.tolist() == [0, 40, 0, 0]
    assert [p.code for p in builder.problems] == ["values_out_of_range"]
