"""On which sensors' rates the pilot's estimator is set up: those of the first of each kind."""

from __future__ import annotations

from typing import Any

import pytest

from attlog.simulate.autopilot import pilot
from attlog.simulate.autopilot.loop import EstimatorChoice
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.settings import ImuSettings, MagSettings, SensorSettings


def test_the_first_unit_and_the_first_compass_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    class Stop(Exception):
        pass

    def live(*given: Any, **named: Any) -> None:
        seen.append((*given[1:], named))
        raise Stop

    monkeypatch.setattr(pilot, "Live", live)
    imus = (ImuSettings(rate_hz=200.0, sampling="instant"), ImuSettings(rate_hz=400.0))
    for mags, rate in (((MagSettings(rate_hz=20.0), MagSettings(rate_hz=50.0)), 20.0), ((), None)):
        sensors = SensorSettings(imu=imus, mag=mags)
        with pytest.raises(Stop):
            pilot.Pilot(Scenario(name="two", estimator=EstimatorChoice(name="mahony"), sensors=sensors), 9.8, 0.1)
        imu_hz, mag_hz, named = seen.pop()
        assert (imu_hz, mag_hz) == (200.0, rate)
        assert named["sampling"] == "instant"
        assert named["declination"] == pytest.approx(5.729578)
