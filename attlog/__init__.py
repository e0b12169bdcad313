"""attlog: which attitude filter is closest, quiet, late in a step, drifting in heading, on the log of a real flight."""

from __future__ import annotations

import typing as _typing

__version__ = "0.23.0"
__all__ = [
    "Aids",
    "Answer",
    "Attitude",
    "AttitudeComparison",
    "AttlogError",
    "Case",
    "Check",
    "Config",
    "Estimate",
    "EstimatorRow",
    "Event",
    "Finding",
    "FlightLog",
    "Measurements",
    "Reference",
    "Result",
    "UnitWarning",
    "UsageError",
    "analyze",
    "compare_attitude",
    "estimate",
    "evaluate",
    "place",
    "prepare",
    "read",
    "rotation",
]

if _typing.TYPE_CHECKING:
    from attlog import rotation
    from attlog.core.errors import AttlogError, UsageError
    from attlog.estimators import Aids, Estimate, Measurements, estimate, place
    from attlog.estimators.unit_checks import UnitWarning
    from attlog.flight import read
    from attlog.flight.model import Attitude, FlightLog
    from attlog.health.check import Check
    from attlog.health.findings import Finding
    from attlog.metrics.metric import Answer, Case
    from attlog.pipeline import analyze, evaluate, prepare
    from attlog.pipeline.attitude_comparison import AttitudeComparison, compare_attitude
    from attlog.pipeline.config import Config
    from attlog.reference.model import Reference
    from attlog.result import EstimatorRow, Result
    from attlog.story.flight_events import Event
else:
    # A type checker does not see this function: to it a name that is not listed is an error.
    _HOMES = {
        "Aids": "attlog.estimators",
        "Answer": "attlog.metrics.metric",
        "Attitude": "attlog.flight.model",
        "AttitudeComparison": "attlog.pipeline.attitude_comparison",
        "AttlogError": "attlog.core.errors",
        "Case": "attlog.metrics.metric",
        "Check": "attlog.health.check",
        "Config": "attlog.pipeline.config",
        "Estimate": "attlog.estimators",
        "EstimatorRow": "attlog.result",
        "Event": "attlog.story.flight_events",
        "Finding": "attlog.health.findings",
        "FlightLog": "attlog.flight.model",
        "Measurements": "attlog.estimators",
        "Reference": "attlog.reference.model",
        "Result": "attlog.result",
        "UnitWarning": "attlog.estimators.unit_checks",
        "UsageError": "attlog.core.errors",
        "analyze": "attlog.pipeline",
        "compare_attitude": "attlog.pipeline.attitude_comparison",
        "estimate": "attlog.estimators",
        "evaluate": "attlog.pipeline",
        "place": "attlog.estimators",
        "prepare": "attlog.pipeline",
        "read": "attlog.flight",
        "rotation": "",
    }

    def __getattr__(name: str) -> object:
        """Import a public name when it is first used: ``import attlog`` stays light."""
        if name not in _HOMES:
            from difflib import get_close_matches

            near = get_close_matches(name, __all__, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise AttributeError(f"module 'attlog' has no attribute {name!r}{hint}")
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name) if _HOMES[name] else import_module(f"attlog.{name}")


def __dir__() -> list[str]:
    """Return the public names for completion, also before their first use."""
    return [*__all__, "__version__"]
