"""Which columns the comparison has, in the order of the questions: for the page and for the terminal."""

from __future__ import annotations

from dataclasses import dataclass, field

from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.names import heading_reference_short
from attlog.present.table.rows import AIR, ALL, PHASES, REST, has_value
from attlog.result import Result


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A question of the table: ``metric`` in the first of ``windows`` in which a filter has a value.

    ``contest`` is False for conditions of another column, which are never marked best.
    ``spare`` says how soon a narrow terminal leaves it out: 0 never, the largest first. ``short`` is its title where a
    question has one column, that of the first which has a value; empty where it stands in no short table.
    """

    title: str
    metric: str
    windows: tuple[str, ...] = field(default=ALL)
    contest: bool = True
    spare: int = 0
    short: str = ""


NOISE = "noise_tilt_deg"
NOISE_TITLES = {
    "rest": "Noise at rest",
    "hover": "Noise added in hover",
    "cruise": "Noise added moving",
    "idle": "Noise added idling",
}

ERRORS = (
    TableColumn("Tilt error RMS", "inclination_rmse_deg", AIR, short="Tilt"),
    TableColumn("Heading error RMS", "heading_rmse_deg", AIR, spare=2, short="Heading"),
)
STEPS = (TableColumn("Lag", "lag_ms", AIR, short="Lag"), TableColumn("Step error", "step_error_deg.0.5s", AIR, spare=1))
DRIFT_REST = TableColumn("Drift at rest", "drift_rest_deg_per_min", REST, short="Drift")
COST = TableColumn("Cost", "cost_ns", ALL, contest=False, spare=4)


AXIS_COLUMNS = tuple(
    TableColumn(f"{axis.capitalize()} {title}", f"{metric}_{axis}{unit}", AIR, contest)
    for axis in ("roll", "pitch", "yaw")
    for metric, title, unit, contest in (
        ("lag", "lag", "_ms", True),
        ("step_gain", "gain", "", False),
        ("distortion", "distortion", "_pct", False),
    )
)
"""Lag, gain and shape of the steps by axis."""


def columns(result: Result) -> list[TableColumn]:
    """The comparison, in the order of the questions: errors, noise by phase, steps, drift, cost.

    Noise has a column for each phase in which a filter has a value; of the drifts in the
    air the quoted heading reference has one. All others stand in the expert's tables.
    """
    phases = [phase for phase in PHASES if _has_noise(result, phase)]
    noise = [
        TableColumn(NOISE_TITLES[p], NOISE, (p,), spare=3 if i else 0, short="Noise") for i, p in enumerate(phases)
    ]
    reference = quoted_heading_reference(result)
    title = f"Air drift by {heading_reference_short(reference)}"
    air = TableColumn(title, f"{DRIFT_AIR}.{reference}", AIR, spare=2, short="Drift")
    return [*ERRORS, *noise, *STEPS, DRIFT_REST, air, COST]


def _has_noise(result: Result, phase: str) -> bool:
    rows = (row for row in result.estimators if row.kind == "replay")
    return any(has_value(row.metrics.get(phase, {}).get(NOISE)) for row in rows)
