"""Rows measured one by one, so that memory does not grow with their number."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial

from attlog import metrics, reference
from attlog.analysis import replay
from attlog.base.errors import PluginError
from attlog.flight.model import part_of
from attlog.metrics.base import Case
from attlog.metrics.figures.trace import Trace
from attlog.metrics.ranking.duplicates import DuplicateSearch
from attlog.reference.model import AlignmentStep, Row
from attlog.result import Duplicates, EstimatorRow


class Measurement:
    """What is measured of each row, and what later steps need of it: then a replayed row gives up its samples.

    What turns out to be needed whole after all is run again.
    """

    def __init__(
        self,
        case: Case,
        chosen: Mapping[str, replay.Chosen],
        onboard: list[Row],
        unusable: str,
        *,
        traces: bool,
        only: Collection[str],
    ) -> None:
        """``unusable``: the sensor because of which no filter can be judged, empty where they can."""
        self.case = case.looked_at_with([])
        self._unusable, self._traces, self._only = unusable, traces, only
        expected = len(case.imus) * sum(not isinstance(spec, PluginError) for spec in chosen.values())
        self._drawing = metrics.Drawing(self.case, expected, onboard)
        self._drawn: list[Trace] = []

        def again(row: Row) -> Row:
            return replay.again(case, chosen, row.name)

        self._likeness = DuplicateSearch(again)
        imu, choice = case.log.replay_imu, str(case.settings.get("reference", "auto"))
        check = reference.ReferenceCheck
        self._check = None if imu is None else check(case.log, imu, case.reference, again, choice)

    def add(self, row: Row, line: EstimatorRow) -> None:
        """Fill in a row's line of the table; a replayed row is empty afterwards."""
        case, log = self.case, self.case.log
        row.aux = {}  # no metric looks at it, and in a long log it is as large as the attitude
        case.rows.append(row)
        if self._check is not None:
            part_of(log, "What filters say against the reference", partial(self._check.add, row), lambda: None)
        reference.withhold(row, self._unusable)
        line.status, line.reason = row.status, row.reason
        part_of(log, "Which rows are alike", partial(self._likeness.add, row), lambda: None)
        line.metrics = metrics.compute(case, row, case.windows, cost=False, only=self._only)
        if self._traces:
            self._drawn += part_of(log, "Figures", partial(self._drawing.of_row, row), list[Trace])
        case.done_with(row)

    def contradiction(self) -> tuple[str, AlignmentStep] | None:
        """Why the reference is refused after all, by filters that agree; None where it is not."""
        if self._check is None:
            return None
        what = "What filters say against the reference"
        return part_of(self.case.log, what, self._check.contradicted, lambda: None)

    def alike(self) -> list[Duplicates]:
        """Which rows are the same filter twice."""
        return part_of(self.case.log, "Which rows are alike", self._likeness.found, list)

    def drawn(self) -> list[Trace]:
        """The traces of all rows and of what is drawn beside them."""
        if not self._traces:
            return []
        log = self.case.log
        first = part_of(log, "Figures", partial(self._drawing.first, self.case.rows), list[Trace])
        return [*first, *self._drawn, *part_of(log, "Figures", self._drawing.last, list[Trace])]
