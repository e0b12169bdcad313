"""What the filters believe about the gyro, and what they cost."""

from __future__ import annotations

from attlog.metrics.trace import Trace
from attlog.present.numbers import quantity
from attlog.present.verdicts import AIR, find
from attlog.report.figure import Figure, number, reach, said, series
from attlog.report.pack import BUDGET, Store
from attlog.report.table import ALL
from attlog.result import Result


def more(by: dict[str, list[Trace]], names: list[str], store: Store, result: Result) -> list[Figure]:
    """Gyro bias that the filters found, and cost against accuracy."""
    figures = []
    if by.get("bias"):
        drawn, ratio = series(by["bias"], ("x", "y", "z"), names, store, BUDGET // 2, 1e-4)
        caption = "Subtracted from the logged gyro. Filters without a bias state are not drawn. " + said(ratio)
        figures.append(
            Figure(
                "bias",
                "bias",
                "Gyro bias that the filters found",
                caption,
                430,
                {"series": drawn},
                words=reach(by["bias"], "deg/s"),
            )
        )
    points = []
    for row in result.estimators:
        cost, error = find(row, "cost_ns", ALL), find(row, "inclination_rmse_deg", AIR)
        price = cost.value if cost is not None and cost.value is not None else row.ns_per_update
        if price is not None and number(price) and error is not None and error.value is not None and row.name in names:
            points.append({"r": names.index(row.name), "x": float(price), "y": float(error.value)})
    if points:
        caption = (
            "Left is cheap, down is close to the reference. "
            "Cost: nanoseconds per IMU sample on the machine that made this report."
        )
        words = "; ".join(f"{names[p['r']]} {p['x']:.0f} ns, {quantity(p['y'], 'deg')}" for p in points)
        figures.append(
            Figure("cost", "cost", "Cost against tilt error", caption, 330, {"points": points}, wide=False, words=words)
        )
    return figures
