"""Attitude filters on plain arrays: :func:`estimate` runs one, :func:`names` lists them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from attlog.estimators.aids import Aids, Measurements
    from attlog.estimators.api import DEFAULT, EstimatorSpec, add, estimate, items, parse, propagated, select
    from attlog.estimators.interface import Estimate, Estimator, LogFacts, LogInfo, Parameter
    from attlog.estimators.registry import get, is_recorded, names
    from attlog.estimators.run import not_compiled
    from attlog.estimators.samples import place

__all__ = [
    "DEFAULT",
    "Aids",
    "Estimate",
    "Estimator",
    "EstimatorSpec",
    "LogFacts",
    "LogInfo",
    "Measurements",
    "Parameter",
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

_HOMES = {
    "Aids": "attlog.estimators.aids",
    "DEFAULT": "attlog.estimators.api",
    "Estimate": "attlog.estimators.interface",
    "Estimator": "attlog.estimators.interface",
    "LogFacts": "attlog.estimators.interface",
    "LogInfo": "attlog.estimators.interface",
    "Measurements": "attlog.estimators.aids",
    "Parameter": "attlog.estimators.interface",
    "EstimatorSpec": "attlog.estimators.api",
    "add": "attlog.estimators.api",
    "estimate": "attlog.estimators.api",
    "get": "attlog.estimators.registry",
    "is_recorded": "attlog.estimators.registry",
    "items": "attlog.estimators.api",
    "names": "attlog.estimators.registry",
    "not_compiled": "attlog.estimators.run",
    "parse": "attlog.estimators.api",
    "place": "attlog.estimators.samples",
    "propagated": "attlog.estimators.api",
    "select": "attlog.estimators.api",
}


def __getattr__(name: str) -> Any:
    """Import a public name at its first use: reading a log's attitudes needs no filter."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """List the public names for completion, also before their first use."""
    return sorted({*globals(), *__all__})
