"""What configurations are compared by: the four questions, and any metric that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from attlog.base.errors import UsageError, suggestion
from attlog.compare.differences.paired import Scale
from attlog.metrics import definitions
from attlog.present.heading import DRIFT_AIR
from attlog.present.table.rows import AIR, ALL, REST

EVERY = ("all", "airborne", "armed", "rest", "hover", "cruise", "idle")


@dataclass(frozen=True, slots=True)
class ComparedMetric:
    """One question: ``metric`` in the first of ``windows`` that a log answers; ``main`` has a sentence and a plot."""

    metric: str
    windows: tuple[str, ...]
    title: str
    main: bool = True

    @property
    def id(self) -> str:
        """What it is called in files: ``inclination_rmse_deg@airborne``."""
        return f"{self.metric}@{self.windows[0]}"

    @property
    def scale(self) -> Scale:
        """Errors and noises are compared as ratios, everything else as a difference."""
        name = self.metric
        paired = name.endswith("_rmse_deg") or (name.startswith("noise_") and "p2p" not in name)
        return "ratio" if paired else "difference"


MAIN = (
    ComparedMetric("inclination_rmse_deg", AIR, "Tilt error"),
    ComparedMetric("heading_rmse_deg", AIR, "Heading error"),
    ComparedMetric("noise_tilt_deg", ("rest",), "Noise at rest"),
    ComparedMetric("noise_tilt_deg", ("hover",), "Noise in hover"),
    ComparedMetric("noise_tilt_deg", ("cruise",), "Noise moving"),
    ComparedMetric("lag_ms", AIR, "Lag"),
    ComparedMetric("step_error_deg.0.5s", AIR, "Step error"),
    ComparedMetric("drift_rest_deg_per_min", REST, "Drift at rest"),
    ComparedMetric(DRIFT_AIR, AIR, "Drift in the air"),
)
"""In the order of a report on one log."""


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
        return list({q.id: q for q in (ComparedMetric(q.metric, windows or q.windows, q.title) for q in MAIN)}.values())
    named = list(known) if "all" in metrics else list(metrics)
    found = []
    for name in named:
        places = windows or next((q.windows for q in MAIN if q.metric == name and "rmse" in name), None)
        title, main = known[name].title, "all" not in metrics
        found += [ComparedMetric(name, places, title, main)] if places else _by_phase(name, title, main)
    return list({q.id: q for q in found}.values())


def _by_phase(name: str, title: str, main: bool) -> list[ComparedMetric]:
    """A metric in the windows that make sense for it: noise by phase, drift at rest at rest, others in flight."""
    if name.startswith("noise_"):
        return [ComparedMetric(name, (w,), f"{title}, {w}", main) for w in ("rest", "hover", "cruise", "idle")]
    if name.startswith(("drift_rest", "allan", "gyro_bias")):
        return [ComparedMetric(name, REST, title, main)]
    return [ComparedMetric(name, (*AIR, *(w for w in (*ALL, *EVERY) if w not in AIR)), title, main)]
