"""Configurations in a TOML file: read, and everything wrong at once with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import LogUnreadable, UsageError
from attlog.compare.configurations.configuration import parse
from attlog.compare.configurations.toml_file import _at, read

GOOD = """metrics = ["inclination_rmse_deg", "lag_ms"]
reference = "truth"

[[configuration]]
estimator = "mahony@xu-0.6"

[[configuration]]
name = "slow and quiet"
estimator = "mahony"
kp = 0.3
lowpass = 20
mag = false
gyro_offset = [0.1, 0, -0.2]
"""
BAD = """metrics = ["inclination_rmse"]
refrence = "truth"
window = 3

[[configuration]]
name = "a"
estimator = "mahoni"

[[configuration]]
estimator = "mahony"
kpp = 0.3
kp = "3 Hz"
lowpas = 20
rate = "x"
latency = true

[[configuration]]
filter = "vqf"

[[configuration]]
estimator = "vqf"

[[configuration]]
estimator = "vqf"
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "filters.toml"
    path.write_text(text)
    return path


def test_a_file_means_what_the_command_line_means(tmp_path: Path) -> None:
    found = read(write(tmp_path, GOOD))
    assert found.metrics == ["inclination_rmse_deg", "lag_ms"]
    assert found.options == {"reference": "truth"}
    assert found.configurations == [
        parse("mahony@xu-0.6"),
        parse("mahony:kp=0.3,lowpass=20,mag=off,gyro_offset=0.1/0/-0.2", "slow and quiet"),
    ]


def test_everything_wrong_is_told_at_once_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as error:
        read(write(tmp_path, BAD))
    told = {line.removeprefix(f"{tmp_path}/filters.toml") for line in str(error.value).splitlines()}
    for begin, part in (
        (", line 1: ", "there is no metric inclination_rmse; did you mean inclination_rmse_deg?"),
        (", line 2: ", "unknown key refrence; did you mean reference?"),
        (", line 3: ", "window: must be a valid string (got 3)"),
        (", line 7: configuration 1: ", "there is no estimator mahoni; did you mean mahony?"),
        (
            ", line 11: configuration 2: ",
            "no parameter kpp, and no setting before a filter is called so; did you mean kp?",
        ),
        (", line 12: configuration 2: ", "kp is given in 1/s, not in Hz"),
        (", line 13: configuration 2: ", "did you mean lowpass?"),
        (", line 14: configuration 2: ", "rate='x': of the wrong type; give A [Hz]"),
        (", line 15: configuration 2: ", "latency=True: of the wrong type; give A [ms]"),
        (", line 18: configuration 3: ", "has no estimator; did you mean estimator?"),
        (", line 23: configuration 5: ", "vqf is there twice"),
    ):
        assert any(line.startswith(begin) and line.endswith(part) for line in told), (begin, part, told)
    assert len(told) == 11
    assert error.value.exit_code == 2


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[[configuration]", "not valid TOML"),
        ("", "holds no [[configuration]]"),
        ("configuration = 3", "holds no [[configuration]]"),
        ("[configuration]\nestimator = 'vqf'", "holds no [[configuration]]"),
        (
            "metrics = 'lag_ms'\n[[configuration]]\nestimator = 'vqf'",
            "metrics: of the wrong type; give a list of names",
        ),
        ("[[configuration]]\nestimator = 'vqf'\nname = 3", "name=3: of the wrong type; give a text"),
        ("[[configuration]]\nestimator = 'mahony'\nrate = 50\npick = 50", "rate and pick exclude each other"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(UsageError) as error:
        read(write(tmp_path, text))
    assert why in str(error.value)


def test_a_file_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadable):
        read(tmp_path / "none.toml")


def test_the_line_of_a_key_is_that_in_its_own_part_of_the_file(tmp_path):
    lines = ['reference = "truth"', "[[configuration]]", "kp = 1", "[[configuration]]", "kp = 2", "window = 3"]
    at = [_at(tmp_path, lines, key, table) for key, table in (("reference", None), ("kp", 1), ("kp", 0))]
    assert [place.rpartition(" ")[2] for place in at] == ["1", "5", "3"]
    assert _at(tmp_path, lines, "window") == str(tmp_path)
    assert _at(tmp_path, lines, "window", 0).endswith("line 2")
