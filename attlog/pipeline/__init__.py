"""From a log to a result: the pipeline, what it is told to do, and what it can say without filters.

The functions come when they are first asked for: ``attlog info`` uses other files of this room and needs no filter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from attlog.pipeline.evaluation import analyze, evaluate, prepare

__all__ = ["analyze", "evaluate", "prepare"]


def __getattr__(name: str) -> Any:
    """The pipeline's functions."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from attlog.pipeline import evaluation

    return getattr(evaluation, name)


def __dir__() -> list[str]:
    """What completion offers."""
    return sorted({*globals(), *__all__})
