"""What the vehicle shall do: timed commands of a flight, or a motion that is prescribed."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from attlog.simulate.sensors.settings import STRICT, ZERO, NotNegative, Positive, Three

Doing = Literal["arm", "takeoff", "hold", "goto", "velocity", "attitude", "track", "land", "disarm", "kill"]


@dataclass(frozen=True, config=STRICT)
class Command:
    """From ``t`` s on, until the next command:

    ``arm`` (rotors idle), ``takeoff`` (climb to ``up_m``), ``hold`` (stay where it is), ``goto`` (``north_m east_m
    up_m`` with up to ``speed_m_s``), ``velocity`` (``north_m_s east_m_s``, height held), ``attitude`` (``roll_deg
    pitch_deg``, height held), ``track`` (roll or pitch follows ``amplitude_deg`` as sine or square of ``period_s``,
    height held), ``land``, ``disarm``, ``kill`` (rotors stop at once). Heading turns to ``heading_deg`` with
    ``yaw_rate_dps``; None leaves it as it was.
    """

    t: NotNegative
    do: Doing
    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float | None = None
    speed_m_s: Positive = 3.0
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    roll_deg: Annotated[float, Field(ge=-80, le=80)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-80, le=80)] = 0.0
    heading_deg: float | None = None
    yaw_rate_dps: Positive = 45.0
    axis: Literal["roll", "pitch"] = "roll"
    shape: Literal["sine", "square"] = "sine"
    amplitude_deg: Annotated[float, Field(ge=0, le=60)] = 10.0
    period_s: Positive = 4.0


@dataclass(frozen=True, config=STRICT)
class Move:
    """Within ``seconds`` on to these angles and height, smoothly (fifth-order, no jump in rate or acceleration).

    What is not given stays; ``north_m east_m`` count from where it began. ``shock_m_s2``: the blow at the end, along
    body down, that rings off in hundredths of a second.
    """

    seconds: Positive
    roll_deg: float | None = None
    pitch_deg: Annotated[float | None, Field(ge=-85, le=85)] = None
    heading_deg: float | None = None
    up_m: float | None = None
    north_m: float | None = None
    east_m: float | None = None
    shock_m_s2: NotNegative = 0.0


@dataclass(frozen=True, config=STRICT)
class PrescribedMotion:
    """A prescribed motion by hand or on a table; rotors stand still. It begins at these angles and goes through
    ``move`` one after the other, then rests. It turns about a point fixed to the earth; ``arm_m`` is the way from
    there to the centre of gravity in body axes. After commands: from ``after_s`` on somebody carries what flew, from
    where and how it lies; roll and pitch of the start are not asked for then."""

    roll_deg: float = 0.0
    pitch_deg: Annotated[float, Field(ge=-85, le=85)] = 0.0
    arm_m: Three = ZERO
    after_s: NotNegative | None = None
    move: tuple[Move, ...] = ()
