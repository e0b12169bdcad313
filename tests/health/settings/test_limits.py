"""A setting is offered where the parameter exists, the value is within its range, and something changes."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import TimeLine
from attlog.flight.parameters import ranges
from attlog.health.assessments import Setting
from attlog.health.settings import limits
from tests.flight.calibration.made import OLD, ardupilot


def test_a_parameter_that_the_log_does_not_hold_itself_is_not_set() -> None:
    log = ardupilot(OLD)
    assert "does not hold the parameter COMPASS_OFS3_X" in limits.refusal(log, [Setting("COMPASS_OFS3_X", None, 1.0)])
    log.params["COMPASS_OFS3_X"], log.filled_params = TimeLine(np.zeros(1), [0.0], ""), frozenset({"COMPASS_OFS3_X"})
    assert limits.refusal(log, [Setting("COMPASS_OFS3_X", None, 1.0)])
    assert "No range of COMPASS_DEV_ID" in limits.refusal(log, [Setting("COMPASS_DEV_ID", None, 1.0)])


def test_one_that_cannot_be_set_takes_the_others_with_it() -> None:
    log = ardupilot(OLD)
    good, far = Setting("COMPASS_OFS_X", 12.4, 50.0), Setting("COMPASS_OFS_Y", -80.6, 500.0)
    assert limits.keep(log, [good]) == [good]
    assert limits.keep(log, [good, far]) == []
    assert limits.keep(log, [good, Setting("COMPASS_OFS_Y", -80.6, float("nan"))]) == []


def test_what_is_set_already_at_the_end_of_the_log_is_not_set_again() -> None:
    log = ardupilot(OLD)
    same, new = Setting("COMPASS_OFS_X", 12.4, float(np.float32(12.4))), Setting("COMPASS_OFS_Y", -80.6, -80.5)
    assert limits.keep(log, [same, new]) == [new]
    log.params["COMPASS_OFS_Y"] = TimeLine(np.array([0.0, 55.0]), [-80.6, -80.5], "PARM")
    assert limits.keep(log, [same, new]) == []


def test_ranges_are_by_the_whole_name() -> None:
    assert ranges.documented("COMPASS_OFS2_Z") == (-400.0, 400.0)
    assert ranges.documented("INS4_ACCOFFS_X") == ranges.documented("INS_ACC3OFFS_X") == (-3.5, 3.5)
    assert ranges.documented("XCOMPASS_OFS_X") is None
    assert ranges.documented("COMPASS_OFS_XX") is None
    assert all(low < high for _, low, high in ranges.RANGES)
    assert ranges.is_whole("CAL_MAG_COMP_TYP")
    assert not ranges.is_whole("CAL_MAG0_XOFF")
