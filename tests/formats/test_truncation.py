"""A log may end anywhere: what is read from the beginning of a file is the beginning of what the whole file holds."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import AttlogError
from attlog.formats import Messages, ParamChange, Recording, Text
from tests.conftest import SAMPLES, few

NAMES = ["px4_steps.ulg", "px4_hover.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"]


def small_ulog(path: Path) -> None:
    """Two topics, one of them twice, a change of a parameter and a text: 2 kB."""
    rng = np.random.default_rng(1)
    t = np.arange(10_000, 410_000, 10_000, dtype=np.uint64)
    topics = {
        ("sensor_combined", 0): {"timestamp": t, "gyro_rad": rng.normal(size=(40, 3)).astype(np.float32)},
        ("status", 0): {"timestamp": t[::4], "name": np.array([b"quad"] * 10, "S8")},
        ("status", 1): {"timestamp": t[::5] + 3, "name": np.array([b"plane"] * 8, "S8")},
    }
    params = [ParamChange(f"PARAM_{i}", i) for i in range(8)] + [ParamChange("PARAM_3", 9, t_us=100_000)]
    recording = Recording(topics, params, [Text("takeoff", 6, 50_000)], {"sys_name": "PX4"})
    formats.format_named("ulog").write(path, recording)


def small_dataflash(path: Path) -> None:
    """Formats, parameters, IMU and ATT records of the sample, each type's first few: 2 kB."""
    source = SAMPLES / "copter_steps_stabilize.bin"
    raw, log = source.read_bytes(), formats.open(source)
    lengths = dict(zip(log["FMT", 0]["Type"].tolist(), log["FMT", 0]["Length"].tolist(), strict=True))
    wanted = {raw[log[key].offsets[0] + 2]: n for key, n in {("PARM", 0): 5, ("IMU", 0): 15, ("ATT", 0): 6}.items()}
    kept = []
    for table in log.values():
        for offset in table.offsets[:400].tolist():
            kind = raw[offset + 2]
            is_wanted_format = kind == 128 and raw[offset + 3] in {128, *wanted}
            if is_wanted_format or wanted.get(kind, 0) > 0:
                wanted[kind] = wanted.get(kind, 0) - 1
                kept.append((offset, raw[offset : offset + lengths[kind]]))
    path.write_bytes(b"".join(record for _, record in sorted(kept)))


def small_tlog(path: Path) -> None:
    """The first packets of the sample: 2 kB."""
    path.write_bytes((SAMPLES / "copter_steps_stabilize.tlog").read_bytes()[:2200])


def at_lengths(path: Path, lengths: Iterator[int]) -> Iterator[tuple[int, Messages | None]]:
    """The log cut to each length, longest first; None where it is refused."""
    for length in sorted(set(lengths), reverse=True):
        with path.open("r+b") as file:
            file.truncate(length)
        try:
            log = formats.open(path)
        except AttlogError:
            log = None
        yield length, log


def columns(log: Messages) -> dict[tuple[tuple[str, int], str], np.ndarray]:
    return {(key, name): np.array(log[key][name]) for key in log for name in log[key].fields}


def assert_beginning(log: Messages, whole: dict[tuple[tuple[str, int], str], np.ndarray], length: int) -> int:
    """Every column is the beginning of the whole one; returns the number of rows."""
    for key, table in log.items():
        assert len(table) == 0 or int(table.offsets[-1]) < length
        for name in table.fields:
            column = table[name]
            assert column.tobytes() == whole[key, name][: len(column)].tobytes(), (length, key, name)
    return sum(map(len, log.values()))


@pytest.mark.parametrize("build", few([small_ulog, small_dataflash, small_tlog], 1), ids=lambda f: f.__name__)
def test_a_small_log_can_end_at_every_byte(build, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "small"
    build(path)
    size, whole = path.stat().st_size, columns(formats.open(path))
    assert 1500 < size < 9000
    rows = np.array(
        [
            assert_beginning(log, whole, n) if log is not None else 0
            for n, log in at_lengths(path, iter(range(size + 1)))
        ]
    )
    assert (np.diff(rows) <= 0).all(), "a shorter file never holds more"
    assert rows[0] > 20
    assert rows[-1] == 0


def check_seeded_lengths(name: str, count: int, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes((SAMPLES / name).read_bytes())
    whole = formats.open(path)
    stored = columns(whole)
    offsets = {key: table.offsets for key, table in whole.items()}
    lengths = np.random.default_rng(20).integers(0, path.stat().st_size, count)
    for length, log in at_lengths(path, iter(lengths.tolist())):
        if log is None:
            assert length < 40_000, "a log with data in it is read"
            continue
        rows = assert_beginning(log, stored, length)
        assert rows >= sum(int((at < length).sum()) for at in offsets.values()) - 1, "only the cut record is lost"


@pytest.mark.parametrize("name", NAMES)
def test_a_sample_log_can_end_anywhere(name: str, tmp_path: Path) -> None:
    check_seeded_lengths(name, 12, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_sample_log_can_end_at_200_places(name: str, tmp_path: Path) -> None:
    check_seeded_lengths(name, 200, tmp_path)


# The script that cuts sample logs keeps definitions, parameters and every record in the window.

CLOCKS = {"ulog": "timestamp", "dataflash": "TimeUS", "tlog": "_t_us"}


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"])
def test_a_cut_log_holds_the_window_and_all_parameters(name: str, tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("cut", SAMPLES / "cut.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    whole = formats.open(SAMPLES / name)
    script.cut(SAMPLES / name, tmp_path / name, 20.0, 30.0)
    short = formats.open(tmp_path / name)
    clock = CLOCKS[whole.format]
    zero = min(int(t[clock].astype(np.int64).min()) for t in whole.values() if clock in t)
    assert short.size < whole.size / 2
    assert [(p.name, p.value) for p in short.params] == [(p.name, p.value) for p in whole.params]
    assert len(short.texts) == len(whole.texts)
    imu = {"ulog": "sensor_combined", "dataflash": "IMU", "tlog": "RAW_IMU"}[whole.format]
    before, after = whole.first(imu), short.first(imu)
    assert before is not None
    assert after is not None
    seconds = (before[clock].astype(np.int64) - zero) / 1e6
    inside = (seconds >= 20) & (seconds < 30)
    assert inside.sum() > 400
    for field in before.fields:
        assert np.array_equal(before[field][inside], after[field]), field
