"""What the filters believe about the gyro, and what they cost."""

from __future__ import annotations

from attlog.present.numbers import quantity
from attlog.present.rows import AIR, ALL, find
from attlog.report.figure import Figure, Rows, number, reach, said, series
from attlog.report.pack import BUDGET, Store
from attlog.result import Result, Trace


def more(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[Figure]:
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
                words=reach(by["bias"], names, "deg/s"),
            )
        )
    points: list[tuple[int, float, float]] = []
    for row in result.estimators:
        cost, error = find(row, "cost_ns", ALL), find(row, "inclination_rmse_deg", AIR)
        price = cost.value if cost is not None and cost.value is not None else row.ns_per_update
        if price is not None and number(price) and error is not None and error.value is not None and row.name in names:
            points.append((names.index(row.name), float(price), float(error.value)))
    if points:
        caption = (
            "Left is cheap, down is close to the reference. "
            "Cost: nanoseconds per IMU sample on the machine that made this report."
        )
        words = "; ".join(f"{names[r]} {x:.0f} ns, {quantity(y, 'deg')}" for r, x, y in points)
        data = {"points": [{"r": r, "x": x, "y": y} for r, x, y in points]}
        figures.append(Figure("cost", "cost", "Cost against tilt error", caption, 330, data, wide=False, words=words))
    return figures
