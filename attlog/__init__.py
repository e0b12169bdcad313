"""attlog: which attitude filter is quiet at rest, late in a step, drifting in heading, on the log of a real flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
__all__ = ["analyze", "estimate", "read"]

if TYPE_CHECKING:
    from attlog.analysis import analyze
    from attlog.estimators import estimate
    from attlog.flight import read

_HOMES = {"analyze": "attlog.analysis", "estimate": "attlog.estimators", "read": "attlog.flight"}


def __getattr__(name: str) -> Any:
    """The public functions, imported when first used: ``import attlog`` stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'attlog' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
