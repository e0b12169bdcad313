"""``[gates.health]``: what it may say, and what is wrong with it, each with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import UsageError
from attlog.compare.gates.file import read
from attlog.compare.gates.limits import GateLimit
from attlog.compare.gates.sensors import SensorGate


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_limits_verdicts_sensors_and_what_unknown_means_are_read(tmp_path):
    text = """
[gates]
lag_ms = { max = 5 }
[gates.health]
compass_offset = { max = 5 }
vibration_level = [{ verdict = "warning", sensors = "IMU.*" }, { min = -1, max = 30, unknown = "pass" }]
"""
    found = read(written(tmp_path / "gates.toml", text))
    assert [gate.metric for gate in found.gates] == ["lag_ms"]
    assert found.health == (
        SensorGate("compass_offset", (GateLimit("max", 5.0),)),
        SensorGate("vibration_level", (), "warning", ("IMU.*",)),
        SensorGate("vibration_level", (GateLimit("min", -1.0), GateLimit("max", 30.0)), unknown_passes=True),
    )


def test_a_file_may_hold_gates_of_sensors_alone(tmp_path):
    found = read(written(tmp_path / "gates.toml", '[gates.health]\nnotch = { verdict = "ok" }\n'))
    assert (found.gates, [gate.question for gate in found.health]) == ((), ["notch"])


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("compas_offset = { max = 5 }", "line 2: compas_offset: there is no such question about a sensor"),
        ("compas_offset = { max = 5 }", "compass_offset"),
        ("compass_offset = { max = -1 }", "line 2: compass_offset: max"),
        ("compass_offset = { maxx = 1 }", "maxx"),
        ('compass_offset = { verdict = "fault" }', "verdict"),
        ('compass_offset = { max = 1, unknown = "skip" }', "unknown"),
        ("compass_offset = { max = 1, min = 2 }", "min=2 is above max=1"),
        ("compass_offset = { sensors = [] , max = 1 }", "must be a list of names"),
        ('compass_offset = { sensors = ["MAG.0"] }', "has no limit; give one of min, max, verdict"),
        ("compass_offset = 5", 'is 5; write compass_offset = { verdict = "warning" }'),
    ],
)
def test_what_is_wrong_is_said_with_its_line_and_what_comes_near(tmp_path, line, said):
    with pytest.raises(UsageError) as error:
        read(written(tmp_path / "gates.toml", f"[gates.health]\n{line}\n"))
    assert said in str(error.value)


def test_everything_wrong_is_said_at_once(tmp_path):
    text = "[gates]\nlag = { max = 1 }\n[gates.health]\nnotsch = { max = 1 }\n"
    with pytest.raises(UsageError) as error:
        read(written(tmp_path / "gates.toml", text))
    assert [line.partition(": ")[0].rpartition(", ")[2] for line in str(error.value).splitlines()] == [
        "line 2",
        "line 4",
    ]


def test_a_table_that_is_none_is_refused(tmp_path):
    with pytest.raises(UsageError, match="write compass_offset"):
        read(written(tmp_path / "gates.toml", "[gates]\nhealth = 3\n"))
