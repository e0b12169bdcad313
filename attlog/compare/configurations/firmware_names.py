"""Which parameter of an autopilot is a filter's own gain? Asked of the filter: what it makes of a log's parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from attlog.estimators import LogInfo
from attlog.estimators.base import Estimator

FACTORS = (0.9, 1.2)
"""Two values that differ from each other and from the default: what follows both is the parameter itself."""


class _Asked(Mapping[str, float]):
    """A log that holds every parameter that is asked for, and remembers their names."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values_, self.names = values, set[str]()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return self.values_.get(name, 1.0)

    def __iter__(self) -> Iterator[str]:
        return iter(self.values_)

    def __len__(self) -> int:
        return len(self.values_)


def firmware_names(estimator: Estimator) -> dict[str, str]:
    """Parameter of the filter -> parameter of the autopilot that it is, for those that are taken as they stand."""
    if estimator.from_log is None:
        return {}
    if estimator.process is not None:
        return estimator.process.call(firmware_names)
    sizes = {p.name: float(p.default) for p in estimator.own if not p.choices}
    try:
        probe = _Asked({})
        estimator.from_log(probe, LogInfo())
        found = {}
        for firmware in sorted(probe.names):
            for own, size in sizes.items():
                values = [size * f for f in FACTORS]
                values_there = [estimator.from_log(_Asked({firmware: v}), LogInfo()).get(own) for v in values]
                if size and values_there == values:
                    found[own] = firmware
        return found
    except Exception:  # a plug-in's function may want more than a log's parameters: then no name is known
        return {}
