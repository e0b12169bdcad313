"""Several logs: each has its outcome, whatever becomes of the others, in one process and in many."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog import Config
from attlog.fleet.several import Outcome, Task, outcomes
from tests.conftest import SAMPLES

ARDUPILOT, PX4 = SAMPLES / "copter_yaw_turns.bin", SAMPLES / "px4_steps.ulg"
DIES_ON_PX4 = """import os

from attlog.estimators.filters.gyro import *  # noqa: F403


def from_log(params, info):
    if "SYS_AUTOSTART" in params:
        os._exit(9)
    return {}
"""


def run(folder: Path, logs: list[Path], jobs: int, specs: list[str]) -> dict[str, Outcome]:
    task = Task(Config(estimators=specs), folder, "c", deterministic=True)
    return {found.log.name: found for found in outcomes(logs, [log.name for log in logs], task, jobs)}


def test_processes_write_what_one_process_writes(tmp_path: Path) -> None:
    logs = [ARDUPILOT, PX4, tmp_path / "none.ulg"]
    one, two = (run(tmp_path / str(jobs), logs, jobs, ["gyro"]) for jobs in (1, 2))
    assert {name: found.code for name, found in two.items()} == {ARDUPILOT.name: 0, PX4.name: 0, "none.ulg": 66}
    for log in (ARDUPILOT, PX4):
        first, second = one[log.name].written, two[log.name].written
        assert first is not None
        assert second is not None
        assert first.json.read_bytes() == second.json.read_bytes()
        assert first.report.read_bytes() == second.report.read_bytes()
        assert first.result.to_json(deterministic=True) == second.result.to_json(deterministic=True)
    assert "no such file" in two["none.ulg"].message


@pytest.mark.slow
def test_a_process_that_dies_costs_its_own_log_alone(tmp_path: Path) -> None:
    filter_file = tmp_path / "dies.py"
    filter_file.write_text(DIES_ON_PX4)
    other = SAMPLES / "copter_steps_stabilize.bin"
    found = run(tmp_path / "out", [PX4, ARDUPILOT, other], 2, [str(filter_file)])
    assert {name: o.code for name, o in found.items()} == {PX4.name: 70, ARDUPILOT.name: 0, other.name: 0}
    assert "ended without a word" in found[PX4.name].message
