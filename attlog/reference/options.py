"""The switches of the comparison, with the names of the command line."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ReferenceOptions:
    """How to choose and align the reference.

    ``reference``: auto, truth, smoother, onboard, onboard:NAME or none. ``clock``: sample (times
    of measurement) or publication. ``declination``: auto, model, param or degrees.
    ``trim``: take the vehicle's trim out of replays. ``input_delay``: auto, off or
    ms. ``score_from``: seconds, None for 15 s after the first IMU sample.
    """

    reference: str = "auto"
    clock: str = "sample"
    declination: str | float = "auto"
    trim: bool = True
    input_delay: str | float = "auto"
    score_from: float | None = None
