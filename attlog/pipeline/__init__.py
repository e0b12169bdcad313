"""From a log to a result: configuration, preparation, evaluation.

Inspection and extraction run no filter. Functions are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from attlog.pipeline.evaluation import analyze, evaluate
    from attlog.pipeline.preparation import prepare

__all__ = ["analyze", "evaluate", "prepare"]


def __getattr__(name: str) -> Any:
    """Import a function of the pipeline."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from attlog.pipeline import evaluation, preparation

    return getattr(preparation if name == "prepare" else evaluation, name)


def __dir__() -> list[str]:
    """Return the names for completion."""
    return sorted({*globals(), *__all__})
