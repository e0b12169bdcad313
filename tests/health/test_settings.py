"""An accelerometer's offset becomes parameters with which the firmware's own correction shows it no more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymavlink.mavparm import MAVParmDict
from scipy.spatial.transform import Rotation

from attlog.flight.model import TimeLine
from attlog.flight.parameters import read_parameter_file
from attlog.health import settings
from attlog.health.check import Setting
from attlog.health.settings import param_file
from tests.flight.calibrated_logs import GAUSS, MG, OLD, amperes, ardupilot, ardupilot_field, px4, raw_field

BIAS, OFFSET, SCALE = np.array([0.3, -0.2, 0.15]), np.array([0.05, -0.1, 0.6]), np.array([1.02, 0.97, 1.01])
TURN = Rotation.from_euler("z", 90.0, degrees=True)
RAW = np.random.default_rng(5).normal(size=(30, 3))


def named(pattern: str, values: np.ndarray) -> dict[str, float]:
    return {pattern.format(axis): float(v) for axis, v in zip("XYZ", values, strict=True)}


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_the_bias_vanishes_with_the_proposed_parameters(firmware: str) -> None:
    """Both firmwares: turned by the board after (raw - offset) * scale."""
    if firmware == "ardupilot":
        names = "INS_ACCOFFS_{}"
        log = ardupilot(OLD | {"AHRS_ORIENTATION": 2.0} | named(names, OFFSET) | named("INS_ACCSCAL_{}", SCALE))
    else:
        names = "CAL_ACC3_{}OFF"
        own = {"CAL_ACC3_ID": 7.0, "SENS_BOARD_ROT": 2.0} | named("CAL_ACC3_{}SCALE", SCALE)
        log = px4(own | named(names, OFFSET), raw_field(), None)
    found = settings.accelerometer_proposal(log, log.imus[0], BIAS)
    assert found.refused == ""
    new = {s.name: s.new for s in found.settings}
    assert {s.unit for s in found.settings} == {"m/s^2"}
    moved = np.array([new[names.format(axis)] for axis in "XYZ"])
    before, after = (TURN.apply((RAW - offset) * SCALE) for offset in (OFFSET, moved))
    np.testing.assert_allclose(before - after, np.tile(BIAS, (30, 1)), atol=1e-4)


def test_without_a_slot_or_beyond_the_range_nothing_is_proposed() -> None:
    log = px4({"CAL_ACC0_ID": 8.0}, raw_field(), None)
    assert "device 7" in settings.accelerometer_proposal(log, log.imus[0], BIAS).refused
    log = ardupilot(OLD | named("INS_ACCOFFS_{}", OFFSET))
    assert (
        "range of -3.5 to 3.5" in settings.accelerometer_proposal(log, log.imus[0], np.array([0.0, 0.0, 5.0])).refused
    )
    log.imus[0].index = 1
    assert "INS_ACC2OFFS_X" in settings.accelerometer_proposal(log, log.imus[0], BIAS).refused


def test_an_axis_without_an_error_keeps_its_value_to_the_last_digit() -> None:
    log = ardupilot(OLD | named("INS_ACCOFFS_{}", np.array([-0.27269041, 0.10993993, -0.66610938])))
    found = settings.accelerometer_proposal(log, log.imus[0], np.array([0.0, 0.0, -0.41]))
    assert [(s.name, s.new) for s in found.settings] == [("INS_ACCOFFS_Z", pytest.approx(-1.0761, abs=1e-4))]


# A compass's error becomes parameters with which the firmware's own correction shows it no more.

ERROR, MOTOR = np.array([145.0, -80.0, 60.0]) * MG, np.array([2.5, -2.0, 3.0]) * MG


def new_values(found) -> dict[str, float]:
    return {s.name: s.new for s in found.settings}


@pytest.mark.parametrize("slot", ["", "2"])
def test_the_error_vanishes_with_the_proposed_parameters(slot: str) -> None:
    """The compass reads earth + error + motor x current; with the new values it reads the earth, to 0.05 mG."""
    own = {f"COMPASS_{k}{slot}{e}": v for k, e, v in (("DIA", "_X", 1.04), ("ODI", "_X", 0.03), ("SCALE", "", 1.1))}
    values = OLD | own | {f"COMPASS_DIA{slot}_Y": 0.97, f"COMPASS_DIA{slot}_Z": 1.01}
    log = ardupilot(values, index=1 if slot else 0, n=slot)
    found = settings.compass_proposal(log, log.mags[0], ERROR, MOTOR, "current")
    assert found.refused == ""
    assert set(new_values(found)) == {f"COMPASS_{k}{slot}_{a}" for k in ("OFS", "MOT") for a in "XYZ"} | {
        "COMPASS_MOTCT"
    }
    raw, power = raw_field(), amperes()
    before = ardupilot_field(raw, values, slot, power)
    after = ardupilot_field(raw, values | new_values(found), slot, power)
    np.testing.assert_allclose(before - after, ERROR + MOTOR * power[:, None], atol=0.5 * MG)
    assert next(s for s in found.settings if s.name == f"COMPASS_MOT{slot}_X").unit == "mG/A"


def test_motor_values_add_to_those_that_flew() -> None:
    log = ardupilot(OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": -3.0})
    found = settings.compass_proposal(log, log.mags[0], np.zeros(3), MOTOR)
    values = new_values(found)
    assert values["COMPASS_MOT_X"] == pytest.approx(-5.5)
    assert values["COMPASS_MOT_Y"] == pytest.approx(2.0)
    assert "COMPASS_MOTCT" not in values
    assert "COMPASS_OFS_X" not in values


def test_throttle_is_per_full_throttle() -> None:
    log = ardupilot(OLD)
    found = settings.compass_proposal(log, log.mags[0], np.zeros(3), MOTOR, "throttle")
    assert new_values(found)["COMPASS_MOTCT"] == 1.0
    assert next(s for s in found.settings if s.name == "COMPASS_MOT_X").unit == "mG"


def test_px4_offsets_hold_what_was_learnt_before_arming_too() -> None:
    """Logged = S (raw - OFF) + d. With the new values S (raw - OFF) is the earth: logged less error, without d."""
    scale, learnt, off = np.diag([1.1, 0.9, 1.0]), np.array([90.0, -30.0, 40.0]) * MG, np.array([0.1, -0.2, 0.05])
    flew = {"CAL_MAG0_ID": 42.0, "CAL_MAG_COMP_TYP": 0.0} | {f"CAL_MAG0_{a}COMP": 0.0 for a in "XYZ"}
    flew |= {
        f"CAL_MAG0_{a}{k}": v
        for k, each in (("OFF", off), ("SCALE", np.diag(scale)))
        for a, v in zip("XYZ", each, strict=True)
    }
    raw = raw_field()
    logged = (raw - GAUSS * off) @ scale + learnt
    log = px4(flew, logged, raw)
    found = settings.compass_proposal(log, log.mags[0], ERROR, MOTOR)
    new = new_values(found)
    offset = np.array([new[f"CAL_MAG0_{a}OFF"] for a in "XYZ"])
    comp = np.array([new[f"CAL_MAG0_{a}COMP"] for a in "XYZ"])
    assert new["CAL_MAG_COMP_TYP"] == 2.0
    after = GAUSS * (raw / GAUSS + amperes()[:, None] / 1000.0 * comp - offset) @ scale
    np.testing.assert_allclose(after, logged - ERROR - MOTOR * amperes()[:, None], atol=0.5 * MG)


def test_what_cannot_be_mapped_is_refused_whole() -> None:
    def refused(values: dict[str, float], error=ERROR, motor=None) -> str:
        log = ardupilot(OLD | values)
        found = settings.compass_proposal(log, log.mags[0], error, motor)
        assert found.settings == []
        return found.refused

    assert "swaps the slots" in refused({"COMPASS_PRIO1_ID": 131874.0})
    assert "outside its range of -400 to 400" in refused({}, error=np.array([6e-5, 0.0, 0.0]))
    assert "holds values of another kind" in refused({"COMPASS_MOT2_X": 1.0}, motor=MOTOR)
    log = ardupilot(OLD)
    log.parameters.lines["COMPASS_PRIO1_ID"] = TimeLine(np.array([0.0, 55.0]), [97539.0, 131874.0], "PARM")
    assert "COMPASS_PRIO1_ID was set after take-off" in settings.compass_proposal(log, log.mags[0], ERROR).refused
    assert settings.compass_proposal(ardupilot(OLD, "Copter 4.5.7"), log.mags[0], np.full(3, np.nan)).settings == []
    log.parameters.lines = {}
    assert "does not hold" in settings.compass_proposal(log, log.mags[0], ERROR).refused


# The parameter file loads in ground stations, and says what every value was.

MADE_LOG = {"name": "made.log", "firmware": {"name": "ArduPilot"}}
SETTINGS = [
    Setting("COMPASS_OFS_X", 12.4, -151.25, "mG"),
    Setting("COMPASS_MOTCT", 0.0, 2.0),
    Setting("COMPASS_OFS_X", 12.4, 7.0, "mG"),
]


def test_pymavlink_and_attlog_load_an_ardupilot_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new.param"
    path.write_text(param_file(MADE_LOG, SETTINGS))
    expected = {"COMPASS_OFS_X": -151.25, "COMPASS_MOTCT": 2.0}
    assert read_parameter_file(path) == expected
    loaded = MAVParmDict()
    assert loaded.load(str(path))
    assert dict(loaded) == expected
    assert "Invalid" not in capsys.readouterr().out


def test_mission_planner_finds_a_name_and_a_value_in_every_line_that_is_no_comment() -> None:
    """ParamFile.cs: a line that begins with # is skipped, and so is one without exactly two words, silently."""
    lines = param_file(MADE_LOG, SETTINGS).splitlines()
    values = [line for line in lines if not line.startswith("#")]
    assert [line.split(",") for line in values] == [["COMPASS_OFS_X", "-151.25"], ["COMPASS_MOTCT", "2"]]
    assert lines[lines.index("COMPASS_OFS_X,-151.25") - 1] == "# COMPASS_OFS_X was 12.4 mG when the log was flown"
    assert "made.log" in lines[0]
    assert "attlog" in lines[0]
    assert "only for this log's vehicle" in lines[1]


def test_a_px4_file_has_the_vehicle_the_component_and_the_type(tmp_path: Path) -> None:
    settings = [Setting("CAL_MAG0_XOFF", 0.01, -0.1511, "G"), Setting("CAL_MAG_COMP_TYP", 0.0, 2.0)]
    log = {"name": "made.ulg", "firmware": {"name": "PX4"}, "params": {"MAV_SYS_ID": 3}}
    path = tmp_path / "new.params"
    path.write_text(param_file(log, settings))
    rows = [line.split("\t") for line in path.read_text().splitlines() if not line.startswith("#")]
    assert rows == [["3", "1", "CAL_MAG0_XOFF", "-0.1511", "9"], ["3", "1", "CAL_MAG_COMP_TYP", "2", "6"]]
    assert read_parameter_file(path) == {"CAL_MAG0_XOFF": -0.1511, "CAL_MAG_COMP_TYP": 2.0}
    assert "# CAL_MAG0_XOFF was 0.01 G when the log was flown" in path.read_text()


def test_the_order_of_compasses_never_stands_beside_their_offsets() -> None:
    order = Setting("COMPASS_PRIO1_ID", 97539.0, 131874.0)
    assert "COMPASS_PRIO1_ID,131874" in param_file(MADE_LOG, [order])
    both = param_file(MADE_LOG, [order, *SETTINGS])
    assert "\nCOMPASS_PRIO1_ID" not in both
    assert "# left out: COMPASS_PRIO1_ID 131874" in both


def test_without_settings_there_is_no_file() -> None:
    assert param_file(MADE_LOG, []) == ""
    assert "its value is not in the log" in param_file(MADE_LOG, [Setting("A", None, 1.0)])


# A setting is offered where the parameter exists, the value is within its range, and something changes.


def test_a_parameter_that_the_log_does_not_hold_itself_is_not_set() -> None:
    log = ardupilot(OLD)
    assert "does not hold the parameter COMPASS_OFS3_X" in settings.range_refusal(
        log, [Setting("COMPASS_OFS3_X", None, 1.0)]
    )
    log.parameters.lines["COMPASS_OFS3_X"], log.parameters.filled = (
        TimeLine(np.zeros(1), [0.0], ""),
        frozenset({"COMPASS_OFS3_X"}),
    )
    assert settings.range_refusal(log, [Setting("COMPASS_OFS3_X", None, 1.0)])
    assert "No range of COMPASS_DEV_ID" in settings.range_refusal(log, [Setting("COMPASS_DEV_ID", None, 1.0)])


def test_what_is_set_already_at_the_end_of_the_log_is_not_set_again() -> None:
    log = ardupilot(OLD)
    same, new = Setting("COMPASS_OFS_X", 12.4, float(np.float32(12.4))), Setting("COMPASS_OFS_Y", -80.6, -80.5)
    assert settings.changing(log, [same, new]) == [new]
    log.parameters.lines["COMPASS_OFS_Y"] = TimeLine(np.array([0.0, 55.0]), [-80.6, -80.5], "PARM")
    assert settings.changing(log, [same, new]) == []
