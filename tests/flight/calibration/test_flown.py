"""Which calibration flew: parameters at arming, agreed with the log, and what was learnt beside them."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.calibration import flown
from attlog.flight.calibration.correction import CalibrationUnknownError
from attlog.flight.model import Firmware, TimeLine
from tests.flight.calibration.made import GAUSS, OLD, T, ardupilot, px4, raw_field

CAL = {"CAL_MAG0_ID": 42.0} | {f"CAL_MAG0_{a}OFF": v for a, v in zip("XYZ", (0.1, -0.2, 0.05), strict=True)}


def why(log) -> str:
    with pytest.raises(CalibrationUnknownError) as refused:
        flown.learnt_bias(log, log.mags[0], flown.compass(log, log.mags[0]))
    return str(refused.value)


def test_the_parameters_are_those_of_the_first_arming() -> None:
    log = ardupilot(OLD)
    log.params["COMPASS_OFS_X"] = TimeLine(np.array([0.0, 5.0, 55.0]), [300.0, 12.4, 99.0], "PARM")
    log.params["COMPASS_MOT3_X"], log.filled_params = TimeLine(np.zeros(1), [1.0], ""), frozenset({"COMPASS_MOT3_X"})
    found = flown.values(log)
    assert found["COMPASS_OFS_X"] == 12.4
    assert "COMPASS_MOT3_X" not in found
    assert flown.compass(log, log.mags[0]).correction.offset[0] == pytest.approx(12.4e-7)


def test_a_change_in_flight_is_refused_and_one_at_disarming_is_not() -> None:
    log = ardupilot(OLD)
    log.params["COMPASS_OFS_X"] = TimeLine(np.array([0.0, 30.0]), [12.4, 99.0], "PARM")
    assert why(log) == "COMPASS_OFS_X was changed during the flight."
    log.params["COMPASS_OFS_X"] = TimeLine(np.array([0.0, 50.1]), [12.4, 99.0], "PARM")
    assert flown.compass(log, log.mags[0]).offsets[0] == "COMPASS_OFS_X"
    log.params["COMPASS_PRIO1_ID"] = TimeLine(np.array([0.0, 55.0]), [97539.0, 131874.0], "PARM")
    assert flown.order_changed(log, flown.compass(log, log.mags[0])) == ["COMPASS_PRIO1_ID"]


def test_offsets_that_are_not_those_of_the_parameters_are_of_another_boot() -> None:
    log = ardupilot(OLD)
    log.mags[0].offsets.x[0, 1] = -81e-7  # logged whole: -80.6 is cut to -80
    assert "flew with offsets 12, -81, 33 mG" in why(log)
    log = ardupilot(OLD)
    log.mags[0].offsets.t = np.array([0.0, 30.0])
    log.mags[0].offsets.x = np.array([[0.0, 0.0, 0.0], log.mags[0].offsets.x[0]])
    assert "changed during the flight" in why(log)
    log.mags[0].offsets = None
    assert "does not hold the offsets" in why(log)


def test_what_was_learnt_before_arming_is_what_raw_values_do_not_explain() -> None:
    raw, learnt = raw_field(), np.array([9e-6, -3e-6, 4e-6])
    field = raw - GAUSS * np.array([0.1, -0.2, 0.05]) + np.where(T[:, None] > 5, learnt, 0.0)
    log = px4(CAL, field, raw)
    mag = log.mags[0]
    np.testing.assert_allclose(flown.learnt_bias(log, mag, flown.compass(log, mag)), learnt, atol=1e-9)
    log.firmware = Firmware("PX4", "1.12.3")
    assert not flown.learnt_bias(log, mag, flown.compass(log, mag)).any()
    log.firmware = Firmware("PX4", "1.11.2")
    assert "1.12" in why(log)


def test_without_raw_values_or_with_others_nothing_is_known() -> None:
    raw = raw_field()
    field = raw - GAUSS * np.array([0.1, -0.2, 0.05])
    assert "bit 6 of SDLOG_PROFILE" in why(px4(CAL, field, None))
    assert "are not those of the compass" in why(px4(CAL, field[:, [1, 0, 2]], raw))
    short = px4(CAL, field, raw)
    short.mags[0].raw.t = short.mags[0].raw.t + 1000.0
    assert "Fewer than 5" in why(short)


def test_few_raw_values_that_scatter_are_not_enough() -> None:
    """Scatter of 10 mG: the median of 6 values is known to 7.6 mG, that of 150 to 1.5 mG."""
    raw = raw_field()
    field = raw - GAUSS * np.array([0.1, -0.2, 0.05]) + 1.5e-6 * np.random.default_rng(2).normal(size=raw.shape)
    log = px4(CAL, field, raw)
    assert np.abs(flown.learnt_bias(log, log.mags[0], flown.compass(log, log.mags[0]))).max() < 6e-7
    few = np.linspace(30, 100, 6).astype(int)
    log.mags[0].raw.t, log.mags[0].raw.x = log.mags[0].raw.t[few], log.mags[0].raw.x[few]
    assert "Too few raw values" in why(log)


def test_a_log_of_telemetry_or_of_another_firmware_is_refused() -> None:
    log = ardupilot(OLD)
    log.format = "tlog"
    assert "the autopilot's own log" in why(log)
    log = ardupilot(OLD)
    log.firmware = Firmware("Other")
    assert "is not known" in why(log)
    log = px4(CAL, raw_field(), raw_field())
    log.mags[0].device = None
    assert "device id" in why(log)


def test_power_is_the_current_or_the_throttle_and_without_one_it_says_so() -> None:
    log = ardupilot(OLD)
    assert flown.power(log, "current", np.array([5.0]))[0, 0] == 0.5
    log.battery.x[:, 1] = np.nan
    for kind in ("current", "throttle"):
        with pytest.raises(CalibrationUnknownError, match=f"no {kind}"):
            flown.power(log, kind, T)


def test_a_log_that_never_tells_of_arming_counts_as_a_whole() -> None:
    log = ardupilot(OLD)
    log.armed = None
    assert flown.span(log) == (1.0, log.seconds)
    log.params = {}
    assert flown.values(log) == {}
    assert "does not hold COMPASS_OFS_X" in why(log)


def test_a_log_that_is_disarmed_within_its_first_second_has_no_span_that_runs_back() -> None:
    log = ardupilot(OLD)
    log.armed = TimeLine(np.array([0.0, 0.4]), [True, False], "armed")
    assert flown.span(log) == (1.0, 1.0)
