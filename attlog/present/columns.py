"""Which columns the comparison has, in the order of the questions: for the page and for the terminal."""

from __future__ import annotations

from dataclasses import dataclass, field

from attlog.present.heading import DRIFT_AIR, quoted_heading_reference
from attlog.present.names import heading_reference_short
from attlog.present.rows import AIR, ALL, REST
from attlog.result import Result


@dataclass(frozen=True, slots=True)
class Column:
    """A question of the table.

    ``metrics`` are looked up in ``windows``; of several the larger value counts.
    ``contest`` is False for conditions of another column, which are never marked best.
    ``spare`` says how soon a narrow terminal leaves it out: 0 never, the largest first.
    """

    title: str
    metrics: tuple[str, ...]
    windows: tuple[str, ...] = field(default=ALL)
    contest: bool = True
    spare: int = 0


COLUMNS = (
    Column("Tilt noise", ("noise_roll_deg", "noise_pitch_deg"), REST),
    Column("Heading noise", ("noise_heading_deg",), REST, spare=3),
    Column("Lag", ("lag_ms",), AIR),
    Column("Step gain", ("step_gain",), AIR, contest=False, spare=5),
    Column("Drift at rest", ("drift_rest_deg_per_min",), REST),
    Column("Air drift by", (DRIFT_AIR,), AIR, spare=2),
    Column("Tilt error RMS", ("inclination_rmse_deg",), AIR, spare=1),
    Column("Heading error RMS", ("heading_rmse_deg",), AIR, spare=1),
    Column("Cost", ("cost_ns",), ALL, spare=4),
)
"""Of the drifts in the air the best heading reference has a column; all others stand in the expert's tables."""

AXIS_COLUMNS = tuple(
    Column(f"{axis.capitalize()} {title}", (f"{metric}_{axis}{unit}",), AIR, contest)
    for axis in ("roll", "pitch", "yaw")
    for metric, title, unit, contest in (
        ("lag", "lag", "_ms", True),
        ("step_gain", "gain", "", False),
        ("distortion", "distortion", "_pct", False),
    )
)
"""Lag, gain and shape of the steps by axis."""


def columns(result: Result) -> list[Column]:
    """COLUMNS with the heading reference of this result."""
    reference = quoted_heading_reference(result)
    return [
        Column(
            f"{c.title} {heading_reference_short(reference)}", (f"{DRIFT_AIR}.{reference}",), c.windows, spare=c.spare
        )
        if c.metrics == (DRIFT_AIR,)
        else c
        for c in COLUMNS
    ]
