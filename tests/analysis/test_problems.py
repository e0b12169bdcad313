"""What an analysis says of filters that did not run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from attlog.analysis.problems import of_reference_and_filters
from attlog.base.errors import AttlogError, PluginError, PluginTimeout, UsageError
from attlog.result import EstimatorRow

SOUND: Any = SimpleNamespace(kind="onboard", gave_way=[], contradiction="", rejected=[])


@pytest.mark.parametrize(
    ("error", "code", "severity"),
    [
        (UsageError("gsf needs gnss, which was not given"), "estimator_failed", "note"),
        (PluginError("line 3: ZeroDivisionError"), "estimator_failed", "error"),
        (PluginTimeout("took longer than 60 s"), "estimator_timed_out", "error"),
        (None, "estimator_failed", "error"),
    ],
)
def test_a_log_that_is_not_enough_for_a_filter_is_no_trouble(
    error: AttlogError | None, code: str, severity: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("attlog.analysis.problems.contradiction", lambda ref: [])
    row = EstimatorRow("mine", "replay", "mine", "failed", str(error))
    found = of_reference_and_filters(SOUND, [row], {} if error is None else {"mine": error}, {}, [])
    assert [(p.code, p.severity) for p in found] == [(code, severity)]
