"""What a figure needs: arrays of one row, or of a sensor."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(slots=True)
class Trace:
    """Arrays of one row for one figure; never in the JSON.

    ``figure`` and its ``columns`` (all (n,), degrees, NaN breaks the line):
    ``attitude``: roll pitch heading at the row's own times (the reference is drawn
    too, as ``truth`` or ``smoother`` where it is no row); ``difference``: total heading inclination roll pitch at
    the reference's times; ``sigma``: inclination and heading, how wrong a smoother says it may be itself;
    ``rest``: roll pitch heading in the longest rest, each minus its straight line; ``spread``: angle and
    share (%) of the samples of roll and pitch there, a straight line taken out of every 5 s;
    ``drift``: heading error block means and ``line`` (fit), each minus the mean of the heading, ``key`` = "rest" or the
    heading reference; ``allan``: tau (also ``t``), deviation of the averaged angle, low, high,
    ``key`` = axis; ``bias``: x y z in deg/s, of filters and of the onboard estimator; ``step``: est and ref of the
    representative event and ``set`` (set-point), t from its onset, ``key`` = "axis@onset";
    ``steps``: median low high of the error in % of the stroke over all events
    of an axis, ``ref`` the reference's median, ``key`` = "axis (events)"; ``setpoint``: roll and pitch response to a
    unit step, t from the step.

    Traces of sensors have no row: see :mod:`attlog.metrics.figures.sensors`.

    Long arrays are envelopes: smallest and largest value of each bucket; ``ratio`` is
    the number of samples that one stored sample stands for. ``values`` are single
    numbers that belong to the arrays.
    """

    figure: str
    row: str
    t: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]
    key: str = ""
    ratio: float = 1.0
    values: dict[str, float] = field(default_factory=dict)
