"""Checks of battery and board supply; all are notes."""

from __future__ import annotations

import numpy as np

from attlog.core.sorting import median, nanmedian
from attlog.core.spans import Span, inside
from attlog.flight.model import Array, FlightLog, Stream
from attlog.health.check import Check, HealthCase, unknown
from attlog.segments.model import Segments
from attlog.story.flight_events import is_still_flying

# Least voltage of a battery, and its least movement in V: a constant is no measurement.
MIN_VOLTS, MIN_MOVED_V = 3.0, 0.05
# Rest voltage per cell below which lithium polymer is nearly empty; the time before lift-off that does not count.
EMPTY_CELL_V, BEFORE_LIFT_S = 3.66, 1.0
# PX4's voltage of an empty cell (BAT1_V_EMPTY) below which the cells are lithium ion, which hold charge at 3.66 V.
MIN_POLYMER_EMPTY_V = 3.2
# Median current below which the sensor has an offset: nothing charges a battery for so long.
NEGATIVE_A = -1.0
# Resistance: mean over a block less the mean over 10 s; least movement of current and least correlation.
BLOCK_S, TREND_S, MIN_SPREAD_A, MIN_CORRELATION, MIN_BLOCKS = 0.5, 10.0, 0.3, 0.8, 40
# Share of the rest voltage that is lost at the median current; unproven on a weak battery.
WEAK_SHARE = 0.15
# Board of 5 V: low median, a dip below this from a sound median, range.
LOW_BOARD_V, DIP_V, SOUND_BOARD_V, MAX_RANGE_V = 4.6, 4.5, 4.8, 0.4
# Brownout: volts of the last second against the 10 s before.
LAST_S, BEFORE_S, LOST_SHARE = 1.0, 10.0, 0.85
LIMITS = {
    "battery": "note: 3.66 V per cell at rest, or 15 % lost in its resistance",
    "board_supply": "note: below 4.6 V, a dip below 4.5 V or 0.4 V of range, overcurrent",
    "brownout": "note: the log ends in the air with the supply below 85 %, or the board below 4.5 V",
}
NO_REST = "No battery voltage is logged at rest before lift-off."
NO_CELLS = "Neither the number of LiPo cells nor a changing current is logged."
SOURCE = "attlog, tried on logs with known faults"


def supply_checks(case: HealthCase) -> list[Check]:
    """Check battery, board and the end of the supply; nothing where the log holds none of them."""
    log, segments = case.log, case.segments
    return [*_battery_check(log, segments), *_board_check(log, segments), *_brownout_check(log, segments)]


def _check(question: str, noted: bool, text: str, value: float | None = None, unit: str = "") -> Check:
    check = Check(question, "warning" if noted else "ok", text, None if value is None else round(value, 3), unit)
    check.threshold, check.source = LIMITS[question], SOURCE
    return check


def battery_volts(log: FlightLog) -> tuple[Array, Array] | None:
    """Return times (n,) s and volts and amperes (n, 2) of a battery that was measured; None without one."""
    stream = log.power.battery
    if stream is None or not len(stream.t):
        return None
    good = np.isfinite(stream.x[:, 0]) & (stream.x[:, 0] >= MIN_VOLTS)
    if np.count_nonzero(good) < 2 or np.ptp(stream.x[good, 0]) < MIN_MOVED_V:
        return None
    return stream.t[good], stream.x[good]


def cells(log: FlightLog) -> int | None:
    """Return the number of cells in series by the log's parameters, None where not set."""
    value = next((v for name in ("BAT1_N_CELLS", "BAT_N_CELLS") if (v := log.param(name))), None)
    return None if value is None or not 1 <= value <= 30 else int(value)


def is_lithium_ion(log: FlightLog) -> bool:
    """Return whether the parameters call a cell empty at a voltage of lithium ion."""
    value = next((v for name in ("BAT1_V_EMPTY", "BAT_V_EMPTY") if (v := log.param(name))), None)
    return value is not None and value < MIN_POLYMER_EMPTY_V


# Parameters of the current sensor's offset of ArduPilot and PX4.
CURRENT_OFFSETS = ("BATT_AMP_OFFSET", "BAT_V_OFFS_CURR")


def _battery_check(log: FlightLog, segments: Segments) -> list[Check]:
    """Check the charge at lift-off and the resistance."""
    measured, flights = battery_volts(log), segments.spans("airborne")
    if log.power.battery is None:
        return []
    amperes = log.power.battery.x[np.isfinite(log.power.battery.x[:, 1]), 1]
    if len(amperes) and median(amperes) <= NEGATIVE_A:
        text = f"The battery's current reads {median(amperes):.1f} A: the current sensor's offset or sign is wrong."
        check = _check("battery", True, text, float(median(amperes)), "A")
        names = [name for name in CURRENT_OFFSETS if log.param(name) is not None]
        check.action = f"Calibrate the current sensor with the motors off{f' ({names[0]})' if names else ''}."
        return [check]
    if not flights:
        return []
    if measured is None:
        return [unknown("battery", "The battery's voltage was not measured.", LIMITS["battery"], source=SOURCE)]
    t, x = measured
    rest = x[t <= flights[0][0] - BEFORE_LIFT_S, 0]
    volts, flown = float(median(rest)) if len(rest) else None, x[inside(t, flights), 0]
    if volts is not None and len(flown) and volts < median(flown) - MIN_MOVED_V:
        volts = None  # the battery was plugged in later, or this is the voltage of USB
    before = "" if volts is None else f"{volts:.1f} V before lift-off and "
    text = f"The battery had {before}at least {float(flown.min()):.1f} V in flight." if len(flown) else ""
    if not text:
        return []
    count = None if is_lithium_ion(log) else cells(log)
    if volts is not None and count is not None and volts / count <= EMPTY_CELL_V:
        text = f"It took off with a nearly empty battery: {volts / count:.2f} V per cell ({count} cells)."
        check = _check("battery", True, text, volts / count, "V")
        check.action = "Charge the battery before the flight."
        return [check]
    ohm = resistance(t, x, flights)
    if volts is None or (count is None and ohm is None):
        check = unknown("battery", NO_REST if volts is None else NO_CELLS, LIMITS["battery"], source=SOURCE)
        check.evidence = [text]
        return [check]
    check = _check("battery", False, text, volts, "V")
    if ohm is not None:
        current = float(nanmedian(x[inside(t, flights), 1]))
        lost = ohm * current / volts
        check.evidence = [
            f"Internal resistance {1000.0 * ohm:.0f} mΩ; {100.0 * lost:.0f} % of the voltage at {current:.0f} A"
        ]
        if lost >= WEAK_SHARE:
            check.verdict, check.cause = "warning", "A weak, cold or small battery, or a bad connection."
            check.action = "Measure the battery's resistance, and check connectors."
    return [check]


def resistance(t: Array, x: Array, spans: list[Span]) -> float | None:
    """Return the internal resistance in ohm by fast movements of volts and amperes (n, 2), None without correlation."""
    use = inside(t, spans) & np.isfinite(x).all(axis=1)
    if np.count_nonzero(use) < MIN_BLOCKS:
        return None
    t, x = t[use], x[use]
    block = np.floor((t - t[0]) / BLOCK_S).astype(np.int64)
    number, place = np.unique(block, return_inverse=True)
    if len(number) < MIN_BLOCKS:
        return None
    count = np.bincount(place)
    mean = np.column_stack([np.bincount(place, column) / count for column in x.T])
    half = round(0.5 * TREND_S / BLOCK_S)
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(mean, axis=0)])
    low = np.searchsorted(number, number - half)
    high = np.searchsorted(number, number + half, side="right")
    volts, amperes = (mean - (total[high] - total[low]) / (high - low)[:, None]).T
    if np.std(amperes) < MIN_SPREAD_A or np.std(volts) == 0.0:
        return None
    if abs(float(np.corrcoef(volts, amperes)[0, 1])) < MIN_CORRELATION:
        return None
    ohm = -float(np.mean(volts * amperes) / np.mean(amperes**2))
    return ohm if ohm > 0 else None


def _board_check(log: FlightLog, segments: Segments) -> list[Check]:
    """Check the supply of the autopilot while armed."""
    stream = log.power.board
    volts = _board_volts(stream, segments)
    if stream is None or not len(volts):
        return []
    middle, least, most = float(median(volts)), float(volts.min()), float(volts.max())
    over = log.power.overcurrent
    on = over is not None and bool(over.x[inside(over.t, segments.spans("armed") or [(-np.inf, np.inf)])].any())
    on = on and over is not None and not bool(over.x.all())  # on in every record: the pin is not connected
    if least == most and not on:
        why = f"Every record of the board's supply reads {middle:.2f} V: a constant is no measurement."
        return [unknown("board_supply", why, LIMITS["board_supply"], sensor=stream.source, source=SOURCE)]
    what = ""
    if middle < LOW_BOARD_V:
        what = "is low"
    elif (least < DIP_V and middle >= SOUND_BOARD_V) or middle - least >= MAX_RANGE_V:
        what = "dips"
    elif most - least >= MAX_RANGE_V:
        what = "varies"
    text = f"The board's supply {what or 'is steady'}: {middle:.2f} V, {least:.2f} to {most:.2f} V"
    text += "; overcurrent was reported." if on else "."
    check = _check("board_supply", bool(what) or on, text, middle, "V")
    check.sensor = stream.source
    if what or on:
        check.cause = "A weak power module or a load on the 5 V rail."
        check.action = "Power servos and other loads from a separate supply."
    return [check]


def _board_volts(stream: Stream | None, segments: Segments) -> Array:
    """Return the board's volts (n,) above 3 V, while armed where that is known."""
    if stream is None:
        return np.zeros(0)
    armed = segments.spans("armed")
    x: Array = stream.x[inside(stream.t, armed) if armed else np.ones(len(stream.t), bool), 0]
    return x[x > MIN_VOLTS]


def _brownout_check(log: FlightLog, segments: Segments) -> list[Check]:
    """Check whether the log ends in the air because the supply failed."""
    flights = segments.spans("airborne")
    end = max((s.t1 for s in segments.of("continuous")), default=log.seconds)
    if not flights or end - flights[-1][1] > LAST_S or any(e.is_crash for e in segments.crash_events):
        return []
    if not is_still_flying(log, segments, end):
        return []
    measured, board = battery_volts(log), log.power.board
    texts = []
    if measured is not None:
        t, volts = measured[0], measured[1][:, 0]
        last, before = volts[t > end - LAST_S], volts[(t <= end - LAST_S) & (t > end - LAST_S - BEFORE_S)]
        if len(last) and len(before) and last.min() < LOST_SHARE * median(before):
            texts.append(f"the battery fell from {median(before):.1f} to {last.min():.1f} V")
    if board is not None:
        known = board.x[:, 0] > MIN_VOLTS
        t, volts = board.t[known], board.x[known, 0]
        last, before = volts[t > end - LAST_S], volts[(t <= end - LAST_S) & (t > end - LAST_S - BEFORE_S)]
        if len(last) and len(before) and last[-1] < DIP_V and median(before) >= SOUND_BOARD_V:
            texts.append(f"the board had {last[-1]:.2f} V")
    if not texts:
        return []
    check = _check("brownout", True, f"The log ends in the air as {' and '.join(texts)}: the supply failed.")
    check.t, check.action = round(end, 1), "Check battery, power module and connectors."
    return [check]
