"""What is written as DataFlash comes back, from our reader and from pymavlink."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from attlog import formats
from attlog.core.errors import UsageError
from attlog.formats import MessageLayout, ParamChange, Recording, Text
from attlog.formats.dataflash import reader
from tests.formats.reference import differences

NAMES = st.from_regex(r"[A-Z][A-Z0-9]{2,3}", fullmatch=True).filter(
    lambda s: s not in {"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "FILE"}
)
KINDS = ["<i1", "<u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f2", "<f4", "<f8", "S4", "S16", "S64", "(32,)<i2"]


@st.composite
def logs(draw: st.DrawFn) -> dict[str, dict[str, np.ndarray]]:
    """Messages with random names, types, row counts and values, NaN and infinity among them."""
    messages = {}
    for name in draw(st.lists(NAMES, min_size=1, max_size=4, unique=True)):
        n = draw(st.integers(1, 8))
        steps = draw(hnp.arrays(np.uint32, n))
        columns = {"TimeUS": np.cumsum(steps, dtype=np.uint64)}
        for k in range(draw(st.integers(0, 5))):
            kind = np.dtype(draw(st.sampled_from(KINDS)))
            if kind.itemsize + sum(c[0].nbytes for c in columns.values()) > 252:
                break  # a record holds 255 bytes
            columns[f"F{k}"] = (
                np.array(draw(st.lists(st.text("abc ,.#", max_size=kind.itemsize), min_size=n, max_size=n)), kind)
                if kind.kind == "S"
                else draw(hnp.arrays(kind.base, (n, *kind.shape)))
            )
        messages[name] = columns
    return messages


@pytest.mark.slow
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=logs())
def test_random_logs_come_back(messages: dict[str, dict[str, np.ndarray]], tmp_path: Path) -> None:
    path = tmp_path / "random.bin"
    path.unlink(missing_ok=True)
    formats.write(path, Recording(of_instance_0(messages)))
    log = reader.read_binary(path)
    assert (log.damage, log.damage_bytes) == ([], 0)
    for name, expected in messages.items():
        assert list(log[name, 0].fields) == list(expected)
        for column, values in expected.items():
            assert log[name, 0][column].dtype == values.dtype
            assert log[name, 0][column].tobytes() == values.tobytes(), (name, column)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=logs())
def test_pymavlink_reads_the_same(messages: dict[str, dict[str, np.ndarray]], tmp_path: Path) -> None:
    path = tmp_path / "random.bin"
    path.unlink(missing_ok=True)
    formats.write(path, Recording(of_instance_0(messages)))
    assert differences(path) == []


def of_instance_0(messages: dict[str, dict[str, np.ndarray]]) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    return {(name, 0): columns for name, columns in messages.items()}


def flight(n: int = 50) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    time = np.arange(n, dtype=np.uint64) * 20_000 + 5_000_000
    rng = np.random.default_rng(1)
    imus = {
        ("IMU", i): {"TimeUS": time, "I": np.full(n, i, np.uint8), "GyrX": rng.normal(size=n).astype(np.float32)}
        for i in (0, 1)
    }
    return {**imus, ("ATT", 0): {"TimeUS": time, "Roll": rng.normal(0, 20, n), "Yaw": rng.uniform(0, 360, n)}}


def test_printed_numbers_are_rounded_to_the_step_of_the_letter(tmp_path: Path) -> None:
    path = tmp_path / "scaled.bin"
    messages = flight()
    formats.write(path, Recording(messages, layouts={"ATT": MessageLayout("QcC")}))
    table = reader.read_binary(path)["ATT", 0]
    assert table["Roll"].dtype == np.int16
    np.testing.assert_allclose(table.value("Roll"), messages["ATT", 0]["Roll"], atol=0.00501)
    np.testing.assert_allclose(table.value("Yaw"), messages["ATT", 0]["Yaw"], atol=0.00501)


def test_units_instances_parameters_and_texts_come_back(tmp_path: Path) -> None:
    path = tmp_path / "units.bin"
    written = Recording(
        flight(),
        [ParamChange("RATE_P", 0.25), ParamChange("RATE_P", 0.5, is_default=True), ParamChange("B", 2, 5_100_000)],
        [Text("ArduCopter V4.6.0 (12345678)", 6), Text("Crash", 2, 5_200_000)],
        layouts={"IMU": MessageLayout("", "s#E", "F-0"), "ATT": MessageLayout("QcC", "sdh", "FBB")},
    )
    formats.write(path, written)
    log = reader.read_binary(path)
    assert log.instances("IMU") == [0, 1]
    assert [log["IMU", 0].fields[c].unit for c in ("TimeUS", "I", "GyrX")] == ["us", None, "rad/s"]
    assert [log["ATT", 0].fields[c].unit for c in ("Roll", "Yaw")] == ["deg", "degheading"]
    assert [(p.name, p.value, p.t_us, p.is_default) for p in log.params] == [
        ("RATE_P", 0.5, 5_000_000, True),
        ("RATE_P", 0.25, 5_000_000, False),
        ("B", 2.0, 5_100_000, False),
    ]
    assert [(x.text, x.t_us) for x in log.texts] == [("ArduCopter V4.6.0 (12345678)", 5_000_000), ("Crash", 5_200_000)]
    assert differences(path) == []


def test_records_of_all_messages_stand_in_the_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / "order.bin"
    formats.write(path, Recording(flight()))
    log = reader.read_binary(path)
    tables = [log["IMU", 0], log["IMU", 1], log["ATT", 0]]
    order = np.argsort(np.concatenate([t.offsets for t in tables]))
    assert np.all(np.diff(np.concatenate([t["TimeUS"] for t in tables])[order].astype(np.int64)) >= 0)


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        ({"toolong": {"TimeUS": np.zeros(1, np.uint64)}}, "1 to 4 capitals"),
        ({"IMU": {"GyrX": np.zeros(1)}}, "needs a column TimeUS"),
        ({"IMU": {"TimeUS": np.zeros(1, np.uint64), "X": np.zeros((1, 3))}}, "no type for"),
        ({"PARM": {"TimeUS": np.zeros(1, np.uint64)}}, "written by attlog itself"),
        (
            {"IMU": {k: np.zeros(1, "u8" if k == "TimeUS" else "S64") for k in ("TimeUS", "A", "B", "C", "D")}},
            "255 bytes",
        ),
        ({"IMU": {f"Column{k}" if k else "TimeUS": np.zeros(1, np.uint64) for k in range(12)}}, "at most 64"),
    ],
)
def test_what_the_format_cannot_hold_is_refused(tmp_path: Path, messages: dict, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        formats.write(tmp_path / "x.bin", Recording(of_instance_0(messages)))


def test_a_value_beyond_its_letter_is_refused(tmp_path: Path) -> None:
    messages = {("ATT", 0): {"TimeUS": np.zeros(1, np.uint64), "Roll": np.array([400.0])}}
    with pytest.raises(UsageError, match=r"ATT.Roll \(letter c\): a value does not fit int16"):
        formats.write(tmp_path / "x.bin", Recording(messages, layouts={"ATT": MessageLayout("Qc")}))
