"""The parameter file loads in ground stations, and says what every value was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymavlink.mavparm import MAVParmDict

from attlog.flight.model import TimeLine
from attlog.flight.parameters.file import read_file
from attlog.health.assessments import Setting
from attlog.health.settings import file
from tests.flight.calibration.made import OLD, ardupilot, px4, raw_field

SETTINGS = [
    Setting("COMPASS_OFS_X", 12.4, -151.25, "mG"),
    Setting("COMPASS_MOTCT", 0.0, 2.0),
    Setting("COMPASS_OFS_X", 12.4, 7.0, "mG"),
]


def test_pymavlink_and_attlog_load_an_ardupilot_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new.param"
    path.write_text(file.text(ardupilot(OLD), SETTINGS))
    expected = {"COMPASS_OFS_X": -151.25, "COMPASS_MOTCT": 2.0}
    assert read_file(path) == expected
    loaded = MAVParmDict()
    assert loaded.load(str(path))
    assert dict(loaded) == expected
    assert "Invalid" not in capsys.readouterr().out


def test_mission_planner_finds_a_name_and_a_value_in_every_line_that_is_no_comment() -> None:
    """ParamFile.cs: a line that begins with # is skipped, and so is one without exactly two words, silently."""
    lines = file.text(ardupilot(OLD), SETTINGS).splitlines()
    values = [line for line in lines if not line.startswith("#")]
    assert [line.split(",") for line in values] == [["COMPASS_OFS_X", "-151.25"], ["COMPASS_MOTCT", "2"]]
    assert lines[lines.index("COMPASS_OFS_X,-151.25") - 1] == "# COMPASS_OFS_X was 12.4 mG when the log was flown"
    assert "made.log" in lines[0]
    assert "attlog" in lines[0]
    assert "only for the vehicle of this log" in lines[1]


def test_a_px4_file_has_the_vehicle_the_component_and_the_type(tmp_path: Path) -> None:
    log = px4({"MAV_SYS_ID": 3.0, "CAL_MAG0_XOFF": 0.01, "CAL_MAG_COMP_TYP": 0.0}, raw_field(), None)
    log.params["CAL_MAG0_XOFF"] = TimeLine(np.array([0.0, 51.0]), [0.01, 0.012], "")
    path = tmp_path / "new.params"
    path.write_text(
        file.text(log, [Setting("CAL_MAG0_XOFF", 0.01, -0.1511, "G"), Setting("CAL_MAG_COMP_TYP", 0.0, 2.0)])
    )
    rows = [line.split("\t") for line in path.read_text().splitlines() if not line.startswith("#")]
    assert rows == [["3", "1", "CAL_MAG0_XOFF", "-0.1511", "9"], ["3", "1", "CAL_MAG_COMP_TYP", "2", "6"]]
    assert read_file(path) == {"CAL_MAG0_XOFF": -0.1511, "CAL_MAG_COMP_TYP": 2.0}
    assert "# CAL_MAG0_XOFF was 0.01 G when the log was flown, 0.012 at its end" in path.read_text()


def test_a_parameter_that_the_log_holds_as_an_integer_is_written_as_one() -> None:
    log = px4({}, raw_field(), None)
    log.params |= {"EKF2_MAG_TYPE": TimeLine(np.zeros(1), [1], ""), "EKF2_MAG_NOISE": TimeLine(np.zeros(1), [1.0], "")}
    text = file.text(log, [Setting("EKF2_MAG_TYPE", 1.0, 0.0), Setting("EKF2_MAG_NOISE", 1.0, 2.0)])
    assert "EKF2_MAG_TYPE\t0\t6" in text
    assert "EKF2_MAG_NOISE\t2\t9" in text


def test_the_order_of_compasses_never_stands_beside_their_offsets() -> None:
    order = Setting("COMPASS_PRIO1_ID", 97539.0, 131874.0)
    assert "COMPASS_PRIO1_ID,131874" in file.text(ardupilot(OLD), [order])
    both = file.text(ardupilot(OLD), [order, *SETTINGS])
    assert "\nCOMPASS_PRIO1_ID" not in both
    assert "# left out: COMPASS_PRIO1_ID 131874" in both


def test_without_settings_there_is_no_file() -> None:
    assert file.text(ardupilot(OLD), []) == ""
    assert "its value is not in the log" in file.text(ardupilot(OLD), [Setting("A", None, 1.0)])
