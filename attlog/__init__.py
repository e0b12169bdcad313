"""attlog: which attitude filter is closest, quiet, late in a step, drifting in heading, on the log of a real flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.20.0"
__all__ = ["Aids", "AttlogError", "Config", "Result", "analyze", "estimate", "evaluate", "prepare", "read"]

if TYPE_CHECKING:
    from attlog.core.errors import AttlogError
    from attlog.estimators import Aids, estimate
    from attlog.flight import read
    from attlog.pipeline import analyze, evaluate, prepare
    from attlog.pipeline.config import Config
    from attlog.result import Result

_HOMES = {
    "Aids": "attlog.estimators",
    "AttlogError": "attlog.core.errors",
    "Config": "attlog.pipeline.config",
    "Result": "attlog.result",
    "analyze": "attlog.pipeline",
    "estimate": "attlog.estimators",
    "evaluate": "attlog.pipeline",
    "prepare": "attlog.pipeline",
    "read": "attlog.flight",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: ``import attlog`` stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'attlog' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """Return the public names for completion, also before their first use."""
    return sorted({*globals(), *__all__})
