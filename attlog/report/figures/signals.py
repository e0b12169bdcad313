"""Picker of signals: a figure without lines, and the packed samples that the reader chooses from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from attlog.metrics.trace import Trace, envelope
from attlog.report.bundle import ArrayPacker
from attlog.report.figures.figure import PageFigure, View
from attlog.result import Result
from attlog.words.numbers import unit_sign
from attlog.words.text import clean, cleaned

# Most bytes of the packed samples in the page (base64).
MAX_BYTES = 1_300_000
# Samples per signal are reduced by at least this factor where they take too many bytes.
REDUCTION = 0.9
COLUMNS = ["time_s", "quantity", "value", "unit"]
HEIGHT_PX = 340


class Picker(NamedTuple):
    """Signals of a page: ``figure`` to draw them, ``block`` of samples, number of signals, messages without samples."""

    figure: PageFigure
    block: str
    signals: int
    messages: int
    left_out: int


def picker(result: Result, limit: int = MAX_BYTES) -> Picker | None:
    """Return the picker of a result, None if it holds no samples."""
    traces = [trace for trace in result.traces if trace.figure == "signal"]
    drawn = [trace for trace in traces if len(trace.t)]
    if not drawn:
        return None
    left = [trace for trace in traces if not len(trace.t)]
    count = sum(len(trace.columns) for trace in drawn)
    return Picker(signal_figure(), packed_signals(drawn, left, limit), count, len(drawn), len(left))


def signal_figure() -> PageFigure:
    """Return the figure with two vertical axes, whose lines the page's script adds."""
    view = View([])
    view.axis("x", "time, s")
    view.axis("y", "", fit={}, nticks=6)
    view.axis("y2", "", fit={}, nticks=6, overlaying="y", side="right", tickmode="auto", showgrid=False, zeroline=False)
    caption = "Up to eight signals, on two axes by their units."
    data = {"views": [view.as_data()], "timed": True, "phases": "named", "alarms": True, "table": COLUMNS}
    return PageFigure("signals", "plot", "Any signal", caption, HEIGHT_PX, data)


def packed_signals(drawn: Sequence[Trace], left: Sequence[Trace] = (), limit: int = MAX_BYTES) -> str:
    """Return signals as a packed block of at most ``limit`` bytes, with fewer samples of each where needed.

    Its header lists ``messages``: name, number of records, times, and fields as [name, unit, values]; ``left``: names
    of signals without samples.
    """
    names = [f"{trace.key}.{column}" for trace in left for column in trace.columns]
    keep = max((len(trace.t) for trace in drawn), default=0)
    while True:
        packer = ArrayPacker()
        messages = [_packed_message(trace, keep, packer) for trace in drawn]
        block = packer.pack({"messages": messages, "left": cleaned(names)})
        if len(block) <= limit or keep <= 2:
            return block
        keep = int(keep * min(limit / len(block), REDUCTION))


def _packed_message(trace: Trace, keep: int, packer: ArrayPacker) -> dict[str, Any]:
    """Return a message with its fields, each reduced to ``keep`` samples."""
    fields = []
    t = trace.t
    for name, y in trace.columns.items():
        t, thinned = envelope(trace.t, np.asarray(y, np.float64)[:, None], keep)
        fields.append([clean(name), clean(unit_sign(trace.units.get(name, ""))), packer.centred(thinned[:, 0])])
    return {"name": clean(trace.key), "records": int(trace.values["records"]), "t": packer.times(t), "fields": fields}
