"""Every registered estimator keeps the contract; adding one adds no code here."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from attlog.estimators import names
from attlog.testing import checks

SLOW = {"keeps_its_norm", "uses_every_parameter"}
"""A few seconds each in filters with many parameters or a large state."""

CASES = [
    pytest.param(check, id=f"{name}-{title}", marks=[pytest.mark.slow] if title in SLOW else [])
    for name in names()
    for title, check in checks(name)
]


@pytest.mark.parametrize("check", CASES)
def test_every_estimator_passes_every_check(check: Callable[[], None]) -> None:
    check()
