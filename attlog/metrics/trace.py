"""What a figure needs: arrays of one row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(slots=True)
class Trace:
    """Arrays of one row for one figure; never in the JSON.

    ``figure`` and its ``columns`` (all (n,), degrees, NaN breaks the line):
    ``attitude``: roll pitch heading at the row's own times (the reference is drawn
    too, as ``truth`` where it is no row); ``difference``: total heading inclination roll pitch at the reference's
    times; ``rest``: roll pitch heading deviations from the mean of rest number ``key``;
    ``drift``: heading error block means and ``line`` (fit), ``key`` = "rest" or the
    heading reference; ``allan``: tau (also ``t``), deviation of the averaged angle, low, high,
    ``key`` = axis; ``bias``: x y z in deg/s; ``step``: est and ref of one event, t from
    its onset, ``key`` = "axis@onset"; ``setpoint``: roll and pitch response to a unit
    step, t from the step.
    """

    figure: str
    row: str
    t: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]
    key: str = ""
