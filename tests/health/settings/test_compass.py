"""A compass's error becomes parameters with which the firmware's own correction shows it no more."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import TimeLine
from attlog.health.settings import compass
from tests.flight.calibration.made import GAUSS, MG, OLD, amperes, ardupilot, ardupilot_field, px4, raw_field

ERROR, MOTOR = np.array([145.0, -80.0, 60.0]) * MG, np.array([2.5, -2.0, 3.0]) * MG


def new_values(found) -> dict[str, float]:
    return {s.name: s.new for s in found.settings}


@pytest.mark.parametrize("slot", ["", "2"])
def test_the_error_vanishes_with_the_proposed_parameters(slot: str) -> None:
    """The compass reads earth + error + motor x current; with the new values it reads the earth, to 0.05 mG."""
    own = {f"COMPASS_{k}{slot}{e}": v for k, e, v in (("DIA", "_X", 1.04), ("ODI", "_X", 0.03), ("SCALE", "", 1.1))}
    values = OLD | own | {f"COMPASS_DIA{slot}_Y": 0.97, f"COMPASS_DIA{slot}_Z": 1.01}
    log = ardupilot(values, index=1 if slot else 0, n=slot)
    found = compass.proposal(log, log.mags[0], ERROR, MOTOR, "current")
    assert found.refused == ""
    assert set(new_values(found)) == {f"COMPASS_{k}{slot}_{a}" for k in ("OFS", "MOT") for a in "XYZ"} | {
        "COMPASS_MOTCT"
    }
    raw, power = raw_field(), amperes()
    before = ardupilot_field(raw, values, slot, power)
    after = ardupilot_field(raw, values | new_values(found), slot, power)
    np.testing.assert_allclose(before - after, ERROR + MOTOR * power[:, None], atol=0.5 * MG)
    assert next(s for s in found.settings if s.name == f"COMPASS_MOT{slot}_X").unit == "mG/A"


def test_a_simulator_s_planted_offset_is_found_again_with_its_sign() -> None:
    """SIM_MAG1_OFS rose from 5 to 150 mG: the compass reads 145 mG too little, and COMPASS_OFS_X must follow."""
    log = ardupilot(
        {n: v for n, v in OLD.items() if "DIA" not in n and "ODI" not in n}
        | {"COMPASS_OFS_X": 5.0, "COMPASS_SCALE": 1.0}
    )
    found = compass.proposal(log, log.mags[0], np.array([-145.0, 0.0, 0.0]) * MG)
    assert [(s.name, s.old, s.new, s.unit) for s in found.settings] == [("COMPASS_OFS_X", 5.0, 150.0, "mG")]


def test_motor_values_add_to_those_that_flew() -> None:
    log = ardupilot(OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": -3.0})
    found = compass.proposal(log, log.mags[0], np.zeros(3), MOTOR)
    values = new_values(found)
    assert values["COMPASS_MOT_X"] == pytest.approx(-5.5)
    assert values["COMPASS_MOT_Y"] == pytest.approx(2.0)
    assert "COMPASS_MOTCT" not in values
    assert "COMPASS_OFS_X" not in values


def test_throttle_is_per_full_throttle() -> None:
    log = ardupilot(OLD)
    found = compass.proposal(log, log.mags[0], np.zeros(3), MOTOR, "throttle")
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
    found = compass.proposal(log, log.mags[0], ERROR, MOTOR)
    new = new_values(found)
    offset = np.array([new[f"CAL_MAG0_{a}OFF"] for a in "XYZ"])
    comp = np.array([new[f"CAL_MAG0_{a}COMP"] for a in "XYZ"])
    assert new["CAL_MAG_COMP_TYP"] == 2.0
    after = GAUSS * (raw / GAUSS + amperes()[:, None] / 1000.0 * comp - offset) @ scale
    np.testing.assert_allclose(after, logged - ERROR - MOTOR * amperes()[:, None], atol=0.5 * MG)


def test_what_cannot_be_mapped_is_refused_whole() -> None:
    def refused(values: dict[str, float], error=ERROR, motor=None) -> str:
        log = ardupilot(OLD | values)
        found = compass.proposal(log, log.mags[0], error, motor)
        assert found.settings == []
        return found.refused

    assert "swaps the slots" in refused({"COMPASS_PRIO1_ID": 131874.0})
    assert "outside its range of -400 to 400" in refused({}, error=np.array([6e-5, 0.0, 0.0]))
    assert "holds values of another kind" in refused({"COMPASS_MOT2_X": 1.0}, motor=MOTOR)
    log = ardupilot(OLD)
    log.params["COMPASS_PRIO1_ID"] = TimeLine(np.array([0.0, 55.0]), [97539.0, 131874.0], "PARM")
    assert "COMPASS_PRIO1_ID was set after take-off" in compass.proposal(log, log.mags[0], ERROR).refused
    assert compass.proposal(ardupilot(OLD, "Copter 4.5.7"), log.mags[0], np.full(3, np.nan)).settings == []
    log.params = {}
    assert "does not hold" in compass.proposal(log, log.mags[0], ERROR).refused
