"""What a configuration may still choose of a flight that was read before."""

from __future__ import annotations

import pytest

from attlog.analysis.choices import flight_of
from attlog.analysis.config import Config
from attlog.base.errors import UsageError
from tests.flight.calibration.made import OLD, ardupilot


def test_all_units_and_those_that_were_read_can_be_asked_of_a_flight_and_no_others() -> None:
    log = ardupilot(OLD)
    log.imu = log.mag = 0
    for settings in ({"imu": "all"}, {"mag": 0}, {"boot": 0}, {}):
        assert flight_of(log, Config.build(settings)) is log
    for settings in ({"mag": 1}, {"mag": "none"}, {"boot": 1}, {"params": "x.param"}):
        with pytest.raises(UsageError, match="is chosen when the log is read"):
            flight_of(log, Config.build(settings))
