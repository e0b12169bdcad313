"""Attitude filters on plain arrays: :func:`estimate` runs one, :func:`names` lists them."""

from __future__ import annotations

from attlog.estimators.api import DEFAULT, Row, estimate, items, parse, select
from attlog.estimators.base import Estimate, Estimator, Parameter
from attlog.estimators.engine.samples import place
from attlog.estimators.registry import get, names

__all__ = [
    "DEFAULT",
    "Estimate",
    "Estimator",
    "Parameter",
    "Row",
    "estimate",
    "get",
    "items",
    "names",
    "parse",
    "place",
    "select",
]
