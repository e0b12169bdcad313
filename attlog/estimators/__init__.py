"""Attitude filters on plain arrays: :func:`estimate` runs one, :func:`names` lists them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from attlog.estimators.aids import Aids, Measurements
    from attlog.estimators.api import DEFAULT, EstimatorSpec, add, estimate, items, parse, select
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
    "Estimate": "attlog.estimators.base",
    "Estimator": "attlog.estimators.base",
    "LogFacts": "attlog.estimators.base",
    "LogInfo": "attlog.estimators.base",
    "Measurements": "attlog.estimators.aids",
    "Parameter": "attlog.estimators.base",
    "EstimatorSpec": "attlog.estimators.api",
    "add": "attlog.estimators.api",
    "estimate": "attlog.estimators.api",
    "get": "attlog.estimators.registry",
    "is_recorded": "attlog.estimators.recorded",
    "items": "attlog.estimators.api",
    "names": "attlog.estimators.registry",
    "not_compiled": "attlog.estimators.engine.loop",
    "parse": "attlog.estimators.api",
    "place": "attlog.estimators.engine.samples",
    "propagated": "attlog.estimators.propagate",
    "select": "attlog.estimators.api",
}


def __getattr__(name: str) -> Any:
    """The public names, imported when first used: who reads a log's attitudes needs no filter."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """What completion offers: the public names also before their first use."""
    return sorted({*globals(), *__all__})
