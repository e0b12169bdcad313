"""What drives an ArduPilot vehicle: throttle, outputs to the motors, rotor speeds, battery."""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Stream

MOTOR_FUNCTIONS = (*range(33, 41), *range(82, 86))
"""SERVOn_FUNCTION of motors 1 to 12."""
MOTORS = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8, "dodecarotor": 12}
"""How many of the first outputs are motors where no parameter tells."""


def throttle(builder: LogBuilder, clock: Clock, family: str) -> Stream | None:
    """Throttle output 0 to 1; planes and rovers log percent, copters before 3.4 per mille."""
    for name in ("CTUN", "THR"):
        table = builder.messages.first(name)
        column = None if table is None else next((c for c in ("ThO", "ThrOut") if c in table), None)
        if table is None or column is None or clock.of_samples(table) is None:
            continue
        x = table.value(column)
        scale = 0.01 if family in ("plane", "rover") else (1e-3 if column == "ThrOut" else 1.0)
        return builder.stream(
            clock.of(table), x * scale, "1", f"{name}.{column}", within=physics.THROTTLE, allow_nan=True
        )
    return None


def motors(builder: LogBuilder, clock: Clock, vehicle: str, values: dict[str, float]) -> Stream | None:
    """Outputs to the motors of a multirotor (n, motors), 0 stopped to 1 full, by RCOU and its limits."""
    table = builder.messages.first("RCOU")
    if table is None or vehicle not in MOTORS or clock.of_samples(table) is None:
        return None
    numbers = [n for n in range(1, 17) if values.get(f"SERVO{n}_FUNCTION") in MOTOR_FUNCTIONS]
    numbers = numbers or list(range(1, MOTORS[vehicle] + 1))
    prefix = next((p for p in ("C", "Ch", "Chan") if f"{p}{numbers[0]}" in table), None)
    throttle_channel = int(values.get("RCMAP_THROTTLE", 3))
    low = values.get("MOT_PWM_MIN") or values.get(f"RC{throttle_channel}_MIN")
    high = values.get("MOT_PWM_MAX") or values.get(f"RC{throttle_channel}_MAX")
    if prefix is None or not low or not high or high - low < 100.0:
        return None
    names = [f"{prefix}{n}" for n in numbers if f"{prefix}{n}" in table]
    share = np.clip((columns(table, *names) - low) / (high - low), 0.0, 1.0)
    return builder.stream(clock.of(table), share, "1", "RCOU")


def rpm(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Rotor speeds (n, rotors) in rev/min: ESC telemetry by motor, else the RPM sensors."""
    messages = builder.messages
    motors = [t for t in (messages["ESC", i] for i in messages.instances("ESC")) if "RPM" in t and len(t) > 1]
    if motors:
        t = clock.of(motors[0])
        x = [np.interp(t, clock.of(m), m.value("RPM")) for m in motors]
        return builder.stream(t, np.column_stack(x), "rpm", "ESC", within=physics.RPM)
    table = messages.first("RPM")
    if table is None:
        return None
    names = [c for c in ("rpm1", "rpm2", "RPM1", "RPM2", "RPM") if c in table]
    return builder.stream(clock.of(table), columns(table, *names), "rpm", "RPM", within=physics.RPM) if names else None


def battery(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A; before 3.4 the log holds hundredths."""
    for name in ("BAT", "CURR"):
        table = builder.messages.first(name)
        if table is None or "Volt" not in table or "Curr" not in table or clock.of_samples(table) is None:
            continue
        x = columns(table, "Volt", "Curr")
        volts = x[np.isfinite(x[:, 0]), 0]
        if table.fields["Volt"].dtype.kind in "iu" or (len(volts) and np.median(np.abs(volts)) > 150.0):
            x = x * 0.01
        return builder.battery(clock.of(table), x, name)
    return None
