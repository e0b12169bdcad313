"""What breaks, when: faults that are planted in a sensor or a rotor."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from attlog.simulate.sensors.settings import STRICT, ZERO, NotNegative, Three

Part = Literal["gyro", "acc", "mag", "gnss", "baro", "rotor"]
Kind = Literal["stuck", "silent", "zero", "offset", "scale", "noise", "spikes", "flipped", "off", "unbalanced"]


@dataclass(frozen=True, config=STRICT)
class PlantedFault:
    """From ``t`` for ``seconds`` (None: to the end), ``part`` number ``instance`` is

    ``stuck`` at its last value, ``silent`` (no samples), ``zero``, ``offset`` by ``value`` (SI; T for mag, m and
    m/s NED for gnss, m for baro uses the first), ``scale`` by ``factor``, ``noise`` of standard deviation ``size``
    added (SI), ``spikes`` of ``size`` in ``share_pct`` of the samples, ``flipped`` (x and y change sign); a rotor
    is ``off``, ``scale`` d in thrust or ``unbalanced``: it shakes every inertial unit ``factor`` times as much.
    """

    t: NotNegative
    part: Part
    kind: Kind
    seconds: NotNegative | None = None
    instance: Annotated[int, Field(ge=0)] = 0
    value: Three = ZERO
    factor: float = 1.0
    size: NotNegative = 0.0
    share_pct: Annotated[float, Field(ge=0, le=100)] = 1.0

    def holds(self, t: float) -> bool:
        """Whether it acts at ``t`` s."""
        return t >= self.t and (self.seconds is None or t < self.t + self.seconds)
