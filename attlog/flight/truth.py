"""How a truth that the user brought came onto the log's clock and axes, and how wrong it may be itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Angles = tuple[float, float, float]
"""Roll, pitch and yaw in deg."""


@dataclass(frozen=True, slots=True)
class TruthFit:
    """What :mod:`attlog.truth` found of an attitude called ``name`` (a file, or a message of the log).

    Its times become the log's by ``offset_s`` at the middle of what both cover and ``drift_ppm``, its body axes
    forward-right-down by ``body_deg``, its earth axes north-east-down by ``world_deg``. ``correlation`` of its angular
    rates with the gyro's (0 to 1), ``residual_dps`` the RMS of their difference, over ``n`` samples in ``seconds``.
    ``sigma_tilt_deg`` and ``sigma_heading_deg``: its own noise and what the fit leaves open, one sigma.
    ``north``: whose north its heading has: that of the ``file``, of ``gnss`` motion, or ``nobody``'s.
    """

    name: str
    offset_s: float
    offset_sigma_s: float
    drift_ppm: float
    drift_sigma_ppm: float
    body_deg: Angles
    world_deg: Angles
    correlation: float
    residual_dps: float
    n: int
    seconds: float
    sigma_tilt_deg: float
    sigma_heading_deg: float
    north: Literal["file", "gnss", "nobody"] = "nobody"
    reading: str = ""
    """How its numbers were read: ``body to earth, scalar last``."""
