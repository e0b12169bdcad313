"""Hover and supply: made outputs, volts and amperes of known level, bias, load and resistance."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.health.check import Check, HealthCase
from attlog.health.hover import hover_checks
from attlog.health.supply import supply_checks
from attlog.segments.model import Segment, Segments
from tests.story.falling import level_log

SECONDS = 150.0
FLIGHT = Segments(
    [Segment("continuous", 0.0, SECONDS), Segment("armed", 5.0, SECONDS), Segment("airborne", 10.0, 140.0)]
)


def hovering(levels: tuple[float, ...], rise: float = 0.0) -> FlightLog:
    """A quadrotor X in hover at these outputs, which rise evenly by ``rise``."""
    log = level_log(SECONDS, np.array(levels))
    outputs = log.power.outputs
    assert outputs is not None
    outputs.x += rise * (outputs.t / SECONDS)[:, None]
    return log


def found(log: FlightLog, spans: Segments = FLIGHT) -> dict[str, Check]:
    case = HealthCase(log, spans)
    return {check.question: check for check in (*hover_checks(case), *supply_checks(case))}


@pytest.mark.parametrize(
    ("levels", "rise", "noted"),
    [
        ((0.5, 0.5, 0.5, 0.5), 0.0, []),
        ((0.6, 0.6, 0.6, 0.6), 0.1, ["hover_thrust"]),
        ((0.7, 0.7, 0.7, 0.7), 0.0, []),
        ((0.14, 0.14, 0.14, 0.14), 0.0, ["hover_thrust"]),
        ((0.01, 0.3, 0.3, 0.3), 0.0, ["hover_thrust", "yaw_bias"]),
        ((0.57, 0.57, 0.44, 0.44), 0.0, ["yaw_bias"]),
        ((0.55, 0.55, 0.44, 0.44), 0.0, []),
        ((0.4, 0.51, 0.4, 0.41), 0.0, ["uneven_motors"]),
        ((0.4, 0.47, 0.4, 0.41), 0.0, []),
        ((0.3, 0.51, 0.4, 0.41), 0.0, []),
    ],
)
def test_hover_is_noted_by_its_level_rise_and_balance(levels: tuple[float, ...], rise: float, noted: list[str]) -> None:
    checks = found(hovering(levels, rise))
    assert [name for name, check in checks.items() if check.verdict == "warning"] == noted


def test_the_sense_that_works_harder_and_the_motor_are_named() -> None:
    assert found(hovering((0.44, 0.44, 0.57, 0.57)))["yaw_bias"].text.startswith("Clockwise motors work 13 %")
    assert found(hovering((0.4, 0.4, 0.55, 0.4)))["uneven_motors"].text.startswith(
        "Motor 3 (front left) works at 55 % in hover"
    )


def test_a_flight_without_hover_answers_nothing() -> None:
    log = hovering((0.5, 0.5, 0.5, 0.5))
    log.imus[0].gyro.x[:, 2] = np.radians(25.0)
    assert {check.verdict for check in hover_checks(HealthCase(log, FLIGHT))} == {"unknown"}


def test_a_motor_that_was_off_for_a_while_hides_only_that_time() -> None:
    log = hovering((0.5, 0.5, 0.5, 0.5))
    outputs = log.power.outputs
    assert outputs is not None
    outputs.x[(outputs.t > 20.0) & (outputs.t < 22.0), 1] = np.nan
    assert 125 < found(log)["hover_thrust"].n < 128
    outputs.t, outputs.x = outputs.t[:50], outputs.x[:50]
    assert "in flight" in found(log)["hover_thrust"].text


# --- supply ---


def battery(rest: float = 16.4, ohm: float = 0.02, count: float | None = None, drop_at_end: float = 0.0) -> FlightLog:
    """A battery with a resistance and a current that moves about 20 A in flight."""
    log = hovering((0.5, 0.5, 0.5, 0.5))
    t = np.arange(0.0, SECONDS, 0.1)
    amperes = np.where(t > 9.0, 20.0 + 5.0 * np.sin(2.0 * np.pi * 0.3 * t), 0.5)
    volts = rest - 0.005 * t - ohm * amperes - drop_at_end * (t > SECONDS - 1.0)
    log.power.battery = Stream(t, np.column_stack([volts, amperes]), "V, A", "", "BAT")
    if count is not None:
        log.parameters.lines["BAT1_N_CELLS"] = TimeLine(np.zeros(1), [count], "parameter")
    return log


def test_resistance_is_that_of_the_battery() -> None:
    check = found(battery())["battery"]
    assert check.verdict == "ok"
    assert check.evidence[0].startswith("Internal resistance 20 mΩ; 2 %")
    assert found(battery(ohm=0.14))["battery"].verdict == "warning"


def test_volts_alone_do_not_judge_a_battery() -> None:
    log = battery()
    assert log.power.battery is not None
    log.power.battery.x[:, 1] = np.nan
    check = found(log)["battery"]
    assert check.verdict == "unknown"
    assert check.evidence[0].startswith("The battery had 16.")


@pytest.mark.parametrize(("count", "verdict"), [(4.0, "ok"), (5.0, "warning"), (None, "ok")])
def test_cells_come_from_parameters_only(count: float | None, verdict: str) -> None:
    assert found(battery(count=count))["battery"].verdict == verdict


def test_a_negative_current_is_an_offset_of_its_sensor() -> None:
    log = battery()
    assert log.power.battery is not None
    log.power.battery.x[:, 1] -= 30.0
    assert "offset" in found(log)["battery"].text


def test_a_constant_voltage_is_no_measurement() -> None:
    log = battery()
    assert log.power.battery is not None
    log.power.battery.x[:, 0] = 12.0
    assert found(log)["battery"].verdict == "unknown"


@pytest.mark.parametrize(
    ("volts", "dip", "noted"),
    [(5.0, 5.0, False), (4.5, 4.5, True), (4.9, 4.45, True), (4.7, 4.5, False), (5.2, 4.7, True)],
)
def test_a_board_that_is_low_or_dips_is_noted(volts: float, dip: float, noted: bool) -> None:
    log = hovering((0.5, 0.5, 0.5, 0.5))
    t = np.arange(0.0, SECONDS, 0.1)
    moves = 0.01 * np.sin(t)
    log.power.board = Stream(t, (np.where((t > 60.0) & (t < 62.0), dip, volts) + moves)[:, None], "V", "", "POWR.Vcc")
    assert (found(log)["board_supply"].verdict == "warning") is noted


def test_a_constant_board_supply_is_no_measurement() -> None:
    log = hovering((0.5, 0.5, 0.5, 0.5))
    log.power.board = Stream(np.arange(0.0, SECONDS, 0.1), np.full((round(10 * SECONDS), 1), 5.0), "V", "", "POWR.Vcc")
    assert found(log)["board_supply"].verdict == "unknown"
    log.power.overcurrent = Stream(np.array([40.0, 60.0]), np.array([[1.0], [0.0]]), "1", "", "POWR.Flags")
    assert found(log)["board_supply"].verdict == "warning"


def test_a_voltage_below_that_of_the_flight_is_none_at_rest() -> None:
    log = battery(count=4.0)
    assert log.power.battery is not None
    log.power.battery.x[log.power.battery.t < 8.0, 0] = 4.8  # USB
    check = found(log)["battery"]
    assert (check.verdict, check.evidence) == ("unknown", ["The battery had at least 15.2 V in flight."])


def test_an_empty_cell_of_lithium_ion_has_a_lower_voltage() -> None:
    log = battery(rest=14.2, count=4.0)
    assert found(log)["battery"].verdict == "warning"
    log.parameters.lines["BAT1_V_EMPTY"] = TimeLine(np.zeros(1), [2.9], "parameter")
    assert found(log)["battery"].verdict == "ok"


@pytest.mark.parametrize(("share", "noted"), [(1.0, False), (0.5, True), (0.0, False)])
def test_overcurrent_in_every_record_is_a_pin_that_is_not_connected(share: float, noted: bool) -> None:
    log = hovering((0.5, 0.5, 0.5, 0.5))
    t = np.arange(0.0, SECONDS, 0.1)
    log.power.board = Stream(t, np.full((len(t), 1), 5.0), "V", "", "POWR.Vcc")
    log.power.overcurrent = Stream(t, (t <= share * SECONDS).astype(float)[:, None], "1", "", "POWR.Flags")
    if not share:
        log.power.overcurrent.x[:] = 0.0
    assert (found(log)["board_supply"].verdict == "warning") is noted


def test_a_log_that_ends_with_disarming_is_no_brownout() -> None:
    spans = Segments([Segment("continuous", 0.0, SECONDS), Segment("airborne", 10.0, SECONDS)])
    log = battery(drop_at_end=3.0)
    log.state.armed = TimeLine(np.array([0.0, SECONDS - 0.5]), [True, False], "made")
    assert "brownout" not in found(log, spans)


@pytest.mark.parametrize(("drop", "end", "count"), [(3.0, SECONDS, 1), (1.0, SECONDS, 0), (3.0, 140.0, 0)])
def test_a_log_that_ends_in_the_air_with_its_supply_is_a_brownout(drop: float, end: float, count: int) -> None:
    spans = Segments([Segment("continuous", 0.0, SECONDS), Segment("airborne", 10.0, end)])
    assert ("brownout" in found(battery(drop_at_end=drop), spans)) == bool(count)
