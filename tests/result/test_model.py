"""Why nothing ran: the reason of the first filter where every one of them failed."""

from __future__ import annotations

import pytest

from attlog.result import model
from tests.words.made import row


@pytest.mark.parametrize(
    ("states", "said"),
    [
        ((("replay", "failed"), ("replay", "failed")), "f0: why 0"),
        ((("onboard", "ok"), ("replay", "failed")), "f1: why 1"),
        ((("onboard", "failed"), ("replay", "ok")), ""),
        ((("replay", "failed"), ("replay", "diverged")), ""),
        ((("onboard", "failed"),), ""),
        ((), ""),
    ],
)
def test_nothing_ran_where_every_filter_failed(states: tuple[tuple[str, str], ...], said: str) -> None:
    rows = []
    for k, (kind, status) in enumerate(states):
        one = row(f"f{k}", {})
        one.kind, one.status, one.reason = kind, status, f"why {k}"
        rows.append(one)
    assert model.nothing_ran(rows) == said
