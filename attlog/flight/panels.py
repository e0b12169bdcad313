"""Lines of the figures of flight data: what each panel shows, from the flight and from signals by firmware.

What a flight log holds for all firmwares (GNSS, barometer, battery, outputs of motors) is taken from there; the rest
are rows of a table per firmware, ``panel -> (label, signal, factor)``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from attlog.core import rotation
from attlog.core.limits import RELEASED_BYTES
from attlog.core.sorting import median
from attlog.flight.drive import MotorOutputs
from attlog.flight.model import FIX_3D, Array, FlightLog, Stream, guarded_part
from attlog.flight.signals import Signals
from attlog.flight.vehicle import VehicleKind


class Row(NamedTuple):
    """Line of a panel: its label, the signal (several: length of the vector), and the factor to the panel's unit.

    The first logged row of a label is drawn. ``{}`` becomes 0, 1, 2 ... in a signal, 1, 2, 3 ... in the label.
    The size of the factor counts where the log has no unit, its sign always.
    """

    label: str
    signal: str | tuple[str, ...]
    factor: float = 1.0


PanelRows = Mapping[str, tuple[Row, ...]]


@dataclass(slots=True)
class PanelLine:
    """Line of a panel: values ``y`` (n,) in the panel's unit at ``t`` (n,) s."""

    panel: str
    label: str
    t: Array
    y: Array


class PanelUnit(NamedTuple):
    """Unit of a panel, and the range outside which a number means a missing value."""

    unit: str
    low: float = -np.inf
    high: float = np.inf


# Panels of body rates; the gyro's are thinned before they are copied.
RATE_PANELS = ("roll_rate", "pitch_rate", "yaw_rate")
PANELS: dict[str, PanelUnit] = {
    "height": PanelUnit("m", -10_000.0, 100_000.0),
    "climb": PanelUnit("m/s", -1_000.0, 1_000.0),
    "speed": PanelUnit("m/s", 0.0, 1_000.0),
    **{axis: PanelUnit("deg/s", -1e5, 1e5) for axis in RATE_PANELS},
    "roll": PanelUnit("deg"),
    "pitch": PanelUnit("deg"),
    "heading": PanelUnit("deg"),
    "acceleration": PanelUnit("m/s^2", -1e4, 1e4),
    "motors": PanelUnit("%", -1_000.0, 1_000.0),
    "servos": PanelUnit("%", -1_000.0, 1_000.0),
    "outputs": PanelUnit("us", 1.0, 10_000.0),
    "commands": PanelUnit("1", -10_000.0, 10_000.0),
    "rpm": PanelUnit("rpm", -1e6, 1e6),
    "esc_current": PanelUnit("A", -1_000.0, 10_000.0),
    "sticks": PanelUnit("%", -150.0, 150.0),
    "stick_pulses": PanelUnit("us", 1.0, 10_000.0),
    "channels": PanelUnit("us", 1.0, 10_000.0),
    "volts": PanelUnit("V", 0.0, 1_000.0),
    "amperes": PanelUnit("A", -1_000.0, 10_000.0),
    "used": PanelUnit("mAh", 0.0, 1e7),
    "remaining": PanelUnit("%", 0.0, 110.0),
    "rails": PanelUnit("V", 0.0, 60.0),
    "satellites": PanelUnit("1", 0.0, 100.0),
    "fix": PanelUnit("1", 0.0, 10.0),
    # 655.35 is the largest number that ArduPilot can log; a fix is never so bad.
    "accuracy": PanelUnit("m", 0.0, 650.0),
    "speed_accuracy": PanelUnit("m/s", 0.0, 650.0),
    "dilution": PanelUnit("1", 0.1, 50.0),
    "jamming": PanelUnit("1", 0.0, 1e4),
    "load": PanelUnit("%", 0.0, 200.0),
    "loop": PanelUnit("ms", 0.0, 1e5),
    "slow_loops": PanelUnit("1", 0.0, 1e6),
    "dropouts": PanelUnit("1", 0.0, 1e9),
    "link": PanelUnit("1", 0.0, 254.0),
    "temperature": PanelUnit("degC", -100.0, 250.0),
}
# Factors between units of the formats and of the panels.
CONVERSIONS = {
    ("cm/s", "m/s"): 0.01,
    ("mm/s", "m/s"): 1e-3,
    ("cm", "m"): 0.01,
    ("mm", "m"): 1e-3,
    ("mV", "V"): 1e-3,
    ("cV", "V"): 0.01,
    ("cA", "A"): 0.01,
    ("d%", "%"): 0.1,
    ("c%", "%"): 0.01,
    ("cdegC", "degC"): 0.01,
    ("us", "ms"): 1e-3,
    ("rad/s", "deg/s"): float(np.degrees(1.0)),
}
# Largest number that replaces ``{}`` of a row, and largest number of instances of a message.
MAX_NUMBER, MAX_INSTANCES = 18, 8
# Cells of a battery in BATTERY_STATUS, and the voltage of one that is missing.
MAX_CELLS, NO_CELL_MV = 10, 65535.0
# Panels that show every instance of a message.
SEVERAL = {"outputs", "esc_current", "volts", "amperes", "used", "remaining", "rails", "temperature"}
# Speed from which the course over ground is drawn, m/s.
MIN_COURSE_M_S = 2.0
# Shortest and longest pulse of a servo or speed controller, us.
MIN_PULSE_US, MAX_PULSE_US = 700.0, 2600.0
# Pulses that move by less in a log drive nothing, us.
MIN_MOVED_US = 20.0


def panel_lines(log: FlightLog) -> list[PanelLine]:
    """Return the lines of all panels, without those that are constantly 0 or missing."""
    found: dict[tuple[str, str], PanelLine] = {}
    parts = {"Flight data": partial(_of_flight, log), "Signals of flight data": partial(_of_signals, log)}
    for what, part in parts.items():
        for line in guarded_part(log, what, lambda part=part: list(part()), list):  # type: ignore[misc]
            limits = PANELS[line.panel]
            with np.errstate(invalid="ignore"):
                line.y = np.where((line.y >= limits.low) & (line.y <= limits.high), line.y, np.nan)
            if len(line.t) > 1 and np.nan_to_num(line.y).any() and not _is_idle(line):
                found.setdefault((line.panel, line.label), line)
    return list(found.values())


def _is_idle(line: PanelLine) -> bool:
    """Return whether an output, channel or command never moved, or a current is not measured (constant)."""
    least = {"outputs": MIN_MOVED_US, "channels": MIN_MOVED_US, "commands": 1e-6, "amperes": 1e-6}.get(line.panel, 0.0)
    return float(np.nanmax(line.y) - np.nanmin(line.y)) < least


def numbered(name: str, k: int) -> str:
    """Return the name of the k-th of several: GNSS, GNSS 2."""
    return f"{name} {k + 1}" if k else name


# --- what a flight log holds for every firmware ------------------------------------------------------------------


def _of_flight(log: FlightLog) -> Iterator[PanelLine]:
    """Yield the lines that need no signal of a firmware."""
    yield from _stream("height", "onboard", log.estimator.height)
    for k, baro in enumerate(log.baro[:MAX_INSTANCES]):
        yield from _stream("height", numbered("barometer", k), baro if baro.unit == "m" else None)
    for k, g in enumerate(log.gnss[:MAX_INSTANCES]):
        fixed = g.fix >= FIX_3D
        receiver = numbered("GNSS", k)
        yield PanelLine("height", receiver, g.t, np.where(fixed, g.alt, np.nan))
        yield PanelLine("climb", receiver, g.t, np.where(fixed, -g.vel_ned[:, 2], np.nan))
        speed = np.sqrt(g.vel_ned[:, 0] ** 2 + g.vel_ned[:, 1] ** 2)
        yield PanelLine("speed", receiver, g.t, np.where(fixed, speed, np.nan))
        yield PanelLine("fix", receiver, g.t, g.fix.astype(np.float64))
        of = f"{receiver} " if k else ""
        yield PanelLine("accuracy", f"{of}horizontal", g.t, g.h_acc)
        yield PanelLine("accuracy", f"{of}vertical", g.t, g.v_acc)
        yield PanelLine("speed_accuracy", receiver, g.t, g.s_acc)
        if g.reception is not None:
            yield PanelLine("satellites", receiver, g.t, g.reception.satellites)
            yield PanelLine("dilution", f"{of}horizontal", g.t, g.reception.hdop)
            yield PanelLine("jamming", f"{of}jamming", g.t, g.reception.jamming)
            yield PanelLine("jamming", f"{of}noise", g.t, g.reception.noise)
    yield from _stream("height", "rangefinder", log.rangefinder)
    yield from _stream("speed", "onboard", log.estimator.speed)
    yield from _stream("speed", "air", log.airspeed)
    yield from _attitudes(log)
    if log.setpoints.rates is not None:
        for axis, x in zip(RATE_PANELS, log.setpoints.rates.x.T, strict=True):
            yield PanelLine(axis, "set-point", log.setpoints.rates.t, np.degrees(x))
    power = log.power
    if (outputs := _scaled_outputs(log)) is not None:
        for k in range(outputs.motors):
            yield PanelLine("motors", outputs.title(k), outputs.t, 100.0 * outputs.x[:, k])
    if power.rpm is not None:
        for k, x in enumerate(power.rpm.x.T):
            yield PanelLine("rpm", f"rotor {k + 1}", power.rpm.t, x)
    if power.battery is not None:
        yield from _stream("volts", "battery", power.battery)
        yield PanelLine("amperes", "battery", power.battery.t, power.battery.x[:, 1])
    yield from _stream("rails", "board", power.board)
    for unit in log.imus:
        yield from _stream("temperature", numbered("IMU", unit.index), unit.temperature)


def _attitudes(log: FlightLog) -> Iterator[PanelLine]:
    """Yield headings in deg: onboard, commanded, and by GNSS where it shows one; all angles where no filter runs."""
    known = {"onboard": log.onboard_attitude, "set-point": log.setpoints.attitude}
    for label, attitude in known.items():
        if attitude is not None and len(attitude.t):
            angles = np.degrees(rotation.to_euler(attitude.q)).T
            for panel, angle in zip(("roll", "pitch", "heading"), angles, strict=True):
                if panel == "heading" or log.imu is None:
                    yield PanelLine(panel, label, attitude.t, angle)
    for k, g in enumerate(log.gnss[:MAX_INSTANCES]):
        north, east = g.vel_ned[:, 0], g.vel_ned[:, 1]
        moving = (g.fix >= FIX_3D) & (north**2 + east**2 >= MIN_COURSE_M_S**2)
        yield PanelLine(
            "heading", numbered("course", k), g.t, np.where(moving, np.degrees(np.arctan2(east, north)), np.nan)
        )
        for stream in () if g.heading is None else (g.heading,):
            yield PanelLine("heading", numbered("two antennas", k), stream.t, np.degrees(stream.x[:, 0]))
    if log.estimator.yaw is not None:
        yaw = log.estimator.yaw
        yield PanelLine("heading", "GNSS motion", yaw.t, np.degrees(yaw.x[:, 0]))


def _scaled_outputs(log: FlightLog) -> MotorOutputs | None:
    """Return the outputs of motors whose floor and ceiling are known; others are drawn as logged."""
    outputs = log.power.outputs
    return outputs if outputs is not None and outputs.scaled else None


def _stream(panel: str, label: str, stream: Stream | None) -> Iterator[PanelLine]:
    """Yield the first column of a stream."""
    if stream is not None and len(stream.t):
        yield PanelLine(panel, label, stream.t, stream.x.reshape(len(stream.t), -1)[:, 0])


# --- signals of a firmware ---------------------------------------------------------------------------------------


def rows_of(log: FlightLog) -> PanelRows:
    """Return the table of the log's firmware, empty for other logs."""
    if log.format == "ulog":
        from attlog.flight.px4.panels import ROWS as px4

        return px4
    if log.format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.panels import ROWS as ardupilot

        return ardupilot
    if log.format in ("tlog", "mavlink"):
        from attlog.flight.mavlink import PANEL_ROWS

        return PANEL_ROWS
    return {}


def _of_signals(log: FlightLog) -> Iterator[PanelLine]:
    """Yield the lines of the firmware's table."""
    table = rows_of(log)
    if not table or log.messages is None:
        return
    signals = Signals(log)
    motors = _scaled_outputs(log)
    taken = set() if motors is None else set(_places_of(signals, motors.source, motors.names))
    many = signals.messages.size > RELEASED_BYTES
    for panel, rows in table.items():
        if panel == "motors" and motors is not None:
            continue
        for row in rows:
            label, signal = _by_stick(log, row) if panel == "stick_pulses" else (row.label, row.signal)
            for name, place in _expanded(signals, panel, label, signal) if label else ():
                if name and not taken & set(place):
                    yield from _line(signals, panel, name, place, row.factor)
        if many:
            signals.release()
    yield from _packs(signals)


def _packs(signals: Signals) -> Iterator[PanelLine]:
    """Yield the voltages of batteries that telemetry has by cell, or as the first of them."""
    for k, place in enumerate(signals.places("BATTERY_STATUS")[:MAX_INSTANCES]):
        cells = [signals.read(f"BATTERY_STATUS{place}.voltages[{i}]") for i in range(MAX_CELLS)]
        volts = np.column_stack([y for _, y in cells])
        volts[volts >= NO_CELL_MV] = np.nan
        known = np.isfinite(volts).any(axis=1)
        yield PanelLine(
            "volts", numbered("battery", k), cells[0][0], np.where(known, 1e-3 * np.nansum(volts, axis=1), np.nan)
        )


def _places_of(signals: Signals, source: str, names: list[str]) -> list[str]:
    """Return the signals of columns of a source (``actuator_outputs:1``)."""
    message, _, instance = source.partition(":")
    number = instance or str(min(signals.instances(message), default=0))
    place = next((p for p in signals.places(message) if re.fullmatch(rf"\[{number}(,.*)?\]", p)), f"[{number}]")
    return [f"{message}{place}.{name}" for name in names]


def _by_stick(log: FlightLog, row: Row) -> tuple[str, str | tuple[str, ...]]:
    """Return label and signal of a stick on the channel that RCMAP gives it; no label for one that is not read."""
    assert isinstance(row.signal, str)
    usual = {"roll": 1.0, "pitch": 2.0, "throttle": 3.0, "yaw": 4.0}
    channel, label = log.param(f"RCMAP_{row.label.upper()}") or usual[row.label], row.label
    if log.kind is VehicleKind.SUB:  # reads no RCMAP
        channel = {"roll": 2.0, "pitch": 1.0}.get(label, usual[label])
    elif log.kind in (VehicleKind.ROVER, VehicleKind.BOAT):
        label = {"roll": "steering", "pitch": "", "yaw": "lateral"}.get(label, label)
    return label, row.signal.replace("#", str(int(channel)))


def _expanded(
    signals: Signals, panel: str, label: str, signal: str | tuple[str, ...]
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield labels and signals of a row: of each number and instance, where the panel has them."""
    parts = (signal,) if isinstance(signal, str) else signal
    message = parts[0].partition(".")[0]
    places = signals.places(message)[: MAX_INSTANCES if panel in SEVERAL else 1]
    for place, where in enumerate(places):
        names = tuple(part.replace(".", f"{where}.", 1) for part in parts)
        if "{}" not in names[0]:
            if all(map(signals.has, names[:1])) and all(map(signals.has, parts[1:])):
                yield numbered(label, place), (names[0], *parts[1:])
            continue
        first = 1 if "[{}]" in names[0] else 0
        for k in range(MAX_NUMBER):
            if signals.has(name := names[0].replace("{}", str(k))):
                own = label.replace("{}", str(k + first))
                yield own if place == 0 else f"{own}, port {place + 1}", (name,)


def _line(signals: Signals, panel: str, label: str, names: tuple[str, ...], factor: float) -> Iterator[PanelLine]:
    """Yield the line of a signal, or of the length of a vector, in the panel's unit."""
    parts = []
    for name in names:
        scale = factor
        unit = signals.unit(name)
        if unit == PANELS[panel].unit:
            scale = np.sign(factor)
        elif (unit, PANELS[panel].unit) in CONVERSIONS:
            scale = np.sign(factor) * CONVERSIONS[unit, PANELS[panel].unit]
        t, y = signals.read(name)
        parts.append((t, scale * y))
    t, y = parts[0]
    if len(parts) > 1:
        others = [other if np.array_equal(s, t) else np.interp(t, s, other) for s, other in parts[1:] if len(s)]
        if len(others) + 1 < len(parts):
            return
        y = np.sqrt(sum((other**2 for other in others), y**2))
    yield PanelLine("commands" if panel == "outputs" and not _are_pulses(y) else panel, label, t, y)


def _are_pulses(y: Array) -> bool:
    """Return whether outputs (n,) are pulses in us, not DShot or CAN numbers or shares."""
    on = y[np.isfinite(y) & (y > 0.0)]
    return bool(len(on)) and float(median(on)) >= MIN_PULSE_US and float(on.max()) <= MAX_PULSE_US
