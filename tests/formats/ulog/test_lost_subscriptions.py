"""Records whose subscription is lost: three of one size with rising times can only be of one format."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.formats.ulog import reader


@pytest.mark.parametrize(
    ("lengths", "fitting", "found"),
    [
        ([40, 40, 40], ["a"], "a"),
        ([40, 40], ["a"], None),
        ([40, 40, 41], ["a"], None),
        ([40, 40, 40, 40], ["a", "b"], None),
        ([40, 40, 40], [], None),
    ],
)
def test_three_records_of_one_size_name_the_one_format_that_fits(
    monkeypatch: pytest.MonkeyPatch, lengths: list[int], fitting: list[str], found: str | None
) -> None:
    layouts = [(name, SimpleNamespace(time_at=k, name=name)) for k, name in enumerate(["c", *fitting, "d"])]
    asked: list[int] = []

    def without(length: int) -> Any:
        asked.append(length)
        return layouts

    monkeypatch.setattr(reader, "rise", lambda data, starts, layout: layout.name in fitting)
    log: Any = SimpleNamespace(data=b"", definitions=SimpleNamespace(without_subscription=without))
    told = reader._Reader._only_topic_for(log, np.array(lengths), 100 * np.arange(len(lengths)))
    assert (None if told is None else told[0]) == found
    if asked:
        assert asked == [40 - reader.HEADER]
