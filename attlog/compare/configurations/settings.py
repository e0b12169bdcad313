"""What may stand before a filter, by name: each setting's unit, size, range and meaning, and values checked against it.

Samples pass through them in this order, whatever the order in which they are written:
calibration, notches, low-pass, sample rate, latency.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from attlog.base.errors import UsageError

Value = tuple[float, ...] | str
"""The numbers of a setting, or its word or file."""

NUMBERS = re.compile(r"\s*([-+0-9.eE]+(?:/[-+0-9.eE]+)*)\s*(.*?)\s*$")
MANY_HZ = 1e5


@dataclass(frozen=True, slots=True)
class InputSetting:
    """One thing that can be done to the samples. ``sizes``: how many numbers, with slashes between; ``words`` instead.

    Without sizes and words the value is a file.
    """

    name: str
    unit: str
    meaning: str
    sizes: tuple[int, ...] = (1,)
    low: float = 0.0
    high: float = MANY_HZ
    words: tuple[str, ...] = ()

    @property
    def form(self) -> str:
        """How a value looks, for messages and help."""
        if self.words:
            return "|".join(self.words)
        if not self.sizes:
            return "FILE"
        shapes = {1: "A", 2: "A/B", 3: "A/B/C"}
        return " or ".join(shapes[n] for n in self.sizes) + (f" [{self.unit}]" if self.unit else "")

    def check(self, value: object) -> Value:
        """The value of a text, number, truth value or list. UsageError says what is wrong and what is wanted."""
        if self.words:
            text = {True: "on", False: "off"}.get(value, str(value)) if isinstance(value, bool) else str(value)
            if text not in self.words:
                raise UsageError(f"{self.name}={text}: give {' or '.join(self.words)}")
            return text
        if not self.sizes:
            if not isinstance(value, str) or not value.strip():
                raise UsageError(f"{self.name}={value!r}: give the name of a file")
            return value.strip()
        numbers = self._numbers(value)
        if len(numbers) not in self.sizes:
            raise UsageError(f"{self.name}={value}: {len(numbers)} numbers; give {self.form}")
        if not all(math.isfinite(x) and self.low <= x <= self.high for x in numbers):
            raise UsageError(
                f"{self.name}={value} is out of range; give {self.form} from {self.low:g} to {self.high:g}"
            )
        return numbers

    def _numbers(self, value: object) -> tuple[float, ...]:
        wrong = UsageError(f"{self.name}={value!r}: of the wrong type; give {self.form}")
        if isinstance(value, bool):
            raise wrong
        if isinstance(value, int | float):
            return (float(value),)
        if isinstance(value, list | tuple):
            if not all(isinstance(x, int | float) and not isinstance(x, bool) for x in value):
                raise wrong
            return tuple(map(float, value))
        found = NUMBERS.match(value) if isinstance(value, str) else None
        if found is None:
            raise wrong
        if found[2] and found[2] != self.unit:
            wanted = f"is given in {self.unit}" if self.unit else "has no unit"
            raise UsageError(f"{self.name}={value}: {self.name} {wanted}, not in {found[2]}")
        try:
            return tuple(map(float, found[1].split("/")))
        except ValueError:
            raise wrong from None


THREE = (3,)
SETTINGS: dict[str, InputSetting] = {
    s.name: s
    for s in (
        InputSetting("lowpass", "Hz", "second-order Butterworth low-pass on gyro and accelerometer", low=0.01),
        InputSetting("gyro_lowpass", "Hz", "the same on the gyro alone", low=0.01),
        InputSetting("acc_lowpass", "Hz", "the same on the accelerometer alone", low=0.01),
        InputSetting("notch", "Hz", "notch on gyro and accelerometer: centre / width", (2,), low=0.01),
        InputSetting(
            "rpm_notch",
            "Hz",
            "notches that follow the logged rotor speeds: width / harmonics (1 if not given)",
            (1, 2),
            low=0.01,
        ),
        InputSetting("rate", "Hz", "means of so many IMU samples that this rate comes out", low=0.01),
        InputSetting("pick", "Hz", "one of so many IMU samples that this rate comes out, the others dropped", low=0.01),
        InputSetting("mag", "", "off: the filter runs without magnetometer", (), words=("on", "off")),
        InputSetting("mag_rate", "Hz", "one of so many magnetometer samples that this rate comes out", low=0.001),
        InputSetting("latency", "ms", "all samples come so much later", low=0.0, high=10_000.0),
        InputSetting(
            "gyro_offset",
            "deg/s",
            "subtracted from the gyro, body axes; a bias that rest shows is subtracted after it",
            THREE,
            -2000.0,
            2000.0,
        ),
        InputSetting("acc_offset", "m/s^2", "subtracted from the accelerometer, body axes", THREE, -200.0, 200.0),
        InputSetting("mag_offset", "uT", "subtracted from the magnetometer, body axes", THREE, -1000.0, 1000.0),
        InputSetting("gyro_scale", "", "the gyro without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting("acc_scale", "", "the accelerometer without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting("mag_scale", "", "the magnetometer without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting(
            "imu_rotation",
            "deg",
            "gyro and accelerometer turned by roll / pitch / yaw, after offset and scale",
            THREE,
            -360.0,
            360.0,
        ),
        InputSetting("mag_rotation", "deg", "the magnetometer turned by roll / pitch / yaw", THREE, -360.0, 360.0),
        InputSetting(
            "params", "", "firmware parameters of this file in place of the log's, for filters that take them", ()
        ),
    )
}
"""What may stand before a filter, by name."""


def written(name: str, value: Value) -> str:
    """``NAME=VALUE`` as the command line takes it."""
    return f"{name}={value if isinstance(value, str) else '/'.join(f'{x:g}' for x in value)}"


def setting_text(name: str, value: Value) -> str:
    """A setting for people: ``low-pass 20 Hz``, ``no magnetometer``."""
    if name == "mag":
        return "no magnetometer" if value == "off" else "magnetometer"
    words = name.replace("lowpass", "low-pass").replace("_", " ").replace("rpm", "RPM")
    if isinstance(value, str):
        return f"{words} {value}"
    unit = SETTINGS[name].unit
    return f"{words} {'/'.join(f'{x:g}' for x in value)}{' ' + unit if unit else ''}"
