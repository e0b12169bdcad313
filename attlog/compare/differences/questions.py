"""What configurations are compared by: the four questions, and any metric that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from attlog.base.errors import UsageError, suggestion
from attlog.compare.differences.paired import Scale
from attlog.metrics import definitions
from attlog.metrics.base import named
from attlog.present.heading import DRIFT_AIR
from attlog.present.table.rows import AIR, ALL, PHASES, REST

EVERY = ("all", "airborne", "armed", "rest", "hover", "cruise", "idle")
PLACES = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
"""What the phases are called after a noun."""
SHORT = PLACES | {"cruise": "moving", "idle": "idling"}
"""The same in a title, as the table of one log has it."""


@dataclass(frozen=True, slots=True)
class ComparedMetric:
    """One question: ``metric`` in the first of ``windows`` that a log answers; ``main`` has a sentence and a plot.

    Its values are compared on ``scale``, as a ratio or as a difference.
    """

    metric: str
    windows: tuple[str, ...]
    title: str
    scale: Scale
    main: bool = True

    @property
    def id(self) -> str:
        """What it is called in files: ``inclination_rmse_deg@airborne``."""
        return f"{self.metric}@{self.windows[0]}"


MAIN: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("inclination_rmse_deg", AIR),
    ("heading_rmse_deg", AIR),
    ("noise_tilt_deg", ("rest",)),
    ("noise_tilt_deg", ("hover",)),
    ("noise_tilt_deg", ("cruise",)),
    ("lag_ms", AIR),
    ("step_error_deg.0.5s", AIR),
    ("drift_rest_deg_per_min", REST),
    (DRIFT_AIR, AIR),
)
"""Metric and windows, in the order of a report on one log."""


def asked(metrics: Sequence[str] = (), window: str | None = None) -> list[ComparedMetric]:
    """The questions of a comparison: the main ones, or the ``metrics`` named (``all``), in one window if named.

    UsageError with a suggestion for metrics that do not exist.
    """
    known = definitions()
    windows = None if window is None else (window,)
    wrong = [m for m in metrics if m != "all" and m not in known]
    if wrong:
        raise UsageError("\n".join(f"there is no metric {m}{suggestion(m, ['all', *known])}" for m in wrong))
    if not metrics:
        found = [_main(name, places, windows) for name, places in MAIN]
    else:
        every = "all" in metrics
        found = [q for name in (known if every else metrics) for q in _asked(name, windows, not every)]
    return list({q.id: q for q in found}.values())


def _main(name: str, places: tuple[str, ...], windows: tuple[str, ...] | None) -> ComparedMetric:
    """One of MAIN, called by its noun: ``Tilt error``, ``Noise added in hover``."""
    metric = named(definitions().values(), name)
    noun = metric.wording.noun if metric.wording is not None else metric.title
    added = " added" if places[0] != "rest" else ""
    place = f"{added} {SHORT[places[0]]}" if metric.asked == "phases" else ""
    return ComparedMetric(name, windows or places, f"{noun[:1].upper()}{noun[1:]}{place}", metric.scale)


def _asked(name: str, windows: tuple[str, ...] | None, main: bool) -> list[ComparedMetric]:
    """A metric by name in the windows that make sense for it: each phase for itself, at rest, or first in flight."""
    metric = definitions()[name]
    title, scale = metric.title, metric.scale
    in_flight = dict(MAIN).get(name) if scale == "ratio" and metric.asked == "flight" else None
    if windows or in_flight:
        return [ComparedMetric(name, windows or in_flight or (), title, scale, main)]
    if metric.asked == "phases":
        return [ComparedMetric(name, (phase,), f"{title}, {phase}", scale, main) for phase in PHASES]
    places = REST if metric.asked == "rest" else (*AIR, *(w for w in (*ALL, *EVERY) if w not in AIR))
    return [ComparedMetric(name, places, title, scale, main)]
