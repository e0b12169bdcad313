"""Scenarios: what is wrong in a file is told at once, with its place and the name that was meant."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from attlog.core.errors import UsageError
from attlog.simulate.guidance import Guidance
from attlog.simulate.scenario import Command, Controller, build_scenario, load_scenario, scenario_names
from attlog.simulate.scenario_text import VALUES_OF_COMMAND, ineffective_entries
from tests.conftest import ROOT


def test_all_problems_of_a_file_are_told_at_once(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'secnds = 3\n[place]\nlat_deg = 100\n[[sensors.imu]]\nrate = 3\n[sensors.imu.gyro]\nnoise_dps_rthz = "much"\n'
        '[[command]]\nt = 1\ndo = "takeof"\n[[command]]\ndo = "arm"\n'
    )
    with pytest.raises(UsageError) as error:
        load_scenario(file)
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
        (
            {"fault": [{"t": 5, "part": "rotor", "kind": "stuck"}]},
            "fault[0].kind: a rotor can be off or stopped or scale",
        ),
        ({"fault": [{"t": 5, "part": "acc", "kind": "unbalanced"}]}, "fault[0].kind: only a rotor is unbalanced"),
        ({"motion": {}, "command": [{"t": 2, "do": "arm"}]}, "motion, command: give one of them, or motion.after_s"),
        ({"motion": {"after_s": 4}}, "motion.after_s: nothing flew before"),
        ({"motion": {"after_s": 1}, "command": [{"t": 2, "do": "arm"}]}, "motion.after_s: 1 s is before the last"),
        ({"fault": [{"t": 5, "part": "gyro", "kind": "off"}]}, "fault[0].kind: only a rotor is off"),
        ({"fault": [{"t": 5, "part": "mag", "kind": "stopped"}]}, "fault[0].kind: only a rotor is stopped"),
        ({"fault": [{"t": 5, "part": "output", "kind": "scale"}]}, "fault[0].kind: an output can be stuck or zero"),
        ({"fault": [{"t": 5, "part": "heading", "kind": "zero"}]}, "fault[0].kind: a heading can have an offset or"),
        ({"fault": [{"t": 5, "part": "baro", "kind": "ramp"}]}, "fault[0].seconds: a ramp needs the time"),
        ({"sensors": {"imu": [{"gaps": [[-5, 1]]}]}}, "sensors.imu[0].gaps: [-5, 1] begins before the flight"),
        ({"sensors": {"battery": {"full_v": 11, "empty_v": 12}}}, "sensors.battery: empty_v 12 is above full_v 11"),
    ],
)
def test_values_that_contradict_each_other_are_refused(values: dict[str, object], told: str) -> None:
    with pytest.raises(UsageError, match=told.replace("[", r"\[").replace("+", r"\+")):
        build_scenario(values)


@pytest.mark.parametrize(
    ("toml", "told"),
    [
        ("seconds = -60", "seconds: must be greater than or equal to 1 (got -60)"),
        ("seconds = true", "seconds: must be a valid number (got True)"),
        ('seconds = "60 s"', "seconds: must be a number without quotes; its unit is in the key (got '60 s')"),
        ('seconds = "60"', "seconds: must be a number without quotes; its unit is in the key (got '60')"),
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
        build_scenario(tomllib.loads(toml), "mine.toml")
    assert [line for line in str(error.value).splitlines() if not line.startswith(f"mine.toml: {told}")] == []


def test_the_docs_list_every_scenario_and_their_example_is_one() -> None:
    page = (ROOT / "docs" / "simulate.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([\w-]+)` \| [^|]+ \|$", page, re.M)
    assert sorted(set(listed)) == scenario_names()
    example = tomllib.loads(re.findall(r"```toml\n(.*?)```", page, re.S)[0])
    scenario = build_scenario(example)
    assert len(scenario.sensors.imu) == 2
    assert scenario.fault[0].part == "mag"


# What a scenario says and nobody does is told with its place; what counts is not.

ARM = {"t": 2, "do": "arm"}


@pytest.mark.parametrize("name", scenario_names())
def test_everything_in_the_library_counts(name: str) -> None:
    scenario = load_scenario(name)
    assert (scenario.name, bool(scenario.title)) == (name, True)
    assert ineffective_entries(scenario) == []


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"command": [ARM, {"t": 8, "do": "land"}]}, "command[1]: land at 8 s is not flown"),
        ({"fault": [{"t": 9, "part": "mag", "kind": "stuck"}]}, "fault[0]: mag stuck at 9 s does not happen"),
        (
            {"parameter": [{"t": 9, "firmware": "px4", "name": "SENS_BOARD_ROT", "value": 2}]},
            "parameter[0]: SENS_BOARD_ROT at 9 s is not set",
        ),
        ({"wind": {"gust": [{"t": 9, "seconds": 2, "ned_m_s": [3, 0, 0]}]}}, "wind.gust[0]: at 9 s does not blow"),
        ({"motion": {"move": [{"seconds": 9}, {"seconds": 1}]}}, "motion.move[1]: begins at 9 s and is not made"),
        ({"sensors": {"mag": [{}, {"gaps": [[1, 2], [8, 9]]}]}}, "sensors.mag[1].gaps: [8, 9] is not reached"),
        ({"sensors": {"gnss": [{"outages": [[9, 10]]}]}}, "sensors.gnss[0].outages: [9, 10] is not reached"),
        ({"sensors": {"gnss": [{"first_fix_s": 9}]}}, "sensors.gnss[0].first_fix_s: 9 s is not reached"),
        ({"command": [ARM, {"t": 3, "do": "hold", "north_m": 5}]}, "command[1].north_m: does nothing in hold, only"),
        ({"command": [ARM, {"t": 3, "do": "land", "up_m": 5}]}, "command[1].up_m: does nothing in land, only in"),
        ({"fault": [{"t": 1, "part": "acc", "kind": "offset"}]}, "fault[0]: offset changes nothing as long as"),
        ({"fault": [{"t": 1, "part": "acc", "kind": "spikes"}]}, "fault[0]: spikes changes nothing as long as size is"),
        ({"fault": [{"t": 1, "part": "mag", "kind": "zero", "seconds": 0}]}, "fault[0].seconds: 0 s change nothing"),
        ({"motion": {}, "fault": [{"t": 1, "part": "rotor", "kind": "off"}]}, "fault[0]: rotors stand still"),
    ],
)
def test_what_changes_nothing_is_told_with_its_place(values: dict[str, object], told: str) -> None:
    (sentence,) = ineffective_entries(build_scenario({"seconds": 8} | values))
    assert sentence.startswith(told)
    assert ineffective_entries(build_scenario({"seconds": 8, "command": [ARM, {"t": 7.9, "do": "land"}]})) == []


OTHER = {
    "north_m": 3.0,
    "east_m": -3.0,
    "up_m": 2.5,
    "speed_m_s": 1.0,
    "north_m_s": 2.0,
    "east_m_s": -2.0,
    "roll_deg": 5.0,
    "pitch_deg": -5.0,
    "heading_deg": 30.0,
    "yaw_rate_dps": 15.0,
    "axis": "pitch",
    "shape": "square",
    "amplitude_deg": 4.0,
    "period_s": 1.5,
}


def _wanted(command: Command) -> np.ndarray:
    """What guidance asks of the controller before and after a command, of a vehicle that is blown about."""
    start = Command(0.5, "takeoff", up_m=1.5, heading_deg=90.0, yaw_rate_dps=20.0)
    guidance = Guidance((start, command), Controller(), 0.5, 9.81)
    rows = []
    for k in range(400):
        t = 0.01 * k
        p, v = np.array([0.3 * np.sin(t), 0.2 * t, -1.5]), np.array([0.3 * np.cos(t), 0.2, 0.0])
        guidance.step(t, 0.01, np.array([1.0, 0.0, 0.0, 0.0]), p, v, True)
        rows.append([*guidance.command, guidance.armed])
    return np.array(rows)


@pytest.mark.parametrize("do", VALUES_OF_COMMAND)
def test_the_values_said_to_count_are_those_that_change_the_flight(do: str) -> None:
    """The table beside guidance itself: each value is changed alone."""
    plain = Command(2.5, do, north_m=6.0 if do == "goto" else 0.0)  # type: ignore[arg-type]
    as_it_is = _wanted(plain)
    for name, other in OTHER.items():
        changed = not np.array_equal(_wanted(dataclasses.replace(plain, **{name: other})), as_it_is)
        assert changed == (name in VALUES_OF_COMMAND[do]), name
