"""A configuration over a case: its samples prepared, its filter run, what comes out as a row of the comparison."""

from __future__ import annotations

from dataclasses import dataclass, replace

from attlog import estimators
from attlog.analysis import replay
from attlog.base.errors import UsageError
from attlog.compare.configurations.configuration import Configuration
from attlog.compare.configurations.input_changes import prepared
from attlog.compare.configurations.settings import SETTINGS
from attlog.flight.calibration.recorrection import units_with
from attlog.flight.model import Imu
from attlog.flight.parameters.file import read_file
from attlog.metrics.base import Case
from attlog.reference.model import Row
from attlog.result import EstimatorRow, ParameterValue


@dataclass(frozen=True, slots=True)
class ConfiguredFilter:
    """What :func:`attlog.analysis.evaluate` takes in place of a filter's name."""

    configuration: Configuration

    @property
    def name(self) -> str:
        """What the row is called."""
        return self.configuration.name

    @property
    def row(self) -> estimators.EstimatorSpec:
        """The filter that runs."""
        return self.configuration.row

    def __str__(self) -> str:
        return self.configuration.text

    def run(self, case: Case, imu: Imu, suffix: str) -> tuple[Row, EstimatorRow]:
        """The row, and its line of the table with what comes before the filter among its parameters.

        UsageError where the log cannot be prepared so; errors of the filter as they come.
        """
        c, log = self.configuration, case.log
        if replay.is_recorded(c.row):
            if c.before:
                raise UsageError(
                    f"{', '.join(c.before)}: nothing can come before an attitude that was computed elsewhere"
                )
            return replay.recorded_row(case, imu, c.row, c.name + suffix)
        mag = None if log.mag is None else log.mags[log.mag]
        settings = {name: value for name, value in c.before.items() if name != "params"}
        facts = replay.facts(case, suffix)
        if c.params is not None:
            given = read_file(c.params)
            facts = replace(facts, given={**facts.given, **given})
            imu, mag = units_with(log, c.params.name, given, imu, mag)
        if settings:  # else the log's own unit, for which metrics find what they need once
            imu, mag = prepared(settings, log, imu, mag)
        row, line = replay.replayed(case, imu, mag, c.row, facts, replay.aids_of(case, suffix), c.name + suffix)
        for name, value in c.before.items():
            shown = value if isinstance(value, str) else "/".join(f"{x:g}" for x in value)
            setting = SETTINGS[name]
            line.parameters[f"before.{name}"] = ParameterValue(shown, "option", setting.unit, setting.meaning)
        return row, line
