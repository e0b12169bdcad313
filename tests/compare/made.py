"""Results made by hand: one row with some answers."""

from __future__ import annotations

from typing import Any

from attlog.result import EstimatorRow, ParameterValue, Result
from tests.present.made import Metrics, row


def result(*rows: EstimatorRow, sha: str = "a", version: str = "1", **changes: Any) -> Result:
    """A result of a log with this hash."""
    log = {
        "name": "x.bin",
        "sha256": sha,
        "firmware": {"name": "F", "version": version},
        "params": {"P": 1.0, "Q": 2.0},
    }
    values = {"config": {"window": "all"}, "log": log | changes.pop("log", {})} | changes
    return Result({"version": version}, "", values["config"], values["log"], estimators=list(rows))


def filtered(metrics: Metrics, name: str = "mahony", kp: float = 0.6, **changes: Any) -> EstimatorRow:
    """A row of a filter with one gain."""
    return row(name, metrics, parameters={"kp": ParameterValue(kp, "default", "1/s")}, **changes)
