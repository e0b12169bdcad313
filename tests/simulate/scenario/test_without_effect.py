"""What a scenario says and nobody does is told with its place; what counts is not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from attlog.simulate.autopilot.guidance import Guidance
from attlog.simulate.autopilot.loop import Controller
from attlog.simulate.scenario.commands import Command
from attlog.simulate.scenario.scenario import build, load, names
from attlog.simulate.scenario.without_effect import ASKED_OF, without_effect

ARM = {"t": 2, "do": "arm"}


@pytest.mark.parametrize("name", names())
def test_everything_in_the_library_counts(name: str) -> None:
    assert without_effect(load(name)) == []


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"command": [ARM, {"t": 9, "do": "land"}]}, "command[1]: land at 9 s is not flown"),
        ({"command": [ARM, {"t": 8, "do": "land"}]}, "command[1]: land at 8 s is not flown"),
        ({"fault": [{"t": 9, "part": "mag", "kind": "stuck"}]}, "fault[0]: mag stuck at 9 s does not happen"),
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
    (sentence,) = without_effect(build({"seconds": 8} | values))
    assert sentence.startswith(told)


def test_a_command_at_the_last_moment_counts() -> None:
    assert without_effect(build({"seconds": 8, "command": [ARM, {"t": 7.9, "do": "land"}]})) == []


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


@pytest.mark.parametrize("do", ASKED_OF)
def test_the_values_said_to_count_are_those_that_change_the_flight(do: str) -> None:
    """The table beside guidance itself: each value is changed alone."""
    plain = Command(2.5, do, north_m=6.0 if do == "goto" else 0.0)  # type: ignore[arg-type]
    as_it_is = _wanted(plain)
    for name, other in OTHER.items():
        changed = not np.array_equal(_wanted(dataclasses.replace(plain, **{name: other})), as_it_is)
        assert changed == (name in ASKED_OF[do]), name
