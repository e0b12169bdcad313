"""Scenarios: what is wrong in a file is told at once, with its place and the name that was meant."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from attlog.base.errors import LogUnreadable, UsageError
from attlog.simulate.scenario.scenario import Scenario, build, load, names
from tests.conftest import ROOT


@pytest.mark.parametrize("name", names())
def test_every_scenario_of_the_library_loads_under_its_name(name: str) -> None:
    scenario = load(name)
    assert scenario.name == name
    assert scenario.title


def test_all_problems_of_a_file_are_told_at_once(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'secnds = 3\n[place]\nlat_deg = 100\n[[sensors.imu]]\nrate = 3\n[sensors.imu.gyro]\nnoise_dps_rthz = "much"\n'
        '[[command]]\nt = 1\ndo = "takeof"\n[[command]]\ndo = "arm"\n'
    )
    with pytest.raises(UsageError) as error:
        load(file)
    lines = str(error.value).splitlines()
    assert [line for line in lines if not line.startswith("mine.toml: ")] == []
    for told in (
        "secnds; did you mean seconds?",
        "place.lat_deg: ",
        "sensors.imu[0].rate; did you mean rate_hz?",
        "sensors.imu[0].gyro.noise_dps_rthz: ",
        "command[0].do: ",
        "command[1].t: is missing",
    ):
        assert [line for line in lines if told in line], told
    assert len(lines) == 6


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"sensors": {"imu": []}}, "sensors.imu: at least one"),
        ({"sensors": {"imu": [{"rate_hz": 4000}]}}, "more than the raw rate"),
        ({"sensors": {"mag": [{}, {"rate_hz": 1e9}]}}, "sensors.mag[1].rate_hz: 1e+09 is more than the raw rate"),
        ({"sensors": {"battery": {"rate_hz": 1e6}}}, "sensors.battery.rate_hz: 1e+06 is more than the raw rate"),
        ({"sensors": {"mag": [{"gaps": [[10, 5]]}]}}, "sensors.mag[0].gaps: [10, 5] ends before it begins"),
        ({"sensors": {"gnss": [{"outages": [[3, 4], [9, 8]]}]}}, "sensors.gnss[0].outages: [9, 8] ends before"),
        ({"seconds": 7200, "loop": {"rate_hz": 2000, "substeps": 50}}, "seconds: 7200 s .* take up to 200 s"),
        ({"name": "../x"}, "name: '../x' is no name of a file"),
        ({"sensors": {"imu": [{"gyro": 3}]}}, "sensors.imu[0].gyro: must be a table"),
        ({"vehicle": {"drag_n_s_m": [-1, 0, 0]}}, "vehicle.drag_n_s_m[0]: "),
        ({"sensors": {"imu": [{"vibration": {"harmonics": [1]}}]}}, "equally long"),
        ({"motion": {}, "command": [{"t": 0, "do": "arm"}]}, "give one of them"),
        ({"vehicle": {"mass_kg": 6}, "command": [{"t": 0, "do": "arm"}]}, "too little to fly"),
        ({"command": [{"t": 5, "do": "arm"}, {"t": 4, "do": "takeoff"}]}, "ascend"),
        ({"fault": [{"t": 5, "part": "mag", "kind": "stuck", "instance": 2}]}, "there is no mag 2"),
        ({"fault": [{"t": 5, "part": "rotor", "kind": "stuck"}]}, "fault[0].kind: a rotor can be off or scale"),
        ({"fault": [{"t": 5, "part": "acc", "kind": "unbalanced"}]}, "fault[0].kind: only a rotor is unbalanced"),
        ({"motion": {}, "command": [{"t": 2, "do": "arm"}]}, "motion, command: give one of them, or motion.after_s"),
        ({"motion": {"after_s": 4}}, "motion.after_s: nothing flew before"),
        ({"motion": {"after_s": 1}, "command": [{"t": 2, "do": "arm"}]}, "motion.after_s: 1 s is before the last"),
        ({"fault": [{"t": 5, "part": "gyro", "kind": "off"}]}, "fault[0].kind: only a rotor is off"),
        ({"sensors": {"imu": [{"gaps": [[-5, 1]]}]}}, "sensors.imu[0].gaps: [-5, 1] begins before the flight"),
        ({"sensors": {"battery": {"full_v": 11, "empty_v": 12}}}, "sensors.battery: empty_v 12 is above full_v 11"),
    ],
)
def test_values_that_contradict_each_other_are_refused(values: dict[str, object], told: str) -> None:
    with pytest.raises(UsageError, match=told.replace("[", r"\[").replace("+", r"\+")):
        build(values)


@pytest.mark.parametrize(
    ("toml", "told"),
    [
        ("seconds = -60", "seconds: must be greater than or equal to 1 (got -60)"),
        ("seconds = true", "seconds: must be a valid number (got True)"),
        ('seconds = "60 s"', "seconds: must be a number without quotes; its unit stands in the key (got '60 s')"),
        ('seconds = "60"', "seconds: must be a number without quotes; its unit stands in the key (got '60')"),
        ("seconds = 2020-01-01", "seconds: must be a number"),
        ("seconds = nan", "seconds: must be a finite number (got nan)"),
        ("[[fault]]\nt = -1\npart = 'mag'\nkind = 'stuck'", "fault[0].t: must be greater than or equal to 0 (got -1)"),
        ("[[command]]\nt = 1\ndo = 'takeoff'\nup_cm = 300", "unknown key command[0].up_cm; did you mean up_m?"),
        (
            "[command]\nt = 1\ndo = 'arm'",
            "command: must be a list of tables, [[command]] each, with keys such as t, do",
        ),
        ("[wind]\nmean_ned_m_s = 5", "wind.mean_ned_m_s: must be a list of values (got 5)"),
        ("[wind]\nmean_ned_m_s = [5, 0]", "wind.mean_ned_m_s[2]: is missing"),
        ("[[sensors.imu]]\ngaps = [[1, 2, 3]]", "sensors.imu[0].gaps[0]: must have 2 values (got [1, 2, 3])"),
        ("[loop]\nsubsteps = 2.5", "loop.substeps: must be a valid integer (got 2.5)"),
        (
            "[place]\ndate = 'yesterday'",
            "place.date: must be a date, 2024-03-01 or 2024-03-01T12:00:00Z (got 'yesterday')",
        ),
    ],
)
def test_a_value_of_the_wrong_kind_is_told_with_its_place(toml: str, told: str) -> None:
    with pytest.raises(UsageError) as error:
        build(tomllib.loads(toml), "mine.toml")
    assert [line for line in str(error.value).splitlines() if not line.startswith(f"mine.toml: {told}")] == []


def test_dates_may_be_written_in_every_form_of_toml() -> None:
    midnight = 1709251200.0  # date -u -d 2024-03-01 +%s
    for written in ("2024-03-01", '"2024-03-01"', "2024-03-01T00:00:00", "2024-03-01T00:00:00Z"):
        assert build(tomllib.loads(f"place.date = {written}")).place.unix_time == midnight


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(UsageError, match="did you mean static"):
        load("statik")


def test_a_file_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadable):
        load(tmp_path / "none.toml")


def test_a_scenario_cannot_be_changed_but_copied() -> None:
    scenario = Scenario(seconds=5)
    with pytest.raises(dataclasses.FrozenInstanceError):
        scenario.seconds = 6  # type: ignore[misc]
    assert scenario.changed(seconds=7).seconds == 7
    assert scenario.seconds == 5


def test_the_docs_list_every_scenario_and_their_example_is_one() -> None:
    page = (ROOT / "docs" / "simulate.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([\w-]+)` \| [^|]+ \|$", page, re.M)
    assert sorted(set(listed)) == names()
    example = tomllib.loads(re.findall(r"```toml\n(.*?)```", page, re.S)[0])
    scenario = build(example)
    assert len(scenario.sensors.imu) == 2
    assert scenario.fault[0].part == "mag"


@pytest.mark.slow
def test_the_python_of_the_docs_runs() -> None:
    page = (ROOT / "docs" / "simulate.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", page, re.S)[0], names)
    flight = names["flight"]
    assert len(flight.truth.t) == 30 * 400 + 1
    assert flight.truth.q.shape == (len(flight.truth.t), 4)
    assert flight.onboard.q.shape[1] == 4
    assert flight.imus[0].gyro.shape == flight.imus[0].gyro_bias.shape
