"""Parameters of an onboard filter that its re-run takes, by firmware version."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

from attlog.core.errors import UsageError
from attlog.estimators.interface import LogInfo, Parameter

Version = tuple[int, int]
LAST: Version = (99, 99)


class FirmwareParameter(NamedTuple):
    """A parameter by its short name, of versions ``first`` to ``last``; ``start``: acts only on a cold start."""

    name: str
    unit: str
    default: float
    low: float
    high: float
    meaning: str
    first: Version
    last: Version = LAST
    start: bool = False


class ParameterTable(NamedTuple):
    """Parameters by short names, which a firmware's full names extend by ``prefix``.

    ``aliases``: full names of other versions to short ones. ``not_offered``: beginnings of full names, with the reason.
    ``outside``: short names without the prefix. ``first``: version of rows that name none.
    """

    prefix: str
    source: str
    rows: Mapping[str, FirmwareParameter]
    aliases: Mapping[str, str]
    not_offered: Mapping[str, str]
    outside: Collection[str] = ()

    @staticmethod
    def rows_of(rows: Iterable[tuple[Any, ...]], first: Version) -> dict[str, FirmwareParameter]:
        """Return rows by name; those that name no version exist from ``first`` on."""
        return {row[0]: FirmwareParameter(*row, *(first,) * (len(row) == 6)) for row in rows}

    def full(self, short: str) -> str:
        """Return the firmware's name of a parameter."""
        return short if short in self.outside else self.prefix + short

    def short(self, full: str) -> str:
        """Return the short name of a parameter."""
        return full.removeprefix(self.prefix)

    @property
    def declared(self) -> tuple[Parameter, ...]:
        """The parameters as settings of an estimator."""
        return tuple(
            Parameter(self.full(p.name), float(p.default), p.unit, float(p.low), float(p.high), p.meaning, self.source)
            for p in self.rows.values()
        )

    @property
    def renamed(self) -> dict[str, str]:
        """Full names of other versions, to full names."""
        return {name: self.full(short) for name, short in self.aliases.items()}

    @property
    def at_start(self) -> frozenset[str]:
        """Short names of parameters that act on a cold start alone."""
        return frozenset(name for name, p in self.rows.items() if p.start)

    def logged(self, params: Mapping[str, float]) -> dict[str, float]:
        """Return the values in a log's parameters, by short name."""
        found = {short: float(params[name]) for name, short in self.aliases.items() if name in params}
        return found | {name: float(params[self.full(name)]) for name in self.rows if self.full(name) in params}

    def flown(self, params: Mapping[str, float], _: LogInfo) -> dict[str, float]:
        """Return the values that the vehicle flew with by full name, where they lie in the documented range."""
        found = self.logged(params).items()
        return {self.full(name): v for name, v in found if self.rows[name].low <= v <= self.rows[name].high}

    def check(self, changes: Collection[str], version: Version) -> None:
        """UsageError for a parameter (short name) that this version of the firmware does not have."""
        for name in changes:
            p = self.rows[name]
            if not p.first <= version <= p.last:
                first, last, here = (".".join(map(str, v)) for v in (p.first, p.last, version))
                span = f"from {first} on" if p.last == LAST else f"from {first} to {last}"
                raise UsageError(f"{self.full(name)} exists {span}; this log is of version {here}.")
