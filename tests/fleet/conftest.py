"""Browser fixtures, shared with the tests of the report."""

from __future__ import annotations

from tests.report.conftest import browser, visit

__all__ = ["browser", "visit"]
