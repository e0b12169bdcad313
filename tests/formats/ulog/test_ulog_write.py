"""What is written as ULog comes back, from our reader and from pyulog."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pyulog import ULog

from attlog import formats
from attlog.core.errors import UsageError
from attlog.core.limits import MAX_TEXT_LENGTH
from attlog.formats import ParamChange, Recording, Text
from attlog.formats.ulog import reader

NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,12}", fullmatch=True)
KINDS = ["<i1", "<u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f4", "<f8"]
TEXT = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FFF), max_size=40)


@st.composite
def columns(draw: st.DrawFn, names: list[str], kinds: list[str], widths: list[int]) -> dict[str, np.ndarray]:
    """A topic's columns: times that rise, anything (NaN and infinity too) else."""
    n = draw(st.integers(1, 8))
    steps = draw(hnp.arrays(np.uint32, n))
    found = {"timestamp": np.cumsum(steps, dtype=np.uint64)}
    for name, kind, width in zip(names, kinds, widths, strict=True):
        found[name] = draw(hnp.arrays(kind, (n, width) if width else n))
    return found


@st.composite
def logs(draw: st.DrawFn) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    topics = {}
    for topic in draw(st.lists(NAMES, min_size=1, max_size=4, unique=True)):
        names = draw(st.lists(NAMES.filter(lambda s: s != "timestamp"), max_size=5, unique=True))
        kinds = [draw(st.sampled_from(KINDS)) for _ in names]
        widths = [draw(st.sampled_from([0, 0, 1, 3, 9])) for _ in names]
        for multi in range(draw(st.integers(1, 3))):
            topics[topic, multi] = draw(columns(names, kinds, widths))
    return topics


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(topics=logs(), texts=st.lists(st.tuples(TEXT, st.integers(0, 7), st.integers(0, 2**40)), max_size=3))
def test_random_logs_come_back(
    topics: dict[tuple[str, int], dict[str, np.ndarray]], texts: list[tuple[str, int, int]], tmp_path: Path
) -> None:
    path = tmp_path / "random.ulg"
    path.unlink(missing_ok=True)
    params = [ParamChange("A_INT", 7), ParamChange("A_FLOAT", 0.5), ParamChange("A_FLOAT", 2.0, is_default=True)]
    written = [Text(text, level, t) for text, level, t in texts]
    formats.write(path, Recording(topics, params, written, {"sys_name": "PX4", "ver": 3}))
    log = reader.read_ulog(path)
    assert (log.damage, log.damage_bytes) == ([], 0)
    assert set(log) == set(topics)
    for key, expected in topics.items():
        assert list(log[key].fields) == list(expected)
        for name, column in expected.items():
            assert log[key][name].dtype == column.dtype
            assert log[key][name].tobytes() == column.tobytes()
    assert [(p.name, p.value, p.is_default) for p in log.params] == [(p.name, p.value, p.is_default) for p in params]
    assert sorted((t.text, t.level, t.t_us) for t in log.texts) == sorted(texts)
    assert log.info["sys_name"] == "PX4"


def test_the_official_library_reads_what_is_written(tmp_path: Path) -> None:
    t = np.arange(1000, 60_000, 1000, dtype=np.uint64)
    gyro = np.random.default_rng(3).normal(size=(len(t), 3)).astype(np.float32)
    topics = {
        ("sensor_combined", 0): {"timestamp": t, "gyro_rad": gyro},
        ("status", 1): {"timestamp": t[::10], "name": np.array([b"abc"] * 6, "S5"), "ok": np.ones(6, bool)},
    }
    change = ParamChange("GAIN", 3, t_us=30_000)
    params, texts = [ParamChange("GAIN", 2), change], [Text("hello", 6, 5000)]
    formats.write(tmp_path / "a.ulg", Recording(topics, params, texts, {"sys_name": "x"}))
    theirs = ULog(str(tmp_path / "a.ulg"))
    assert not theirs.file_corruption
    data = theirs.get_dataset("sensor_combined").data
    assert all(np.array_equal(data[f"gyro_rad[{i}]"], gyro[:, i]) for i in range(3))
    assert bytes(theirs.get_dataset("status", 1).data[f"name[{i}]"][0] for i in range(5)) == b"abc\0\0"
    assert theirs.initial_parameters == {"GAIN": 2}
    assert theirs.changed_parameters == [(30_000, "GAIN", 3)]
    assert [(m.timestamp, m.message) for m in theirs.logged_messages] == [(5000, "hello")]
    mine = reader.read_ulog(tmp_path / "a.ulg")
    assert mine["status", 1]["name"].tolist() == [b"abc"] * 6
    assert mine.params[-1].t_us == 30_000


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"x": np.zeros(3)}, "timestamp"),
        ({"timestamp": np.zeros(3, np.uint64), "a[1].b": np.zeros(3)}, "numbered"),
        ({"timestamp": np.zeros(3, np.uint64), "a": np.zeros(3, complex)}, "no type"),
        ({"timestamp": np.zeros(3, np.uint64), "a": np.zeros((3, 9000))}, "65535"),
    ],
)
def test_what_ulog_cannot_hold_is_refused(columns: dict[str, np.ndarray], words: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=words):
        formats.write(tmp_path / "bad.ulg", Recording({("topic", 0): columns}))
    assert not (tmp_path / "bad.ulg").exists()


def test_long_texts_and_short_names_are_no_damage(tmp_path: Path) -> None:
    """A message of 60 000 characters and parameters of one letter: rare, and still a log as pyulog reads it."""
    path = tmp_path / "odd.ulg"
    topics = {("topic", 0): {"timestamp": np.arange(50, dtype=np.uint64), "x": np.arange(50.0)}}
    params = [ParamChange(name, 1.5) for name in ("A", "B2", "C3", "LONG_NAME_OF_16_")]
    formats.write(path, Recording(topics, params, [Text("A" * 60_000, 4, 20), Text("b", 4, 21)]))
    mine, theirs = reader.read_ulog(path), ULog(str(path))
    assert mine.damage == []
    assert {p.name: p.value for p in mine.params} == theirs.initial_parameters
    assert [x.text for x in mine.texts] == [m.message[:MAX_TEXT_LENGTH] for m in theirs.logged_messages]
    assert np.array_equal(mine["topic", 0]["x"], theirs.get_dataset("topic").data["x"])


def test_a_default_is_that_of_firmware_and_airframe_for_the_official_library(tmp_path: Path) -> None:
    stamps = {("status", 0): {"timestamp": np.arange(1000, 5000, 1000, dtype=np.uint64), "x": np.zeros(4, np.float32)}}
    params = [ParamChange("A", 7), ParamChange("A", 5, is_default=True)]
    formats.write(tmp_path / "x.ulg", Recording(stamps, params, [], {"sys_name": "PX4"}))
    log = ULog(str(tmp_path / "x.ulg"))
    assert (log.get_default_parameters(0), log.get_default_parameters(1)) == ({"A": 5}, {"A": 5})
    assert log.initial_parameters == {"A": 7}
