"""Attitude filters on plain arrays: :func:`estimate` runs one, :func:`names` lists them."""

from __future__ import annotations

from attlog.estimators.aids import Aids, Measured
from attlog.estimators.api import DEFAULT, Row, add, estimate, items, parse, select
from attlog.estimators.base import Estimate, Estimator, LogFacts, LogInfo, Parameter
from attlog.estimators.engine.loop import not_compiled
from attlog.estimators.engine.samples import place
from attlog.estimators.propagate import propagated
from attlog.estimators.recorded import is_recorded
from attlog.estimators.registry import get, names

__all__ = [
    "DEFAULT",
    "Aids",
    "Estimate",
    "Estimator",
    "LogFacts",
    "LogInfo",
    "Measured",
    "Parameter",
    "Row",
    "add",
    "estimate",
    "get",
    "is_recorded",
    "items",
    "names",
    "not_compiled",
    "parse",
    "place",
    "propagated",
    "select",
]
